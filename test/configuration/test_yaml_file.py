"""Tests of the reader of YAML and JSON: types of scalars and rejected input."""

import json
import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import ProgramError
from programs_read import refusal
from thoroughness import examples


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('2e4', 2e4),
        ('1e-1', 0.1),
        ('1e-05', 1e-5),
        ('-2E+3', -2e3),
        ('1.', 1.0),
        ('.5', 0.5),
        ('+3', 3),
        ('1_000', 1000),
        ('0x10', 16),
        ('.inf', math.inf),
        ('-.inf', -math.inf),
        ('010', '010'),  # 8 or 10: who can tell
        ('1:30', '1:30'),
        ('"2e4"', '2e4'),
        ('e4', 'e4'),
        ('1e', '1e'),
        ('-a', '-a'),
        ('yes', True),
        ('off', False),
        ('', None),
        ('~', None),
        ('2026-01-01', '2026-01-01'),
        ('!!str 5', '5'),
    ],
)
def test_scalars_have_their_apparent_type(text, value):
    found = yaml_file.parse(f'a: {text}', 'it', ProgramError)['a']
    assert type(found) is type(value)
    assert found == value


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('a: !!float 5', 'tags are not allowed'),
        ('a: !!set {b}', 'tags are not allowed'),
        ('{[1]: 2}', 'a key must not be a list or a mapping'),
        ('a: 1\n---\nb: 2', 'line 2, column 1: it is not valid YAML: a second document begins'),
        ('[' * 51 + ']' * 51, 'more than 50 deep'),
        ('a: ' + '9' * 5000, 'is not valid YAML'),
    ],
)
def test_yaml_features_outside_programs_are_rejected(text, reason):
    assert reason in refusal(yaml_file.parse, text, 'it', ProgramError)


BROKEN = [
    (b'a: 1\n b: 2\n', '2:3', 'mapping values are not allowed'),
    (b'a:\n  - 1\n  - @x', '3:5', 'found character'),
    (b'moves:\n  - {l: 1, l: 2}', '2:12', "the key 'l' occurs twice"),
    (b'a: 1\nb: *c', '2:4', 'aliases are not allowed'),
    (b'# \xc3\xa4\nb: \xff', '2:4', 'the byte 0xff is not UTF-8'),
    ('ä: \x07'.encode(), '1:4', 'the character U+0007 is not allowed'),
    ('a: 1'.encode('utf-16'), '1:1', 'the encoding is UTF-16, but must be UTF-8'),
    (b'a: [' + b'9' * 5000, '1:5', 'Exceeds the limit'),
]
LOADERS = [yaml.SafeLoader, yaml_file.LOADER]


@pytest.mark.parametrize('loader', LOADERS, ids=['python', 'fast'])
@pytest.mark.parametrize(('content', 'place', 'reason'), BROKEN, ids=[place for _, place, _ in BROKEN])
def test_broken_yaml_names_file_line_and_column(content, place, reason, loader, tmp_path, monkeypatch):
    monkeypatch.setattr(yaml_file, 'LOADER', loader)
    path = tmp_path / 'file.yaml'
    path.write_bytes(content)
    sentence = refusal(yaml_file.read, path, 'cell file', ProgramError)
    assert sentence.startswith(f'{path}:{place}: cell file is not valid YAML: ')
    assert reason in sentence


@pytest.mark.parametrize('loader', LOADERS, ids=['python', 'fast'])
def test_the_column_of_a_broken_text_counts_characters(loader, monkeypatch):
    monkeypatch.setattr(yaml_file, 'LOADER', loader)
    sentence = refusal(yaml_file.parse, 'ü: ü\näöü: *b', 'the fault', ProgramError)
    assert sentence == 'line 2, column 6: the fault is not valid YAML: aliases are not allowed'


JSON_TEXTS = st.text(
    st.characters(exclude_categories=('Cc', 'Cs', 'Cn', 'Zl', 'Zp'), exclude_characters='\ufeff')
)
JSON_DOCUMENTS = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(10**20), 10**20),
        st.floats(allow_nan=False, allow_infinity=False),
        JSON_TEXTS,
    ),
    lambda children: st.one_of(
        st.lists(children, max_size=4),
        st.dictionaries(JSON_TEXTS.filter(lambda key: key != '<<' and len(key) < 50), children, max_size=4),
    ),
    max_leaves=15,
)


@settings(max_examples=examples(200))
@given(JSON_DOCUMENTS)
def test_every_json_document_is_read_with_its_types(document):
    text = json.dumps(document, ensure_ascii=False)
    read = yaml_file.parse(text, 'it', ProgramError)
    assert (
        json.dumps(read, ensure_ascii=False) == text
    )  # numbers to the last digit, and whole ones as whole ones

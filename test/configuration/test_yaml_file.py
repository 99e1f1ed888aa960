"""Facts about the reader of YAML and JSON: what a scalar is, and what is refused."""

import json
import math

import pytest
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
def test_scalars_are_what_they_look_like(text, value):
    found = yaml_file.parse(f'a: {text}', 'it', ProgramError)['a']
    assert type(found) is type(value)
    assert found == value


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('a: !!float 5', 'tags are not allowed'),
        ('a: !!set {b}', 'tags are not allowed'),
        ('{[1]: 2}', 'a key must not be a list or a mapping'),
        ('a: 1\n---\nb: 2', 'a second document begins at line 2'),
        ('[' * 51 + ']' * 51, 'more than 50 deep'),
        ('a: ' + '9' * 5000, 'is not valid YAML'),
    ],
)
def test_what_yaml_has_and_programs_do_not_need_is_refused(text, reason):
    assert reason in refusal(yaml_file.parse, text, 'it', ProgramError)


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
def test_every_json_document_is_read_as_what_it_is(document):
    text = json.dumps(document, ensure_ascii=False)
    read = yaml_file.parse(text, 'it', ProgramError)
    assert (
        json.dumps(read, ensure_ascii=False) == text
    )  # numbers to the last digit, and whole ones as whole ones

"""Tests of the folder of a study: provenance in every file, and a page of all files."""

import base64
import json
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from delta3_pacdrive.errors import FigureError, ReportError
from delta3_pacdrive.studies.framework.figure_style import empty_figure
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder, Table

ORIGIN = Provenance('delta3 tune <a> & "b"', 7, 'abc (delta3.yaml)', ('experiment1 123',), 'numpy 2')


def drawing():
    """A curve over time, <commanded> & actual.

    This is not part of the caption.
    """
    figure = empty_figure(2.0)
    figure.suptitle(r'Current $I_{\mathrm{eff}}$')
    return figure


@pytest.fixture
def left(tmp_path):
    """Return a folder with a figure and two tables, and its summary."""
    folder = ReportFolder(tmp_path / 'new' / 'out', ORIGIN)
    folder.table(Table('short.csv', ['name', 'value [1]'], [['a', None], ['b', float('nan')], ['c <', 0.0]]))
    folder.table(Table.of_columns('long.csv', {'time [s]': np.arange(100.0), 'x [m]': np.full(100, 0.5)}))
    folder.figures({'curve 1.png': drawing})
    document = folder.summary('A study', {'ok': True, 'value': 1.5}, ['first < line', 'second line'])
    return tmp_path / 'new' / 'out', document


class Page(HTMLParser):
    """Reads links, images and text of a page, and checks that opened tags are closed."""

    def __init__(self, text):
        super().__init__()
        self.links, self.texts, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.links += [value for name, value in attributes if name in ('href', 'src')]
        if tag not in ('meta', 'img'):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture
def page(left):
    return Page((left[0] / 'index.html').read_text(encoding='utf-8'))


def test_page_embeds_every_file(left, page):
    assert page.open == []
    held = {base64.b64decode(link.partition('base64,')[2]) for link in page.links}
    names = {path.name for path in left[0].iterdir()} - {'index.html'}
    assert held == {(left[0] / name).read_bytes() for name in names}
    assert all(link.startswith('data:') for link in page.links)


def test_a_file_that_is_too_large_for_the_page_is_a_link_by_its_name_alone(tmp_path):
    folder = ReportFolder(tmp_path, ORIGIN)
    large = tmp_path / 'a large one.csv'
    large.write_bytes(b'0' * 600_000)
    folder.add(large)
    folder.page('A study')
    text = (tmp_path / 'index.html').read_text(encoding='utf-8')
    assert Page(text).links == ['a%20large%20one.csv']
    assert '(0.6 MB, in the same folder)' in text


def test_page_shows_command_text_captions_and_provenance(page):
    text = ' '.join(page.texts)
    for told in (ORIGIN.command, 'first < line\nsecond line', 'Current I_eff.', *ORIGIN.lines().values()):
        assert told in text
    assert 'A curve over time, <commanded> & actual.' in text
    assert 'not part of the caption' not in text


def test_the_page_shows_short_tables_whole_and_the_begin_of_long_ones(page):
    text = ' '.join(page.texts)
    assert '3 rows' in text
    assert 'c <' in text
    assert 'the first 12 of 100 rows' in text
    assert '11' in page.texts
    assert '12' not in page.texts


def test_summary_names_all_files_including_itself_with_the_page_first(left):
    folder, document = left
    assert json.loads((folder / 'report.json').read_text()) == document
    names = [path.rpartition('/')[2] for path in document['files']]
    assert names == ['report.json', 'index.html', 'short.csv', 'long.csv', 'curve 1.png']
    assert set(names) == {path.name for path in folder.iterdir()}


def test_missing_value_is_an_empty_cell_and_every_file_names_its_origin(left):
    folder, _ = left
    *origin, header, first, second, third = (folder / 'short.csv').read_text().splitlines()
    assert origin == [f'# {name}: {text}' for name, text in ORIGIN.lines().items()]
    assert [header, first, second, third] == ['name,value [1]', 'a,', 'b,', 'c <,0.0']
    assert ORIGIN.command.encode() in (folder / 'curve 1.png').read_bytes()
    assert unescape((folder / 'index.html').read_text()).count(ORIGIN.command) == 1


def test_clearing_removes_only_complete_files(left):
    folder, _ = left
    (folder / 'mine.txt').write_text('mine')
    ReportFolder(folder, ORIGIN).clear(['*.png', 'short.csv'])
    assert {path.name for path in folder.iterdir()} == {'long.csv', 'mine.txt'}


def test_unwritable_folder_is_rejected_with_one_message(tmp_path):
    (tmp_path / 'file').write_text('')
    folder = ReportFolder(tmp_path / 'file', ORIGIN)
    with pytest.raises(ReportError, match=r'^cannot write to .*file: File exists$'):
        folder.make()
    with pytest.raises(ReportError, match=r'^cannot write to .*file: File exists$'):
        folder.page('A study')
    with pytest.raises(FigureError, match=r'^cannot write figures to .*file: File exists$'):
        folder.figures({'curve.png': drawing})

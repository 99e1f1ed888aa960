"""Tests of text tables of other programs: correct numbers or one clear message."""

import itertools

import numpy as np
import pytest

from cases import for_each
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.tables import column_file, table_csv

NAMES = ['time', 'current_1', 'current_2', 'current_3']
ROWS = [[0.0, 1.5, -2.25, 3.0], [0.25, 1e-3, 4.0, -1234.5], [0.5, 0.0, 7.125, 8.0]]
COLUMNS = """
columns:
- {column: Zeit, signal: time, unit: ms}
- {column: Größe 1, signal: current, axis: 1, unit: mA, factor: -2.0, offset: 5.0}
- {column: Größe 2, signal: current, axis: 2, unit: A, offset: 0.5}
- {column: 4, signal: current, axis: 3, unit: A}
"""


def lines(separator=',', decimal='.', units='header', end='\n', quoted=False, trailing=False):
    """Return the table of ``ROWS`` as text."""
    quote = '"' if quoted else ''
    headings = (
        [f'{name} [{"s" if name == "time" else "A"}]' for name in NAMES] if units == 'header' else NAMES
    )
    rows = [headings]
    if units == 'row':
        rows.append(['s', 'A', 'A', 'A'])
    rows += [[repr(value).replace('.', decimal) for value in row] for row in ROWS]
    tail = separator if trailing else ''
    return ''.join(separator.join(f'{quote}{cell}{quote}' for cell in row) + tail + end for row in rows)


def load(path, content, columns=None, gaps=True):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return trace_file.load(path, columns, gaps)


def chosen(tmp_path, text=COLUMNS):
    (tmp_path / 'columns.yaml').write_text(text, encoding='utf-8')
    return column_file.read(tmp_path / 'columns.yaml')


@for_each(
    ('separator', 'decimal', 'units', 'end'),
    [
        form
        for form in itertools.product(',;\t|', '.,', ('header', 'row'), ('\n', '\r\n', '\r'))
        if form[0] != form[1]
    ],
)
@for_each('encoding', ['utf-8', 'utf-8-sig', 'utf-16', 'cp1252'])
def test_every_form_gives_the_same_numbers(separator, decimal, units, end, encoding, tmp_path):
    for quoted, trailing in itertools.product((False, True), repeat=2):
        text = lines(separator, decimal, units, end, quoted, trailing)
        trace = load(tmp_path / 'a.csv', text.encode(encoding))
        assert np.column_stack([trace.time_s, trace['current']]).tolist() == ROWS


@pytest.mark.parametrize('cell', ['', ' ', 'nan', 'NaN', 'NULL', 'n/a', '-', '#N/A'])
@pytest.mark.parametrize('place', [1, 2, 3])
def test_a_cell_without_a_number_is_a_gap(cell, place, tmp_path):
    row = ['0.25', '1', '2', '3']
    row[place] = cell
    text = lines().replace('0.25,0.001,4.0,-1234.5', ','.join(row))
    trace = load(tmp_path / 'a.csv', text)
    assert np.flatnonzero(np.isnan(trace['current']).any(axis=0)).tolist() == [place - 1]
    assert np.flatnonzero(np.isnan(trace['current']).any(axis=1)).tolist() == [1]
    assert trace.meta['notices'] == ['Some of 3 rows have gaps: current in 1']
    with pytest.raises(TraceError, match=r'not finite: current, row 2$'):
        load(tmp_path / 'a.csv', text, gaps=False)


def test_table_without_gaps_reports_no_gaps(tmp_path):
    assert 'notices' not in load(tmp_path / 'a.csv', lines()).meta


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        (lines(';') + '0,75;1;2;3\n', 'numbers with commas and points'),
        (lines(';').replace('-1234.5', '-1.234,5'), 'numbers with commas and points'),
        (lines().replace('7.125', '7,125'), r'line 4 of .* has 5 values, the header 4 columns$'),
        (lines().replace('7.125', 'abc'), r"line 4 of .* contains 'abc', not only numbers$"),
        (lines().replace('7.125', '7_125'), r"line 4 of .* contains '7_125', not only numbers$"),
        (lines().replace('7.125', 'inf'), r'not finite: current, row 3$'),
        (lines().replace('0.5,', '0.25,'), r'do not increase: row 2 is at 0.25 s, row 3 at 0.25 s, and 1 of 3 rows'),
        (lines().replace('0.5,', '-1,'), r'do not increase: row 2 is at 0.25 s, row 3 at -1 s'),
        (lines().replace('0.25,', ','), r'not finite: the time, row 2$'),
        (lines().partition('\n')[2], 'begins with numbers, expected headings'),
        (lines().replace(' [A]', ''), r"column 'current_1' must have a unit, one of \[A\], \[mA\]$"),
        (lines().replace('current_2', 'curent_2'), 'did you mean current_2'),
        (lines().replace('current_2', 'current_1'), 'twice'),
        (b'\x00\x01\x02\x03', 'is not text'),
        (b'PK\x03\x04' + bytes(range(256)), 'is not text'),
        ('x' * (2 << 20), 'a line has more than'),
        (lines().encode('utf-16')[:-1], 'cannot read trace'),
        ('', 'is empty: it has no headings and no numbers$'),
        ('\n\n', 'is empty'),
        ('# exported by a logger\n', 'is empty'),
    ],
)  # fmt: skip
def test_unknown_table_is_rejected_with_one_message(content, sentence, tmp_path):
    with pytest.raises(TraceError, match=sentence) as caught:
        load(tmp_path / 'a.csv', content)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('piece', [1, 7, 64, 1000])
def test_pieces_of_any_size_make_the_same_table(piece, tmp_path, monkeypatch):
    monkeypatch.setattr(table_csv, 'PIECE', piece)
    trace = load(tmp_path / 'a.csv', '# a comment\n\n' + lines(';', ',', 'row', '\r\n'))
    assert np.column_stack([trace.time_s, trace['current']]).tolist() == ROWS
    with pytest.raises(TraceError, match=r"line 8 of .* contains 'x', not only numbers$"):
        load(tmp_path / 'a.csv', '# a comment\n\n' + lines(';', ',', 'row') + 'x;1;2;3\n')


def test_a_million_rows_are_read_in_pieces_and_are_right(tmp_path):
    count = 1_000_000
    with (tmp_path / 'a.csv').open('w') as file:
        file.write('time [ms];tcp_error_norm [mm]\n')
        file.writelines(f'{n};{n % 1000},5\n' for n in range(count))
    trace = trace_file.load(tmp_path / 'a.csv')
    assert len(trace.time_s) == count
    np.testing.assert_allclose(
        trace['tcp_error_norm'][:, 0], 1e-3 * (np.arange(count) % 1000 + 0.5), rtol=1e-15
    )


def test_names_of_the_thesis_are_read(tmp_path):
    headings = ['time [s]', 'Norm of TCP error [mm]']
    headings += [f'Actual Arm Angle position {n} [°]' for n in (1, 2, 3)]
    headings += [f'Reference Arm Angle acceleration {n} [deg/s²]' for n in (1, 2, 3)]
    headings += [f'Current I_eff into the motors {n} [A]' for n in (1, 2, 3)]
    headings += [f'Actual TCP position {n} [mm]' for n in 'xyz']
    row = ';'.join(str(n) for n in range(len(headings)))
    trace = load(tmp_path / 'a.csv', f'{";".join(headings)}\n{row}\n')
    assert trace['tcp_error_norm'].tolist() == [[1e-3]]
    assert trace['arm_position'][0] == pytest.approx(np.radians([2, 3, 4]))
    assert trace['arm_acceleration_reference'][0] == pytest.approx(np.radians([5, 6, 7]))
    assert trace['current'].tolist() == [[8.0, 9.0, 10.0]]
    assert trace['tcp_actual'][0] == pytest.approx([0.011, 0.012, 0.013])


# forms of other tools -------------------------------------------------------------------------------------------------

TIMES = {
    's': ('time [s]', lambda t: f'{t:.3f}'),
    'ms': ('time [ms]', lambda t: f'{1e3 * t:.0f}'),
    'ns': ('time [ns]', lambda t: f'{round(1e9 * t)}'),
    'epoch': ('time [ns]', lambda t: f'{1_795_800_000_123_456_789 + round(1e9 * t)}'),
    'iso': ('time', lambda t: f'2026-03-29 01:59:{57 + t:06.3f}'),
    'zone': ('Timestamp', lambda t: f'2026-03-29T01:59:{57 + t:06.3f}+02:00'),
}
FORMS = list(
    itertools.product(
        ',;\t|',
        '.,',
        TIMES,
        ('utf-8', 'utf-8-sig', 'utf-16', 'utf-16-le', 'utf-16-be', 'cp1252'),
        ('\n', '\r\n', '\r'),
    )
)


@for_each('seed', range(60))
def test_a_table_in_the_form_of_any_tool_keeps_its_numbers(seed, tmp_path):
    rng = np.random.default_rng(seed)
    separator, decimal, time, encoding, end = FORMS[rng.integers(len(FORMS))]
    time_s = 0.002 * np.arange(1, 2 + rng.integers(2, 40)) + (0.25 if time not in ('iso', 'zone') else 0.0)
    values = np.round(rng.normal(0.0, 3.0, (len(time_s), 3)), 6)
    quoted = separator == decimal or rng.random() < 0.3
    heading, stamp = TIMES[time]
    headings = [heading, 'current_1 [A]', 'current_2 [A]', 'current_3 [A]']
    index = rng.random() < 0.3
    preamble = [f'Größe: Messung {seed}', 'Datum;2026-11-20 10:11:12', ''] if rng.random() < 0.3 else []

    def line(cells):
        cells = [f'"{cell}"' if quoted else cell for cell in cells]
        return separator.join(cells)

    body = [line(['', *headings] if index else headings)]
    for n, row in enumerate(values):
        cells = [stamp(time_s[n]) if time in ('iso', 'zone') else stamp(time_s[n]).replace('.', decimal)]
        cells += [repr(float(value)).replace('.', decimal) for value in row]
        body.append(line([str(n), *cells] if index else cells))
    trace = load(tmp_path / 'a.csv', ''.join(text + end for text in preamble + body).encode(encoding))
    assert trace['current'].tolist() == values.tolist()
    np.testing.assert_allclose(trace.time_s - trace.time_s[0], time_s - time_s[0], rtol=0.0, atol=1e-9)
    if time in ('s', 'ms', 'ns'):
        np.testing.assert_allclose(trace.time_s, time_s, rtol=0.0, atol=1e-9)
    told = ' '.join(trace.meta.get('notices', ()))
    assert ('Times count from' in told) is (time in ('epoch', 'iso', 'zone'))
    assert (f'headings are in line {len(preamble) + 1}' in told) is bool(preamble)
    assert ('Columns without a heading are left out: 1' in told) is index


@pytest.mark.parametrize('heading', ['"remark; free"', '|e|', '"a\tb; c|d"'])
def test_a_separator_in_a_heading_does_not_part_the_table(heading, tmp_path):
    text = lines().replace('\n', ',1\n').replace('[A],1\n', f'[A],{heading}\n', 1)
    assert text.startswith('time [s],current_1 [A]')
    with pytest.raises(TraceError, match='has an unknown column') as caught:
        load(tmp_path / 'a.csv', text)
    assert heading.strip('"')[:1] in str(caught.value)
    trace = load(tmp_path / 'a.csv', text, chosen(tmp_path, NAMED))
    assert np.column_stack([trace.time_s, trace['current']]).tolist() == ROWS


NAMED = 'columns:\n- {column: time, signal: time, unit: s}\n' + ''.join(
    f'- {{column: current_{n}, signal: current, axis: {n}, unit: A}}\n' for n in '123'
)


def test_an_index_column_whose_heading_is_missing_is_left_out(tmp_path):
    first, *rows = lines().splitlines()
    text = '\n'.join([first, *(f'{n},{row}' for n, row in enumerate(rows))]) + '\n'
    trace = load(tmp_path / 'a.csv', text)
    assert np.column_stack([trace.time_s, trace['current']]).tolist() == ROWS
    assert trace.meta['notices'] == ['Columns without a heading are left out: 1']


COUNTED = 'time [ms],current_1 [A],current_2 [A],current_3 [A]'  # its times look like an index
UNIT_ROW = 'time,current_1,current_2,current_3\nms,A,A,A'


@pytest.mark.parametrize('separator', [',', ';', '\t'])
@pytest.mark.parametrize(
    ('head', 'end'), [(COUNTED, ''), (UNIT_ROW, ''), (UNIT_ROW, ','), (COUNTED + ',', '')]
)
def test_a_separator_at_the_end_of_every_row_moves_no_column(head, end, separator, tmp_path):
    body = ''.join(f'{n},{n}.5,{n + 10},{n + 20},\n' for n in range(5))
    trace = load(tmp_path / 'a.csv', f'{head}{end}\n{body}'.replace(',', separator))
    assert trace.time_s.tolist() == [n * 1e-3 for n in range(5)]
    assert trace['current'].tolist() == [[n + 0.5, n + 10, n + 20] for n in range(5)]
    assert 'notices' not in trace.meta


@pytest.mark.parametrize('first', [0, 1, 1000])
@pytest.mark.parametrize('head', [COUNTED, UNIT_ROW])
def test_unnamed_first_column_is_an_index_if_rows_have_one_more_cell(head, first, tmp_path):
    body = ''.join(f'{first + 3 * n},{n},{n}.5,{n + 10},{"" if n else 20}\n' for n in range(5))
    trace = load(tmp_path / 'a.csv', f'{head}\n{body}', gaps=True)
    assert trace.time_s.tolist() == [n * 1e-3 for n in range(5)]
    assert trace['current'][:, 0].tolist() == [n + 0.5 for n in range(5)]
    assert trace.meta['notices'][0] == 'Columns without a heading are left out: 1'


@pytest.mark.parametrize(
    ('rows', 'sentence'),
    [
        (['0,0,1,2,3', '0,1,1,2,3'], 'line 2 of .* has 5 values, the header 4 columns'),  # counts nothing
        (['1.5,0,1,2,3', '2.5,1,1,2,3'], 'line 2 of .* has 5 values'),
        (['0,0,1,2,3', '1,1,1,2'], 'line 2 of .* has 5 values'),
        (['0,1,2,3,', '1,1,2,3'], 'line 2 of .* has 5 values'),
        (
            [f'{n},{n},1,2,3' for n in range(500)] + ['7,500,1,2,3'],
            'row 501 of .* first value without a heading',
        ),
        (
            [f'{n},1,2,3,' for n in range(500)] + ['500,1,2,3,4'],
            'row 501 of .* a value after the last column',
        ),
    ],
)
def test_rows_that_are_longer_for_another_reason_are_rejected_with_their_place(rows, sentence, tmp_path):
    text = '\n'.join([COUNTED, *rows]) + '\n'
    with pytest.raises(TraceError, match=sentence):
        load(tmp_path / 'a.csv', text)


def test_nanoseconds_of_an_epoch_keep_every_digit(tmp_path):
    begin = 1_795_800_000_000_000_001
    text = 'time [ns],tcp_error_norm [mm]\n' + ''.join(f'{begin + 3 * n},{n}\n' for n in range(5))
    trace = load(tmp_path / 'a.csv', text)
    assert trace.time_s == pytest.approx([3e-9 * n for n in range(5)], rel=1e-12)
    assert trace.meta['notices'] == [f'Times count from {begin}']


def test_dates_over_the_end_of_a_day_and_in_a_time_zone(tmp_path):
    times = ['2026-12-31T23:59:59,75Z', '2027-01-01T01:00:00,25+01:00', '2027-01-01T00:00:00,5Z']
    text = 'time;tcp_error_norm [mm]\n' + ''.join(f'{time};{n}\n' for n, time in enumerate(times))
    assert load(tmp_path / 'a.csv', text).time_s.tolist() == [0.0, 0.5, 0.75]
    with pytest.raises(
        TraceError, match=r"line 3 of .* contains '2027-02-30T01:00:00,25Z', expected a time like"
    ):
        load(tmp_path / 'a.csv', text.replace('01-01T01:00:00,25+01:00', '02-30T01:00:00,25Z'))


def test_windows_1252_text_gives_a_notice(tmp_path):
    text = '# Größe\n' + lines()
    notice = 'Its text is not UTF-8; it is read as Windows-1252 (cp1252)'
    assert load(tmp_path / 'a.csv', text.encode('cp1252')).meta['notices'] == [notice]
    late = lines() + ''.join(f'{1 + n},1,2,3\n' for n in range(20_000)) + '# Größe\n'
    assert load(tmp_path / 'b.csv', late.encode('cp1252')).meta['notices'] == [notice]
    assert 'notices' not in load(tmp_path / 'c.csv', text.encode()).meta


# column files ---------------------------------------------------------------------------------------------------------


def test_column_file_defines_columns_and_their_units(tmp_path):
    text = 'Zeit;Größe 1;Größe 2;x;Bemerkung\n0;10;1;3;\n5;20;2;4;\n'
    trace = load(tmp_path / 'a.csv', text.encode('cp1252'), chosen(tmp_path))
    assert trace.time_s.tolist() == [0.0, 0.005]
    assert trace['current'].tolist() == [[-0.015, 1.5, 3.0], [-0.035, 2.5, 4.0]]


def test_a_file_without_headings_is_read_by_the_numbers_of_its_columns(tmp_path):
    text = 'headings: false\nskip_lines: 2\nseparator: "|"\ndecimal: ","\ncolumns:\n'
    text += '- {column: 2, signal: time, unit: s}\n- {column: 1, signal: tcp_error_norm, unit: mm}\n'
    trace = load(tmp_path / 'a.csv', 'logger 7\nsome text; more\n1,5|0\n2,5|0,5\n', chosen(tmp_path, text))
    assert trace.time_s.tolist() == [0.0, 0.5]
    assert trace['tcp_error_norm'].tolist() == [[1.5e-3], [2.5e-3]]


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        (
            ('column: Zeit', 'column: Zeet'),
            r"no column 'Zeet', its columns are 'Zeit', .*: did you mean Zeit",
        ),
        (('column: 4', 'column: 9'), 'no column 9, it has 4 columns'),
        (('unit: ms', 'unit: mm'), r"columns\[0\].unit is 'mm', but must be one of \[s\], \[ms\], \[us\]"),
        (('axis: 3', 'axis: 2'), 'two columns are current, axis 2'),
        (
            ('columns:', 'skip_lines: x\ncolumns:\n- {column: 4, signal: time, unit: s}'),
            'two columns are time, axis 1; .*skip_lines is',
        ),
        (('column: 4', 'column: 3'), 'column 3 of .* to two axes of current'),
        (('column: 4', 'column: Größe 2'), "column 'Größe 2' of .* to two axes of current"),
        (('axis: 3, ', ''), r'columns\[3\]: missing key axis, one of 1, 2, 3'),
        (('factor: -2.0', 'factor: 0'), 'factor is 0'),
        (('factor: -2.0', 'factor: .inf'), 'must be finite'),
        (('signal: time', 'signal: tme'), 'did you mean time'),
        (('signal: time, ', 'signal: time, axis: 1, '), 'time has no axes'),
        (('columns:', 'encoding: klingon\ncolumns:'), 'is not an encoding'),
        (('columns:', 'headings: false\ncolumns:'), 'without headings columns are identified by number'),
        (
            ('- {column: 4, signal: current, axis: 3, unit: A}\n', ''),
            r'not all three of a signal \(current\)',
        ),
        (('columns:', 'decimal: ","\ncolumns:'), r'contains numbers with .*, its column file has'),
    ],
)
def test_invalid_column_file_is_rejected_with_one_message(change, sentence, tmp_path):
    table = 'Zeit;Größe 1;Größe 2;x\n0;1.5;1;3\n5;20;2;4\n'.encode()
    with pytest.raises(TraceError, match=sentence) as caught:
        load(tmp_path / 'a.csv', table, chosen(tmp_path, COLUMNS.replace(*change)))
    assert '\n' not in str(caught.value)


def test_a_column_file_does_not_contradict_the_headings(tmp_path):
    with pytest.raises(TraceError, match=r'the unit of column .* is ms in .*, but s in .*$'):
        load(tmp_path / 'a.csv', 'Zeit [s];Größe 1;Größe 2;x\n0;1;1;3\n'.encode(), chosen(tmp_path))


def test_a_column_file_is_for_tables_only(tmp_path):
    (tmp_path / 'a.npz').write_bytes(b'')
    with pytest.raises(TraceError, match='is not a table: the column file'):
        trace_file.load(tmp_path / 'a.npz', chosen(tmp_path))

"""Facts about the command line of the page: what it refuses before it serves anything."""

import socket

import pytest

from delta3_pacdrive.cli.main import main

pytest.importorskip('viser', reason='the page needs the extra "view"')


def refused(capsys, *arguments):
    """Run the command; return the sentence that it is refused with."""
    assert main(['view', *arguments]) == 1
    output = capsys.readouterr()
    assert output.out == ''
    (line,) = output.err.splitlines()
    return line


def test_a_recording_that_is_not_there_or_not_to_be_read_is_refused(capsys, tmp_path):
    assert 'nothing.npz' in refused(capsys, str(tmp_path / 'nothing.npz'))
    broken = tmp_path / 'broken.npz'
    broken.write_bytes(b'no trace')
    assert 'broken.npz is not a trace file' in refused(capsys, str(broken))
    (tmp_path / 'empty').mkdir()
    assert 'cannot read recording' in refused(capsys, str(tmp_path / 'empty'))


def test_a_column_file_is_read_for_a_table(capsys, tmp_path):
    table, columns = tmp_path / 'log.csv', tmp_path / 'columns.yaml'
    table.write_text('t,a\n' + ''.join(f'{n},1\n' for n in range(9)))
    assert 'unknown column' in refused(capsys, str(table))
    columns.write_text('columns: [{column: t, signal: time, unit: s}]\n')
    assert 'cannot be shown without motor_position' in refused(capsys, str(table), '--columns', str(columns))


def test_a_port_that_is_taken_is_refused(capsys):
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        port = other.getsockname()[1]
        sentence = refused(capsys, 'experiment1', '--port', str(port))
    assert sentence == f"error: cannot serve the page on port {port} of '127.0.0.1': Address already in use"


def test_a_page_needs_viser(capsys, monkeypatch):
    from importlib import util

    find = util.find_spec
    monkeypatch.setattr(util, 'find_spec', lambda name, *more: None if name == 'viser' else find(name, *more))
    assert (
        refused(capsys) == "error: the page needs viser: pip install '.[view]' in the folder of the sources"
    )


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--port', '0'], '--port is 0, but must be between 1 and 65535'),
        (['--port', '70000'], '--port is 70000, but must be between 1 and 65535'),
        (
            ['experiment1', '--columns', 'a.yaml'],
            '--columns is for a table of measurements, experiment1 is none',
        ),
        (
            ['--columns', 'a.yaml'],
            '--columns is for a table of measurements: a robot that is up has no columns',
        ),
        (['experiment1', '--control'], '--control is for a robot that is up'),
        (['experiment1', '--namespace', 'cell2'], '--namespace is for a robot that is up'),
        (
            ['--parameters', 'rich'],
            '--parameters is for a program or a recording: a robot that is up tells its own',
        ),
    ],
)
def test_options_that_do_not_fit_are_a_usage_error(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as ending:
        main(['view', *arguments])
    assert ending.value.code == 2
    assert sentence in capsys.readouterr().err


def test_a_robot_takes_a_port_only_for_its_page(capsys):
    with pytest.raises(SystemExit):
        main(['up', '--view-port', '0'])
    assert '--view-port is 0, but must be between 1 and 65535' in capsys.readouterr().err

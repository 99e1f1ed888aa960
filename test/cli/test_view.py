"""Tests of the command line of the page: effects of options and rejections before serving."""

import os
import queue
import socket
import webbrowser

import numpy as np
import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.view import serving

pytest.importorskip('viser', reason='the page needs the extra "view"')


def refused(capsys, *arguments):
    """Run the command; return the message of its rejection."""
    assert main(['view', *arguments]) == 1
    output = capsys.readouterr()
    assert output.out == ''
    (line,) = output.err.splitlines()
    return line


def test_a_recording_that_is_not_there_or_not_to_be_read_is_rejected(capsys, tmp_path):
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


def test_a_port_that_is_taken_is_rejected(capsys):
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
            '--columns requires a table of measurements, but experiment1 is not one',
        ),
        (
            ['--columns', 'a.yaml'],
            '--columns requires a table of measurements',
        ),
        (['experiment1', '--control'], '--control applies to a running robot only'),
        (['experiment1', '--namespace', 'cell2'], '--namespace applies to a running robot only'),
        (
            ['--parameters', 'rich'],
            '--parameters requires a program or a recording: a running robot publishes its parameters',
        ),
    ],
)
def test_options_that_do_not_fit_are_a_usage_error(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as ending:
        main(['view', *arguments])
    assert ending.value.code == 2
    assert sentence in capsys.readouterr().err


def test_robot_opens_a_port_only_for_its_page(capsys):
    with pytest.raises(SystemExit):
        main(['up', '--view-port', '0'])
    assert '--view-port is 0, but must be between 1 and 65535' in capsys.readouterr().err


# what options do

SOON_S = 10.0


@pytest.fixture
def own_ports(monkeypatch):
    """Keep away from the ports of pages that other tests serve meanwhile."""
    monkeypatch.setattr(serving, 'PORT', 18742)


@pytest.fixture
def shown(tmp_path, monkeypatch, capsys, own_ports):
    """Return the function that shows a short recording, and returns the requests to the page during it."""
    from delta3_pacdrive.view import playback

    cycles, found = 5, []
    meta = {'cycle_time_s': 1e-3, 'gear_ratio': 32.0}
    Trace(np.arange(cycles) * 1e-3, {'motor_position': np.zeros((cycles, 3))}, meta).save(tmp_path / 'a.npz')

    def show(*options, look=lambda _: None):
        monkeypatch.setattr(playback, 'run', lambda page, _: found.append((page.url, look(page))))
        assert main(['view', str(tmp_path / 'a.npz'), *options]) == 0
        url, seen = found.pop()
        assert f'the page is at {url} ; Ctrl-C ends' in capsys.readouterr().err
        return url, seen

    return show


def test_page_is_served_at_the_requested_address_only(shown):
    with socket.socket() as other:
        other.bind(('', 0))
        port = other.getsockname()[1]  # that nobody has at any address

    def answering(_):
        found = []
        for host in ('127.0.0.1', '127.0.0.2'):
            with socket.socket() as visitor:
                if visitor.connect_ex((host, port)) == 0:
                    found.append(host)
        return found

    assert shown('--port', str(port), look=answering) == (f'http://127.0.0.1:{port}', ['127.0.0.1'])
    elsewhere = shown('--port', str(port), '--host', '127.0.0.2', look=answering)
    assert elsewhere == (f'http://127.0.0.2:{port}', ['127.0.0.2'])


def test_page_starts_dark_on_request_and_light_by_default(shown, monkeypatch):
    import viser

    plain, themes = viser.GuiApi.configure_theme, queue.Queue()

    def configure(gui, **look):
        themes.put(look.get('dark_mode', False))
        plain(gui, **look)

    monkeypatch.setattr(viser.GuiApi, 'configure_theme', configure)

    def until_now(page):
        page.show_cell(())  # applies the theme again
        return [themes.get() for _ in range(themes.qsize())]

    def until_dark(_):
        return next(filter(None, iter(lambda: themes.get(timeout=SOON_S), None)))

    assert not any(shown(look=until_now)[1])
    assert shown('--dark', look=until_dark)[1]


def test_page_is_opened_in_the_desktop_browser_only_on_request(shown, monkeypatch, tmp_path, capsys):
    opened = []

    class Browser:
        @staticmethod
        def open(url):
            opened.append(url)

    monkeypatch.setattr(webbrowser, 'get', Browser)
    shown()
    assert opened == []
    url, _ = shown('--open')
    assert opened == [url]

    def no_browser():
        raise webbrowser.Error

    monkeypatch.setattr(webbrowser, 'get', no_browser)
    assert main(['view', str(tmp_path / 'a.npz'), '--open']) == 1
    assert f'no browser available to open {url}' in capsys.readouterr().err


def test_waiting_for_a_robot_is_unlimited_on_request_only(monkeypatch, capsys, own_ports):
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    from delta3_pacdrive.ros.clients import live_view

    waits = []
    monkeypatch.setattr(os, 'nice', lambda _: 0)  # the tests go on
    monkeypatch.setattr(live_view, 'run', lambda *asked: waits.append(asked[2:]))
    assert main(['view']) == 0
    assert main(['view', '--wait', '--namespace', 'cell2']) == 0
    assert waits == [('/', live_view.APPEAR_S), ('/cell2', float('inf'))]

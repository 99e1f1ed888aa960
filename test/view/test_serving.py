"""Tests of the address of the page."""

import os
import socket
import subprocess
import sys
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.view import serving
from delta3_pacdrive.view.page import Page

WAIT_S = 30.0

viser = pytest.importorskip('viser', reason='the page needs the extra "view"')
CLIENT = {'subprotocols': [f'viser-v{viser.__version__}'], 'open_timeout': WAIT_S}


@pytest.fixture(autouse=True)
def own_ports(monkeypatch):
    """Keep away from the ports of pages that other tests serve meanwhile."""
    monkeypatch.setattr(serving, 'PORT', 18642)


@pytest.fixture
def taken():
    with socket.socket() as other:
        other.bind((serving.HOST, 0))
        other.listen()
        yield other.getsockname()[1]


def chosen(host, port=None):
    with serving.held(host, port) as place:
        return place.port


def test_occupied_port_is_rejected_with_one_message(taken):
    with pytest.raises(
        RunError, match=f'^cannot serve the page on port {taken} of .*: Address already in use$'
    ):
        chosen(serving.HOST, taken)


def test_unrequested_port_is_a_free_one():
    first = chosen(serving.HOST)
    assert serving.PORT <= first < serving.PORT + serving.PORTS
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # others may have had it a moment ago
        other.bind((serving.HOST, first))
        other.listen()
        assert chosen(serving.HOST) != first


def test_a_port_is_held_until_its_page_is_served():
    look = (
        f'from delta3_pacdrive.view import serving; serving.PORT = {serving.PORT};'
        f'print(serving.held({serving.HOST!r}, None).__enter__().port)'
    )
    with serving.held(serving.HOST, None) as place:
        first = place.port
        other = subprocess.run([sys.executable, '-c', look], capture_output=True, text=True, check=True)
        assert first < int(other.stdout) < serving.PORT + serving.PORTS
    assert chosen(serving.HOST) == first


def test_requested_port_is_reserved_as_well():
    with serving.held(serving.HOST, None) as place:
        port = place.port
    with serving.held(serving.HOST, port), pytest.raises(RunError, match='Address already in use'):
        chosen(serving.HOST, port)
    assert chosen(serving.HOST, port) == port


def test_browser_that_connects_before_the_page_waits_for_it(robot):
    from websockets.sync.client import connect

    with serving.held(serving.HOST, None) as place, ThreadPoolExecutor(2) as other:
        client = other.submit(urllib.request.urlopen, f'{place.url}/', timeout=WAIT_S)
        early = other.submit(connect, place.url.replace('http', 'ws'), **CLIENT)
        with pytest.raises(TimeoutError):
            early.result(0.5)
        assert not client.done()
        page = Page(robot, place, 'a robot of the tests')
        try:
            with early.result(WAIT_S):
                pass
            with client.result(WAIT_S) as answer:
                assert answer.status == 200
            with connect(place.url.replace('http', 'ws'), **CLIENT):  # and whoever comes later
                pass
        finally:
            page.close()


def test_a_process_finds_the_listener_that_it_was_handed(monkeypatch):
    with serving.held(serving.HOST, None) as place:
        monkeypatch.setenv(serving.LISTENING, str(os.dup(place.inheritable())))
        with serving.held(serving.HOST, place.port) as handed:
            assert handed.port == place.port
        assert serving.LISTENING not in os.environ


def test_exhausted_ports_are_reported_with_one_message():
    with ExitStack() as stack:
        for _ in range(serving.PORTS):
            stack.enter_context(serving.held(serving.HOST, None))
        last = serving.PORT + serving.PORTS - 1
        with pytest.raises(
            RunError, match=f'^cannot serve the page on port {last} of .*: Address already in use$'
        ):
            chosen(serving.HOST)


def test_an_address_that_is_not_ours_is_rejected():
    with pytest.raises(RunError, match='cannot serve the page'):
        chosen('192.0.2.1', 8000)
    with pytest.raises(RunError, match='cannot serve the page'):
        chosen('192.0.2.1')
    with pytest.raises(RunError, match='cannot serve the page'):
        chosen('no.such.host.invalid', 8000)


@pytest.mark.parametrize(
    ('host', 'here'),
    [
        ('127.0.0.1', True),
        ('localhost', True),
        ('::1', True),
        ('0.0.0.0', False),
        ('10.0.0.1', False),
        ('127.evil.test', False),
    ],
)
def test_only_the_loopback_is_this_machine(host, here):
    assert serving.is_here(host) is here


def test_browser_gets_an_address_that_it_can_reach():
    assert serving.address('127.0.0.1', 80) == 'http://127.0.0.1:80'
    assert serving.address('0.0.0.0', 81) == 'http://localhost:81'
    assert serving.address('::1', 82) == 'http://[::1]:82'


@pytest.mark.parametrize(
    ('origin', 'asked', 'host', 'foreign'),
    [
        (None, 'localhost:8642', '127.0.0.1', False),
        (None, 'evil.test:8642', '127.0.0.1', True),
        (None, '10.0.0.7:8642', '127.0.0.1', True),
        (None, '10.0.0.7:8642', '0.0.0.0', False),
        (None, '', '127.0.0.1', True),
        ('http://127.0.0.1:8642', '127.0.0.1:8642', '127.0.0.1', False),
        ('http://localhost:9000', 'localhost:9000', '127.0.0.1', False),  # through a tunnel
        ('http://cell.plant.test:8642', 'cell.plant.test:8642', '0.0.0.0', False),  # its own name
        ('http://CELL.plant.test:8642', 'CELL.plant.test:8642', '0.0.0.0', False),
        ('http://10.0.0.7:8642', '10.0.0.7:8642', '0.0.0.0', False),
        ('http://[fe80::7]:8642', '[fe80::7]:8642', '::', False),
        ('http://evil.test:8642', 'evil.test:8642', '0.0.0.0', True),  # its name leads to this machine
        ('http://cell.plant.test.evil.test:8642', 'cell.plant.test.evil.test:8642', '0.0.0.0', True),
        ('http://10.0.0.7.evil.test:8642', '10.0.0.7.evil.test:8642', '0.0.0.0', True),
        ('http://10.0.0.7:8642', '10.0.0.7:8642', '127.0.0.1', True),
        ('http://:8642', ':8642', '0.0.0.0', True),
        ('http://[', '[', '0.0.0.0', True),
        ('http://[', 'localhost:8642', '127.0.0.1', True),
        ('http://evil.test', '127.0.0.1:8642', '127.0.0.1', True),
        ('http://127.0.0.1:8000', '127.0.0.1:8642', '127.0.0.1', True),
        ('null', '127.0.0.1:8642', '127.0.0.1', True),
        ('http://evil.test:8642', 'evil.test:8642', '127.0.0.1', True),  # its name leads to this machine
        ('http://127.evil.test:8642', '127.evil.test:8642', '127.0.0.1', True),
    ],
)
def test_pages_of_other_servers_are_rejected(origin, asked, host, foreign):
    names = frozenset({'localhost', 'cell.plant.test'})
    assert serving.is_cross_origin(origin, asked, host, names) is foreign


def test_reachable_machine_is_addressed_by_its_own_names():
    assert serving.own_names('127.0.0.1') == {'localhost'}
    names = serving.own_names('0.0.0.0')
    assert {'localhost', socket.gethostname().lower()} <= names
    assert 'cell.plant.test' in serving.own_names('Cell.Plant.test')


def test_a_page_of_others_cannot_connect(robot):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with serving.held(serving.HOST, None) as place:
        page = Page(robot, place, 'a robot of the tests')
    try:
        there = page.url.replace('http', 'ws')
        with connect(there, origin=page.url, **CLIENT):
            pass
        with pytest.raises(InvalidStatus, match='403'):
            connect(there, origin='http://evil.test', **CLIENT)
        renamed = there.replace('127.0.0.1', 'evil.test')
        with (
            socket.create_connection(('127.0.0.1', int(page.url.rpartition(':')[2]))) as way,
            pytest.raises(InvalidStatus, match='403'),
        ):
            connect(renamed, sock=way, origin=renamed.replace('ws', 'http'), **CLIENT)
    finally:
        page.close()


def test_client_that_leaves_without_a_request_is_not_reported(robot, caplog):
    with serving.held(serving.HOST, None) as place:
        page = Page(robot, place, 'a robot of the tests')
    try:
        for said in (b'', b'GET / HT', b'\x16\x03\x01\r\n\r\n'):
            with socket.create_connection((serving.HOST, place.port), timeout=WAIT_S) as visitor:
                visitor.sendall(said)
                visitor.shutdown(socket.SHUT_WR)
                while visitor.recv(4096):  # until it is closed on the other side, too
                    pass
    finally:
        page.close()
    assert [record.getMessage() for record in caplog.records if record.levelname == 'ERROR'] == []

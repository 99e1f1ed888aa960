"""Tests of the guard of the page: connections that are accepted, and messages that reach a control."""

import importlib
import math
import socket
import struct
import time
from contextlib import ExitStack, closing, suppress
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('viser', reason='the page needs the extra "view"')

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.view import browser_messages, page_guard, serving
from delta3_pacdrive.view.browser_messages import PART_BYTES, RejectedError
from thoroughness import examples

WAIT_S = 30.0
UPLOAD_BYTES = PART_BYTES + 1000
PROTOCOL = f'viser-v{viser.__version__}'
CAMERA = {
    'wxyz': (1.0, 0.0, 0.0, 0.0), 'position': (1.0, -1.5, 0.0), 'fov': 0.8, 'near': 0.01, 'far': 1000.0,
    'image_height': 800, 'image_width': 1280, 'look_at': (0.0, 0.0, -0.5), 'up_direction': (0.0, 0.0, 1.0),
}  # fmt: skip


class Site:
    """A server with one control of each kind, and a record of the received messages."""

    def __init__(self):
        self.reached, self.refused = [], []
        listener = socket.create_server((serving.HOST, 0))
        self.guard = page_guard.Guard(serving.HOST, UPLOAD_BYTES, self.refused.append)
        self.server = self.guard.serve('a page of the tests', listener)
        self.port = listener.getsockname()[1]
        gui = self.server.gui
        self.controls = {
            'stop': gui.add_button('stop'),
            'motion': gui.add_button_group('motion', ('Start', 'Hold')),
            'speed': gui.add_slider('speed', 1, 250, 1, 50),
            'time': gui.add_slider('time', 0.0, 1.2345, 1e-3, 0.0),
            'lasts': gui.add_number('lasts', 0.5, min=0.0, max=10.0),
            'level': gui.add_number('level', 0.0),
            'force': gui.add_checkbox('force', False),
            'program': gui.add_dropdown('program', ('a', 'b')),
            'name': gui.add_text('name', 'p1'),
            'place': gui.add_vector3('place', (0.0, 0.0, 0.0)),
        }
        for name, handle in self.controls.items():
            listen = handle.on_click if name in ('stop', 'motion') else handle.on_update
            listen(lambda event: self.reached.append((event.target.label, event.target.value)))
        self.file = gui.add_upload_button('file')
        self.file.on_upload(lambda event: self.reached.append(('file', event.target.value.content)))
        self.guard.begin()

    def wait_for(self, condition, what):
        deadline = time.monotonic() + WAIT_S
        while not condition():
            assert time.monotonic() < deadline, what
            time.sleep(0.002)


class Browser:
    """A client that sends arbitrary messages."""

    def __init__(self, site, **options):
        self.site = site
        options = {'subprotocols': [PROTOCOL], 'open_timeout': WAIT_S, 'max_size': None} | options
        self.socket = connect(f'ws://{serving.HOST}:{site.port}', compression=None, **options)
        self.send('ViewerCameraMessage', **CAMERA)  # it counts as connected from here on
        self.uuids = {}
        while 'file' not in self.uuids:
            raw = self.socket.recv(timeout=WAIT_S)
            size, packed = struct.unpack('<QQ', raw[:16])
            told = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=size)
            for message in msgspec.msgpack.decode(told)['messages']:
                if 'label' in message.get('props', {}):
                    self.uuids[message['props']['label']] = message['uuid']

    def send(self, kind, **fields):
        self.socket.send(msgspec.msgpack.encode({'type': kind, **fields}))

    def update(self, label, **updates):
        self.send('GuiUpdateMessage', uuid=self.uuids[label], updates=updates)

    def start(self, size, parts, transfer='t1', label='file'):
        self.send(
            'FileTransferStartUpload', source_component_uuid=self.uuids[label], transfer_uuid=transfer,
            filename='x.yaml', mime_type='', part_count=parts, size_bytes=size,
        )  # fmt: skip

    def part(self, index, content, transfer='t1'):
        self.send(
            'FileTransferPart', source_component_uuid=self.uuids['file'], transfer_uuid=transfer,
            part_index=index, content=content,
        )  # fmt: skip

    def settle(self):
        """Wait until the page has taken all that was sent before."""
        before = self.site.reached.count(('stop', True))
        self.update('stop', value=True)
        self.site.wait_for(
            lambda: self.site.reached.count(('stop', True)) > before, 'a click reaches the page'
        )

    def close_code(self):
        """Return the code with which the page closes the connection."""
        try:
            while True:
                self.socket.recv(timeout=WAIT_S)
        except ConnectionClosed as closed:
            return closed.rcvd and closed.rcvd.code

    def close(self):
        self.socket.close()


@pytest.fixture(scope='module')
def site():
    with pytest.MonkeyPatch.context() as patch:
        for name in ('CONNECTS_BURST', 'UPLOADS_BURST'):
            patch.setattr(page_guard, name, 1e6)
        made = Site()
    try:
        yield made
    finally:
        made.server.stop()


@pytest.fixture
def browser(site):
    site.reached.clear()
    with closing(Browser(site)) as made:
        yield made


@pytest.mark.parametrize(
    ('label', 'value', 'taken'),
    [
        ('speed', 1, 1),
        ('speed', 250, 250),
        ('speed', 251, 250),  # the client rounds to steps
        ('speed', 0, 1),
        ('time', 1.235, 1.2345),
        ('lasts', 10, 10.0),
        ('lasts', 0, 0.0),
        ('level', -1e9, -1e9),
        ('program', 'b', 'b'),
        ('motion', 'Hold', 'Hold'),
        ('force', True, True),
        ('name', 'p2', 'p2'),
    ],
)
def test_a_value_within_the_limits_of_its_control_is_taken(label, value, taken, browser, site):
    browser.update(label, value=value)
    browser.settle()
    assert site.controls[label].value == taken


@pytest.mark.parametrize(
    ('label', 'value'),
    [
        ('speed', 252), ('speed', 4000), ('speed', -1), ('speed', 50.5), ('speed', math.nan), ('speed', math.inf),
        ('speed', True), ('speed', '100'), ('speed', 2**63), ('time', 1.236), ('time', -0.002),
        ('lasts', math.nextafter(10.0, 11.0)), ('lasts', -5e-324), ('level', -math.inf), ('level', 'x'),
        ('program', 'c'), ('program', ''), ('program', 0), ('motion', 'Abort'), ('force', 1), ('force', 'on'),
        ('stop', False), ('stop', 1), ('name', 5), ('place', 1.0), ('file', 'x'),
    ],
)  # fmt: skip
def test_invalid_value_is_ignored_and_the_browser_stays_connected(label, value, browser, site):
    before = {name: handle.value for name, handle in site.controls.items()}
    browser.update(label, value=value)
    browser.settle()
    assert {name: handle.value for name, handle in site.controls.items()} == before
    assert {label for label, _ in site.reached} == {'stop'}
    assert [what for what, _ in site.reached] == ['stop']


MALFORMED = {
    'callbacks': {'updates': {'update_cb': []}},
    'removed': {'updates': {'removed': True}},
    'properties': {'updates': {'props': {}}},
    'value and callbacks': {'updates': {'value': True, 'update_cb': []}},
    'nothing': {'updates': {}},
    'a list': {'updates': {'value': [0.0, 0.0, 1.0]}},
    'a long text': {'updates': {'value': 'x' * (browser_messages.TEXT_MAX + 1)}},
    'a long number': {'uuid': 'x' * 65, 'updates': {'value': True}},
    'more': {'updates': {'value': True}, 'excluded_self_client': 0},
    'a tunnel': {'type': 'ShareUrlRequest'},
    'no tunnel': {'type': 'ShareUrlDisconnect'},
    'a command': {'type': 'CommandTriggerMessage', 'uuid': 'x'},
    'a form': {'type': 'GuiFormDirtyMessage', 'uuid': 'x'},
    'a script': {'type': 'RunJavascriptMessage', 'source': 'x'},
    'a camera that looks nowhere': {'type': 'ViewerCameraMessage', 'fov': 'x'},
    'no type': {'type': None},
}


@pytest.mark.parametrize('name', MALFORMED)
def test_malformed_message_closes_its_connection_and_changes_nothing(name, site, caplog):
    with closing(Browser(site)) as attacker:
        fields = MALFORMED[name]
        own = {} if 'type' in fields else {'uuid': attacker.uuids['stop']}
        attacker.send(**({'kind': 'GuiUpdateMessage'} | own | fields if 'type' not in fields else
                         {'kind': fields['type'], **{k: v for k, v in fields.items() if k != 'type'}}))  # fmt: skip
        assert attacker.close_code() == 1008
    lines = [record.getMessage() for record in caplog.records if record.levelname != 'DEBUG']
    assert len(lines) <= 1
    assert all('\n' not in line and len(line) < 200 for line in lines)
    with closing(Browser(site)) as other:
        other.settle()


@pytest.mark.parametrize(
    'raw',
    [
        'text',
        b'',
        b'\xc1',
        b'\x91' * 10_000,
        b'\x80',
        b'\x81\xa4type\xc0',
        b'x' * 20_000,
        b'\xdf\xff\xff\xff\xff',
    ],
)
def test_bytes_that_are_not_a_message_close_their_connection(raw, site):
    with closing(Browser(site)) as attacker:
        attacker.socket.send(raw)
        assert attacker.close_code() == 1008


@given(st.binary(max_size=200) | st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(
        ['type', 'uuid', 'updates', 'value', 'update_cb', 'frequency', 'content']), inner, max_size=5), max_leaves=9,
).map(msgspec.msgpack.encode))  # fmt: skip
@settings(max_examples=examples(120), deadline=None)
def test_random_bytes_are_a_message_of_the_list_or_rejected(raw):
    reasons = []
    try:
        kind = type(browser_messages.decoded(raw)).__name__
    except RejectedError as error:
        reasons.append(error)
    else:
        assert kind in ('Camera', 'Update', 'Hold', 'Start', 'Part')
    assert all(reason.fatal and len(str(reason)) < 120 for reason in reasons)


def test_held_button_is_received(site):
    beats = []
    button = site.server.gui.add_button('held')
    button.on_hold(lambda _: beats.append(1), callback_hz=20.0)
    with closing(Browser(site)) as browser:
        browser.send('GuiButtonHoldMessage', uuid=browser.uuids['held'], frequency=20.0)
        site.wait_for(lambda: beats, 'a held button is heard')
    button.remove()


# files ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('size', [0, 1, PART_BYTES, PART_BYTES + 1, UPLOAD_BYTES])
def test_a_file_up_to_the_limit_arrives(size, browser, site):
    content = bytes(range(256)) * (size // 256 + 1)
    content = content[:size]
    pieces = [content[at : at + PART_BYTES] for at in range(0, size, PART_BYTES)]
    browser.start(size, len(pieces), f'whole{size}')
    for index, piece in enumerate(pieces):
        browser.part(index, piece, f'whole{size}')
    site.wait_for(lambda: ('file', content) in site.reached, 'the file arrives')


def test_a_file_beyond_the_limit_is_rejected_before_it_is_sent(site):
    site.refused.clear()
    with closing(Browser(site)) as attacker:
        attacker.start(UPLOAD_BYTES + 1, 2, 'large')
        attacker.settle()
        assert site.refused == [f'x.yaml has {UPLOAD_BYTES + 1} bytes, the limit is {UPLOAD_BYTES}']
        attacker.part(0, b'x' * PART_BYTES, 'large')
        assert attacker.close_code() == 1008


@pytest.mark.parametrize('label', ['speed', 'stop', 'name'])
def test_control_without_file_input_receives_no_file(label, site):
    with closing(Browser(site)) as attacker:
        attacker.start(10, 1, f'for {label}', label)
        attacker.settle()
        attacker.part(0, b'x' * PART_BYTES, f'for {label}')
        assert attacker.close_code() == 1008


@pytest.mark.filterwarnings('ignore:.*Dropping upload')
def test_parts_that_were_not_announced_are_not_kept(site):
    site.reached.clear()
    with closing(Browser(site)) as browser:
        for size, parts in ((10, 2), (10, 0), (PART_BYTES + 1, 1)):
            browser.start(size, parts, 'wrong')
        browser.part(0, b'x', 'wrong')
        browser.start(10, 1, 'one')
        browser.start(10, 1, 'two')
        browser.part(0, b'x' * 10, 'two')
        browser.part(1, b'x', 'one')
        browser.part(0, b'123456789', 'one')  # a byte is missing: viser drops it
        browser.settle()
        browser.start(10, 1, 'three')
        browser.part(0, b'1234567890', 'three')
        site.wait_for(lambda: ('file', b'1234567890') in site.reached, 'the announced file arrives')
        browser.start(10, 1, 'four')
        browser.part(0, b'12345678901', 'four')
        assert browser.close_code() == 1008
    assert [value for label, value in site.reached if label == 'file'] == [b'1234567890']


# floods ---------------------------------------------------------------------------------------------------------------


def test_a_bucket_lets_a_burst_through_and_then_its_rate():
    clock = [0.0]
    bucket = page_guard.Bucket(10.0, 3.0, lambda: clock[0])
    assert [bucket.take() for _ in range(4)] == [True, True, True, False]
    clock[0] = 0.0999
    assert not bucket.take()
    clock[0] = 0.2
    assert bucket.take()
    clock[0] = 100.0
    assert [bucket.delay_s() for _ in range(5)] == pytest.approx([0.0, 0.0, 0.0, 0.1, 0.2])


def test_a_message_that_is_larger_than_any_of_a_browser_is_not_read(site):
    with closing(Browser(site)) as attacker:
        with suppress(ConnectionClosed):
            attacker.socket.send(b'x' * (PART_BYTES + page_guard.MESSAGE_BYTES + 1))
        assert attacker.close_code() in (1009, None)


@pytest.mark.parametrize('opcode', [Opcode.PING, Opcode.PONG, Opcode.CONT])
def test_endless_control_frames_and_fragments_end_their_connection(opcode, site):
    with closing(Browser(site)) as attacker, suppress(OSError):
        if opcode is Opcode.CONT:
            attacker.socket.socket.sendall(Frame(Opcode.BINARY, b'', fin=False).serialize(mask=True))
        for _ in range(10_000):
            frame = Frame(opcode, b'', fin=opcode is not Opcode.CONT)
            attacker.socket.socket.sendall(frame.serialize(mask=True))
        assert attacker.close_code() is None


def test_more_browsers_than_the_page_serves_are_turned_away_until_one_leaves(site, monkeypatch):
    monkeypatch.setattr(page_guard, 'CLIENTS_MAX', 3)
    with ExitStack() as stack:
        crowd = [stack.enter_context(closing(Browser(site))) for _ in range(3)]
        with pytest.raises(InvalidStatus, match='503'):
            Browser(site)
        crowd[0].close()
        stack.enter_context(closing(Browser(site)))


def test_idle_connections_are_closed_for_a_browser(site):
    with ExitStack() as stack:
        silent = [
            stack.enter_context(socket.create_connection((serving.HOST, site.port)))
            for _ in range(page_guard.PENDING_MAX + 1)
        ]
        stack.enter_context(closing(Browser(site)))
        silent[0].settimeout(WAIT_S)
        with suppress(ConnectionResetError):
            assert silent[0].recv(1) == b''


def test_a_browser_that_sends_too_many_bad_values_is_disconnected(site, caplog):
    with closing(Browser(site)) as attacker:
        for _ in range(page_guard.REJECTED_MAX + 1):
            attacker.update('program', value='c')
        assert attacker.close_code() == 1008
    assert len(caplog.records) <= page_guard.LINES_BURST + 5


# connections ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('headers', 'status'),
    [
        ({'Host': 'evil.test'}, 403),
        ({'Host': 'evil.test', 'Origin': 'http://evil.test'}, 403),
        ({'Host': ''}, 403),
        ({'Origin': 'http://evil.test'}, 403),
    ],
)
def test_a_name_that_is_not_ours_is_turned_away_with_and_without_an_origin(headers, status, site):
    import http.client

    connection = http.client.HTTPConnection(serving.HOST, site.port, timeout=WAIT_S)
    connection.putrequest('GET', '/', skip_host='Host' in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    assert connection.getresponse().status == status


@pytest.mark.parametrize('protocol', ['other', 'viser-v', 'viser-v1x', 'viser-v' + '1' * 30])
def test_a_client_of_another_protocol_is_turned_away(protocol, site):
    with pytest.raises(InvalidStatus, match='400'):
        connect(f'ws://{serving.HOST}:{site.port}', subprotocols=[protocol], open_timeout=WAIT_S)


def test_the_server_opens_no_tunnel(site):
    assert site.server.request_share_url() is None


@pytest.mark.parametrize('missing', ['serve', 'controls'])
def test_without_its_guard_the_page_is_not_served(missing, monkeypatch):
    infra = importlib.import_module('viser.infra._infra')
    if missing == 'serve':
        monkeypatch.setattr(infra, 'websockets', SimpleNamespace(asyncio=SimpleNamespace(server=None)))
    else:
        monkeypatch.setattr(page_guard.Guard, 'controls', lambda _: None)
    with socket.create_server((serving.HOST, 0)) as listener:
        guard = page_guard.Guard(serving.HOST, 1, print)
        with pytest.raises(
            RunError,
            match=r'^the page is not served: its guard is not compatible with viser .* and websockets',
        ):
            guard.serve('a page', listener)

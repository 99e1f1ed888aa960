"""Guard of the page: accepts connections and validates the messages of browsers before they reach viser.

viser trusts its clients: any of them may set any attribute of a control, such as its callbacks, open a tunnel to the
Internet, or upload without limit. Every message is therefore decoded with a strict schema, its value is validated
against its control, and only valid messages are re-encoded and passed on.
"""

import asyncio
import functools
import http
import importlib
import logging
import re
import socket
import time
from collections.abc import Callable
from importlib import metadata
from typing import Any

import msgspec
import viser
from viser._messages import FileTransferPartAck
from websockets.asyncio.server import ServerConnection
from websockets.frames import Opcode

from delta3_pacdrive.errors import RunError, shown
from delta3_pacdrive.view.browser_messages import (
    PART_BYTES,
    Part,
    RejectedError,
    Start,
    Update,
    checked,
    decoded,
)
from delta3_pacdrive.view.serving import START_S, is_cross_origin, own_names

CLIENTS_MAX, PENDING_MAX = 32, 32  # browsers, and connections without a request
CONNECTS_HZ, CONNECTS_BURST = 10.0, 50.0
MESSAGES_HZ, MESSAGES_BURST = 150.0, 300.0  # per browser: camera 50, slider 20 and held button 20 Hz
CONTROL_HZ, CONTROL_BURST = 2.0, 20.0  # pings and pongs; a browser only replies to those of the server
FRAGMENTS_MAX = 64  # per message; browsers send parts of files in a few
MESSAGE_BYTES = 16 * 1024  # of any other message
UPLOADS_HZ, UPLOADS_BURST = 0.2, 10.0  # all browsers together; viser keeps what it has acknowledged
CLOSE_S = 1.0  # timeout for a browser to confirm the end of its connection
QUEUE = 2  # buffered frames of a connection
REJECTED_MAX = 50  # messages before a connection is closed
LINES_HZ, LINES_BURST = 0.2, 10.0  # of the log
PROTOCOL = re.compile(r'viser-v[0-9.]{1,20}')
LOG = logging.getLogger(__name__)
# a browser that disconnects before its first request is not logged
LOG.addFilter(lambda record: record.getMessage() != 'opening handshake failed')


class Bucket:
    """A token bucket: limits a rate but allows bursts."""

    def __init__(self, rate_hz: float, burst: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate_hz, self._burst, self._clock = rate_hz, burst, clock
        self._tokens, self._then_s = burst, clock()

    def _fill(self) -> None:
        now_s = self._clock()
        self._tokens = min(self._burst, self._tokens + self._rate_hz * (now_s - self._then_s))
        self._then_s = now_s

    def take(self) -> bool:
        """Take a token if one is available."""
        self._fill()
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True

    def delay_s(self) -> float:
        """Take a token, possibly a future one; return the time until it is available [s]."""
        self._fill()
        self._tokens -= 1.0
        return max(0.0, -self._tokens / self._rate_hz)


# connections ----------------------------------------------------------------------------------------------------------


class _Connection(ServerConnection):  # type: ignore[misc]
    """A connection that yields only valid messages, at a limited rate."""

    def __init__(self, guard: 'Guard', *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._guard = guard
        self._messages = Bucket(MESSAGES_HZ, MESSAGES_BURST)
        self._controls = Bucket(CONTROL_HZ, CONTROL_BURST)
        self._fragments = self._rejected = 0
        self.upload: Start | None = None  # in progress
        self.parts: dict[int, int] = {}  # sizes of its received parts

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._guard.enter(self)

    def connection_lost(self, error: Exception | None) -> None:
        super().connection_lost(error)
        self._guard.leave(self)

    def process_event(self, event: Any) -> None:
        """Abort a connection that sends too many fragments, pings or pongs."""
        opcode = getattr(event, 'opcode', None)
        if opcode in (Opcode.PING, Opcode.PONG):
            bad = not self._controls.take()
        else:
            self._fragments = self._fragments + 1 if opcode is Opcode.CONT else 0
            bad = self._fragments > FRAGMENTS_MAX
        if bad:
            self._guard.log('a connection sent too many control frames or fragments and was closed')
            self.transport.abort()
            return
        super().process_event(event)

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next valid message; close the connection after too many invalid ones."""
        while True:
            raw = await super().recv(decode)
            if (delay_s := self._messages.delay_s()) > 0.0:
                await asyncio.sleep(delay_s)
            try:
                return self._guard.passed(raw, self)
            except RejectedError as error:
                self._guard.log(f'a message of a browser was rejected: {error}')
                self._rejected += 1
                if error.fatal or self._rejected > REJECTED_MAX:
                    await self.close(1008, 'message rejected')

    def recv_streaming(self, decode: bool | None = None) -> Any:
        """Not supported: fragments cannot be validated."""
        raise NotImplementedError


class _Server(viser.ViserServer):  # type: ignore[misc]
    """A viser server without the tunnel to the Internet."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Do nothing."""


class Guard:
    """The guard of one page; ``refuse`` displays the reason when an upload is rejected."""

    def __init__(self, host: str, upload_bytes: int, refuse: Callable[[str], None]) -> None:
        self._host, self._names = host, own_names(host)
        self._upload_bytes, self._refuse = upload_bytes, refuse
        self._pending: dict[_Connection, None] = {}
        self._clients: set[_Connection] = set()
        self._connects = Bucket(CONNECTS_HZ, CONNECTS_BURST)
        self._uploads = Bucket(UPLOADS_HZ, UPLOADS_BURST)
        self._lines, self._unsaid = Bucket(LINES_HZ, LINES_BURST), 0
        self._begin: Callable[[], Any] | None = None
        self._server: Any = None

    def serve(self, label: str, listener: socket.socket) -> Any:
        """Return a viser server for guarded connections; it listens after ``begin``.

        Raises
        ------
        RunError
            The guard is not compatible with the installed viser or websockets.

        """
        server: Any = importlib.import_module('websockets.asyncio.server')
        infra: Any = importlib.import_module('viser.infra._infra')
        plain = server.serve
        if infra.websockets.asyncio.server is not server:
            raise _misfit()

        def serve(*arguments: Any, **options: Any) -> Any:
            request = options.get('process_request')
            options = {
                name: options[name] for name in ('compression', 'select_subprotocol') if name in options
            }
            found = plain(
                *arguments[:1],
                sock=listener,
                start_serving=False,
                process_request=functools.partial(self._judged, request),
                create_connection=functools.partial(_Connection, self),
                max_size=PART_BYTES + MESSAGE_BYTES,
                max_queue=QUEUE,
                close_timeout=CLOSE_S,
                logger=LOG,
                **options,
            )
            loop = asyncio.get_running_loop()
            if arguments and request is not None:
                self._begin = lambda: asyncio.run_coroutine_threadsafe(
                    found.server.start_serving(), loop
                ).result(START_S)
            return found

        server.serve = serve
        try:
            # viser must use our listener; should it open its own, then for this host only and briefly
            self._server = _Server(
                host='127.0.0.1', port=listener.getsockname()[1], label=label, verbose=False
            )
        finally:
            server.serve = plain
        if self._begin is None or self.controls() is None:
            self._server.stop()
            raise _misfit()
        return self._server

    def begin(self) -> None:
        """Start listening."""
        if self._begin is not None:
            self._begin()
            self._begin = None

    def controls(self) -> Any:
        """Return the controls of the page by UUID, None if this version of viser stores them differently."""
        return getattr(self._server.gui, '_gui_input_handle_from_uuid', None)

    def log(self, sentence: str) -> None:
        """Log a line, unless the rate limit is exceeded."""
        if not self._lines.take():
            self._unsaid += 1
            return
        more = f' ({self._unsaid} more lines were left out)' if self._unsaid else ''
        self._unsaid = 0
        LOG.warning('%s%s', sentence, more)

    # connections ------------------------------------------------------------------------------------------------------

    def enter(self, connection: _Connection) -> None:
        """Register a connection without a request; above the limit abort the oldest."""
        self._pending[connection] = None
        if len(self._pending) > PENDING_MAX:
            next(iter(self._pending)).transport.abort()

    def leave(self, connection: _Connection) -> None:
        """Unregister a closed connection."""
        self._pending.pop(connection, None)
        self._clients.discard(connection)

    def _judged(self, answer: Any, connection: Any, request: Any) -> Any:
        """Respond to the request of a new connection, None to accept it as a browser."""
        headers = request.headers
        one = {
            name: headers.get_all(name) for name in ('Origin', 'Host', 'Upgrade', 'Sec-WebSocket-Protocol')
        }
        origin = ','.join(one['Origin']) if one['Origin'] else None
        if is_cross_origin(origin, ','.join(one['Host']), self._host, self._names):
            return connection.respond(http.HTTPStatus.FORBIDDEN, 'requests of other pages are forbidden\n')
        if one['Upgrade'] != ['websocket']:
            return answer(connection, request)
        if not PROTOCOL.fullmatch(','.join(one['Sec-WebSocket-Protocol'])):  # viser prints it
            return connection.respond(http.HTTPStatus.BAD_REQUEST, 'this page uses the protocol of viser\n')
        if len(self._clients) >= CLIENTS_MAX or not self._connects.take():
            self.log(f'a browser was rejected: {len(self._clients)} of {CLIENTS_MAX} are connected')
            return connection.respond(http.HTTPStatus.SERVICE_UNAVAILABLE, 'too many browsers\n')
        self._pending.pop(connection, None)
        self._clients.add(connection)
        return answer(connection, request)

    # messages ---------------------------------------------------------------------------------------------------------

    def passed(self, raw: Any, connection: _Connection) -> bytes:
        """Validate a message and return it re-encoded; raises RejectedError."""
        if not isinstance(raw, bytes) or (len(raw) > MESSAGE_BYTES and connection.upload is None):
            raise RejectedError(f'it is a text or has more than {MESSAGE_BYTES} bytes', fatal=True)
        message = decoded(raw)
        match message:
            case Update():
                message.updates.value = checked(self._handle(message.uuid), message.updates.value)
            case Start():
                self._start(message, connection)
            case Part():
                self._take(message, connection)
        return bytes(msgspec.msgpack.encode(message))

    def _handle(self, uuid: str) -> Any:
        if (found := self.controls().get(uuid)) is None:
            raise RejectedError('it is for an unknown control')
        return found

    def _start(self, start: Start, connection: _Connection) -> None:
        """Register the start of an upload; raises RejectedError if it is unexpected or too large."""
        if not isinstance(self._handle(start.source_component_uuid), viser.GuiUploadButtonHandle):
            raise RejectedError('it is an upload for a control that accepts none')
        if not self._uploads.take():
            raise RejectedError('it is one of too many uploads')
        if start.size_bytes > self._upload_bytes:
            sentence = f'{start.filename} has {start.size_bytes} bytes, the limit is {self._upload_bytes}'
            self._refuse(sentence)
            self._end_upload(start)
            raise RejectedError(shown(sentence))
        if connection.upload is not None:
            raise RejectedError('it is a second upload before the first one is complete')
        if start.part_count != -(-start.size_bytes // PART_BYTES):
            raise RejectedError(f'{start.size_bytes} bytes do not fit {start.part_count} parts')
        if any(start.transfer_uuid == other.upload.transfer_uuid for other in self._clients if other.upload):
            raise RejectedError('it is an upload with the identifier of another one')
        connection.upload, connection.parts = (start, {}) if start.part_count else (None, {})

    def _end_upload(self, start: Start) -> None:
        """Acknowledge a whole rejected upload, because the browser's button waits for that."""
        size = start.size_bytes
        acknowledged = FileTransferPartAck(start.source_component_uuid, start.transfer_uuid, size, size)
        self._server._websock_server.queue_message(acknowledged)

    def _take(self, part: Part, connection: _Connection) -> None:
        """Register a part of an upload; raises RejectedError if it was not announced."""
        start, parts = connection.upload, connection.parts
        announced = start is not None and (part.transfer_uuid, part.source_component_uuid) == (
            start.transfer_uuid,
            start.source_component_uuid,
        )
        if start is None or not announced or part.part_index >= start.part_count or part.part_index in parts:
            raise RejectedError('it is a part of a file that was not announced')
        parts[part.part_index] = len(part.content)
        if sum(parts.values()) > start.size_bytes:
            raise RejectedError('a file is larger than announced', fatal=True)
        if len(parts) == start.part_count:
            connection.upload = None


def _misfit() -> RunError:
    versions = ' and '.join(f'{name} {metadata.version(name)}' for name in ('viser', 'websockets'))
    return RunError(f'the page is not served: its guard is not compatible with {versions}')

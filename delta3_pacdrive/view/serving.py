"""Where the page is served. Light: what is missing or taken is said before anything that takes long is loaded."""

import contextlib
import importlib.util
import ipaddress
import os
import selectors
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from delta3_pacdrive.errors import RunError, shown

HOST, PORT = '127.0.0.1', 8642
EVERYWHERE = ('0.0.0.0', '::', '')  # noqa: S104 (what somebody may ask for)
PORT_MAX = 65535
PORTS = 20  # that are tried if none is asked for
BACKLOG = 100
LISTENING = 'DELTA3_LISTENING'  # number of the socket on which a process finds that others listen for it
REQUEST_BYTES, GREETING_S, START_S = 65536, 2.0, 10.0
# The client tries to connect for 5 s, then anew in each second in which the page has the focus. Chromium lets wait for
# seconds who has failed often, longer than the client does: it would never connect. So it has no focus until the page
# is there.
IS_THERE = '/is-there'  # is answered by the page itself
PATIENT = f"""
<script>
document.hasFocus = () => false;
fetch('{IS_THERE}').finally(() => {{
  delete document.hasFocus;
  window.dispatchEvent(new Event('focus'));
}});
</script>
""".encode()
REPLY = b'HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nConnection: close\r\nContent-Length: %d\r\n\r\n'


def refusal(name: str, port: int | None) -> str:
    """Return why an option cannot be a port, empty if it can, or if it is not given."""
    if port is None or 1 <= port <= PORT_MAX:
        return ''
    return f'{name} is {port}, but must be between 1 and {PORT_MAX}'


def is_here(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return host == 'localhost' or ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name, wherever it leads
        return False


def own_names(host: str) -> frozenset[str]:
    """Return the names by which browsers may call the machine that serves a page at an address."""
    names = {'localhost'}
    if not is_here(host):
        own = socket.gethostname()
        names |= {host, own, f'{own.partition(".")[0]}.local'}
        with contextlib.suppress(OSError):
            found = socket.getaddrinfo(own, None, flags=socket.AI_CANONNAME)
            names |= {canonical for _, _, _, canonical, _ in found if canonical}
    return frozenset(name.lower() for name in names if name)


def _is_ours(name: str, host: str, names: frozenset[str]) -> bool:
    """Whether a browser that calls the machine by a name, or by an address, can only mean this page."""
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return name.lower() in names  # any other name may be one of a stranger that leads to this machine
    return address.is_loopback or not is_here(host)


def require_viser() -> None:
    """Raise RunError if the library of the page is not installed."""
    if importlib.util.find_spec('viser') is None:
        raise RunError("the page needs viser: pip install '.[view]' in the folder of the sources")


def _bound(host: str, port: int) -> socket.socket:
    """Return a socket that listens there; raises RunError if no page can be served there."""
    try:
        family, _, _, _, place = socket.getaddrinfo(
            host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(place)
            listener.listen(BACKLOG)
        except OSError:
            listener.close()
            raise
    except OSError as error:
        raise taken(host, port, error.strerror or str(error)) from None
    return listener


def _first_free(host: str) -> socket.socket:
    """Return a socket that listens on the first port that is free; raises RunError."""
    for candidate in range(PORT, PORT + PORTS):
        try:
            return _bound(host, candidate)
        except RunError as error:
            last = error
    raise last


def _handed_over(port: int | None) -> socket.socket | None:
    """Return the socket on which whoever has started this process listens for it, None if nobody does."""
    given = os.environ.pop(LISTENING, '')
    if not given:
        return None
    listener = socket.socket(fileno=int(given))
    listener.set_inheritable(False)
    if listener.getsockname()[1] == port:
        return listener
    listener.close()
    return None


@contextlib.contextmanager
def held(host: str, port: int | None) -> Iterator['Place']:
    """Hold the place of a page: the port that is asked for, else the first that is free.

    It is held from here on: what comes before a page is served, such as compiling, may take long.

    Raises
    ------
    RunError
        The port is taken, no port is free, or the address is not one of this machine.

    """
    require_viser()
    listener = _handed_over(port) or (_first_free(host) if port is None else _bound(host, port))
    place = Place(host, listener)
    try:
        yield place
    finally:
        place.close()


class Place:
    """A port that is held for a page. Browsers that come before the page is there get the client, and wait.

    To load the client takes a browser as long as it takes the page to be made; so both happen at once.

    Parameters
    ----------
    host
        Where the page is served.
    listener
        Listens there.

    Attributes
    ----------
    port, url
        Its port, and what a browser is told.
    is_told
        Whether people know of it.

    """

    def __init__(self, host: str, listener: socket.socket) -> None:
        self.host, self.port = host, int(listener.getsockname()[1])
        self.url = address(host, self.port)
        self.is_told = False
        self.listener = _Listener(listener)
        self._is_held = True
        self._waiting: list[socket.socket] = []
        self._greeter: threading.Thread | None = None
        self._over, self._is_over = socket.socketpair()

    def greet(self) -> None:
        """Give browsers the client from now on, in a thread, until the page takes the listener over."""
        client = client_file()
        if client is not None and self._greeter is None:
            self._greeter = threading.Thread(target=self._greet, args=(client,), daemon=True)
            self._greeter.start()

    def _greet(self, client: Path) -> None:
        listener = self.listener
        with selectors.DefaultSelector() as selector:
            selector.register(listener, selectors.EVENT_READ)
            selector.register(self._is_over, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    if key.fileobj is self._is_over:
                        own = listener, self._is_over
                        known = [registered.fileobj for registered in selector.get_map().values()]
                        self._waiting += [
                            one for one in known if isinstance(one, socket.socket) and one not in own
                        ]
                        return
                    if key.fileobj is listener:
                        with contextlib.suppress(OSError):
                            selector.register(listener.accept()[0], selectors.EVENT_READ)
                    elif isinstance(key.fileobj, socket.socket):
                        selector.unregister(key.fileobj)
                        self._answer(key.fileobj, client)

    def _answer(self, connection: socket.socket, client: Path) -> None:
        """Send the client if that is what a browser asks for; whatever else it wants waits for the page."""
        try:
            connection.settimeout(GREETING_S)
            if asks_for_client(connection.recv(REQUEST_BYTES, socket.MSG_PEEK)):
                connection.recv(REQUEST_BYTES)
                content = client.read_bytes() + PATIENT
                connection.sendall(REPLY % len(content) + content)
                connection.close()
            else:
                self._waiting.append(connection)
        except OSError:  # the browser is gone
            connection.close()

    def inheritable(self) -> int:
        """Return the number of the listener for a process that is started now, which ``held`` finds in LISTENING."""
        self.listener.set_inheritable(True)
        return self.listener.fileno()

    def hand_over(self) -> None:
        """Leave the listener to the server that has it; who waits already is the first that it accepts."""
        if self._is_held:
            self._stop()
            self.listener.admit(self._waiting)
            self._is_held, self._waiting = False, []

    def _stop(self) -> None:
        self._over.close()
        if self._greeter is not None:
            self._greeter.join()
        self._is_over.close()

    def close(self) -> None:
        """Hold it no longer, unless a server has it."""
        self._stop()
        if self._is_held:
            for one in (*self._waiting, self.listener):
                one.close()
            self._is_held, self._waiting = False, []


class _Listener(socket.socket):
    """A socket that listens, of which some connections are accepted already: they come first."""

    def __init__(self, listener: socket.socket) -> None:
        super().__init__(listener.family, listener.type, listener.proto, fileno=listener.detach())
        self._accepted: list[socket.socket] = []
        self._knock: Any = None

    def admit(self, waiting: list[socket.socket]) -> None:
        """Let them come first."""
        self._accepted = waiting
        if waiting:  # a server looks at its listener only when somebody comes
            with socket.socket(self.family, self.type) as knock:
                knock.connect(self.getsockname())
                self._knock = knock.getsockname()

    def accept(self) -> tuple[socket.socket, Any]:
        if self._accepted:
            return self._accepted.pop(0), ()
        connection, address = super().accept()
        if address == self._knock:
            self._knock = None
            connection.close()
            raise BlockingIOError
        return connection, address


def client_file() -> Path | None:
    """Return the client that viser serves, None where this viser has none in one file."""
    found = importlib.util.find_spec('viser')
    for folder in (found and found.submodule_search_locations) or ():
        client = Path(folder) / 'client' / 'build' / 'index.html'
        if client.is_file():
            return client
    return None


def asks_for_client(request: bytes) -> bool:
    """Whether a request is that of a browser for the page itself, and a whole one."""
    line, _, headers = request.partition(b'\r\n')
    method, _, target = line.partition(b' ')
    asked = method == b'GET' and target.partition(b' ')[0].partition(b'?')[0] == b'/'
    return asked and headers.endswith(b'\r\n\r\n') and b'upgrade: websocket' not in headers.lower()


def taken(host: str, port: int, reason: str) -> RunError:
    """Return the error of a place where no page can be served."""
    return RunError(f'cannot serve the page on port {port} of {shown(host)}: {reason}')


def is_foreign(origin: str | None, asked: str, host: str, names: frozenset[str]) -> bool:
    """Whether a connection comes from a page that is not ours, or means a machine of another name.

    Browsers let every page that is open in them connect to this machine, and name in ``Origin`` the page that does so.
    A stranger who lets a name of his lead to this machine has the same name in both. Requests of a page to its own
    server may come without ``Origin``.

    Parameters
    ----------
    origin
        As the browser sends it; None: it sends none.
    asked
        Name and port that the browser believes to talk to, its ``Host``.
    host
        Where the page is served.
    names
        As ``own_names`` has them.

    """
    try:
        name, whose = urlsplit(f'//{asked}').hostname or '', urlsplit(origin or f'//{asked}').netloc
    except ValueError:
        return True
    return whose != asked or not _is_ours(name, host, names)


def address(host: str, port: int) -> str:
    """Return what a browser is told."""
    name = 'localhost' if host in EVERYWHERE else f'[{host}]' if ':' in host else host
    return f'http://{name}:{port}'

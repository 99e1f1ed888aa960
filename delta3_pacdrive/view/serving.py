"""Address and port of the page, checked before anything slow is loaded."""

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
EVERYWHERE = ('0.0.0.0', '::', '')  # noqa: S104 (valid user input)
PORT_MAX = 65535
PORTS = 20  # candidates if none is requested
BACKLOG = 100
LISTENING = 'DELTA3_LISTENING'  # file descriptor of a listener that the parent process has opened
REQUEST_BYTES, GREETING_S, START_S = 65536, 2.0, 10.0
# The client tries to connect for 5 s, then once a second while the page has the focus. After repeated failures Chromium
# delays connections by more than the client's timeout, so it would never connect. Therefore the client gets no focus
# until the page is available.
IS_THERE = '/is-there'  # answered by the page itself
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
    """Return why an option is not a valid port, empty if it is or if it is not given."""
    if port is None or 1 <= port <= PORT_MAX:
        return ''
    return f'{name} is {port}, but must be between 1 and {PORT_MAX}'


def is_here(host: str) -> bool:
    """Whether an address is reachable from this host only."""
    try:
        return host == 'localhost' or ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name may resolve to anything
        return False


def own_names(host: str) -> frozenset[str]:
    """Return the host names under which browsers may request a page at an address."""
    names = {'localhost'}
    if not is_here(host):
        own = socket.gethostname()
        names |= {host, own, f'{own.partition(".")[0]}.local'}
        with contextlib.suppress(OSError):
            found = socket.getaddrinfo(own, None, flags=socket.AI_CANONNAME)
            names |= {canonical for _, _, _, canonical, _ in found if canonical}
    return frozenset(name.lower() for name in names if name)


def _is_ours(name: str, host: str, names: frozenset[str]) -> bool:
    """Whether a host name or address in a request can only mean this page."""
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return name.lower() in names  # any other name may be a third party's that resolves to this host
    return address.is_loopback or not is_here(host)


def require_viser() -> None:
    """Raise RunError if viser is not installed."""
    if importlib.util.find_spec('viser') is None:
        raise RunError("the page needs viser: pip install '.[view]' in the folder of the sources")


def _bound(host: str, port: int) -> socket.socket:
    """Return a listening socket; raises RunError if the address cannot be used."""
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
    """Return a socket that listens on the first free port; raises RunError."""
    for candidate in range(PORT, PORT + PORTS):
        try:
            return _bound(host, candidate)
        except RunError as error:
            last = error
    raise last


def _handed_over(port: int | None) -> socket.socket | None:
    """Return the listener opened by the parent process, None if there is none."""
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
    """Hold the port of a page: the requested one, else the first free one.

    The port is held from now on, because compiling before the page is served may take long.

    Raises
    ------
    RunError
        The port is taken, no port is free, or the address does not belong to this host.

    """
    require_viser()
    listener = _handed_over(port) or (_first_free(host) if port is None else _bound(host, port))
    place = Place(host, listener)
    try:
        yield place
    finally:
        place.close()


class Place:
    """A port held for a page. Browsers that connect early get the client, which waits for the page.

    Loading the client takes a browser as long as creating the page takes, so both happen in parallel.
    """

    def __init__(self, host: str, listener: socket.socket) -> None:
        self.host, self.port = host, int(listener.getsockname()[1])
        self.url = address(host, self.port)
        self.is_told = False  # the user knows the address
        self.listener = _Listener(listener)
        self._is_held = True
        self._waiting: list[socket.socket] = []
        self._greeter: threading.Thread | None = None
        self._over, self._is_over = socket.socketpair()

    def greet(self) -> None:
        """Start a thread that serves the client until the page takes over the listener."""
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
        """Send the client to a browser that requests it; other requests wait for the page."""
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
        """Return the file descriptor of the listener for a child process, which ``held`` finds in LISTENING."""
        self.listener.set_inheritable(True)
        return self.listener.fileno()

    def hand_over(self) -> None:
        """Hand the listener to the server; waiting connections are accepted first."""
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
        """Release the port, unless a server has taken it over."""
        self._stop()
        if self._is_held:
            for one in (*self._waiting, self.listener):
                one.close()
            self._is_held, self._waiting = False, []


class _Listener(socket.socket):
    """A listening socket that returns previously accepted connections first."""

    def __init__(self, listener: socket.socket) -> None:
        super().__init__(listener.family, listener.type, listener.proto, fileno=listener.detach())
        self._accepted: list[socket.socket] = []
        self._knock: Any = None

    def admit(self, waiting: list[socket.socket]) -> None:
        """Queue accepted connections."""
        self._accepted = waiting
        if waiting:  # wake the server, which polls its listener only on a new connection
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
    """Return the client file of viser, None if this version has none."""
    found = importlib.util.find_spec('viser')
    for folder in (found and found.submodule_search_locations) or ():
        client = Path(folder) / 'client' / 'build' / 'index.html'
        if client.is_file():
            return client
    return None


def asks_for_client(request: bytes) -> bool:
    """Whether the data is a complete request for the page itself."""
    line, _, headers = request.partition(b'\r\n')
    method, _, target = line.partition(b' ')
    asked = method == b'GET' and target.partition(b' ')[0].partition(b'?')[0] == b'/'
    return asked and headers.endswith(b'\r\n\r\n') and b'upgrade: websocket' not in headers.lower()


def taken(host: str, port: int, reason: str) -> RunError:
    """Return the error for an address that cannot be used."""
    return RunError(f'cannot serve the page on port {port} of {shown(host)}: {reason}')


def is_cross_origin(origin: str | None, asked: str, host: str, names: frozenset[str]) -> bool:
    """Whether a request comes from another page, or names another host.

    Any page open in a browser may connect to this host, and the browser names the requesting page in ``Origin``. A
    third-party name that resolves to this host appears in both headers. Requests of a page to its own server may lack
    ``Origin``.

    Parameters
    ----------
    origin
        Header of the request; None: missing.
    asked
        Host and port in the request, its ``Host``.
    host
        Address of the page.
    names
        As returned by ``own_names``.

    """
    try:
        name, whose = urlsplit(f'//{asked}').hostname or '', urlsplit(origin or f'//{asked}').netloc
    except ValueError:
        return True
    return whose != asked or not _is_ours(name, host, names)


def address(host: str, port: int) -> str:
    """Return the URL of the page."""
    name = 'localhost' if host in EVERYWHERE else f'[{host}]' if ':' in host else host
    return f'http://{name}:{port}'

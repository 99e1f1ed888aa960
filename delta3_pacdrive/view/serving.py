"""Address and port of the page, checked before anything slow is loaded."""

import contextlib
import importlib.util
import ipaddress
import os
import socket
from collections.abc import Iterator
from urllib.parse import urlsplit

from delta3_pacdrive.errors import RunError, shown

HOST, PORT = '127.0.0.1', 8642
EVERYWHERE = ('0.0.0.0', '::', '')  # noqa: S104 (valid user input)
PORT_MAX = 65535
PORTS = 20  # candidates if none is requested
BACKLOG = 100
LISTENING = 'DELTA3_LISTENING'  # file descriptor of a listener that the parent process has opened
START_S = 10.0  # for the server to start


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
    """A port held for a page. Browsers that connect early wait in the queue of the listener for the page."""

    def __init__(self, host: str, listener: socket.socket) -> None:
        self.host, self.port = host, int(listener.getsockname()[1])
        self.url = address(host, self.port)
        self.is_told = False  # the user knows the address
        self.listener = listener
        self._is_held = True

    def inheritable(self) -> int:
        """Return the file descriptor of the listener for a child process, which ``held`` finds in LISTENING."""
        self.listener.set_inheritable(True)
        return self.listener.fileno()

    def hand_over(self) -> None:
        """Hand the listener to the server."""
        self._is_held = False

    def close(self) -> None:
        """Release the port, unless a server has taken it over."""
        if self._is_held:
            self._is_held = False
            self.listener.close()


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

"""Where the page is served. Light: what is missing or taken is said before anything that takes long is loaded."""

import contextlib
import http
import ipaddress
import socket
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from delta3_pacdrive.errors import RunError, shown

HOST, PORT = '127.0.0.1', 8642
EVERYWHERE = ('0.0.0.0', '::', '')  # noqa: S104 (what somebody may ask for)
PORT_MAX = 65535
PORTS = 20  # that are tried if none is asked for


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
    import importlib.util

    if importlib.util.find_spec('viser') is None:
        raise RunError("the page needs viser: pip install '.[view]' in the folder of the sources")


def require_free(host: str, port: int) -> None:
    """Raise RunError if no page can be served there."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(address)
    except OSError as error:
        raise taken(host, port, error.strerror or str(error)) from None


@contextlib.contextmanager
def port_for(host: str, port: int | None) -> Iterator[int]:
    """Give the port of a page: the one that is asked for, else the first that is free.

    The latter is held within the context: what comes before a page is served, such as compiling, may take long, and
    other pages that look for a port meanwhile take another one.

    Raises
    ------
    RunError
        The port is taken, no port is free, or the address is not one of this machine.

    """
    require_viser()
    if port is not None:
        require_free(host, port)
        yield port
        return
    for candidate in range(PORT, PORT + PORTS):
        with socket.socket(socket.AF_UNIX) as claim:
            try:
                claim.bind(f'\0delta3_page_{candidate}')  # no file: it ends with the process
                require_free(host, candidate)
            except (RunError, OSError) as error:
                last = (
                    error if isinstance(error, RunError) else taken(host, candidate, 'Address already in use')
                )
            else:
                yield candidate
                return
    raise last


def taken(host: str, port: int, reason: str) -> RunError:
    """Return the error of a place where no page can be served."""
    return RunError(f'cannot serve the page on port {port} of {shown(host)}: {reason}')


def is_foreign(origin: str | None, asked: str, host: str, names: frozenset[str]) -> bool:
    """Whether a connection comes from a page that is not ours.

    Browsers let every page that is open in them connect to this machine, and tell only in ``Origin`` whose page it is.
    A stranger who lets a name of his lead to this machine has the same name in both.

    Parameters
    ----------
    origin
        As the browser tells it; None: it is no browser.
    asked
        Name and port that the browser believes to talk to, its ``Host``.
    host
        Where the page is served.
    names
        As ``own_names`` has them.

    """
    if origin is None:
        return False
    try:
        name, whose = urlsplit(f'//{asked}').hostname or '', urlsplit(origin).netloc
    except ValueError:
        return True
    return whose != asked or not _is_ours(name, host, names)


@contextlib.contextmanager
def own_pages_only(host: str) -> Iterator[None]:
    """Let the servers that viser starts meanwhile turn away the pages of others; viser asks nobody where he is from."""
    import importlib

    server: Any = importlib.import_module('websockets.asyncio.server')
    plain, names = server.serve, own_names(host)

    def serve(*arguments: Any, process_request: Any, **options: Any) -> Any:
        def judged(connection: Any, request: Any) -> Any:
            headers = request.headers
            if is_foreign(headers.get('Origin'), headers.get('Host', ''), host, names):
                return connection.respond(http.HTTPStatus.FORBIDDEN, 'this page is not for other pages\n')
            return process_request(connection, request)

        return plain(*arguments, process_request=judged, **options)

    server.serve = serve
    try:
        yield
    finally:
        server.serve = plain


def address(host: str, port: int) -> str:
    """Return what a browser is told."""
    name = 'localhost' if host in EVERYWHERE else f'[{host}]' if ':' in host else host
    return f'http://{name}:{port}'

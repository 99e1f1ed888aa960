"""A client that receives the page of a robot without drawing it, like a browser on another machine."""

import threading
import time
from contextlib import suppress
from importlib import metadata
from itertools import pairwise
from statistics import median

APPEAR_S = 30.0  # timeout for the page
LOOK_S, TRY_S, SETTLE_S = 0.5, 0.2, 2.0
CAMERA = {
    'type': 'ViewerCameraMessage',
    'wxyz': (1.0, 0.0, 0.0, 0.0),
    'position': (1.0, -1.5, 0.0),
    'fov': 0.8,
    'near': 0.01,
    'far': 1000.0,
    'image_height': 800,
    'image_width': 1280,
    'look_at': (0.0, 0.0, -0.5),
    'up_direction': (0.0, 0.0, 1.0),
}


class PageWatcher:
    """A thread that opens a page and receives everything it sends; ``pid`` is the process that serves it."""

    def __init__(self, host: str, port: int, pid: int) -> None:
        self._pid, self.cores = pid, 0.0  # cores: load of the page while it is watched, without its start-up
        self._address = f'ws://{host}:{port}'
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.received_bytes, self.watched_s = 0, 0.0
        self.pictures_s: list[float] = []  # arrival times; all changes of a picture arrive together
        self._thread.start()

    def _watch(self) -> None:
        import msgspec
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        protocol = Subprotocol(f'viser-v{metadata.version("viser")}')
        deadline = time.monotonic() + APPEAR_S
        while not self._stop.is_set() and time.monotonic() < deadline:
            with suppress(OSError, WebSocketException):
                options = {'subprotocols': [protocol], 'compression': None, 'max_size': None}
                with connect(self._address, **options) as socket:
                    socket.send(msgspec.msgpack.encode(CAMERA))
                    self._stop.wait(SETTLE_S)
                    start, spent_s = time.monotonic(), self._spent_s()
                    while not self._stop.is_set():
                        with suppress(TimeoutError):
                            self._take(socket.recv(timeout=LOOK_S))
                        self.watched_s = max(time.monotonic() - start, 1e-3)
                        if (now_s := self._spent_s()) > spent_s:
                            self.cores = (now_s - spent_s) / self.watched_s
            self._stop.wait(TRY_S)

    def _take(self, data: bytes | str) -> None:
        self.received_bytes += len(data)
        self.pictures_s.append(time.monotonic())

    @property
    def pictures_hz(self) -> float:
        """Rate of the pictures while the robot moves, from the median of their periods."""
        between = [b - a for a, b in pairwise(self.pictures_s)]
        return 1.0 / max(median(between), 1e-3) if between else 0.0

    def _spent_s(self) -> float:
        import psutil

        try:
            times = psutil.Process(self._pid).cpu_times()
        except psutil.NoSuchProcess:  # robot and page have ended
            return 0.0
        return float(times.user + times.system)

    def close(self) -> None:
        """Close the page."""
        self._stop.set()
        self._thread.join()

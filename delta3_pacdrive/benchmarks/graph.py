"""``delta3 bench graph``: timing and cost of the nodes, compared with nodes that only exchange messages.

Each case is measured with real-time scheduling, and without the permission to use it, as for an ordinary user.
"""

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from delta3_pacdrive.benchmarks.case import in_child, program_file, times_text
from delta3_pacdrive.bringup import child
from delta3_pacdrive.bringup.scheduling import (
    NOT_PERMITTED,
    SLICE_S,
    Schedule,
    give_up_real_time,
    real_time_is_permitted,
    set_scheduling,
)
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.view import serving

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


TITLES = {
    'machine': 'the machine: a loop that only sleeps',
    'bare': 'bare nodes, separate processes, real time',
    'separate': 'robot, separate processes, real time',
    'viewed': 'robot, separate processes, real time, with a page in a browser',
    'scoped': 'robot, separate processes, real time, with an oscilloscope of eight channels at 16 kHz',
    'single': 'robot, one process, real time',
    'fast': 'robot, one process, as fast as possible',
}
CASES = tuple(TITLES)
WITHOUT_PAGE = tuple(case for case in CASES if case not in ('viewed', 'scoped'))
BESIDE_PAGE = ('separate', 'viewed')
PAGE_LEAST_S = 2.0  # minimum watching time for figures of the page
BESIDE_SCOPE = ('separate', 'scoped')
SCOPED = (
    'axis1.current_reference,axis1.motor_current,axis1.phase_current_1,axis1.phase_voltage_1,axis2.current_reference,'
    'axis2.motor_current,axis3.speed,axis3.speed_reference'
)
REAL_TIME, ORDINARY = SCHEDULINGS = ('real-time', 'ordinary')
COLUMNS = {
    REAL_TIME: 'real-time scheduling',
    ORDINARY: f'ordinary user (slices of {SLICE_S * 1e3:g} ms)',
}


def measure(
    seconds: float, cases: Sequence[str] | None, schedulings: Sequence[str] | None, quiet: bool
) -> dict[str, Any]:
    """Measure all or some cases, each in a separate process; return the results by case and column. Raises RunError."""
    schedulings = schedulings or SCHEDULINGS[not real_time_is_permitted() :]
    if REAL_TIME in schedulings and not real_time_is_permitted():
        raise RunError(NOT_PERMITTED)
    results: dict[str, dict[str, Any]] = {}
    for case in cases or WITHOUT_PAGE:
        # without a clock a robot is never scheduled in real time
        for scheduling in schedulings if case != 'fast' else (ORDINARY,):
            if not quiet:
                title = f'{case}, {COLUMNS[scheduling]}: {seconds:g} s of motion'
                print(f'measuring {title} ...', file=sys.stderr, flush=True)
            measured = in_child(partial(_measure, case, scheduling, seconds))
            results.setdefault(case, {})[scheduling] = measured
    return results


class _Meter:
    """Measures processor time and memory of processes since its creation."""

    def __init__(self, pids: dict[str, int]) -> None:
        import psutil

        self._processes = {name: psutil.Process(pid) for name, pid in pids.items()}
        self._start_s = time.monotonic()
        self._start = self._cpu()
        self.cores: dict[str, float] = {}
        self.spent_s = 0.0
        self.memory_mib: dict[str, float] = {}

    def _cpu(self) -> dict[str, float]:
        times = {name: process.cpu_times() for name, process in self._processes.items()}
        return {name: item.user + item.system for name, item in times.items()}

    def measure(self) -> None:
        """Take the figures up to now."""
        duration = time.monotonic() - self._start_s
        spent = {name: cpu - self._start[name] for name, cpu in self._cpu().items()}
        self.cores = {name: cpu / duration for name, cpu in spent.items()}
        self.spent_s = sum(spent.values())
        self.memory_mib = {name: p.memory_full_info().pss / 2**20 for name, p in self._processes.items()}

    def figures(self, cycles: int) -> dict[str, Any]:
        """Return the newest figures; ``cycles`` have passed since the creation."""
        spent = 1e6 * self.spent_s / max(cycles, 1)
        return {'cores': self.cores, 'us_per_cycle': spent, 'memory_mib': self.memory_mib}


def _measure(case: str, scheduling: str, seconds: float) -> dict[str, Any]:
    if scheduling == ORDINARY:
        give_up_real_time()
    if case == 'machine':
        return _measure_machine(seconds)
    return _measure_baseline(seconds) if case == 'bare' else _measure_robot(case, seconds)


def _measure_machine(seconds: float) -> dict[str, Any]:
    """Measure the lateness of a loop that only sleeps until the next millisecond, in real time if permitted."""
    from delta3_pacdrive.robot.sercos.scheduler import Histogram

    set_scheduling(Schedule.REAL_TIME)
    lateness = Histogram()
    start = time.monotonic()
    for cycle in range(round(seconds * 1e3)):
        due = start + cycle * 1e-3
        time.sleep(max(0.0, due - time.monotonic()))
        lateness.add(time.monotonic() - due)
    return {'lateness_ms': lateness.summary_ms()}


def _measure_robot(case: str, seconds: float) -> dict[str, Any]:
    from delta3_pacdrive.bringup.bringup import Bringup
    from delta3_pacdrive.bringup.options import Options
    from delta3_pacdrive.bringup.page import started

    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder, ExitStack() as stack:
        page = port = None
        if case == 'viewed':
            place = stack.enter_context(serving.held(serving.HOST, None))
            port, page = place.port, stack.enter_context(started(place, '/', Path(folder)))
        scope = stack.enter_context(_oscilloscope(Path(folder))) if case == 'scoped' else None
        bringup = Bringup(
            Options(
                program=program_file(seconds, folder),
                real_time_factor=0.0 if case == 'fast' else 1.0,
                single_process=case in ('single', 'fast'),
                view=page,
            )
        )
        meters: list[_Meter] = []
        watchers: list[PageWatcher] = []
        first_cycle = 0

        def show(progress: MotionProgress) -> None:
            nonlocal first_cycle
            if not meters:
                first_cycle = progress.cycles
                meters.append(_Meter({child.name: child.pid for child in bringup.processes()}))
                if page is not None and port is not None:
                    watchers.append(PageWatcher(serving.HOST, port, page.pid))
                    stack.callback(watchers[0].close)
            if progress.finished:
                meters[0].measure()

        result = bringup.run(show)
        if scope is not None:
            result['scope_samples'], result['scope_lost'] = _end_oscilloscope(scope)
    if watchers:
        result['page_kb_s'] = 1e-3 * watchers[0].received_bytes / max(watchers[0].watched_s, 1e-3)
        result |= {'page_watched_s': watchers[0].watched_s, 'page_cores': watchers[0].cores}
        result['page_pictures_hz'] = watchers[0].pictures_hz
    return result | meters[0].figures(result['cycles'] - first_cycle)


@contextmanager
def _oscilloscope(folder: Path) -> Iterator['subprocess.Popen[str]']:
    """Start an oscilloscope in a separate process, which waits for the robot."""
    more = '--mode', 'rolling', '--duration', '1', '--output', str(folder / 'scope.npz'), '--json'
    with child.start('scope', SCOPED, *more, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def _end_oscilloscope(process: 'subprocess.Popen[str]') -> tuple[int, int]:
    """End an oscilloscope; return the number of samples per channel, and of lost ones."""
    result = json.loads(child.end(process))
    if not result['ok']:
        raise RunError(f'the oscilloscope: {result["error"]}')
    return result['scope'][0]['samples'], result['lost_samples']


def _measure_baseline(seconds: float) -> dict[str, Any]:
    from delta3_pacdrive.benchmarks import baseline_nodes
    from delta3_pacdrive.bringup.processes import end_all, spawn
    from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
    from delta3_pacdrive.ros import node_process
    from delta3_pacdrive.ros.wire import discovery

    discovery.keep_to_this_machine()
    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder:
        report = Path(folder) / 'report.json'

        def done(figures: dict[str, Any]) -> None:
            report.with_suffix('.part').write_text(json.dumps(figures))
            report.with_suffix('.part').rename(report)

        factories: dict[str, Any] = {'plant': baseline_nodes.BaselinePlant}
        factories |= {
            f'mc4_drive_{n + 1}': partial(baseline_nodes.BaselineDrive, axis) for n, axis in enumerate(DRIVES)
        }
        factories['transformation_task'] = partial(
            baseline_nodes.BaselineMaster, round(seconds / baseline_nodes.PERIOD_S), done
        )
        children = [
            spawn(name, partial(node_process.run, [factory], []), Path(folder) / name, Schedule.REAL_TIME)
            for name, factory in factories.items()
        ]
        try:
            time.sleep(3.0)  # start-up is not measured
            meter = _Meter({child.name: child.pid for child in children})
            deadline = time.monotonic() + 3.0 * seconds + 30.0
            while not report.exists() and time.monotonic() < deadline:
                time.sleep(0.2)
            meter.measure()
            figures = json.loads(report.read_text())
        finally:
            end_all(children)
    return dict(figures) | meter.figures(figures['cycles'])


def _percentiles(counts: list[int]) -> str:
    import numpy as np

    cumulative = np.cumsum(counts)
    shares = [int(np.searchsorted(cumulative, share * cumulative[-1])) for share in (0.5, 0.99, 0.999, 1.0)]
    return ' / '.join(str(value) for value in shares)


def _each(values: dict[str, float], digits: int) -> str:
    return ', '.join(f'{name} {value:.{digits}f}' for name, value in values.items())


def _rows(result: dict[str, Any]) -> dict[str, str]:
    """Write the figures of one column, by the names of their rows."""
    if 'cycles' not in result:
        return {'wakes up late': times_text(result['lateness_ms'])}
    cycles, overruns = result['cycles'], result['overruns']
    rows = {
        'cycles': f'{cycles}, slip {result["slip_s"] * 1e3:.1f} ms',
        'overruns': f'{overruns} ({overruns / cycles:.3%})',
        'cycle start late': times_text(result['lateness_ms']),
        'MDT to last AT': times_text(result['mdt_to_last_at_ms']),
    }
    if 'bus_time_s' in result:
        bus, wall = result['bus_time_s'], result['wall_time_s']
        rows['bus / wall time'] = f'{bus:.3f} s / {wall:.3f} s = {bus / wall:.3f}'
        rows['telegrams'] = f'{result["lost_telegrams"]} lost, {result["refused_telegrams"]} refused'
        rows['outstanding'] = f'{_percentiles(result["outstanding"])} cycles'
    rows['processor'] = (
        f'{sum(result["cores"].values()):.2f} cores, {result["us_per_cycle"]:.0f} us per cycle'
    )
    if 'scope_samples' in result:
        rows['oscilloscope'] = (
            f'{result["scope_samples"]} samples of a channel held, {result["scope_lost"]} lost'
        )
    if 'page_kb_s' in result:
        rows['page'] = _page(result)
    rows['memory (PSS)'] = f'{sum(result["memory_mib"].values()):.0f} MiB'
    return rows


def _page(result: dict[str, Any]) -> str:
    watched_s = result['page_watched_s']
    if watched_s < PAGE_LEAST_S:
        return f'watched for {watched_s:.1f} s: too short to say what it takes'
    pictures = f'{result["page_pictures_hz"]:.1f} pictures a second in motion'
    return (
        f'{result["page_cores"]:.3f} cores, {pictures}, {result["page_kb_s"]:.0f} kB/s for {watched_s:.0f} s'
    )


def text(results: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield the columns side by side."""
    yield 'times and outstanding cycles as p50 / p99 / p99.9 / max'
    for case, columns in results.items():
        texts = {scheduling: _rows(result) for scheduling, result in columns.items()}
        yield f'\n{TITLES[case]}'
        if case != 'fast':
            yield f'  {"":>16}' + ''.join(f'  {COLUMNS[scheduling]:<36}' for scheduling in texts).rstrip()
        for row in next(iter(texts.values())):
            yield f'  {row:>16}' + ''.join(f'  {text[row]:<36}' for text in texts.values()).rstrip()
        for result in columns.values():
            if 'cores' in result:
                yield f'  {"cores":>16}  {_each(result["cores"], 2)}'
    if 'bare' in results and 'separate' in results:
        for scheduling in results['bare']:
            yield from _ratios_text(scheduling, results['separate'][scheduling], results['bare'][scheduling])


def _ratios_text(scheduling: str, robot: dict[str, Any], baseline: dict[str, Any]) -> Iterator[str]:
    yield f'\nrobot / bare nodes, {COLUMNS[scheduling]}'
    pairs = [('processor us per cycle', robot['us_per_cycle'], baseline['us_per_cycle'])]
    for share in ('p50', 'p99', 'p99.9'):
        times = (case['mdt_to_last_at_ms'][share] for case in (robot, baseline))
        pairs.append((f'MDT to last AT {share}', *times))
    for name, ours, theirs in pairs:
        yield f'  {name:>22}  {ours:.2f} / {theirs:.2f} = {ours / theirs:.2f}'

"""Distribution of runs to many processes: a local cluster of dask workers, or an existing cluster.

Runs are sent in batches. The batches depend on the sweep alone and each run on its own values, so the results do not
depend on the workers. A batch of a lost worker is repeated by another one.
"""

import atexit
import json
import logging
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from itertools import islice
from typing import Any, Self

import numpy as np
import psutil

from delta3_pacdrive import interrupts, simulation
from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.parameters import from_flat
from delta3_pacdrive.studies.fleet.sweep.single_run import Row, Runner
from delta3_pacdrive.studies.fleet.sweep.store import Store
from delta3_pacdrive.studies.fleet.sweep.study import Settings, Sweep
from delta3_pacdrive.studies.framework.provenance import versions
from delta3_pacdrive.studies.framework.study import OnProgress

BATCHES = 400  # approximate number for a large sweep
BATCH_MIN, BATCH_MAX = 5, 100  # runs per batch
AHEAD = 3  # queued batches per worker
CONNECT_S = 10.0
CLOSE_S = 1.0  # timeout for workers whose batch is no longer needed
GONE = 'the scheduler does not respond; completed runs are on disk, and the same command continues with the others'
LOGGERS = ('distributed', 'distributed.client', 'distributed.core')
QUIET = {
    'distributed.worker.daemon': True,
    'distributed.admin.tick.limit': '1h',
    'distributed.scheduler.allowed-failures': 10,
    'distributed.admin.low-level-log-length': 10,  # entries per batch, for debugging of dask
    'logging': {'distributed': 'error'},
}
Values = Mapping[str, Any]
Batch = Sequence[tuple[int, Mapping[str, Any]]]  # numbers of runs, and their values
_runners: dict[str, Runner] = {}  # of a worker, by digest of the sweep


def work_of(sweep: Sweep, values: Values, missing: Sequence[int]) -> Iterator[Batch]:
    """Yield batches of missing runs with their values."""
    for batch in batches(sweep, missing):
        yield [(number, values_in(values, number)) for number in batch]


def batches(sweep: Sweep, missing: Sequence[int]) -> Iterator[list[int]]:
    """Yield the numbers of missing runs in batches."""
    size = int(np.clip(sweep.runs // BATCHES, BATCH_MIN, BATCH_MAX))
    lacking = set(missing)
    for first in range(1, sweep.runs + 1, size):
        batch = [number for number in range(first, min(first + size, sweep.runs + 1)) if number in lacking]
        if batch:
            yield batch


def values_in(values: Values, number: int) -> dict[str, Any]:
    """Return the values of a run by varied quantity."""
    return {key: column[number - 1] for key, column in values.items()}


def to_row(values: Values) -> Row:
    """Return values in the format of the table: numbers, and other values as JSON."""
    row: Row = {}
    for key, value in values.items():
        plain = value.item() if isinstance(value, np.generic) else value
        is_number = isinstance(plain, (int, float)) and not isinstance(plain, bool)
        row[key] = float(plain) if is_number else json.dumps(plain)
    return row


def made_by_same(own: str, sweep: Sweep, batch: Batch) -> list[Row]:
    """Make a batch on a worker, which may have joined late; raises SweepError if its sources differ."""
    if (theirs := _versions()) != own:
        raise SweepError(f'a worker has {theirs}, but this is {own}')
    return made(sweep, batch)


@cache
def _versions() -> str:
    return versions()


def made(sweep: Sweep, batch: Batch) -> list[Row]:
    """Make a batch of runs on a worker."""
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    runner = _runners.get(sweep.digest)
    if runner is None:
        _runners.clear()
        runner = _runners[sweep.digest] = Runner(sweep)
    rows = []
    for number, values in batch:
        row = runner.run(number, values)
        head = {name: row.pop(name) for name in ('run', 'outcome', 'reason')}
        rows.append(head | to_row(values) | row)
    return rows


@contextmanager
def cluster(workers: int, scheduler: str) -> Iterator[Any]:
    """Yield a client of a local cluster, or of an existing one; raises SweepError."""
    import dask
    from distributed import Client, LocalCluster

    for name in LOGGERS:  # errors are reported by SweepError
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(QUIET), warnings.catch_warnings():
        warnings.simplefilter('ignore')
        if scheduler:
            try:
                client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
            except (OSError, ValueError) as error:
                raise SweepError(f'no cluster responds at {scheduler}: {error}') from error
            with client:
                require_same_version(client, scheduler)
                yield client
            return
        with interrupts.answered_by(lambda: None), _without_interrupts():
            own = LocalCluster(
                n_workers=workers or os.cpu_count() or 1,
                threads_per_worker=1,
                processes=True,
                host='127.0.0.1',
                dashboard_address='127.0.0.1:0',
                silence_logs=50,
            )
            client = Client(own, set_as_default=False)
        try:
            if interrupts.asked():
                raise interrupts.Interrupted(interrupts.asked())
            yield client
        finally:
            for one in (client, own):
                with suppress(Exception):  # completed runs are on disk
                    one.close(timeout=CLOSE_S)
            _end_workers()


def _end_workers() -> None:
    """Kill worker processes that are still busy with a batch."""
    from distributed.deploy import spec

    atexit.unregister(spec.close_clusters)  # would wait ten seconds for them
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            if any('spawn_main' in word for word in child.cmdline()):
                child.kill()


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Block Ctrl-C in child processes started meanwhile; it reaches a whole terminal, and this process ends them."""
    os.environ.setdefault('PYTHONWARNINGS', 'ignore')  # of the resource tracker after a kill
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited by children
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def require_same_version(client: Any, address: str) -> None:
    """Reject workers with other sources, whose results may differ; raises SweepError."""
    own = versions()
    try:
        found = client.run(versions)
    except Exception as error:  # a worker without this package may raise anything
        raise SweepError(
            f'the workers at {address} cannot compute: {type(error).__name__}: {error}'
        ) from error
    if not found:
        raise SweepError(f'the cluster at {address} has no worker')
    for worker, theirs in found.items():
        if theirs != own:
            raise SweepError(f'worker {worker} has {theirs}, but this is {own}')


def workers_of(client: Any) -> int:
    """Return the number of workers."""
    return len(client.scheduler_info(n_workers=-1)['workers'])


def make(client: Any, sweep: Sweep, work: Iterable[Batch], keep: Callable[[list[Row]], None]) -> None:
    """Make runs batch by batch; each batch is stored when it arrives.

    Raises
    ------
    SweepError
        A batch fails on every worker.

    """
    from distributed import as_completed
    from distributed.comm.core import CommClosedError

    waiting, own = iter(work), _versions()

    def submit(batch: Batch) -> Any:
        # arguments are sent with each batch: scattered data would be lost with its workers
        return client.submit(made_by_same, own, sweep, batch, pure=False)

    begun = [submit(batch) for batch in islice(waiting, AHEAD * max(workers_of(client), 1))]
    done = as_completed(begun, loop=client.loop)
    for future in done:
        try:
            rows = future.result()
        except SweepError:
            raise
        except Exception as error:  # errors of the cluster; those of a run are in its row
            if isinstance(error, CommClosedError) or client.status != 'running':
                raise SweepError(GONE) from error
            raise SweepError(f'the cluster failed: {type(error).__name__}: {error}') from error
        future.release()
        keep(rows)
        batch = next(waiting, None)
        if batch is not None:
            done.add(submit(batch))


class RunMaker:
    """Makes the runs of a sweep that are not stored yet; workers start with the first of them.

    ``rows`` are those of all stored runs by number. Raises SweepError if the folder contains another sweep.
    """

    def __init__(self, sweep: Sweep, store: Store, settings: Settings, on_progress: OnProgress) -> None:
        self._sweep, self._store, self._settings = sweep, store, settings
        self._on_progress, self._stack, self._client = on_progress, ExitStack(), None
        self.rows = store.open()
        self.made, self.workers, self.seconds = 0, 0, 0.0  # new runs, processes, and time without their start

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *reason: Any) -> None:
        self._stack.__exit__(*reason)

    def make(self, work: Iterable[Batch]) -> None:
        """Make runs batch by batch; raises SweepError."""
        if self._client is None:
            # compile once, before several workers would do so at the same time
            simulation.load_kernels(from_flat(dict(self._sweep.parameters)))
            self._on_progress('workers start', 0, 0)
            own = cluster(self._settings.workers, self._settings.scheduler)
            self._client = self._stack.enter_context(own)
            self.workers = workers_of(self._client)
        before, started = self.seconds, time.monotonic()

        def keep(batch: list[Row]) -> None:
            self._store.add(batch)
            self.rows.update((row['run'], row) for row in batch)
            self.made += len(batch)
            self.seconds = before + time.monotonic() - started
            kept, rate = len(self.rows), self.made / max(self.seconds, 1e-9)
            left_s = (self._sweep.runs - kept) / rate
            self._on_progress(f'runs ({rate:.1f} per second, {left_s:.0f} s left)', kept, self._sweep.runs)

        make(self._client, self._sweep, work, keep)

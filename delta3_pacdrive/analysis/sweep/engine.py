"""Runs on many processes: an own cluster of dask workers on this machine, or one that is up.

Batches of runs travel, not single ones. Which runs are in a batch depends on the sweep alone, and each run on its own
values, so that nobody sees in the table who has made it. A batch whose worker is lost is made by another one.
"""

import atexit
import json
import logging
import os
import signal
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import psutil

from delta3_pacdrive import interrupts
from delta3_pacdrive.analysis.provenance import versions
from delta3_pacdrive.analysis.sweep.design import Sweep
from delta3_pacdrive.analysis.sweep.single_run import Row, Runner
from delta3_pacdrive.errors import SweepError

BATCHES = 400  # that a large sweep has, about
BATCH_MIN, BATCH_MAX = 5, 100  # runs in one
AHEAD = 3  # batches that wait at each worker
CONNECT_S = 10.0
CLOSE_S = 1.0  # for workers in the middle of a batch, which nobody needs any more
GONE = 'the scheduler does not answer any more; what is done is on the disk, and the same command goes on with the rest'
LOGGERS = ('distributed', 'distributed.client', 'distributed.core')
QUIET = {
    'distributed.worker.daemon': True,
    'distributed.admin.tick.limit': '1h',
    'distributed.scheduler.allowed-failures': 10,
    'distributed.admin.low-level-log-length': 10,  # notes of each batch, for whoever looks for faults in dask
    'logging': {'distributed': 'error'},
}
Values = Mapping[str, Any]
Batch = Sequence[tuple[int, Mapping[str, Any]]]  # numbers of runs, and their values
_runners: dict[str, Runner] = {}  # of a worker, by the digests of sweeps


def work_of(sweep: Sweep, values: Values, missing: Sequence[int]) -> Iterator[Batch]:
    """Return the runs that are still missing, in batches, each run with its values."""
    for batch in batches(sweep, missing):
        yield [(number, values_in(values, number)) for number in batch]


def batches(sweep: Sweep, missing: Sequence[int]) -> Iterator[list[int]]:
    """Return the runs that are still missing, in batches."""
    size = int(np.clip(sweep.runs // BATCHES, BATCH_MIN, BATCH_MAX))
    lacking = set(missing)
    for first in range(1, sweep.runs + 1, size):
        batch = [number for number in range(first, min(first + size, sweep.runs + 1)) if number in lacking]
        if batch:
            yield batch


def values_in(values: Values, number: int) -> dict[str, Any]:
    """Return the values of a run, by what varies."""
    return {key: column[number - 1] for key, column in values.items()}


def told(values: Values) -> Row:
    """Return values as a row of the table has them: numbers, and all else as JSON."""
    row: Row = {}
    for key, value in values.items():
        plain = value.item() if isinstance(value, np.generic) else value
        is_number = isinstance(plain, (int, float)) and not isinstance(plain, bool)
        row[key] = float(plain) if is_number else json.dumps(plain)
    return row


def made_by_same(own: str, sweep: Sweep, batch: Batch) -> list[Row]:
    """Make the runs of a batch on a worker, which may have joined late; raises SweepError if its sources are others."""
    if (theirs := _versions()) != own:
        raise SweepError(f'a worker has {theirs}, but this is {own}')
    return made(sweep, batch)


@cache
def _versions() -> str:
    return versions()


def made(sweep: Sweep, batch: Batch) -> list[Row]:
    """Make the runs of a batch; a worker does this."""
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    runner = _runners.get(sweep.digest)
    if runner is None:
        _runners.clear()
        runner = _runners[sweep.digest] = Runner(sweep)
    rows = []
    for number, values in batch:
        row = runner.run(number, values)
        head = {name: row.pop(name) for name in ('run', 'outcome', 'reason')}
        rows.append(head | told(values) | row)
    return rows


@contextmanager
def cluster(workers: int, scheduler: str) -> Iterator[Any]:
    """Give a client of an own cluster, or of the one that is up; raises SweepError."""
    import dask
    from distributed import Client, LocalCluster

    for name in LOGGERS:  # what ends a sweep is told in one sentence
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(QUIET), warnings.catch_warnings():
        warnings.simplefilter('ignore')
        if scheduler:
            try:
                client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
            except (OSError, ValueError) as error:
                raise SweepError(f'no cluster answers at {scheduler}: {error}') from error
            with client:
                require_same_version(client, scheduler)
                yield client
            return
        with interrupts.answered_by(lambda: None), _deaf_children():
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
                with suppress(Exception):  # what is done is on the disk
                    one.close(timeout=CLOSE_S)
            _end_workers()


def _end_workers() -> None:
    """End workers of this process that are still in the middle of a batch, for which nobody waits any more."""
    from distributed.deploy import spec

    atexit.unregister(spec.close_clusters)  # would wait for them for ten seconds
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            if any('spawn_main' in word for word in child.cmdline()):
                child.kill()


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Let processes that are started meanwhile hear no Ctrl-C: it reaches all of a terminal, and this one ends them."""
    os.environ.setdefault('PYTHONWARNINGS', 'ignore')  # of what tidies up behind processes that were ended
    before = signal.pthread_sigmask(
        signal.SIG_BLOCK, {signal.SIGINT}
    )  # what is blocked is so in children as well
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def require_same_version(client: Any, address: str) -> None:
    """Refuse workers of other sources: their numbers would be others; raises SweepError."""
    own = versions()
    try:
        found = client.run(versions)
    except Exception as error:  # what a worker without this package raises is not bounded
        raise SweepError(
            f'the workers at {address} cannot compute: {type(error).__name__}: {error}'
        ) from error
    if not found:
        raise SweepError(f'the cluster at {address} has no worker')
    for worker, theirs in found.items():
        if theirs != own:
            raise SweepError(f'worker {worker} has {theirs}, but this is {own}')


def workers_of(client: Any) -> int:
    """Return how many workers there are."""
    return len(client.scheduler_info(n_workers=-1)['workers'])


def make(client: Any, sweep: Sweep, work: Iterable[Batch], keep: Callable[[list[Row]], None]) -> None:
    """Make runs batch by batch; each batch is kept as soon as it is there.

    Raises
    ------
    SweepError
        A batch cannot be made, whoever tries.

    """
    from distributed import as_completed
    from distributed.comm.core import CommClosedError

    waiting, own = iter(work), _versions()

    def submit(batch: Batch) -> Any:
        return client.submit(
            made_by_same, own, sweep, batch, pure=False
        )  # what is scattered is lost with its workers

    begun = [submit(batch) for batch in islice(waiting, AHEAD * max(workers_of(client), 1))]
    done = as_completed(begun, loop=client.loop)
    for future in done:
        try:
            rows = future.result()
        except SweepError:
            raise
        except Exception as error:  # of the cluster: those of a run are rows
            if isinstance(error, CommClosedError) or client.status != 'running':
                raise SweepError(GONE) from error
            raise SweepError(f'the cluster cannot go on: {type(error).__name__}: {error}') from error
        future.release()
        keep(rows)
        batch = next(waiting, None)
        if batch is not None:
            done.add(submit(batch))

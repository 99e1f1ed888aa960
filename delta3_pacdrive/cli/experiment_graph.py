"""Run one program with the nodes of the model and then of the robot, and record each into a bag."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.bringup import child
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording import trace_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from delta3_pacdrive.recording.trace import Trace
    from delta3_pacdrive.studies.framework.study import OnProgress


def bag_of(who: str, folder: Path) -> Path:
    """Return the path of the bag of a robot."""
    return folder / f'bag_{who}'


def require_no_bags(robots: Iterable[str], folder: Path) -> None:
    """Raise RunError if one of the bags exists."""
    for who in robots:
        if (bag := bag_of(who, folder)).exists():
            raise RunError(f'cannot record into {bag}: it exists already')


@dataclass(frozen=True)
class Graph:
    """Runs a program with the nodes of robots and records a bag of each into a folder.

    ``real_time_factor`` is bus time divided by wall time; 0: as fast as possible.
    """

    folder: Path
    real_time_factor: float

    def __call__(
        self,
        program: Path,
        robots: Mapping[str, Path],
        simulated: Mapping[str, Trace],
        on_progress: OnProgress,
    ) -> tuple[dict[str, Trace], list[str]]:
        """Return the traces, and notes on recording and on equality with the simulations.

        A bring-up requires a separate process, so each run is a ``delta3 run``. If one fails, all bags are removed.
        ``robots`` are parameter files by name; the bags are named ``bag_NAME``.

        Raises
        ------
        RunError
            A bag exists, or a run failed.
        TraceError
            A bag cannot be read.

        """
        require_no_bags(robots, self.folder)
        traces, notes = {}, []
        try:
            for done, (who, parameters) in enumerate(robots.items()):
                on_progress(f'nodes of the {who}', done, len(robots))
                bag = bag_of(who, self.folder)
                result = _run([
                    str(program), '--parameters', str(parameters), '--bag', str(bag),
                    '--real-time-factor', str(self.real_time_factor), '--json',
                ], who)  # fmt: skip
                if missing := result.get('bag_missing'):
                    notes.append(
                        f'the bag of the {who} lacks {missing} messages: the recorder could not keep up'
                    )
                traces[who] = trace_file.load(bag)
        except BaseException:
            for who in robots:
                shutil.rmtree(bag_of(who, self.folder), ignore_errors=True)
            raise
        return traces, notes + [f'{who}: {same_as(trace, simulated[who])}' for who, trace in traces.items()]


def same_as(graph: Trace, simulated: Trace) -> str:
    """Return a sentence on whether graph and simulation are bit-identical."""
    shared, of_graph, of_simulated = np.intersect1d(
        np.rint(graph.time_s / graph.meta['cycle_time_s']),
        np.rint(simulated.time_s / graph.meta['cycle_time_s']),
        return_indices=True,
    )
    differing = [
        name
        for name, values in graph.signals.items()
        if values[of_graph].tobytes() != simulated[name][of_simulated].tobytes()
    ]
    if differing:
        return f'nodes and simulation differ in {", ".join(differing)}'
    return f'nodes and simulation are bit-identical in {len(graph.signals)} signals of {len(shared)} cycles'


def _run(arguments: list[str], who: str) -> dict[str, Any]:
    """Run ``delta3 run`` and return its result; raises RunError."""
    process = child.start('run', *arguments, stderr=subprocess.PIPE)
    try:
        out, err = process.communicate()
    except BaseException:
        child.end(process)
        raise
    lines = out.strip().splitlines()
    try:
        result: dict[str, Any] = json.loads(lines[-1])
        if result['ok'] and process.returncode == 0:
            return result
        reason = result['error']
    except (IndexError, KeyError, TypeError, ValueError):
        last = err.strip().splitlines()[-1:] or [f'exit status {process.returncode}']
        reason = last[0].removeprefix('error: ')
    raise RunError(f'nodes of the {who}: {reason}')

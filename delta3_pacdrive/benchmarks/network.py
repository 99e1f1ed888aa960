"""``delta3 bench network``: a robot with its drives on another host, over links with delays, losses and gaps."""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from delta3_pacdrive.benchmarks.case import program_file
from delta3_pacdrive.benchmarks.two_hosts import Conditions, Host, Link, end, two_hosts
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.studies.framework.study import OnProgress, silent

MS = 1e-3
START = (
    'import sys; from delta3_pacdrive.ros.nodes import start; sys.argv[0] = sys.argv.pop(1); '
    'sys.exit(getattr(start, sys.argv[0])())'
)
OPERATOR = 'delta3_pacdrive.benchmarks.network_operator'
DRIVES = (1, 2, 3)
ON_REQUEST = 'motion.start_cycle:=-1'
GAP_AFTER_S = 0.5  # after the start of motion


@dataclass(frozen=True)
class Case:
    """A link, and an optional gap of the connection while the robot moves."""

    conditions: Conditions = field(default_factory=Conditions)
    gap_s: float = 0.0


CASES = {
    'no delay': Case(),
    'delay 0.1 ms': Case(Conditions(0.1 * MS)),
    'delay 0.5 ms': Case(Conditions(0.5 * MS)),
    'delay 1 ms': Case(Conditions(1.0 * MS)),
    'delay 2 ms': Case(Conditions(2.0 * MS)),
    'delay 5 ms': Case(Conditions(5.0 * MS)),
    'delay 0.5 ms, jitter 0.4 ms, overtaking': Case(Conditions(0.5 * MS, 0.4 * MS)),
    'loss 0.01 %': Case(Conditions(loss=1e-4)),
    'loss 1 %': Case(Conditions(loss=1e-2)),
    'loss 5 %': Case(Conditions(loss=5e-2)),
    'every twentieth packet twice': Case(Conditions(duplicate=5e-2)),
    'gone for 10 ms': Case(gap_s=0.01),
    'gone for 100 ms': Case(gap_s=0.1),
    'gone for 1 s': Case(gap_s=1.0),
    'gone for 10 s': Case(gap_s=10.0),
}


def node(host: Host, name: str, *values: str, **options: Any) -> 'subprocess.Popen[str]':
    """Start a node of the robot on a host, with parameters such as ``axis:=1``."""
    words = [word for value in values for word in ('-p', value)]
    command = [sys.executable, '-P', '-c', START, name, '--ros-args', *words]
    if name == 'mc4_drive':
        command += ['-r', f'__node:=mc4_drive_{values[0].partition(":=")[2]}']
    return host.start(command, **options)


@contextmanager
def robot(
    near: Host, far: Host, factor: float, *values: str, waits: bool = False, **options: Any
) -> Iterator[None]:
    """Run a robot with its drives on the far host, at a real-time factor.

    ``values`` are parameters of all its nodes; with ``waits`` no bus cycle starts without a program.
    """
    of_task = f'real_time_factor:={factor!r}', f'wait_for_program:={str(waits).lower()}'
    nodes = [node(far, 'mc4_drive', f'axis:={axis}', *values, **options) for axis in DRIVES]
    nodes += [
        node(near, 'plant', *values, **options),
        node(near, 'transformation_task', *of_task, *values, **options),
    ]
    try:
        yield
    finally:
        end(nodes)


def measure(cases: Sequence[str] | None, seconds: float, show: OnProgress = silent) -> dict[str, Any]:
    """Return the result of each case; raises RunError if two hosts are not possible."""
    names = list(cases or CASES)
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder, two_hosts() as (near, far, link):
        program = program_file(seconds, folder)
        quiet: dict[str, Any] = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.DEVNULL}
        with robot(near, far, 1.0, ON_REQUEST, **quiet):
            planner = node(near, 'unit_robot', ON_REQUEST, **quiet)
            pipes = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE}
            operator = near.start([sys.executable, '-P', '-m', OPERATOR], **pipes)
            try:
                next_line(operator, 'ready')
                for done, name in enumerate(names):
                    show(name, done, len(names))
                    found[name] = drive_over(operator, link, CASES[name], program)
            finally:
                end([operator, planner])
    return {'seconds': seconds, 'cases': found}


def drive_over(operator: 'subprocess.Popen[str]', link: Link, case: Case, program: Path) -> dict[str, Any]:
    """Run a program over a link; return its result, and the recovery time."""
    link.set(case.conditions)
    if operator.stdin is not None:
        operator.stdin.write(f'{program}\n')
        operator.stdin.flush()
    next_line(operator, 'moving')
    if case.gap_s:
        time.sleep(GAP_AFTER_S)
        link.set(Conditions(down=True))
        time.sleep(case.gap_s)
        link.set(case.conditions)
    run = next_line(operator, 'cycles')
    link.set(Conditions())
    return run | next_line(operator, 'back_s')


def next_line(operator: 'subprocess.Popen[str]', key: str) -> dict[str, Any]:
    """Return the next line of the operator, which must contain a key; raises RunError."""
    text = operator.stdout.readline() if operator.stdout is not None else ''
    line = dict(json.loads(text)) if text else {}
    if key not in line:
        raise RunError(f'the operator of the robot has ended: {line.get("error", "without a message")}')
    return line


def text(result: dict[str, Any]) -> Iterator[str]:
    """Yield one line per case."""
    yield (
        f'drives on another host, {result["seconds"]:g} s of motion in real time; delays are those of one way'
    )
    yield f'{"link":>40} {"overruns":>16} {"slip":>9} {"lost":>5} {"bus / wall":>10} {"back in":>8}  fault'
    for name, case in result['cases'].items():
        cycles, overruns = case['cycles'], case['overruns']
        share = overruns / max(cycles, 1)
        pace = case['bus_time_s'] / max(case['wall_time_s'], 1e-3)
        yield (
            f'{name:>40} {overruns:7d} {share:8.2%} {case["slip_s"]:7.3f} s {case["lost_telegrams"]:5d} '
            f'{pace:10.3f} {case["back_s"]:6.1f} s  {case["fault"] or "none"}'
        )

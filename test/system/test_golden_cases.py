"""The golden runs (``test/golden``) on the node graph: the bits of every signal are those of the simulation.

Two of them run always; all others, which take two minutes, are ``long``.
"""

import importlib.util
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_file
from thoroughness import some

SPEC = importlib.util.spec_from_file_location('golden_make', Path(__file__).parents[1] / 'golden' / 'make.py')
assert SPEC is not None
assert SPEC.loader is not None
make = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(make)

IN_EACH_RUN = ('winding shorted', 'mains dip', 'fan blocked')
NOT_ON_THE_BUS = {'arm_angle', 'tcp_true', 'torque_command'}


def file_of(changes: dict[str, Any]) -> str:
    """Return a parameter file with changes."""
    groups: dict[str, Any] = {}
    for name, value in changes.items():
        group, _, key = name.partition('__')
        groups.setdefault(group, {})[key] = value
    return yaml.safe_dump({'/**': {'ros__parameters': groups}})


@pytest.mark.parametrize('name', some(make.CASES, IN_EACH_RUN))
def test_a_golden_run_has_the_same_bits_on_the_graph(
    name: str,
    delta3: Callable[..., subprocess.CompletedProcess[str]],
    tmp_path: Path,
    nothing_left_behind: None,
) -> None:
    program, changes, source = make.CASES[name]
    robot = parameters.load(source).replace(**changes)
    if not isinstance(program, str):
        (tmp_path / 'program.yaml').write_text(json.dumps(program))
        program = str(tmp_path / 'program.yaml')
    (tmp_path / 'changes.yaml').write_text(file_of(changes))
    # with the file of the thesis in front nothing else decides which controller the run has
    files = '+'.join(
        ['delta3', *([source] if source else []), *([str(tmp_path / 'changes.yaml')] if changes else [])]
    )
    simulated = simulation.run(programs.load(program, robot.motion), robot)
    options = ['--single-process', '--real-time-factor', '0', '--parameters', files]
    done = delta3('run', program, '--bag', tmp_path / 'bag', *options)
    stopped = simulated.meta['stopped']
    assert done.returncode == int(bool(stopped)), done.stderr
    assert stopped in done.stderr
    recorded = trace_file.load(tmp_path / 'bag')
    cycles = [np.rint(one.time_s / robot.bus.cycle_time_s).astype(int) for one in (simulated, recorded)]
    common, ours, theirs = np.intersect1d(*cycles, return_indices=True)
    # a robot that has stopped goes on until all are without torque, a simulation ends with it
    assert (
        len(common) == min(len(simulated.time_s), len(recorded.time_s)) >= 300 * 1e-3 / robot.bus.cycle_time_s
    )
    for signal in simulated.signals.keys() & recorded.signals.keys():
        np.testing.assert_array_equal(recorded[signal][theirs], simulated[signal][ours], err_msg=signal)
    assert simulated.signals.keys() - recorded.signals.keys() <= NOT_ON_THE_BUS

"""``delta3 bench simulate`` and ``delta3 bench kinematics``: speed without ROS, against MuJoCo and the targets."""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive import dynamics, kinematics, simulation
from delta3_pacdrive import parameters as core
from delta3_pacdrive.benchmarks.case import program_file
from delta3_pacdrive.bringup import child
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import capability
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.scene.mjcf import mjcf

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

REAL_TIME_FACTOR_AIM = 100.0
START_AIM_S = 2.0
POSES_PER_S_AIM = {'inverse': 10e6, 'forward': 5e6}
POSES = 1_000_000
ROUNDS = 7
FALL_S = 0.05  # of the comparison with MuJoCo: motion under gravity and a constant torque
PUSH_N_M = (6.0, -2.0, 0.0)


def measure_simulation(seconds: float) -> dict[str, Any]:
    """Measure speed and accuracy of the whole robot, and compare the mechanism with MuJoCo."""
    robot = core.load()
    simulation.precompile(robot)
    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder:
        program = programs.load(program_file(seconds, folder), robot.motion)
    speeds = {}
    for name, changed in {
        'exchange 1 ms': robot,
        'exchange 250 us': robot.replace(bus__exchange_period_s=250e-6),
        'exchange 125 us': robot.replace(bus__exchange_period_s=125e-6),
        'rich plant': core.load('rich'),
    }.items():
        simulation.precompile(changed)
        spent_s, trace = _spent(partial(simulation.run, program, changed))
        speeds[name] = len(trace.time_s) * changed.bus.cycle_time_s / spent_s
    return {
        'bus_time_s': len(trace.time_s) * robot.bus.cycle_time_s,
        'real_time_factors': speeds,
        'start_s': _start_s(),
        **_exchange_difference(robot),
        'mechanism': _compare_with_mujoco(robot),
    }


def measure_kinematics() -> dict[str, Any]:
    """Measure the speed of array kinematics on one core."""
    robot = core.load()
    k = robot.kinematics
    generator = np.random.default_rng(1)
    low, high = (-0.25, -0.25, -0.95), (0.25, 0.25, -0.75)
    points = generator.uniform(low, high, (POSES, 3))
    theta = kinematics.inverse(points, k)
    actions: dict[str, Callable[[], Any]] = {
        'inverse': lambda: kinematics.inverse(points, k),
        'forward': lambda: kinematics.forward(theta, k),
        'jacobian': lambda: kinematics.jacobian(theta, points, k),
        'singularity': lambda: kinematics.singularity(theta, points, k),
        'capability': lambda: capability(points, robot),
    }
    result: dict[str, Any] = {'poses': POSES, 'poses_per_s': {}}
    for name, action in actions.items():
        action()
        rates = [POSES / _spent(action)[0] for _ in range(ROUNDS)]
        result['poses_per_s'][name] = {'median': float(np.median(rates)), 'best': max(rates)}
    back = kinematics.forward(theta, k)
    result['round_trip_max_m'] = float(np.abs(back - points).max())
    return result


def _spent(action: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time [s] of an action in this single-threaded process, and its result."""
    started = time.process_time()
    outcome = action()
    return time.process_time() - started, outcome


def _start_s() -> float:
    """Return the wall time [s] of ``delta3 simulate`` from start to result, without the run itself."""
    started = time.perf_counter()
    output, _ = child.start('simulate', '--json', stderr=subprocess.DEVNULL).communicate()
    return time.perf_counter() - started - float(json.loads(output)['wall_time_s'])


def _exchange_difference(robot: Parameters) -> dict[str, float]:
    """Return the TCP difference of the default exchange period from the exact reference."""
    once = programs.load('experiment1', robot.motion)
    normal = simulation.run(once, robot)
    exact = simulation.run(once, robot.replace(bus__exchange_period_s=125e-6))
    difference = np.linalg.norm(normal['tcp_actual'] - exact['tcp_actual'], axis=1)
    return {
        'tcp_difference_max_m': float(difference.max()),
        'tcp_difference_rms_m': float(np.sqrt((difference**2).mean())),
    }


def _compare_with_mujoco(robot: Parameters) -> dict[str, Any]:
    """Measure step cost and final TCP of the mechanism alone, starting at rest; without MuJoCo only its own cost."""
    free = robot.replace(motor__static_friction_n_m=0.0, motor__viscous_friction_n_m_s_rad=0.0)
    step_s = free.drive.current_period_s
    steps = round(FALL_S / step_s)
    home = np.array(free.motion.home_m)
    torque = dynamics.gravity(kinematics.inverse(home, free.kinematics), free) + np.array(PUSH_N_M)
    own_s, own_tcp = _own_mechanism(free, torque, steps)
    result: dict[str, Any] = {'step_s': step_s, 'own_us_per_step': own_s / steps * 1e6}
    try:
        import mujoco
    except ImportError:
        return result
    model = mujoco.MjModel.from_xml_string(mjcf(free, step_s=step_s))
    data = mujoco.MjData(model)
    spent = []
    for _ in range(ROUNDS):
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = torque
        spent.append(_spent(partial(mujoco.mj_step, model, data, nstep=steps))[0])
    mujoco.mj_kinematics(model, data)
    apart = float(np.linalg.norm(data.site('tcp').xpos - own_tcp))
    return result | {
        'mujoco': mujoco.__version__,
        'mujoco_us_per_step': float(np.median(spent)) / steps * 1e6,
        'motion_m': float(np.linalg.norm(own_tcp - home)),
        'tcp_apart_m': apart,
    }


def _own_mechanism(robot: Parameters, torque: Floats, steps: int) -> tuple[float, Floats]:
    """Return the median processor time [s] of the steps, and the final TCP."""
    current = torque / (robot.dynamics.gear_ratio * robot.motor.torque_constant_n_m_a)
    currents = np.tile(current, (steps, 1))
    spent = []
    for _ in range(ROUNDS):
        plant = Plant(robot)
        plant.state['brake_released'], plant.state['brake_locked'] = 1, 0
        plant.state['current'] = current
        spent.append(_spent(partial(plant.advance, currents, [True] * 3))[0])
    return float(np.median(spent)), plant.tcp()


def simulation_text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text."""
    rows = [
        (name, f'{factor:.1f} x real time, {factor / REAL_TIME_FACTOR_AIM:.2f} of the aim')
        for name, factor in result['real_time_factors'].items()
    ]
    start = result['start_s']
    rows += [
        (
            'start',
            f'{start:.2f} s from command to run, kernels cached; {start / START_AIM_S:.2f} of the bound',
        ),
        (
            'exchange',
            f'1 ms against 125 us, experiment 1: TCP differs by {result["tcp_difference_max_m"] * 1e6:.2f} um max, '
            f'{result["tcp_difference_rms_m"] * 1e6:.2f} um rms',
        ),
    ]
    mechanism = result['mechanism']
    own = mechanism['own_us_per_step']
    rows.append(('mechanism', f'{own:.2f} us per step of {mechanism["step_s"] * 1e6:g} us'))
    if 'mujoco' in mechanism:
        other = mechanism['mujoco_us_per_step']
        rows += [
            ('MuJoCo', f'{other:.2f} us per step: own / MuJoCo = {own / other:.2f}'),
            (
                '',
                f'TCP {mechanism["tcp_apart_m"] * 1e6:.1f} um apart after {mechanism["motion_m"] * 1e3:.1f} mm '
                f'in {FALL_S:g} s',
            ),
        ]
    else:
        rows.append(('MuJoCo', 'not installed: pip install mujoco'))
    for name, text in rows:
        yield f'{name:>16}  {text}'


def kinematics_text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text."""
    for name, rates in result['poses_per_s'].items():
        aim = POSES_PER_S_AIM.get(name)
        share = f', {rates["median"] / aim:.2f} of the aim' if aim else ''
        yield (
            f'{name:>16}  {rates["median"] / 1e6:.1f} M poses/s median, {rates["best"] / 1e6:.1f} best{share}'
        )
    yield f'{"round trip":>16}  {result["round_trip_max_m"]:.1e} m at most, {result["poses"]} poses'

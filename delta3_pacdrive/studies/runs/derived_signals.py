"""Signals computed from those of a run: virtual master, velocity and acceleration of the TCP.

The master is the distance travelled by the command along its path (section 6), accumulated over all moves. It is
available wherever the command is, in recordings and in simulations.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.recording.signals import FORCES, JOINT_MOTION
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs.run_signals import (
    SLOPE_S,
    cycles_of,
    derivatives,
    energy_of_round,
    gears_of_round,
    noted_cycle,
    positive,
    temperatures_of_round,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from delta3_pacdrive.numerics.types import Floats
    from delta3_pacdrive.parameters import Parameters

GAP_CYCLES = 1000  # longer gaps are shortened to this many rows
LOST_MAX = 5  # missing cycles in a row that derivatives bridge


def added(trace: Trace) -> Trace:
    """Return a trace with all signals of ``DERIVED_SIGNALS`` that can be computed.

    Raises
    ------
    TraceError
        The trace contains no cycle time.

    """
    return replace(trace, signals=trace.signals | (derived(trace) if len(trace.time_s) else {}))


def derived(trace: Trace) -> dict[str, Floats]:
    """Return the derived signals missing in a trace, each of shape (cycles, 3); missing cycles are bridged."""
    period, cycles = positive(trace, 'cycle_time_s'), cycles_of(trace)
    rows = _rows(cycles)
    found = {}
    if 'tcp_command' in trace.signals and 'master' not in trace.signals:
        start = int(np.interp(noted_cycle(trace, 'start_cycle') or 0, cycles, rows))
        found['master'] = _master(_without_gaps(trace['tcp_command'], rows), period, start)[rows]
    if 'tcp_actual' in trace.signals:
        place = _without_gaps(trace['tcp_actual'], rows, LOST_MAX)
        wide = max(1, round(SLOPE_S / period))
        found['tcp_velocity'] = _derivatives(place, period, 1)[0][rows]
        found['tcp_acceleration'] = _derivatives(place, period, wide)[1][rows]
    of_plant = all(name in trace.signals for name in ('coupling_torque', 'shaft_speed', 'current_mean'))
    if of_plant and (robot := _robot_of(trace)) is not None:
        found['gear_torque'] = gear_torques(trace, rows, period, robot)
    return {name: values for name, values in found.items() if name not in trace.signals}


def loads_of_round(trace: Trace, robot: Parameters, repeat: int) -> dict[str, Any]:
    """Return loads of a run for JSON, as far as they are known.

    They are the energy of a round, the load of the gears, the temperatures of the motors after a shift, and the load
    of a modelled supply.
    """
    from delta3_pacdrive.studies.runs.run_supply import supply_of_run  # slow import: needs the compiler

    found = {
        'energy': energy_of_round(trace, robot, repeat),
        'gears': gears_of_round(added(trace), robot),
        'temperature': temperatures_of_round(trace, robot),
        'supply': supply_of_run(trace, robot),
    }
    return {name: asdict(one) for name, one in found.items() if one is not None}


def on_request(trace: Trace, names: Collection[str]) -> dict[str, Floats]:
    """Return the named signals that are computed on request only, each of shape (cycles, columns), if possible."""
    found = {}
    if 'tcp_speed' in names and 'tcp_velocity' in trace.signals:
        found['tcp_speed'] = np.linalg.norm(trace['tcp_velocity'], axis=1, keepdims=True)
    if wanted := [name for name in JOINT_MOTION if name in names and name not in trace.signals]:
        found |= {name: values for name, values in _joint_motion(trace).items() if name in wanted}
    if wanted := [name for name in FORCES if name in names and name not in trace.signals]:
        found |= {name: values for name, values in _forces(trace).items() if name in wanted}
    changes = trace.meta.get('drive_status')
    if 'status_word' in names and changes:
        found['status_word'] = np.column_stack([_words(cycles_of(trace), own) for own in changes])
    return found


def _joint_motion(trace: Trace) -> dict[str, Floats]:
    """Return joint motion through the Jacobian; empty if the trace contains no command or no robot parameters.

    The command is at rest before the first cycle and after the last one.
    """
    from delta3_pacdrive.control.cycle.joint_motion import joint_motions  # slow import: needs the compiler
    from delta3_pacdrive.kinematics import geometry

    robot = _robot_of(trace)
    if robot is None or 'tcp_command' not in trace.signals:
        return {}
    period = positive(trace, 'cycle_time_s')
    rows = _rows(cycles_of(trace))
    places = np.pad(_without_gaps(trace['tcp_command'], rows), ((1, 1), (0, 0)), mode='edge')
    return {name: values[rows] for name, values in joint_motions(places, period, geometry(robot)).items()}


def _robot_of(trace: Trace) -> Parameters | None:
    """Return the parameters of a recording; None if they are missing, or of another version."""
    from delta3_pacdrive.parameters import from_flat

    try:
        return from_flat(dict(trace.meta['parameters']), 'the parameters of the recording')
    except (ParameterError, LookupError, TypeError, ValueError):
        return None


def gear_torques(trace: Trace, rows: NDArray[np.int64], period_s: float, robot: Parameters) -> Floats:
    """Return the torques at the outputs of the gears [N m], (cycles, 3); ``rows`` are the grid rows of the cycles.

    Rigid gears: k_r d + (A_bar - I_rotor) thetaddot (4.31), with brakes and any payload, without end stops. Elastic
    gears vibrate at frequencies that differences of the shaft speed do not resolve: mean of the cycle
    k_r (K_m I - friction) - I_rotor thetaddot, without brakes.
    """
    from delta3_pacdrive.dynamics import rotor_inertia  # slow import: needs the compiler
    from delta3_pacdrive.robot.motor import friction_torques

    ratio, motor, rotor = robot.dynamics.gear_ratio, robot.motor, rotor_inertia(robot)
    speed = _without_gaps(trace['shaft_speed'], rows, LOST_MAX)
    if not robot.rich.effects.gear:
        acceleration = _derivatives(speed / ratio, period_s, 1)[0][rows]
        inertia = robot.drive.observer_arm_inertia_kg_m2 - rotor
        return np.asarray(ratio * trace['coupling_torque'] + inertia * acceleration)
    change = np.diff(speed, axis=0, append=speed[-1:])[rows]
    mean = speed[rows] + 0.5 * change
    torque = motor.torque_constant_n_m_a * trace['current_mean'] - friction_torques(mean, motor)
    return np.asarray(ratio * torque - rotor * change / ratio / period_s)


def _forces(trace: Trace) -> dict[str, Floats]:
    """Return the forces of the commanded motion; empty if the trace contains no command or no robot parameters.

    The payload is that of the trace if it contains it, otherwise that of the parameters.
    """
    from delta3_pacdrive.planning.limits.joint_forces import joint_forces  # slow import: needs the compiler

    robot = _robot_of(trace)
    if robot is None or 'tcp_command' not in trace.signals:
        return {}
    period, rows = positive(trace, 'cycle_time_s'), _rows(cycles_of(trace))
    place = _without_gaps(trace['tcp_command'], rows)
    speed, acceleration = _derivatives(place, period, 1)
    payload = trace['payload'][:, 0] if 'payload' in trace.signals else None
    found = joint_forces(place[rows], speed[rows], acceleration[rows], robot, payload)
    return {
        'rod_force': found.larger_rods_n,
        'spring_force': found.spring_n,
        'plate_load': np.column_stack([found.plate_axial_n, found.plate_moment_n_m]),
    }


def _rows(cycles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return grid rows of bus cycles; long gaps are shortened to ``GAP_CYCLES`` rows."""
    return np.concatenate([[0], np.cumsum(np.minimum(np.diff(cycles), GAP_CYCLES))])


def _words(cycles: NDArray[np.int64], changes: Sequence[Sequence[int]]) -> Floats:
    """Return the status word of a drive in each bus cycle from its changes; the first word applies before them."""
    since, words = np.array(changes, dtype=np.float64).reshape(-1, 2).T
    return np.asarray(words[np.searchsorted(since, cycles, side='right').clip(1) - 1])


def _master(command: Floats, period_s: float, start: int) -> Floats:
    """Distance [m] from the row of the start, speed and acceleration along the path, shape (n, 3)."""
    steps = np.linalg.norm(np.diff(command, axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    distance -= distance[start]
    speed, acceleration = _derivatives(distance[:, None], period_s, 1)
    return np.column_stack([distance, speed, acceleration])


def _without_gaps(values: Floats, rows: NDArray[np.int64], longest: int = GAP_CYCLES) -> Floats:
    """Interpolate values linearly on every row; nan in gaps longer than ``longest``."""
    every = np.arange(rows[-1] + 1)
    known = np.isfinite(values).all(axis=1)
    rows, values = rows[known], values[known]
    if not len(rows):
        return np.full((len(every), values.shape[1]), np.nan)
    found = np.column_stack([np.interp(every, rows, column) for column in values.T])
    after = np.searchsorted(rows, every).clip(0, len(rows) - 1)
    before = np.searchsorted(rows, every, side='right').clip(1) - 1
    found[(rows[after] - rows[before] > longest + 1) & (every != rows[before])] = np.nan
    return found


def _derivatives(values: Floats, period_s: float, half: int) -> tuple[Floats, Floats]:
    """First and second derivative; the robot is at rest before the first and after the last row."""
    padded = np.pad(values, ((half, half), (0, 0)), mode='edge')
    first, second = derivatives(padded, period_s, half)
    return first[half:-half], second[half:-half]

"""Input of the Jacobian experiments: poses, velocities and accelerations of TCP and joints on a trajectory.

The trajectory of a program consists of the set points of the transformation task before rounding to increments. As the
controller of 11.2, this module differentiates per bus cycle: central and second differences of set points one cycle
apart, for TCP and joints alike. Recorded positions are multiples of increments, whose second difference over 1 ms is
0.4 rad/s^2; they are differentiated by a parabola through the samples within ``WINDOW`` cycles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from delta3_pacdrive import kinematics, simulation
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs.inputs import is_recording, program_name
from delta3_pacdrive.studies.runs.run_signals import derivatives, program_part

WINDOW = 4  # cycles on each side, used by the parabola through recorded samples
UNEVEN = 0.05  # largest deviation of a sample from the grid, in sample times
MOVING_RAD_S = 1e-3  # least peak velocity of the fastest joint


class Signals(StrEnum):
    """Signals of TCP and joints that are compared."""

    COMMAND = 'command'  # set points
    ACTUAL = 'actual'  # encoders and motor speeds; TCP by forward kinematics of the encoders
    TRUE = 'true'  # TCP from an external measurement or the simulation


@dataclass(frozen=True)
class Thesis:
    """Data of an experiment in the thesis (11.2)."""

    number: int
    first_figure: int
    deviation_percent: float  # largest deviation of a joint velocity


# 11.2.4: 10 % in "1 and 2", 5 % in 2; the former must mean 1 and 3
EXPERIMENTS = {
    'experiment1': Thesis(1, 25, 10.0),
    'experiment2': Thesis(2, 32, 5.0),
    'experiment3': Thesis(3, 39, 10.0),
}


@dataclass(frozen=True)
class Motion:
    """Trajectory with n samples; arrays (n, 3)."""

    name: str
    source: str  # signals and their differentiation, as text
    period_s: float  # sample time; samples are missing in gaps of a recording
    time_s: Floats  # from the start of the program, shape (n,)
    theta: Floats  # arm angles [rad]; the recorded motion of the joints is the reference of 11.2
    thetadot: Floats
    thetaddot: Floats
    tcp: Floats  # m
    tcp_velocity: Floats
    tcp_acceleration: Floats
    thesis: Thesis | None = None

    def __post_init__(self) -> None:
        """Reject a trajectory without motion."""
        if not np.abs(self.thetadot).max(initial=0.0) > MOVING_RAD_S:
            raise TraceError(f'{self.name}: no joint moves faster than {MOVING_RAD_S:g} rad/s')


def load(text: str, robot: Parameters, signals: Signals) -> Motion:
    """Return the motion of an experiment number, a program, a trace (.npz, .csv) or the folder of a bag.

    Raises
    ------
    Delta3Error
        The input cannot be read, is invalid, lacks signals, or contains no motion.

    """
    if is_recording(text):
        path = Path(text)
        trace = trace_file.load(path)
        return of_trace(trace, robot, signals, path.stem)
    name = program_name(text)
    program, thesis = programs.load(name, robot.motion), EXPERIMENTS.get(Path(name).stem)
    label = f'experiment {thesis.number}' if thesis else Path(name).stem
    if signals is Signals.COMMAND:
        return of_program(program, robot, label, thesis)
    return of_trace(simulation.run(program, robot), robot, signals, label, thesis)


def of_program(program: Program, robot: Parameters, name: str, thesis: Thesis | None = None) -> Motion:
    """Return the set points of a program in every bus cycle, not rounded to increments.

    Raises
    ------
    ProgramError
        The program is invalid.

    """
    placed = simulation.placed(robot, program)
    plan = program_planner.plan(program, placed.motion.home_m, placed).plan
    period = robot.bus.cycle_time_s
    tcp = sample_plan(plan, period * np.arange(int(plan.duration_s / period) + 1))[0]
    theta = kinematics.inverse(tcp, robot.kinematics)
    return _motion(
        name=name,
        source='set points of the bus cycles, central and second differences over one cycle each way',
        period_s=period,
        time_s=np.arange(len(tcp), dtype=np.float64) * period,
        signals=(theta, *derivatives(theta, period), tcp, *derivatives(tcp, period)),
        thesis=thesis,
    )


def of_trace(
    trace: Trace, robot: Parameters, signals: Signals, name: str, thesis: Thesis | None = None
) -> Motion:
    """Return the motion of a recording, restricted to the program if its cycles are known.

    Raises
    ------
    TraceError
        A signal is missing, the samples are uneven or too few, or the robot had another gear ratio.

    """
    part, period = _evenly(trace, name)
    gear = robot.dynamics.gear_ratio
    if (own := part.meta.get('gear_ratio', gear)) != gear:
        raise TraceError(f'{name} is of a robot with gear ratio {own}, the parameters have {gear:g}')
    if signals is Signals.TRUE:
        tcp = part['tcp_measured' if 'tcp_measured' in part.signals else 'tcp_true']
        angles = part['arm_angle'] if 'arm_angle' in part.signals else part['motor_position'] / gear
    else:
        which = 'motor_command' if signals is Signals.COMMAND else 'motor_position'
        tcp, angles = part[f'tcp_{signals}'], part[which] / gear
    speed, acceleration = derivatives(angles, period, WINDOW)
    if signals is Signals.ACTUAL:
        speed = np.asarray(part['motor_speed'] / gear)
        acceleration = derivatives(speed, period, WINDOW)[0]
    return _motion(
        name=name,
        source=f'{signals} signals, parabola through {2 * WINDOW + 1} samples'
        + (', joint velocity as the drives tell it' if signals is Signals.ACTUAL else ''),
        period_s=period,
        time_s=part.time_s,
        signals=(angles, speed, acceleration, tcp, *derivatives(tcp, period, WINDOW)),
        thesis=thesis,
    )


def _evenly(trace: Trace, name: str) -> tuple[Trace, float]:
    """Return the program in a trace on an even grid, nan for missing samples, and the sample time [s]."""
    if len(trace.time_s) < 2 * WINDOW + 1:
        raise TraceError(f'{name} has {len(trace.time_s)} samples, but needs {2 * WINDOW + 1}')
    whole = trace.time_s[-1] - trace.time_s[0]
    period = float(whole / np.rint(whole / np.median(np.diff(trace.time_s))))
    offset = trace.time_s[0] if trace.meta.get('start_cycle') is None else 0.0
    steps = (trace.time_s - offset) / period
    if np.abs(steps - np.rint(steps)).max() > UNEVEN:
        raise TraceError(f'the samples of {name} are not evenly spaced')
    meta = trace.meta | {'cycle_time_s': period}
    return program_part(Trace(trace.time_s - offset, trace.signals, meta)), period


def _motion(
    name: str,
    source: str,
    period_s: float,
    time_s: Floats,
    signals: Sequence[Floats],
    thesis: Thesis | None,
) -> Motion:
    """Return the samples in which all signals, in the order of the fields of ``Motion``, are finite."""
    known = np.isfinite(np.concatenate(signals, axis=1)).all(axis=1)
    theta, thetadot, thetaddot, tcp, velocity, acceleration = (values[known] for values in signals)
    return Motion(
        name=name,
        source=source,
        period_s=period_s,
        time_s=time_s[known],
        theta=theta,
        thetadot=thetadot,
        thetaddot=thetaddot,
        tcp=tcp,
        tcp_velocity=velocity,
        tcp_acceleration=acceleration,
        thesis=thesis,
    )

"""Converts a sampled trajectory into a program that plays it as the reference.

The arm angles, or those computed from the TCP, are interpolated by cubic splines over time, so the acceleration is
continuous. Values rounded more coarsely than the resolution of the drives are fitted by a smoothing spline within
their rounding. Points of the program lie on the splines, with speed and acceleration, and a quintic between them
follows the splines within ``WITHIN_RAD``. Phases at rest become dwells. The program is planned and checked like any
other.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.interpolate import BPoly, CubicSpline, PPoly, splrep
from scipy.signal import butter, sosfiltfilt

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths.move import MOVES_MAX
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.file_reader import TIME_MAX_S
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.tables import column_file
from delta3_pacdrive.recording.trace import Trace

WITHIN_RAD = 3.7e-7  # deviation from the splines: one increment at the arm
SMOOTHING_ORDER, SETTLED_PERIODS = 2, 3.0  # order of the low pass, and its settling time in periods
STILL_RAD = 1e-9  # largest step between two samples at rest
STANDING_S, STANDING_SAMPLES = 0.05, 24  # minimum length of a rest that becomes a dwell
SETTLED_SAMPLES = 10  # at either end of a rest, left to the motion for its acceleration to decay
ENDS_AT_REST = 0.05  # of the largest speed: apparent speed accepted at the start and at the end
INSTANTS_MIN = 5
POINTS_MAX = 10_000  # between two rests; a program file with more would be too large
COUNTED_MAX = 20 * POINTS_MAX  # points at which the search ends
INSIDE = np.linspace(0.0, 1.0, 12)[1:-1]  # of a piece: where it is compared with the spline
# in order of preference: commanded, then measured signals
CHOICES = ('motor_command', 'arm_position_reference', 'tcp_command', 'motor_position', 'arm_position', 'tcp_actual',
           'tcp_measured')  # fmt: skip


@dataclass(frozen=True)
class Reference:
    """Program that plays a sampled trajectory."""

    name: str  # file of the trajectory
    document: dict[str, Any]  # content of the program file
    text: str  # description of the trajectory
    origin_s: float  # time of its first sample in the file
    starts_s: tuple[float, ...]  # start of each move after that sample

    def write(self, path: Path) -> Path:
        """Write the program file; raises OSError."""
        dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
        return whole_file.write_text(yaml.dump(self.document, Dumper=dumper, sort_keys=False), path)

    def require_drivable(self, program: Program, robot: Parameters) -> None:
        """Reject a trajectory that exceeds a limit, with the time in its file; raises ProgramError."""
        try:
            program_planner.plan(replace(program, source='', places=()), robot.motion.home_m, robot)
        except ProgramError as error:
            raise ProgramError(f'{self.name}: {self._in_file_time(str(error))}') from None

    def _in_file_time(self, text: str) -> str:
        """Replace move numbers and times in an error message by times of the file."""
        begin_s = 0.0

        def converted(found: re.Match[str]) -> str:
            nonlocal begin_s
            if found[1] is not None:
                begin_s = self.starts_s[int(found[1])]
                return ''
            return f'at {self.origin_s + begin_s + float(found[2]):.4f} s'

        return re.sub(r'moves\[(\d+)\]\.\w+: |at (\d+\.\d{4}) s, before point \d+', converted, text)


def load(
    path: str | Path, robot: Parameters, columns: str | None = None, smooth_hz: float | None = None
) -> Reference:
    """Read a trajectory from a table, a trace or a bag; ``smooth_hz`` as in ``of``.

    Raises
    ------
    TraceError
        The file cannot be read.
    ProgramError
        The file contains no trajectory, it has gaps or is out of reach, or it does not begin and end at rest.

    """
    chosen = None if columns is None else column_file.read(columns)
    return of(trace_file.load(path, chosen, gaps=True), str(path), robot, smooth_hz)


def of(trace: Trace, name: str, robot: Parameters, smooth_hz: float | None = None) -> Reference:
    """Return the program with which a robot plays the trajectory of a trace read from the file ``name``.

    ``smooth_hz`` is the cut-off frequency of a zero-phase low pass; None: no filter.

    Raises
    ------
    ProgramError
        As for ``load``, or the sampling rate is too low for the low pass.

    """
    signal = next((one for one in CHOICES if one in trace.signals), None)
    if signal is None:
        raise ProgramError(f'{name} contains no trajectory: none of {", ".join(CHOICES)}')
    time_s, values = trace.time_s, trace[signal]
    known = np.isfinite(values).all(axis=1)
    if not known.all():
        raise ProgramError(f'{name} has a gap at {time_s[np.argmin(known)]:.6g} s: {signal} is missing there')
    if len(time_s) < INSTANTS_MIN or time_s[-1] - time_s[0] > TIME_MAX_S:
        raise ProgramError(
            f'{name} contains {len(time_s)} samples in {time_s[-1] - time_s[0]:g} s, expected at least {INSTANTS_MIN} '
            f'in up to {TIME_MAX_S:g} s'
        )
    origin = float(time_s[0])
    angles, rounding = _angles(signal, time_s, values, name, robot)
    time_s = time_s - origin
    changed = ''
    if smooth_hz is not None:
        time_s, angles, changed = _smoothed(time_s, angles, smooth_hz, name, robot)
        rounding = 0.0
    _require_rest(time_s, angles, name, origin)
    moves: list[dict[str, Any]] = []
    starts, count = list[float](), 0
    for first, last, stands in _stretches(time_s, angles):
        starts.append(float(time_s[first]))
        if stands:
            moves.append({'dwell': {'time_s': float(time_s[last] - time_s[first])}})
            continue
        rows = slice(first, last + 1)
        points = _points(time_s[rows] - time_s[first], angles[rows], rounding)
        if len(points) > POINTS_MAX:
            raise ProgramError(
                f'{name} requires {len(points)} points from {origin + time_s[first]:.6g} to '
                f'{origin + time_s[last]:.6g} s, where it is in motion, the limit is {POINTS_MAX}: play a part '
                'of it, or data with less noise'
            )
        count += len(points)
        moves.append({'joints': {'points': points}})
    if len(moves) > MOVES_MAX:
        raise ProgramError(f'{name} rests {len(moves)} times, the limit is {MOVES_MAX} moves')
    start = kinematics.forward(angles[0], robot.kinematics)
    smooth = f', smoothed within their rounding of {rounding:.2g} rad' if rounding else changed
    text = (
        f'{signal} of {name}: {len(time_s)} samples in {time_s[-1]:.6g} s{smooth}, played by {count} points'
    )
    document = {'name': _title(name), 'start_m': [float(x) for x in start], 'moves': moves}
    return Reference(name, document, text, origin, tuple(starts))


def _smoothed(
    time_s: Floats, angles: Floats, cutoff_hz: float, name: str, robot: Parameters
) -> tuple[Floats, Floats, str]:
    """Return evenly spaced times, the angles there after a zero-phase low pass, and the change as a text."""
    even_s = np.linspace(0.0, time_s[-1], len(time_s))
    rate_hz = (len(time_s) - 1) / time_s[-1]
    if cutoff_hz >= 0.5 * rate_hz:
        raise ProgramError(
            f'{name} has {rate_hz:.6g} samples per second: the cut-off frequency must be below {0.5 * rate_hz:.6g} Hz, '
            f'not {cutoff_hz:g} Hz'
        )
    plain = np.asarray(CubicSpline(time_s, angles)(even_s))
    # filtered forwards and backwards: fourth order without delay; the robot is at rest at both ends
    low_pass = butter(SMOOTHING_ORDER, cutoff_hz, fs=rate_hz, output='sos')
    more = min(len(even_s) - 1, math.ceil(SETTLED_PERIODS * rate_hz / cutoff_hz))
    smooth = np.asarray(sosfiltfilt(low_pass, plain, axis=0, padtype='constant', padlen=more))
    before, after = (kinematics.forward(one, robot.kinematics, unreachable='nan') for one in (plain, smooth))
    moved = 1e3 * np.linalg.norm(after - before, axis=1)
    change = (
        f', low pass at {cutoff_hz:g} Hz: it moves the TCP by {math.sqrt(np.mean(moved**2)):.3g} mm rms and '
    )
    return even_s, smooth, f'{change}{moved.max():.3g} mm at most'


def _title(name: str) -> str:
    stem = ''.join(character if character.isprintable() else '?' for character in Path(name).stem)
    return f'reference {stem}'[: programs.NAME_MAX]


def _angles(
    signal: str, time_s: Floats, values: Floats, name: str, robot: Parameters
) -> tuple[Floats, float]:
    """Return the arm angles and their rounding step, 0 if that is finer than the resolution of the drives."""
    if signal.startswith('motor'):
        angles, step = values / robot.dynamics.gear_ratio, _step(values) / robot.dynamics.gear_ratio
    elif signal.startswith('arm'):
        angles, step = values, _step(values)
    else:
        angles = kinematics.inverse(values, robot.kinematics, unreachable='nan')
        lost = ~np.isfinite(angles).all(axis=1)
        if lost.any():
            n = int(np.argmax(lost))
            x, y, z = values[n]
            raise ProgramError(
                f'{name}: at {time_s[n]:.6g} s the TCP is at ({x:.4f}, {y:.4f}, {z:.4f}) m, which the arms cannot reach'
            )
        step = _step(values) / robot.kinematics.upper_arm_length_m
    increment = math.tau / robot.bus.increments_per_rev / robot.dynamics.gear_ratio
    return np.asarray(angles), step if step > 2.0 * increment else 0.0


def _step(values: Floats) -> float:
    """Return the spacing of the grid on which all values lie; 0 if there is none."""
    steps = np.diff(np.unique(values))
    largest = float(np.abs(values).max(initial=0.0))
    steps = steps[steps > 1e-12 * max(largest, 1.0)]
    if not len(steps):
        return 0.0
    step = float(steps.min())
    return (
        step
        if (np.abs(steps / step - np.rint(steps / step)) < 1e-3 * np.maximum(steps / step, 1.0)).all()
        else 0.0
    )


def _require_rest(time_s: Floats, angles: Floats, name: str, origin_s: float) -> None:
    """Reject a trajectory that begins or ends in motion, judged by the parabola through three samples."""
    fastest = float(np.abs(np.diff(angles, axis=0) / np.diff(time_s)[:, None]).max())
    if not fastest > 0.0:
        raise ProgramError(f'{name} contains no motion')
    for what, rows in (('begins', slice(0, 3)), ('ends', slice(None, -4, -1))):
        t, y = time_s[rows], angles[rows]
        speeds = CubicSpline(*_ordered(t, y), bc_type='not-a-knot')(t[0], 1)
        axis = int(np.argmax(np.abs(speeds)))
        if abs(speeds[axis]) > ENDS_AT_REST * fastest:
            raise ProgramError(
                f'{name} {what} at {origin_s + t[0]:.6g} s with a speed of {speeds[axis]:.4g} rad/s of arm {axis + 1}, '
                'but must be at rest there'
            )


def _ordered(time_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    order = np.argsort(time_s)
    return time_s[order], values[order]


def _stretches(time_s: Floats, angles: Floats) -> Iterator[tuple[int, int, bool]]:
    """Yield first and last sample of alternating motions and rests, and whether it is a rest."""
    still = np.asarray((np.abs(np.diff(angles, axis=0)) <= STILL_RAD).all(axis=1))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    at = 0
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first < STANDING_SAMPLES or time_s[last] - time_s[first] < STANDING_S:
            continue
        begin = 0 if first == 0 else int(first) + SETTLED_SAMPLES
        end = int(last) if last == len(still) else int(last) - SETTLED_SAMPLES
        if begin > at:
            yield at, begin, False
        yield begin, end, True
        at = end
    if at < len(time_s) - 1:
        yield at, len(time_s) - 1, False


def _points(time_s: Floats, angles: Floats, rounding: float) -> list[dict[str, Any]]:
    """Return as many points on splines through a motion from rest to rest as the accuracy requires."""
    splines = [_spline(time_s, column, rounding) for column in angles.T]
    knots = _knots(float(time_s[-1]), splines)
    values = np.array([[spline(knots, order) for spline in splines] for order in range(3)])
    values[0, :, 0], values[0, :, -1] = angles[0], angles[-1]
    values[1, :, 0] = values[1, :, -1] = 0.0
    return [
        {
            'time_s': float(time),
            'angles_rad': values[0, :, n].tolist(),
            'speeds_rad_s': values[1, :, n].tolist(),
            'accelerations_rad_s2': values[2, :, n].tolist(),
        }
        for n, time in enumerate(knots)
    ]


def _spline(time_s: Floats, values: Floats, rounding: float) -> Any:
    if not rounding or len(time_s) < 2 * INSTANTS_MIN or not np.ptp(values) > 0.0:
        return CubicSpline(time_s, values, bc_type='clamped')
    return PPoly.from_spline(splrep(time_s, values, k=5, s=len(time_s) * rounding**2 / 12.0))


def _knots(duration_s: float, splines: list[Any]) -> Floats:
    """Return times between which a quintic follows the splines; pieces are halved until it does."""
    kept: list[Floats] = []
    starts, ends = np.array([0.0]), np.array([duration_s])
    while len(starts) and sum(map(len, kept)) + len(starts) <= COUNTED_MAX:
        wrong = np.zeros(len(starts), dtype=bool)
        length = ends - starts
        for spline in splines:
            powers = length ** np.arange(3)[:, None]
            sides = [
                np.array([spline(side, order) for order in range(3)]) * powers for side in (starts, ends)
            ]
            quintic = BPoly.from_derivatives([0.0, 1.0], sides)
            inside = starts + INSIDE[:, None] * length
            wrong |= (np.abs(quintic(INSIDE) - spline(inside)) > WITHIN_RAD).any(axis=0)
        kept.append(starts[~wrong])
        middle = 0.5 * (starts[wrong] + ends[wrong])
        starts, ends = np.concatenate([starts[wrong], middle]), np.concatenate([middle, ends[wrong]])
    return np.append(np.sort(np.concatenate([*kept, starts])), duration_s)

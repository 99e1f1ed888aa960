"""Learned torques: additional torque of each motor for one plan, cycle by cycle.

They are valid only for the motion, payloads and parameters from which they were learned, executed as planned. The start
of a plan depends on the robot position; the motion counts as the same within ``SAME_M`` and ``SAME_S``. The file is a
numpy archive (``.npz``) without code.
"""

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import LearnedError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, flat_document
from delta3_pacdrive.planning.paths.move import UNCHANGED
from delta3_pacdrive.planning.plan import Plan, plan_master_at, plan_path_at

SUFFIX = '.npz'
CYCLES_MAX = 1_000_000
PLACES = (
    100  # positions at which motions are compared, evenly spaced in time; limited by the time of a bus cycle
)
# a returning robot stops within a few increments, which changes accelerations by at most 0.1 m/s2
SAME_M = 2e-5  # for the TCP, [rad] for the arms
SAME_S = 1e-4
_ELSEWHERE = 'motion.home_m'  # does not affect a plan, which contains the start position
_ARRAYS = ('torques', 'kinds', 'payloads_kg', 'starts_s', 'changes', 'places')


@dataclass(frozen=True, eq=False)
class Origin:
    """Plan and parameters from which torques were learned."""

    program: str  # name, for messages
    parameters: dict[str, Any]  # by dotted name, as in JSON
    kinds: NDArray[Any]  # of the executed moves, shape (n,)
    payloads_kg: Floats  # at their start, shape (n,)
    starts_s: Floats  # start times, and end of the last move, shape (n + 1,)
    changes: Floats  # payload changes: number of the move, distance [m], payload [kg], shape (k, 3)
    places: Floats  # path positions [m] or arm angles [rad], evenly spaced in time, shape (``PLACES``, 3)

    @staticmethod
    def of(program: str, plan: Plan, parameters: Parameters) -> 'Origin':
        """Return the origin for a plan."""
        starts = np.array(plan.tables.starts)
        return Origin(
            program, _compared(parameters), *_driven(plan), starts, _changes(plan), _places(plan, starts)
        )

    @property
    def duration_s(self) -> float:
        """Duration of the plan [s]."""
        return float(self.starts_s[-1])


def _compared(parameters: Parameters) -> dict[str, Any]:
    return {name: value for name, value in flat_document(parameters).items() if name != _ELSEWHERE}


def _driven(plan: Plan) -> tuple[NDArray[Any], Floats]:
    """Return kinds and payloads [kg] of the executed moves."""
    order, moves = plan.tables.order, plan.moves
    return np.array([int(move.kind) for move in moves])[order], np.array([m.payload_kg for m in moves])[order]


def _changes(plan: Plan) -> Floats:
    order, moves, events = plan.tables.order, plan.tables.moves, plan.tables.events
    counts = moves['events'][order]
    driven = np.repeat(np.arange(len(order)), counts)
    rows = np.arange(len(driven)) + np.repeat(
        moves['first_event'][order] - np.cumsum(counts) + counts, counts
    )
    changes = np.column_stack([driven, events[rows, 0], events[rows, 3]])
    return np.asarray(changes[events[rows, 3] != UNCHANGED])


def _places(plan: Plan, starts_s: Floats) -> Floats:
    """Return path positions at the comparison times, on the moves of a plan that start at ``starts_s``."""
    times = _times(starts_s)
    numbers = np.searchsorted(starts_s[1:-1], times, side='right')
    return np.array(
        [
            plan_path_at(plan_master_at(time, number, plan.tables)[0], number, plan.tables)
            for time, number in zip(times.tolist(), numbers.tolist(), strict=True)
        ]
    )


def _times(starts_s: Floats) -> Floats:
    return np.linspace(0.0, starts_s[-1], PLACES)


@dataclass(frozen=True, eq=False)
class Learned:
    """Learned torques and their origin."""

    torques: Floats  # of the motors [N m], by cycle since the start of the program, shape (n, 3)
    origin: Origin

    def parameter_refusal(self, parameters: Parameters) -> str:
        """Return why they do not apply to a robot; empty if they do."""
        ours, theirs = self.origin.parameters, _compared(parameters)
        other = [name for name in theirs if name not in ours or ours[name] != theirs[name]]
        if not other:
            return ''
        name = other[0]
        more = f' (and {len(other) - 1} more)' if len(other) > 1 else ''
        was = f'was {ours[name]}' if name in ours else 'was not known'
        return f'they belong to other parameters: {name} {was} when they were learned, here it is {theirs[name]}{more}'

    def plan_refusal(self, plan: Plan) -> str:
        """Return why they do not apply to a plan executed as planned; empty if they do."""
        ours = self.origin
        # compare the durations first: cheaper than thousands of moves
        if abs(plan.duration_s - ours.duration_s) > SAME_S:
            return f'they belong to a plan of {ours.duration_s:.4f} s ({ours.program}), not of {plan.duration_s:.4f} s'
        if len(plan) != len(ours.kinds):
            return f'they belong to a plan of {len(ours.kinds)} moves ({ours.program}), not of {len(plan)}'
        kinds, payloads = _driven(plan)
        apart = np.abs(plan.tables.starts - ours.starts_s)
        if (kinds != ours.kinds).any() or apart.max() > SAME_S:
            number = int(np.argmax((kinds != ours.kinds) | (apart[1:] > SAME_S)))
            return f'they belong to another plan ({ours.program}): its move {number + 1} is another one'
        distances = np.linalg.norm(_places(plan, ours.starts_s) - ours.places, axis=1)
        if not distances.max() <= SAME_M:
            first = int(np.argmax(~(distances <= SAME_M)))
            return (
                f'they belong to another plan ({ours.program}): {_times(ours.starts_s)[first]:.3f} s after its start '
                'its position differs'
            )
        changes = _changes(plan)
        if (payloads != ours.payloads_kg).any():
            number = int(np.argmax(payloads != ours.payloads_kg))
            return (
                f'they belong to other payloads: {ours.payloads_kg[number]:g} kg in move {number + 1}, here '
                f'{payloads[number]:g} kg'
            )
        if len(changes) != len(ours.changes) or (np.abs(changes - ours.changes) > [0.0, SAME_M, 0.0]).any():
            return 'they belong to other payloads: these change at other positions'
        return ''

    def refusal(self, plan: Plan, parameters: Parameters) -> str:
        """Return why they do not apply to a plan on a robot, executed as planned; empty if they do."""
        return self.parameter_refusal(parameters) or self.plan_refusal(plan)

    def require(self, plan: Plan, parameters: Parameters, source: str) -> None:
        """Raise LearnedError unless they apply to a plan on a robot; ``source`` is the name of their file."""
        _require(self.refusal(plan, parameters), source)

    def require_robot(self, parameters: Parameters, source: str) -> None:
        """Raise LearnedError unless they apply to a robot; ``source`` is the name of their file."""
        _require(self.parameter_refusal(parameters), source)


def followed_text(unlearned: str) -> str:
    """Return the status of learned torques for messages; ``unlearned`` is why they are not used, or empty."""
    return f'learned torques are not followed: {unlearned}' if unlearned else 'learned torques are followed'


def _require(refusal: str, source: str) -> None:
    if refusal:
        raise LearnedError(f'the learned torques of {source} do not fit: {refusal}')


def save(learned: Learned, path: str | Path) -> Path:
    """Write learned torques to a file; raises LearnedError."""
    path, origin = Path(path), learned.origin
    if refusal := write_refusal(path):
        raise LearnedError(f'cannot write learned torques {path}: {refusal}')
    arrays = {name: getattr(origin, name) for name in _ARRAYS[1:]}
    header = json.dumps({'program': origin.program, 'parameters': origin.parameters})
    try:
        with whole_file.atomic_path(path) as partial, partial.open('wb') as file:
            np.savez(file, torques=learned.torques, origin=np.array(header), **arrays)
    except OSError as error:
        raise LearnedError(f'cannot write learned torques {path}: {error.strerror or error}') from None
    return path


def write_refusal(path: Path) -> str:
    """Return why learned torques cannot be written to a path; empty if no obstacle is known."""
    if path.suffix != SUFFIX:
        return f'the name must end with {SUFFIX}'
    return whole_file.file_refusal(path)


def load(path: str | Path) -> Learned:
    """Read learned torques from a file; raises LearnedError."""
    try:
        file = whole_file.arrays_of(Path(path))
        torques, kinds, *others = (_numbers(file[name]) for name in _ARRAYS)
        header = json.loads(str(file['origin']))
        origin = Origin(_typed(header['program'], str), _typed(header['parameters'], dict), kinds, *others)
    except OSError as error:
        raise LearnedError(f'cannot read learned torques {path}: {error.strerror or error}') from None
    except (
        ValueError, KeyError, TypeError, AttributeError, EOFError, MemoryError, NotImplementedError, RecursionError,
        SyntaxError, zipfile.BadZipFile, zlib.error,
    ):  # fmt: skip
        raise LearnedError(
            f'{path} does not contain learned torques: delta3 learn writes such files'
        ) from None
    if torques.ndim != 2 or torques.shape[1] != 3 or not 0 < len(torques) <= CYCLES_MAX:
        raise LearnedError(
            f'{path}: learned torques have the shape {torques.shape}, but must be of 3 axes in up to {CYCLES_MAX} '
            'cycles'
        )
    if not np.isfinite(torques).all():
        raise LearnedError(f'{path}: a learned torque is not a finite number')
    moves = len(kinds) if kinds.ndim == 1 else 0
    shapes = [(moves,), (moves,), (moves + 1,), (len(origin.changes), 3), (PLACES, 3)]
    arrays = [getattr(origin, name) for name in _ARRAYS[1:]]
    if (
        not moves
        or [one.shape for one in arrays] != shapes
        or not all(np.isfinite(one).all() for one in arrays)
    ):
        raise LearnedError(f'{path} does not specify the plan of its torques: delta3 learn writes such files')
    return Learned(np.ascontiguousarray(torques), origin)


def _numbers(values: Any) -> Floats:
    if values.dtype.kind not in 'fiu' or values.ndim == 0:
        raise TypeError
    return np.asarray(values, dtype=np.float64)


def _typed(value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value

"""Torques that were learned for one plan: what each motor is to have beside the model, cycle by cycle.

They are right for what they were learned from alone: the same motion and payloads, the same parameters, driven as
planned. A plan begins where the robot stands, which is a little elsewhere each time: the motion is the same as long as
it stays as near as ``SAME_M`` and ``SAME_S``. The file is an archive of numpy (``.npz``) and holds no code.
"""

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import LearnedError
from delta3_pacdrive.motion.move import UNCHANGED
from delta3_pacdrive.motion.plan import Plan, plan_master_at, plan_path_at
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, flat_document

SUFFIX = '.npz'
CYCLES_MAX = 1_000_000
PLACES = 100  # at which motions are compared, spread over their time: a bus cycle has no time for all
# a robot that comes back stands there to a few increments; an acceleration changes by 0.1 m/s2 at most
SAME_M = 2e-5  # of the TCP, [rad] of the arms
SAME_S = 1e-4
_ELSEWHERE = 'motion.home_m'  # where a robot stands before a program is in the plan
_ARRAYS = ('torques', 'kinds', 'payloads_kg', 'starts_s', 'changes', 'places')


@dataclass(frozen=True, eq=False)
class Origin:
    """The origin is what torques were learned from.

    Attributes
    ----------
    program
        Its name, for people.
    parameters
        Those of the robot by dotted name, as JSON has them.
    kinds, payloads_kg
        Of the moves as they are driven, at their start, shape (n,).
    starts_s
        When they begin, and the last one ends, shape (n + 1,).
    changes
        Of the payload on the way: number of the move, distance [m] and payload [kg], shape (k, 3).
    places
        On the path, spread over its time [m] (of arm angles [rad]), shape (``PLACES``, 3).

    """

    program: str
    parameters: dict[str, Any]
    kinds: NDArray[Any]
    payloads_kg: Floats
    starts_s: Floats
    changes: Floats
    places: Floats

    @staticmethod
    def of(program: str, plan: Plan, parameters: Parameters) -> 'Origin':
        """Return that of a plan that a robot drives."""
        starts = np.array(plan.tables.starts)
        return Origin(
            program, _told(parameters), *_driven(plan), starts, _changes(plan), _places(plan, starts)
        )

    @property
    def duration_s(self) -> float:
        """Of the plan [s]."""
        return float(self.starts_s[-1])


def _told(parameters: Parameters) -> dict[str, Any]:
    return {name: value for name, value in flat_document(parameters).items() if name != _ELSEWHERE}


def _driven(plan: Plan) -> tuple[NDArray[Any], Floats]:
    """Kinds and payloads [kg] of the moves that are driven."""
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
    """Places of a plan, each on the move that is driven at that time in one whose moves begin at ``starts_s``."""
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
    """Learned torques belong to one origin.

    Attributes
    ----------
    torques
        Of the motors [N m] by cycles since the start of the program, shape (n, 3).
    origin
        What they are for.

    """

    torques: Floats
    origin: Origin

    def parameter_refusal(self, parameters: Parameters) -> str:
        """Return why they are not for a robot; empty if they are."""
        ours, theirs = self.origin.parameters, _told(parameters)
        other = [name for name in theirs if name not in ours or ours[name] != theirs[name]]
        if not other:
            return ''
        name = other[0]
        more = f' (and {len(other) - 1} more)' if len(other) > 1 else ''
        was = f'was {ours[name]}' if name in ours else 'was not known'
        return f'they belong to other parameters: {name} {was} when they were learned, here it is {theirs[name]}{more}'

    def plan_refusal(self, plan: Plan) -> str:
        """Return why they are not for a plan that is driven as it was planned; empty if they are."""
        ours = self.origin
        # what is not as long needs no look at thousands of moves
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
                'it is somewhere else'
            )
        changes = _changes(plan)
        if (payloads != ours.payloads_kg).any():
            number = int(np.argmax(payloads != ours.payloads_kg))
            return (
                f'they belong to other payloads: {ours.payloads_kg[number]:g} kg in move {number + 1}, here '
                f'{payloads[number]:g} kg'
            )
        if len(changes) != len(ours.changes) or (np.abs(changes - ours.changes) > [0.0, SAME_M, 0.0]).any():
            return 'they belong to other payloads: these change elsewhere on the way'
        return ''

    def refusal(self, plan: Plan, parameters: Parameters) -> str:
        """Return why they are not for a plan that a robot drives as it was planned; empty if they are."""
        return self.parameter_refusal(parameters) or self.plan_refusal(plan)

    def require(self, plan: Plan, parameters: Parameters, source: str) -> None:
        """Refuse them for another plan or robot; ``source`` is the name of their file. Raises LearnedError."""
        _require(self.refusal(plan, parameters), source)

    def require_robot(self, parameters: Parameters, source: str) -> None:
        """Refuse them for another robot, as ``require`` does; raises LearnedError."""
        _require(self.parameter_refusal(parameters), source)


def followed_text(unlearned: str) -> str:
    """Say whether learned torques are followed; ``unlearned`` is why not, empty if they are."""
    return f'learned torques are not followed: {unlearned}' if unlearned else 'learned torques are followed'


def _require(refusal: str, source: str) -> None:
    if refusal:
        raise LearnedError(f'the learned torques of {source} do not fit: {refusal}')


def save(learned: Learned, path: str | Path) -> Path:
    """Write learned torques; raises LearnedError."""
    path, origin = Path(path), learned.origin
    if refusal := write_refusal(path):
        raise LearnedError(f'cannot write learned torques {path}: {refusal}')
    arrays = {name: getattr(origin, name) for name in _ARRAYS[1:]}
    told = json.dumps({'program': origin.program, 'parameters': origin.parameters})
    try:
        with whole_file.atomic_path(path) as partial, partial.open('wb') as file:
            np.savez(file, torques=learned.torques, origin=np.array(told), **arrays)
    except OSError as error:
        raise LearnedError(f'cannot write learned torques {path}: {error.strerror or error}') from None
    return path


def write_refusal(path: Path) -> str:
    """Return why learned torques cannot be written there; empty if they can, as far as that can be known before."""
    if path.suffix != SUFFIX:
        return f'the name must end with {SUFFIX}'
    return whole_file.file_refusal(path)


def load(path: str | Path) -> Learned:
    """Read learned torques; raises LearnedError."""
    try:
        file = whole_file.arrays_of(Path(path))
        torques, kinds, *others = (_numbers(file[name]) for name in _ARRAYS)
        told = json.loads(str(file['origin']))
        origin = Origin(_typed(told['program'], str), _typed(told['parameters'], dict), kinds, *others)
    except OSError as error:
        raise LearnedError(f'cannot read learned torques {path}: {error.strerror or error}') from None
    except (
        ValueError, KeyError, TypeError, AttributeError, EOFError, MemoryError, NotImplementedError, RecursionError,
        SyntaxError, zipfile.BadZipFile, zlib.error,
    ):  # fmt: skip
        raise LearnedError(f'{path} holds no learned torques: delta3 learn writes such files') from None
    if torques.ndim != 2 or torques.shape[1] != 3 or not 0 < len(torques) <= CYCLES_MAX:
        raise LearnedError(
            f'{path}: learned torques have the shape {torques.shape}, but must be of 3 axes in up to {CYCLES_MAX} '
            'cycles'
        )
    if not np.isfinite(torques).all():
        raise LearnedError(f'{path}: a learned torque is no number')
    moves = len(kinds) if kinds.ndim == 1 else 0
    shapes = [(moves,), (moves,), (moves + 1,), (len(origin.changes), 3), (PLACES, 3)]
    told_of = [getattr(origin, name) for name in _ARRAYS[1:]]
    if (
        not moves
        or [one.shape for one in told_of] != shapes
        or not all(np.isfinite(one).all() for one in told_of)
    ):
        raise LearnedError(
            f'{path} does not tell which plan its torques are for: delta3 learn writes such files'
        )
    return Learned(np.ascontiguousarray(torques), origin)


def _numbers(values: Any) -> Floats:
    if values.dtype.kind not in 'fiu' or values.ndim == 0:
        raise TypeError
    return np.asarray(values, dtype=np.float64)


def _typed(value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value

"""Torques that were learned for one plan: what each motor is to have beside the model, cycle by cycle.

They are right for what they were learned from alone: the same plan and payloads, the same parameters, driven as
planned. The file is an archive of numpy (``.npz``) and holds no code.
"""

import hashlib
import json
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import LearnedError
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, flatten

SUFFIX = '.npz'
CYCLES_MAX = 1_000_000
_ELSEWHERE = 'motion.home_m'  # where a robot stands before a program is in the plan
_DIGITS = 16
_NUMBERS = ('payload_kg', 'duration_s')  # of an origin


@dataclass(frozen=True)
class Origin:
    """The origin is what torques were learned from, as digests, and its names for people.

    Attributes
    ----------
    program
        Its name.
    plan, payload, parameters
        Digests of the plan without its payloads, of these, and of the parameters of the robot.
    payload_kg
        At the start of the program.
    duration_s
        Of the plan.

    """

    program: str
    plan: str
    payload: str
    payload_kg: float
    parameters: str
    duration_s: float

    @staticmethod
    def of(program: str, plan: Plan, parameters: Parameters) -> 'Origin':
        """Return that of a plan that a robot drives."""
        tables = plan.tables
        whole = tables.order, tables.moves, tables.phases, tables.segments, tables.events[:, :3]
        payloads = np.array([move.payload_kg for move in plan.moves]), tables.events[:, 3]
        values = {name: value for name, value in flatten(parameters).items() if name != _ELSEWHERE}
        return Origin(
            program,
            _digest(*(np.ascontiguousarray(table).tobytes() for table in whole)),
            _digest(*(np.ascontiguousarray(table).tobytes() for table in payloads)),
            plan.move(0).payload_kg,
            _digest(repr(sorted(values.items())).encode()),
            plan.duration_s,
        )


def _digest(*parts: bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()[:_DIGITS]


@dataclass(frozen=True)
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

    def refusal(self, plan: Plan, parameters: Parameters) -> str:
        """Return why they are not for a plan that is driven as it was planned; empty if they are."""
        ours, cycle_s = self.origin, parameters.bus.cycle_time_s
        # what is not as long needs no digest of thousands of moves, for which a bus cycle has no time
        if abs(plan.duration_s - ours.duration_s) > cycle_s:
            return f'they belong to a plan of {ours.duration_s:.3f} s ({ours.program}), not of {plan.duration_s:.3f} s'
        theirs = Origin.of('', plan, parameters)
        if ours.parameters != theirs.parameters:
            return f'they belong to other parameters ({ours.parameters}, here {theirs.parameters})'
        if ours.plan != theirs.plan:
            return f'they belong to another plan ({ours.plan} of {ours.program}, here {theirs.plan})'
        if ours.payload != theirs.payload:
            return (
                f'they belong to other payloads ({ours.payload}, {ours.payload_kg:g} kg at the start; here '
                f'{theirs.payload}, {theirs.payload_kg:g} kg)'
            )
        return ''

    def require(self, plan: Plan, parameters: Parameters, source: str) -> None:
        """Refuse them for another plan or robot; ``source`` is the name of their file. Raises LearnedError."""
        if refusal := self.refusal(plan, parameters):
            raise LearnedError(f'the learned torques of {source} do not fit: {refusal}')


def save(learned: Learned, path: str | Path) -> Path:
    """Write learned torques; raises LearnedError."""
    path = Path(path)
    if refusal := write_refusal(path):
        raise LearnedError(f'cannot write learned torques {path}: {refusal}')
    try:
        with whole_file.replacing(path) as partial, partial.open('wb') as file:
            np.savez(file, torques=learned.torques, origin=np.array(json.dumps(asdict(learned.origin))))
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
        with np.load(path, allow_pickle=False) as file:
            torques, text = np.asarray(file['torques'], dtype=np.float64), str(file['origin'])
        origin = Origin(**_checked(json.loads(text)))
    except OSError as error:
        raise LearnedError(f'cannot read learned torques {path}: {error.strerror or error}') from None
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        raise LearnedError(f'{path} holds no learned torques: delta3 learn writes such files') from None
    if torques.ndim != 2 or torques.shape[1] != 3 or not 0 < len(torques) <= CYCLES_MAX:
        raise LearnedError(
            f'{path}: learned torques have the shape {torques.shape}, but must be of 3 axes in up to {CYCLES_MAX} '
            'cycles'
        )
    if not np.isfinite(torques).all():
        raise LearnedError(f'{path}: a learned torque is no number')
    return Learned(np.ascontiguousarray(torques), origin)


def _checked(document: Any) -> dict[str, Any]:
    for name, value in document.items():
        if not isinstance(value, float | int if name in _NUMBERS else str):
            raise TypeError(name)
    return dict(document)

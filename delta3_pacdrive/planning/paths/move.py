"""A move of a plan: motion of the virtual master over time, slave path over the master, and events on the path."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG, ROTARY_AXES_MAX, Kinematics
from delta3_pacdrive.planning.paths.joint_path import tcp_samples
from delta3_pacdrive.planning.paths.path import SEGMENT_COLUMNS, sample_path
from delta3_pacdrive.planning.paths.rotations import (
    TURN_COLUMNS,
    require_smooth,
    sample_turn,
    standing,
)
from delta3_pacdrive.planning.paths.virtual_master import PHASE_COLUMNS, slowest

VERSION = (
    2  # one more for each rotary axis whose angle the move defines; the header then has its number of pieces
)
# version, number of the move, number of moves, kind, phases, segments, events, acceleration and jerk of stops, payload
HEADER = 10
MOVES_MAX = 20_000
ROWS_MAX = 200_000  # phases, segments or events of one move
COUNT_MAX = 10**9  # upper limit of header fields
BACKWARDS_M_S = 1e-6  # slower backward motion is rounding
CONTINUOUS = 1e-6  # largest jump between two phases (relative to the move) or two path pieces [m]
OUTPUTS = ('gripper', 'output1', 'output2', 'output3', 'output4', 'output5', 'output6', 'output7')
# TRACK attaches the robot to a belt (1) or detaches it (0); it is internal to the controller
TRACK = 'track'
EVENT_NAMES = (*OUTPUTS, TRACK)
TRACK_BIT = 1 << EVENT_NAMES.index(TRACK)
UNCHANGED = -1.0  # value of the payload column for events that keep the payload
EVENT_COLUMNS = 4  # distance [m], output number, value, payload after the event [kg] or UNCHANGED


class MoveKind(IntEnum):
    """Kinds of moves."""

    DWELL = 0
    LINE = 1
    ARC = 2
    SPLINE = 3
    BLENDED = 4  # several moves with rounded corners
    CUBIC = 5  # parametrized by time: the master runs at 1 s/s (chapter 5)
    JOINTS = 6  # as CUBIC, with a path of arm angles [rad]
    IN_POSITION = 7  # dwell until the robot is in position, at least the planned time
    TURN = 8  # rotation of the tool at a fixed TCP; the master is its angle [rad]


STANDING = (MoveKind.DWELL, MoveKind.IN_POSITION)
TIMED = (MoveKind.CUBIC, MoveKind.JOINTS)  # path parameter is time


def _no_events() -> Floats:
    return np.zeros((0, EVENT_COLUMNS))


@dataclass(frozen=True)
class Move:
    """One move from rest to rest."""

    kind: MoveKind
    master: (
        Floats  # phases (n, 5): time [s], distance [m], speed and acceleration at the start of a phase, jerk
    )
    segments: Floats  # path pieces (m, 19) over the distance
    stop_acceleration: float = 1.0  # limits of the master for holding and resuming [m/s^2, m/s^3]
    stop_jerk: float = np.inf
    payload_kg: float = 0.0  # from the start of the move
    # rows (k, 4) in order of distance: distance [m], output number (-1: none), value, payload [kg]
    events: Floats = field(default_factory=_no_events)
    kinematics: Kinematics | None = None  # needed for the TCP of a path of arm angles
    turns: tuple[
        Floats, ...
    ] = ()  # rotation of each rotary axis over the distance, pieces (l, 7): see ``rotations``

    @property
    def duration_s(self) -> float:
        """Time from rest to rest [s]."""
        return float(self.master[-1, 0])

    @property
    def length_m(self) -> float:
        """Length of the path [m]."""
        return float(self.master[-1, 1])

    def end_m(self) -> Floats:
        """Last point of the path [m], shape (3,)."""
        return np.asarray(self.sample([self.length_m])[0, 0])

    def start_m(self) -> Floats:
        """First point of the path [m], shape (3,)."""
        return np.asarray(self.sample([self.master[0, 1]])[0, 0])

    def turns_rad(self, distance: float) -> tuple[float, ...]:
        """Return the angle of each rotary axis at a distance [rad]; empty if the move does not define them."""
        return tuple(float(sample_turn([distance], rows)[0, 0]) for rows in self.turns)

    @property
    def start_turns_rad(self) -> tuple[float, ...]:
        """Angle of each rotary axis at the start of the move [rad]."""
        return self.turns_rad(float(self.master[0, 1]))

    @property
    def end_turns_rad(self) -> tuple[float, ...]:
        """Angle of each rotary axis at the end of the move [rad]."""
        return self.turns_rad(self.length_m)

    def with_turns(self, turns_rad: Sequence[float]) -> 'Move':
        """Return the move with constant angles of the rotary axes, unless it already defines their angles."""
        return self if self.turns else replace(self, turns=standing(turns_rad))

    def sample(self, distances_m: ArrayLike) -> Floats:
        """Return TCP and first three derivatives by the master at distances of shape (n,): shape (n, 4, 3).

        Rows are nan where the forearms do not meet, and for paths of arm angles without ``kinematics``.
        """
        samples = sample_path(distances_m, self.segments)
        if self.kind != MoveKind.JOINTS:
            return samples
        if self.kinematics is None:
            return np.full_like(samples, np.nan)
        return tcp_samples(samples, self.kinematics)

    def to_array(self, number: int, count: int) -> Floats:
        """Serialize the move, the ``number``-th of ``count``, to one row of numbers for a message."""
        jerk = self.stop_jerk if np.isfinite(self.stop_jerk) else 0.0
        version = VERSION + len(self.turns)
        header = [version, number, count, self.kind, len(self.master), len(self.segments), len(self.events)]
        values = [self.stop_acceleration, jerk, self.payload_kg, *(len(rows) for rows in self.turns)]
        tables = self.master, self.segments, self.events, *self.turns
        return np.concatenate([np.array([*header, *values]), *(table.ravel() for table in tables)])

    @staticmethod
    def from_array(values: ArrayLike, kinematics: Kinematics | None = None) -> tuple['Move', int, int]:
        """Parse a row of ``to_array`` and return (move, number, count); ``kinematics`` is that of the robot.

        Raises
        ------
        ProgramError
            The row is not a move of this version, contains a number that is not finite, or is discontinuous.

        """
        row = np.asarray(values, dtype=np.float64)
        if row.ndim != 1 or len(row) < HEADER or not np.isfinite(row).all():
            raise ProgramError(f'a plan message must be a row of finite numbers with a header of {HEADER}')
        whole = row[:7]
        if (whole != np.floor(whole)).any() or (row[:HEADER] < 0).any() or whole.max() > COUNT_MAX:
            raise ProgramError(f'the header of a plan message must hold whole numbers up to {COUNT_MAX}')
        version, number, count, kind, phases, segments, events = (int(value) for value in whole)
        acceleration, jerk, payload = row[7:HEADER].tolist()
        if not VERSION <= version <= VERSION + ROTARY_AXES_MAX or kind not in tuple(MoveKind):
            raise ProgramError(f'plan message of version {version} and kind {kind} is unknown')
        what = f'plan message {number} of {count}'
        if not number < count <= MOVES_MAX or not 2 <= phases <= ROWS_MAX or not 1 <= segments <= ROWS_MAX:
            raise ProgramError(f'{what} with {phases} phases and {segments} segments is invalid')
        begin = HEADER + version - VERSION
        turns = [_whole_count(value, what) for value in row[HEADER:begin].tolist()]
        sizes = [
            phases * PHASE_COLUMNS,
            segments * SEGMENT_COLUMNS,
            events * EVENT_COLUMNS,
            *(pieces * TURN_COLUMNS for pieces in turns),
        ]
        if len(row) != begin + sum(sizes):
            raise ProgramError(f'{what} has {len(row)} numbers, which does not fit its header')
        master, path, happenings, *angles = np.split(row[begin:].copy(), np.cumsum(sizes[:-1]))
        move = Move(
            MoveKind(kind),
            master=master.reshape(phases, PHASE_COLUMNS),
            segments=path.reshape(segments, SEGMENT_COLUMNS),
            stop_acceleration=acceleration,
            stop_jerk=jerk or np.inf,
            payload_kg=payload,
            events=happenings.reshape(events, EVENT_COLUMNS),
            kinematics=kinematics,
            turns=tuple(rows.reshape(-1, TURN_COLUMNS) for rows in angles),
        )
        move._require_continuous(what)
        return move, number, count

    def _require_continuous(self, what: str) -> None:
        """Raise ProgramError unless the move starts at 0, runs from rest to rest and is continuous."""
        master, path = self.master, self.segments
        if (np.diff(master[:, 0]) < 0.0).any() or (np.diff(path[:, 0]) <= 0.0).any():
            raise ProgramError(f'{what}: times or distances do not increase')
        if not (self.stop_acceleration > 0.0 and master[0, 0] == 0.0 and path[0, 0] == 0.0):
            raise ProgramError(f'{what}: it does not start at 0, or its stop acceleration is not positive')
        runs_evenly = self.kind in TIMED
        if not runs_evenly and (master[0, 2] != 0.0 or master[-1, 2:].any()):
            raise ProgramError(f'{what}: its master is not at rest at both ends')
        check_phases(master, what)
        if master[0, 1] < 0.0 or slowest(master) < -BACKWARDS_M_S:
            raise ProgramError(f'{what}: its master runs backwards')
        u = np.diff(path[:, 0])[:, None] ** np.arange(6)
        ends = np.einsum('nap,np->na', path[:-1, 1:].reshape(-1, 3, 6), u)
        jumps = np.abs(ends - path[1:, 1::6]).max(initial=0.0)
        if not jumps <= CONTINUOUS:
            unit = 'rad' if self.kind == MoveKind.JOINTS else 'm'
            raise ProgramError(f'{what}: its path jumps by {jumps:.3g} {unit}')
        for rows in self.turns:
            require_smooth(rows, what)
        places, bits = self.events[:, 0], self.events[:, 1]
        payloads = [self.payload_kg, *self.events[self.events[:, 3] != UNCHANGED, 3].tolist()]
        for payload in payloads:
            if not 0.0 <= payload <= PAYLOAD_MAX_KG:
                raise ProgramError(
                    f'{what}: a payload is {payload:g} kg, but must be between 0 and {PAYLOAD_MAX_KG:g}'
                )
        if (np.diff(places) < 0.0).any() or (bits < -1).any() or (bits >= len(EVENT_NAMES)).any():
            raise ProgramError(f'{what}: its events are not in order of distance, or name an unknown output')


def _whole_count(value: float, what: str) -> int:
    if value % 1.0 or not 1 <= value <= ROWS_MAX:
        raise ProgramError(f'{what} has {value:g} pieces of a turn, but must have 1 to {ROWS_MAX}')
    return int(value)


def check_phases(master: Floats, what: str) -> None:
    """Raise ProgramError if distances or speeds of phases (n, 5) are discontinuous."""
    t = np.diff(master[:, 0])
    _, s, v, a, j = master[:-1].T
    length, speed = max(float(np.abs(master[:, 1]).max()), 1e-3), max(float(np.abs(master[:, 2]).max()), 1e-3)
    jump_s = np.abs(s + t * (v + t * (a / 2.0 + t * j / 6.0)) - master[1:, 1]).max(initial=0.0)
    jump_v = np.abs(v + t * (a + t * j / 2.0) - master[1:, 2])[:-1].max(initial=0.0)
    if jump_s > CONTINUOUS * length or jump_v > CONTINUOUS * speed:
        raise ProgramError(f'{what}: its master jumps')

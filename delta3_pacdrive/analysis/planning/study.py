"""A plan over time and move by move: data only."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.motion.energy import Energy
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.numerics.types import Floats


class Quantity(StrEnum):
    """A quantity that may keep a move from being faster; those of ``motion.excess.Limited`` have the same names."""

    TCP_SPEED = 'TCP speed'
    TCP_ACCELERATION = 'TCP acceleration'
    TCP_JERK = 'TCP jerk'
    CURVATURE = 'curvature'  # the TCP's acceleration or jerk, most of which the bend of the path takes
    MOTOR_SPEED = 'motor speed'
    MOTOR_VOLTAGE = 'motor voltage'
    MOTOR_CURRENT = 'motor current'
    TORQUE_RATE = 'torque rate'
    RMS_CURRENT = 'rms current'  # of the whole program
    TIME = 'time given'  # the program tells how long it takes
    ROTARY = 'rotary axis'  # which turns the tool on the way


@dataclass(frozen=True)
class Samples:
    """A plan over time; arrays (n,) or (n, 3).

    Attributes
    ----------
    time_s
        From the start of the plan; at the joint of two phases there is a sample on either side.
    move
        Number of the move.
    distance_m
        That the TCP has gone since the start: the master.
    speed_m_s, acceleration_m_s2, jerk_m_s3
        Of the master, along the path.
    position_m
        Of the TCP.
    tcp_speed_m_s, tcp_acceleration_m_s2, tcp_jerk_m_s3
        Of the TCP in space, norms.
    curvature_1_m
        Of the path; nan where the TCP stands.
    speed_limit_m_s, acceleration_limit_m_s2, jerk_limit_m_s3
        That the program gives; nan where it gives none.
    arm_angle_rad, motor_speed_rad_s, motor_torque_n_m, motor_current_a
        Of each axis; torque and current with friction.
    used
        Share of each limit that is used, by quantity, 1 = all of it.
    leading
        Number of the quantity, in ``Quantity``'s order, that would be the first to break its limit if the plan were
        driven faster here.

    """

    time_s: Floats
    move: NDArray[np.int64]
    distance_m: Floats
    speed_m_s: Floats
    acceleration_m_s2: Floats
    jerk_m_s3: Floats
    position_m: Floats
    tcp_speed_m_s: Floats
    tcp_acceleration_m_s2: Floats
    tcp_jerk_m_s3: Floats
    curvature_1_m: Floats
    speed_limit_m_s: Floats
    acceleration_limit_m_s2: Floats
    jerk_limit_m_s3: Floats
    arm_angle_rad: Floats
    motor_speed_rad_s: Floats
    motor_torque_n_m: Floats
    motor_current_a: Floats
    used: dict[Quantity, Floats]
    leading: NDArray[np.int64]


@dataclass(frozen=True)
class Use:
    """Use that a move makes of a limit.

    Attributes
    ----------
    quantity
        Which it is.
    axis
        Number of the motor, 1 to 3; None for the TCP.
    peak, limit
        Largest value, and the limit where that is, in ``unit``.
    used
        Largest share of the limit, 1 = all of it.
    time_share
        Share of the move's time in which it is the first that a faster move would break.

    """

    quantity: Quantity
    axis: int | None
    peak: float
    limit: float
    unit: str
    used: float
    time_share: float


@dataclass(frozen=True)
class TurnRow:
    """The tool turns on a move: from where to where, how fast at most, and what its motor needs at most."""

    start_rad: float
    end_rad: float
    speed_max_rad_s: float
    acceleration_max_rad_s2: float
    current_max_a: float


@dataclass(frozen=True)
class StatementRow:
    """A statement of a blended sequence, on its own part of the path.

    The part begins where the blend of the statement before it ends, and ends where its own blend does.

    Attributes
    ----------
    start_s
        From the start of the sequence.
    speed_min_m_s, speed_max_m_s
        Smallest and largest speed of the TCP in space.
    limited_by
        The limit that keeps it from being faster.

    """

    name: str
    start_s: float
    duration_s: float
    length_m: float
    speed_min_m_s: float
    speed_max_m_s: float
    limited_by: Use


@dataclass(frozen=True)
class MoveRow:
    """A move of the plan.

    Attributes
    ----------
    number, name, kind
        From 1 on; of its statements; ``line``, ``arc`` and so on.
    start_s, duration_s, length_m
        When it begins, how long it takes, how far the TCP goes.
    payload_kg
        At its start.
    speed_max_m_s, acceleration_max_m_s2, jerk_max_m_s3
        Largest of the TCP in space.
    motor_speed_max_rad_s, motor_torque_max_n_m, motor_current_rms_a
        Of each motor; torque and current with friction.
    uses
        Of all limits, the most limiting first.
    limited_by
        What keeps it from being faster.
    distances
        Least distance to each limit of the place: workspace [m], arm angles and swing [deg], singularities; by key.
    turn
        What the tool does on the way; None where the plan says nothing of it.
    statements
        Those of a blended sequence; empty for other moves.

    """

    number: int
    name: str
    kind: str
    start_s: float
    duration_s: float
    length_m: float
    payload_kg: float
    speed_max_m_s: float
    acceleration_max_m_s2: float
    jerk_max_m_s3: float
    motor_speed_max_rad_s: tuple[float, ...]
    motor_torque_max_n_m: tuple[float, ...]
    motor_current_rms_a: tuple[float, ...]
    uses: tuple[Use, ...]
    limited_by: Use
    distances: dict[str, float]
    turn: TurnRow | None = None
    statements: tuple[StatementRow, ...] = ()


@dataclass(frozen=True)
class PlanStudy:
    """A planned program with its samples and rows, of its first round, and the energy of a round."""

    planned: Planned
    samples: Samples
    rows: tuple[MoveRow, ...]
    energy: Energy

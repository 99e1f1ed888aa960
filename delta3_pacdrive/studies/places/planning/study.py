"""Data of an evaluated plan, over time and by move."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.limits.energy import Energy
from delta3_pacdrive.planning.program_planner import Planned


class Quantity(StrEnum):
    """Quantity that can limit a move; shares the names of ``motion.excess.Limited``."""

    TCP_SPEED = 'TCP speed'
    TCP_ACCELERATION = 'TCP acceleration'
    TCP_JERK = 'TCP jerk'
    CURVATURE = 'curvature'  # TCP acceleration or jerk, most of it due to the curvature of the path
    MOTOR_SPEED = 'motor speed'
    MOTOR_VOLTAGE = 'motor voltage'
    MOTOR_CURRENT = 'motor current'
    TORQUE_RATE = 'torque rate'
    RMS_CURRENT = 'rms current'  # of the whole program
    TIME = 'time given'  # duration given by the program
    ROTARY = 'rotary axis'


@dataclass(frozen=True)
class Samples:
    """A plan over time; arrays (n,) or (n, 3)."""

    time_s: Floats  # from the start of the plan; one sample on either side of a phase boundary
    move: NDArray[np.int64]
    # master: distance of the TCP since the start and its derivatives along the path
    distance_m: Floats
    speed_m_s: Floats
    acceleration_m_s2: Floats
    jerk_m_s3: Floats
    # TCP: position and norms of its derivatives
    position_m: Floats
    tcp_speed_m_s: Floats
    tcp_acceleration_m_s2: Floats
    tcp_jerk_m_s3: Floats
    curvature_1_m: Floats  # of the path; nan where the TCP is at rest
    # limits of the program; nan without a limit
    speed_limit_m_s: Floats
    acceleration_limit_m_s2: Floats
    jerk_limit_m_s3: Floats
    # axes; torque and current include friction
    arm_angle_rad: Floats
    motor_speed_rad_s: Floats
    motor_torque_n_m: Floats
    motor_current_a: Floats
    used: dict[Quantity, Floats]  # used share of each limit
    leading: NDArray[np.int64]  # index in Quantity of the limit that a faster motion would violate first


@dataclass(frozen=True)
class Use:
    """Use of a limit by a move."""

    quantity: Quantity
    axis: int | None  # motor, 1 to 3; None for the TCP
    peak: float  # largest value, in ``unit``
    limit: float  # at the peak
    unit: str
    used: float  # largest share of the limit
    time_share: float  # share of the time in which a faster move would violate this limit first


@dataclass(frozen=True)
class TurnRow:
    """Rotation of the tool during a move."""

    start_rad: float
    end_rad: float
    speed_max_rad_s: float
    acceleration_max_rad_s2: float
    current_max_a: float


@dataclass(frozen=True)
class StatementRow:
    """Statement of a blended sequence, from the end of the previous blend to the end of its own."""

    name: str
    start_s: float  # from the start of the sequence
    duration_s: float
    length_m: float
    speed_min_m_s: float  # of the TCP in space
    speed_max_m_s: float
    limited_by: Use


@dataclass(frozen=True)
class MoveRow:
    """One move of a plan."""

    number: int  # from 1
    name: str  # of its statements
    kind: str  # 'line', 'arc', ...
    start_s: float
    duration_s: float
    length_m: float  # of the TCP path
    payload_kg: float  # at the start
    # of the TCP in space
    speed_max_m_s: float
    acceleration_max_m_s2: float
    jerk_max_m_s3: float
    # of each motor; torque and current include friction
    motor_speed_max_rad_s: tuple[float, ...]
    motor_torque_max_n_m: tuple[float, ...]
    motor_current_rms_a: tuple[float, ...]
    uses: tuple[Use, ...]  # of all limits, the most limiting first
    limited_by: Use
    distances: dict[
        str, float
    ]  # least distance to workspace [m], arm angle and swing limits [deg], singularities
    turn: TurnRow | None = None  # None if the move does not define the rotation
    statements: tuple[StatementRow, ...] = ()  # of a blended sequence


@dataclass(frozen=True)
class PlanStudy:
    """Planned program with samples and rows of its first round, and the energy of a round."""

    planned: Planned
    samples: Samples
    rows: tuple[MoveRow, ...]
    energy: Energy

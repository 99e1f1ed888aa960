"""Data of an evaluated plan, over time and by move."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.limits.energy import Energy
from delta3_pacdrive.planning.limits.gear_load import GearLoad
from delta3_pacdrive.planning.limits.supply import SupplyLoad
from delta3_pacdrive.planning.limits.temperature import Temperatures
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.studies.framework.columns import HIDDEN, Column


class Quantity(StrEnum):
    """Quantity that can limit a move; shares the names of ``planning.limits.violations.Limited``."""

    TCP_SPEED = 'TCP speed'
    TCP_ACCELERATION = 'TCP acceleration'
    TCP_JERK = 'TCP jerk'
    CURVATURE = 'curvature'  # TCP acceleration or jerk, most of it due to the curvature of the path
    MOTOR_SPEED = 'motor speed'
    MOTOR_VOLTAGE = 'motor voltage'
    MOTOR_CURRENT = 'motor current'
    GEAR_TORQUE = 'gear torque'
    ROD_FORCE = 'rod force'
    SPRING_FORCE = 'spring force'
    PLATE_MOMENT = 'plate moment'
    TORQUE_RATE = 'torque rate'
    RMS_CURRENT = 'rms current'  # of the whole program
    TIME = 'time given'  # duration given by the program
    ROTARY = 'rotary axis'

    @property
    def key(self) -> str:
        """Name in JSON."""
        return self.value.lower().replace(' ', '_')


@dataclass(frozen=True)
class Samples:
    """A plan over time; arrays (n,) or (n, 3)."""

    # from the start of the plan; one sample on either side of a phase boundary
    time_s: Annotated[Floats, Column('time [s]')]
    move: Annotated[NDArray[np.int64], Column('move')]  # from 1
    # master: distance of the TCP since the start and its derivatives along the path
    distance_m: Annotated[Floats, Column('distance [m]')]
    speed_m_s: Annotated[Floats, Column('speed [m/s]')]
    acceleration_m_s2: Annotated[Floats, Column('acceleration [m/s2]')]
    jerk_m_s3: Annotated[Floats, Column('jerk [m/s3]')]
    # TCP: position and norms of its derivatives
    position_m: Annotated[Floats, Column('{} [m]', 'xyz')]
    tcp_speed_m_s: Annotated[Floats, Column('TCP speed [m/s]')]
    tcp_acceleration_m_s2: Annotated[Floats, Column('TCP acceleration [m/s2]')]
    tcp_jerk_m_s3: Annotated[Floats, Column('TCP jerk [m/s3]')]
    curvature_1_m: Annotated[Floats, Column('curvature [1/m]')]  # of the path; nan where the TCP is at rest
    # limits of the program; nan without a limit
    speed_limit_m_s: Floats
    acceleration_limit_m_s2: Floats
    jerk_limit_m_s3: Floats
    # axes; torque and current include friction
    arm_angle_rad: Annotated[Floats, Column('arm angle {} [rad]')]
    motor_speed_rad_s: Annotated[Floats, Column('motor speed {} [rad/s]')]
    motor_torque_n_m: Annotated[Floats, Column('motor torque {} [N m]')]
    motor_current_a: Floats
    gear_torque_n_m: Annotated[Floats, Column('gear torque {} [N m]')]  # at the output
    # of each arm: axial force in that rod where it is largest, tension positive; needed force of its springs
    rod_force_n: Annotated[Floats, Column('rod force {} [N]')]
    spring_force_n: Annotated[Floats, Column('spring force {} [N]')]
    # of tool and payload on the plate
    plate_force_n: Annotated[Floats, Column('plate axial force [N]')]
    plate_moment_n_m: Annotated[Floats, Column('plate moment [N m]')]
    used: Annotated[dict[Quantity, Floats], Column('used: {}')]  # used share of each limit
    # index in Quantity of the limit that a faster motion would violate first
    leading: Annotated[NDArray[np.int64], Column('leading')]


@dataclass(frozen=True)
class Use:
    """Use of a limit by a move."""

    quantity: Annotated[Quantity, Column('limited by')]
    axis: Annotated[int | None, Column('axis')]  # motor, 1 to 3; None for the TCP
    peak: Annotated[float, Column(key='peak{unit!k}')]  # largest value, in ``unit``
    limit: Annotated[float, Column(key='limit{unit!k}')]  # at the peak
    unit: Annotated[str, HIDDEN]
    used: Annotated[float, Column('used')]  # largest share of the limit
    # share of the time in which a faster move would violate this limit first
    time_share: Annotated[float, Column('share of its time')]


@dataclass(frozen=True)
class TurnRow:
    """Rotation of a rotary axis during a move."""

    from_deg: float
    to_deg: float
    speed_max_deg_s: float
    acceleration_max_deg_s2: float
    motor_current_max_a: float


@dataclass(frozen=True)
class StatementRow:
    """Statement of a blended sequence, from the end of the previous blend to the end of its own."""

    name: Annotated[str, Column(key='statement')]
    start_s: float  # from the start of the sequence
    duration_s: Annotated[float, Column(key='time_s')]
    length_m: float
    speed_min_m_s: float  # of the TCP in space
    speed_max_m_s: float
    limited_by: Use


@dataclass(frozen=True)
class MoveRow:
    """One move of a plan."""

    number: Annotated[int, Column('move')]  # from 1
    name: Annotated[str, Column('statements', key='statements')]
    kind: Annotated[str, Column('kind')]  # 'line', 'arc', ...
    start_s: Annotated[float, Column('start [s]')]
    duration_s: Annotated[float, Column('time [s]', key='time_s')]
    length_m: Annotated[float, Column('length [m]')]  # of the TCP path
    payload_kg: Annotated[float, Column('payload [kg]')]  # at the start
    # of the TCP in space
    speed_max_m_s: Annotated[float, Column('speed [m/s]')]
    acceleration_max_m_s2: Annotated[float, Column('acceleration [m/s2]')]
    jerk_max_m_s3: Annotated[float, Column('jerk [m/s3]')]
    # of each motor; torque and current include friction
    motor_speed_max_rad_s: Annotated[tuple[float, ...], Column('motor speed {} [rad/s]')]
    motor_torque_max_n_m: Annotated[tuple[float, ...], Column('motor torque {} [N m]')]
    motor_current_rms_a: Annotated[tuple[float, ...], Column('rms current {} [A]')]
    gear_torque_max_n_m: Annotated[tuple[float, ...], Column('gear torque {} [N m]')]  # at the outputs
    # of each arm: largest axial force of a rod, largest needed force of the springs; of tool and payload on the plate
    rod_force_max_n: Annotated[tuple[float, ...], Column('rod force {} [N]')]
    spring_force_max_n: Annotated[tuple[float, ...], Column('spring force {} [N]')]
    plate_force_max_n: Annotated[float, Column('plate axial force [N]')]
    plate_moment_max_n_m: Annotated[float, Column('plate moment [N m]')]
    limited_by: Annotated[Use, Column('{}')]
    uses: Annotated[tuple[Use, ...], Column(key='limits')]  # of all limits, the most limiting first
    # of each rotary axis; None if the move does not define the rotation
    turn: Annotated[TurnRow | None, Column(optional=True)]
    turn_2: Annotated[TurnRow | None, Column(optional=True)]
    # least distance to workspace [m], arm angle and swing limits [deg], singularities, by key with unit
    distances: dict[str, float]
    # of a blended sequence
    statements: Annotated[tuple[StatementRow, ...], Column(key='by_statement', optional=True)]

    @property
    def turns(self) -> tuple[TurnRow, ...]:
        """Rotations of the rotary axes; empty if the move does not define them."""
        return tuple(turn for turn in (self.turn, self.turn_2) if turn is not None)


@dataclass(frozen=True)
class PlanStudy:
    """Planned program with samples and rows of its first round; loads of a round, temperatures after a shift."""

    planned: Planned
    samples: Samples
    rows: tuple[MoveRow, ...]
    energy: Energy
    gears: GearLoad
    temperature: Temperatures
    supply: SupplyLoad | None = None  # of the first round by the arms; None without a model of the supply

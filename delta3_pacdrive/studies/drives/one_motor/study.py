"""Settings and results of a single-motor study, data only."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.framework.columns import Column


@dataclass(frozen=True)
class Settings:
    """Settings of a single-motor study."""

    parameters: str | None  # file; None: the packaged one
    axis: int  # arm whose motion the motor executes, 1 to 3
    load_inertia_kg_m2: float | None = None  # I_Load; None: from the parameters
    load_torque_n_m: float | None = None  # tau_load; None: from the parameters
    coupling_effect: float | None = None  # CE; None: from the parameters
    trace: str | None = None  # file for all signals; None: none


@dataclass(frozen=True)
class SingleRun:
    """Signals of one motor in every period of the current loop, motor side, shapes (n,)."""

    program: str
    axis: int
    robot: Parameters
    inertia_kg_m2: float  # of the shaft with its load
    time_s: Annotated[Floats, Column('time [s]')]  # start of the period, from the start of the program
    command: Annotated[Floats, Column('command [rad]')]  # in the MDT of the bus cycle
    reference: Annotated[Floats, Column('reference [rad]')]  # interpolated set point of the drive
    position: Annotated[Floats, Column('position [rad]')]  # of the shaft at the start of the period
    speed: Annotated[Floats, Column('speed [rad/s]')]  # of the shaft at the start of the period
    acceleration: Floats  # mean over the exchange period [rad/s2]
    speed_reference: Floats  # of the velocity loop [rad/s]
    current_reference: Floats  # of the current loop [A]
    current: Annotated[Floats, Column('current [A]')]  # at the end of the period
    phase_currents: Annotated[Floats, Column('I{}s [A]')]  # shape (n, 3)
    voltage: Annotated[Floats, Column('voltage [V]')]  # of a phase
    torque: Annotated[Floats, Column('torque [N m]')]  # K_m I
    friction: Annotated[Floats, Column('friction [N m]')]
    load: Annotated[Floats, Column('load [N m]')]  # tau_load / k_r
    coupling: Annotated[Floats, Column('coupling [N m]')]  # CE d
    position_error: Floats  # set point less shaft [rad]
    in_robot: Floats  # shaft of the same motor in the robot [rad]
    meta: dict[str, Any]  # format of Trace.meta

    @property
    def driven(self) -> slice:
        """Rows from the start of the program."""
        return slice(int(np.searchsorted(self.time_s, -1e-9)), None)

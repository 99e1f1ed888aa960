"""Settings and results of learning, data only."""

from dataclasses import dataclass
from typing import Annotated

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.learned_torques import Learned
from delta3_pacdrive.studies.framework.columns import Column


@dataclass(frozen=True)
class Settings:
    """Settings of learning."""

    program: str  # file, or name of a packaged program
    parameters: str | None  # file of the robot; None: the packaged one
    machine: str | None  # file of the simulated robot, if it differs from the controller's; None: the same
    repetitions: int  # maximum number
    bandwidth_hz: float  # of the Q filter
    # weight of the change of the torques, relative to the largest gain of an axis
    change_weight: float = 1e-3
    torque_weight: float = 1e-4  # weight of the torques, relative to the largest gain of an axis


@dataclass(frozen=True)
class Contraction:
    """Contraction rate of learning for one load."""

    masses: Annotated[float, Column('masses')]  # of the robot relative to those in the controller
    place_m: Annotated[tuple[float, float, float], Column('{} [m]', 'xyz')]  # TCP position
    payload_kg: Annotated[float, Column('payload [kg]')]
    # largest singular value over all frequencies; below 1 learning converges monotonically
    rate: Annotated[float, Column('rate')]
    at_hz: Annotated[float, Column('frequency [Hz]')]  # frequency of the rate


@dataclass(frozen=True)
class Repetition:
    """One run of the program; number 0 is without learned torques.

    TCP errors are those of the controller, currents those of the most loaded motor.
    """

    number: Annotated[int, Column('repetition')]
    tcp_error_max_m: Annotated[float, Column('TCP error max [m]')]
    tcp_error_rms_m: Annotated[float, Column('TCP error rms [m]')]
    current_peak_a: Annotated[float, Column('current peak [A]')]
    current_rms_a: Annotated[float, Column('current rms [A]')]
    torque_max_n_m: Annotated[float, Column('learned torque max [N m]')]  # of the applied torques


@dataclass(frozen=True)
class Results:
    """Repetitions, the best one, and its learned torques."""

    program: str
    contractions: tuple[Contraction, ...]
    repetitions: tuple[Repetition, ...]
    best: Repetition
    learned: Learned
    time_s: Floats  # from the start of the program, shape (n,)
    before_m: Floats  # TCP error without learned torques, shape (n, 3)
    after_m: Floats  # TCP error with them, shape (n, 3)
    at_end: str  # reason for ending the repetitions

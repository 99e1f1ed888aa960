"""What learning depends on, and what it finds."""

from dataclasses import dataclass

from delta3_pacdrive.motion.learned import Learned
from delta3_pacdrive.numerics.types import Floats


@dataclass(frozen=True)
class Settings:
    """The settings are what learning depends on, apart from the contents of its files.

    Attributes
    ----------
    program
        Program file, or the name of a packaged one.
    parameters
        Parameter file of the robot; None: the packaged one.
    machine
        Parameter file of the robot that is driven, where the controller takes it for another one; None: the same.
    repetitions
        At most.
    bandwidth_hz
        Of the Q filter: what is faster is not learned.
    change_weight, torque_weight
        Of the norm that a repetition makes least: weights of the change of the torques and of the torques, over that
        of the errors. They are shares of the largest gain of an axis.

    """

    program: str
    parameters: str | None
    machine: str | None
    repetitions: int
    bandwidth_hz: float
    change_weight: float = 1e-3
    torque_weight: float = 1e-4


@dataclass(frozen=True)
class Contraction:
    """A contraction is how much of the distance to the end of learning a repetition leaves, at most, with one load.

    Attributes
    ----------
    masses
        Of the robot over those that the controller knows.
    place_m, payload_kg
        Where the robot stands, and what it holds.
    rate
        Largest singular value over all frequencies: below 1 learning converges monotonically.
    at_hz
        Where that is.

    """

    masses: float
    place_m: tuple[float, float, float]
    payload_kg: float
    rate: float
    at_hz: float


@dataclass(frozen=True)
class Repetition:
    """A repetition is one run of the program; number 0 is without learned torques.

    Attributes
    ----------
    tcp_error_max_m, tcp_error_rms_m, current_peak_a, current_rms_a
        As the controller sees it; of the motor that has most.
    torque_max_n_m
        Largest of the torques that were learned before it.

    """

    number: int
    tcp_error_max_m: float
    tcp_error_rms_m: float
    current_peak_a: float
    current_rms_a: float
    torque_max_n_m: float


@dataclass(frozen=True)
class Results:
    """The results are the repetitions, which of them is the best, and what was learned for that.

    Attributes
    ----------
    time_s
        From the start of the program, shape (n,).
    before_m, after_m
        TCP error without and with what was learned, shape (n, 3).
    at_end
        Why no more repetitions followed.

    """

    program: str
    contractions: tuple[Contraction, ...]
    repetitions: tuple[Repetition, ...]
    best: Repetition
    learned: Learned
    time_s: Floats
    before_m: Floats
    after_m: Floats
    at_end: str

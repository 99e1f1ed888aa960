"""What a study of the ripple depends on, and what it finds."""

from dataclasses import dataclass

from delta3_pacdrive.numerics.types import Floats


@dataclass(frozen=True)
class Settings:
    """The settings are what the study depends on, apart from the contents of its files.

    Attributes
    ----------
    program
        Program file, or the name of a packaged one.
    parameters
        Parameter file; None: the packaged one.
    cycle_times_s
        Of the bus.
    interpolations
        Fine interpolations of the drives.
    axis
        Number of the motor that the figures show, 1 to 3.
    at_s
        Time from the start of the program whose bus cycle is shown; None: that of the largest current.

    """

    program: str
    parameters: str | None
    cycle_times_s: tuple[float, ...]
    interpolations: tuple[str, ...]
    axis: int
    at_s: float | None = None


@dataclass(frozen=True)
class Samples:
    """The samples are those of one motor in every period of the current loop, shapes (n,).

    Attributes
    ----------
    time_s
        Start of the period, from the start of the program.
    set_point, speed_reference, speed, current_reference, voltage
        During the period [rad, rad/s, rad/s, A, V]; the speed at its start.
    current
        At its end [A].
    at_time_s, at_current
        Of the AT: when its sample was taken, and the sample [A].

    """

    time_s: Floats
    set_point: Floats
    speed_reference: Floats
    speed: Floats
    current_reference: Floats
    voltage: Floats
    current: Floats
    at_time_s: Floats
    at_current: Floats


@dataclass(frozen=True)
class Case:
    """A case is one cycle time with one interpolation; lists are by axis.

    Attributes
    ----------
    delay_s
        Of a set point.
    at_peak_a, at_rms_a
        Of the currents that the AT tell.
    peak_a, rms_a
        Of all samples.
    jerk_rad_s3
        Root mean square of what the motor's torque gives an arm of the mean inertia, above ``JERK_FROM_HZ``.
    tcp_error_max_m, tcp_error_rms_m
        Set-point delay removed.
    samples
        Of the motor that the figures show.

    """

    cycle_time_s: float
    interpolation: str
    delay_s: float
    at_peak_a: list[float]
    at_rms_a: list[float]
    peak_a: list[float]
    rms_a: list[float]
    jerk_rad_s3: list[float]
    tcp_error_max_m: float
    tcp_error_rms_m: float
    samples: Samples


@dataclass(frozen=True)
class Results:
    """The results are the cases, and which bus cycle of each is shown from where [s]."""

    program: str
    axis: int
    cases: tuple[Case, ...]
    shown_s: float

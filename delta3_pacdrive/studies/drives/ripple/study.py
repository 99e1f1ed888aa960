"""Settings and results of a ripple study, data only."""

from dataclasses import dataclass
from typing import Annotated

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.framework.columns import HIDDEN, Column

# planned jerk has tens of Hz; higher frequencies are audible and excite frame and gears
JERK_FROM_HZ = 100.0


@dataclass(frozen=True)
class Samples:
    """Samples of one motor in every period of the current loop, shapes (n,)."""

    time_s: Floats  # start of the period, from the start of the program
    set_point: Floats  # during the period [rad]
    speed_reference: Floats  # during the period [rad/s]
    speed: Floats  # at the start of the period [rad/s]
    current_reference: Floats  # during the period [A]
    voltage: Floats  # during the period [V]
    current: Floats  # at the end of the period [A]
    at_time_s: Floats  # sampling time of the AT
    at_current: Floats  # sample in the AT [A]


@dataclass(frozen=True)
class Case:
    """Figures of a cycle time with an interpolation; lists are by axis."""

    cycle_time_s: Annotated[float, Column('cycle time [s]')]
    interpolation: Annotated[str, Column('interpolation')]
    axis: Annotated[tuple[int, ...], Column('axis', in_json=False)]  # numbers of the axes
    set_point_delay_s: Annotated[float, Column('set-point delay [s]')]
    at_current_peak_a: Annotated[list[float], Column('AT peak [A]')]  # of the samples in the AT
    at_current_rms_a: Annotated[list[float], Column('AT rms [A]')]
    current_peak_a: Annotated[list[float], Column('peak [A]')]  # of all samples
    current_rms_a: Annotated[list[float], Column('rms [A]')]
    # rms jerk of an arm with mean inertia due to its motor, above JERK_FROM_HZ
    jerk_rad_s3: Annotated[list[float], Column('jerk [rad/s3]')]
    tcp_error_max_m: Annotated[float, Column('TCP error max [m]')]  # set-point delay removed
    tcp_error_rms_m: Annotated[float, Column('TCP error rms [m]')]
    samples: Annotated[Samples, HIDDEN]  # of the motor shown in the figures


@dataclass(frozen=True)
class Settings:
    """Settings of a ripple study."""

    program: str  # file, or name of a packaged program
    parameters: str | None  # file; None: the packaged one
    cycle_times_s: tuple[float, ...]  # of the bus
    interpolations: tuple[str, ...]  # fine interpolations of the drives
    axis: int  # motor shown in the figures, 1 to 3
    at_s: float | None = None  # time whose bus cycle is shown; None: that of the largest current


@dataclass(frozen=True)
class Results:
    """All cases, and the start of the displayed bus cycle [s]."""

    program: str
    axis: int
    cases: tuple[Case, ...]
    shown_s: float

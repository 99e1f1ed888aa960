"""What a tuning depends on, and what it finds."""

from dataclasses import dataclass

from delta3_pacdrive.analysis.tuning.analysis import LoopResult, OperatingPoint
from delta3_pacdrive.analysis.tuning.disturbance import Rejection
from delta3_pacdrive.analysis.tuning.effect import Effect
from delta3_pacdrive.analysis.tuning.load import Load
from delta3_pacdrive.analysis.tuning.measured_response import MeasuredResponse
from delta3_pacdrive.analysis.tuning.proposal import Proposal
from delta3_pacdrive.parameters import Parameters


@dataclass(frozen=True)
class Settings:
    """The settings are what a tuning depends on, apart from the contents of its files.

    Attributes
    ----------
    parameters
        Parameter file; None: the packaged one.
    pose_m
        Where the load is looked at; None: home.
    payload_kg
        Carried everywhere; None: as the parameters say.
    axis
        1 to 3, or 4: the drive of the rotary axis.
    speed_rad_s
        At which the bench turns, motor side.
    amplitude
        Multiple of the usual excitations.
    changes
        Texts ``NAME=VALUE``; empty: nothing is compared.
    sweep
        Text ``NAME=LOW:HIGH:N``, or None.
    program
        That shows the effect; None: the usual one.
    recording
        Trace or bag; None without.
    exchange_period_s
        Between drives and plant in simulated programs; None: as the parameters say.
    auto
        Whether gains are looked for, with payloads up to ``payload_kg``; None: up to the rated one.
    phase_margin_deg, gain_margin_db
        That they keep.

    """

    parameters: str | None = None
    pose_m: tuple[float, float, float] | None = None
    payload_kg: float | None = None
    axis: int = 1
    speed_rad_s: float = 10.0
    amplitude: float = 1.0
    changes: tuple[str, ...] = ()
    sweep: str | None = None
    program: str | None = None
    recording: str | None = None
    exchange_period_s: float | None = None
    auto: bool = False
    phase_margin_deg: float | None = None
    gain_margin_db: float | None = None


@dataclass(frozen=True)
class Variant:
    """A variant is the robot with one set of gains.

    Attributes
    ----------
    robot
        With these gains.
    loops
        As ``analysis.analyse`` returns them.
    workspace
        Velocity loop, position loop, cascade, and cascade that exchanges with its plant as simulations do, by load.
    effect
        On the program.
    rejection
        Of disturbances, with the load of the operating point; None where the loops are not stable.

    """

    robot: Parameters
    loops: list[LoopResult]
    workspace: list[tuple[Load, list[LoopResult]]]
    effect: Effect
    rejection: Rejection | None


@dataclass(frozen=True)
class SweepPoint:
    """A point is one value of a sweep.

    Attributes
    ----------
    value
        Of the gain [SI].
    loops
        Linear.
    overshoot
        Of the drive on the bench, by loop; None: it trips.
    workspace_stable
        Whether every load of the workspace is stable with the simulation's exchange period.
    effect
        On the program.

    """

    value: float
    loops: list[LoopResult]
    overshoot: dict[str, float | None]
    workspace_stable: bool
    effect: Effect


@dataclass(frozen=True)
class Results:
    """The results are what a tuning finds.

    Attributes
    ----------
    operation
        At what the loops were looked at.
    program
        Name of the one that shows the effect.
    variants
        By name: ``now``, or ``before`` and ``after``.
    by_loop
        Their loops by the name of the loop and of the variant.
    swept, points
        Name of the parameter that was swept, and its values; empty without a sweep.
    measured
        Responses of a recording.
    proposal
        Gains that were searched; None without a search.
    margins_given
        Whether the user asked for its margins, so that it is proposed even if it is worse in all other figures.

    """

    operation: OperatingPoint
    program: str
    variants: dict[str, Variant]
    by_loop: dict[str, dict[str, LoopResult]]
    swept: str
    points: list[SweepPoint]
    measured: list[MeasuredResponse]
    proposal: Proposal | None = None
    margins_given: bool = False

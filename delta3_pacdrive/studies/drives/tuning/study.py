"""Settings and results of a tuning study."""

from dataclasses import dataclass

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.drives.loops.analysis import LoopResult, OperatingPoint
from delta3_pacdrive.studies.drives.loops.disturbance import Rejection
from delta3_pacdrive.studies.drives.loops.load import Load
from delta3_pacdrive.studies.drives.tuning.effect import Effect
from delta3_pacdrive.studies.drives.tuning.measured_response import MeasuredResponse
from delta3_pacdrive.studies.drives.tuning.proposal import Proposal


@dataclass(frozen=True)
class Settings:
    """Settings of a tuning study, except for the contents of its files."""

    parameters: str | None = None  # file; None: packaged parameters
    pose_m: tuple[float, float, float] | None = None  # operating point; None: home
    payload_kg: float | None = None  # None: as in the parameters
    axis: int = 1  # 1 to 3: arm; 4 or 5: rotary axis
    speed_rad_s: float = 10.0  # of the bench, motor side
    amplitude: float = 1.0  # multiple of the default excitations
    changes: tuple[str, ...] = ()  # NAME=VALUE; empty: no comparison
    sweep: str | None = None  # NAME=LOW:HIGH:N
    program: str | None = None  # program that shows the effect; None: default program
    recording: str | None = None  # trace or bag
    exchange_period_s: float | None = (
        None  # between drives and plant in simulations; None: as in the parameters
    )
    auto: bool = False  # search for gains, with payloads up to payload_kg (None: rated payload)
    phase_margin_deg: float | None = None  # required from the search
    gain_margin_db: float | None = None


@dataclass(frozen=True)
class Variant:
    """Results of the robot with one set of gains."""

    robot: Parameters  # with these gains
    loops: list[LoopResult]  # as returned by analysis.analyse
    # by load: velocity loop, position loop, cascade, and cascade that exchanges with its plant as in simulations
    workspace: list[tuple[Load, list[LoopResult]]]
    effect: Effect  # on the program
    rejection: Rejection | None  # with the load of the operating point; None if the loops are unstable


@dataclass(frozen=True)
class SweepPoint:
    """Results for one value of a sweep."""

    value: float  # of the swept gain [SI]
    loops: list[LoopResult]  # linear
    overshoot: dict[str, float | None]  # of the drive on the bench, by loop; None if it trips
    workspace_stable: bool  # for every load of the workspace, with the exchange period of the simulation
    effect: Effect  # on the program


@dataclass(frozen=True)
class Results:
    """Results of a tuning study."""

    operation: OperatingPoint
    program: str  # name of the program that shows the effect
    variants: dict[str, Variant]  # 'now', or 'before' and 'after'
    by_loop: dict[str, dict[str, LoopResult]]  # loops by name of the loop and of the variant
    swept: str  # name of the swept parameter; empty without a sweep
    points: list[SweepPoint]
    measured: list[MeasuredResponse]  # responses of a recording
    proposal: Proposal | None = None  # None without a search
    margins_given: bool = (
        False  # requested by the user: gains are proposed even if all other figures are worse
    )

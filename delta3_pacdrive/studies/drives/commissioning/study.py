"""Settings and results of the commissioning of a running robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from delta3_pacdrive.studies.framework.columns import HIDDEN, Column

if TYPE_CHECKING:
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.studies.drives.commissioning.mechanics import Mechanics
    from delta3_pacdrive.studies.drives.commissioning.responses import AxisResponse
    from delta3_pacdrive.studies.drives.tuning.candidates import Gains, Least
    from delta3_pacdrive.studies.drives.tuning.proposal import Targets


@dataclass(frozen=True)
class Settings:
    """Settings of the commissioning."""

    namespace: str = '/'
    propose: bool = False
    apply: bool = False  # write the proposed gains to the drives and verify them
    phase_margin_deg: float | None = None  # None: default of the proposal
    gain_margin_db: float | None = None


@dataclass(frozen=True)
class AxisMargins:
    """Measured margins of all loops of an axis, open at its current set point; None outside the measured band."""

    gains: Annotated[str, Column('gains')]  # before or after
    axis: Annotated[int, Column('axis')]  # 1 to 3
    phase_margin_deg: Annotated[float | None, Column('phase margin [deg]')]
    crossover_hz: Annotated[float | None, Column('crossover [Hz]')]
    gain_margin_db: Annotated[float | None, Column('gain margin [dB]')]
    gain_margin_hz: Annotated[float | None, Column('gain margin at [Hz]')]
    band_low_hz: Annotated[float | None, Column('measured from [Hz]')]
    band_high_hz: Annotated[float | None, Column('measured to [Hz]')]


@dataclass(frozen=True)
class Measurement:
    """Responses and margins of the three axes with one set of gains."""

    responses: list[AxisResponse]
    margins: list[AxisMargins]
    least: Least  # of velocity loop, position loop and cascade, from the measured plants


@dataclass(frozen=True)
class Proposed:
    """Gains from the measured plants."""

    targets: Targets
    gains: Gains
    least: Least
    before: Gains


@dataclass(frozen=True)
class Outcome:
    """Result of ``--apply``: whether the gains stay in the drives, and why."""

    kept: bool
    sentence: str


@dataclass(frozen=True)
class Results:
    """Results of the commissioning."""

    angles_rad: Sequence[float]
    tcp_m: Sequence[float]
    parameters: Annotated[Parameters, HIDDEN]
    mechanics: list[Mechanics]
    measured: dict[str, Measurement]  # 'before', and 'after' if the gains were applied
    proposed: Proposed | None
    outcome: Outcome | None

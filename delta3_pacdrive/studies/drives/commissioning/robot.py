"""A running robot as the commissioning uses it, and the records of its motions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.drives.commissioning.strokes import Strokes
from delta3_pacdrive.studies.drives.tuning.drive_gains import Channel


@dataclass(frozen=True)
class AxisRecord:
    """Oscilloscope record of a motion of one axis at the rate of its current loop."""

    axis: int  # 0 to 2, the moved axis
    first: int  # number of the first sample; sample n is at the end of period n - 1 of the current loop
    sample_s: float
    signals: Mapping[str, Floats]  # by full name of a channel, each of shape (samples,)

    def own(self, channel: str) -> Floats:
        """Return a channel of the moved axis."""
        return self.signals[f'axis{self.axis + 1}.{channel}']


@dataclass(frozen=True)
class ProgramRun:
    """Execution of the test program."""

    figures: dict[str, Any]  # of the controller: TCP error, currents
    time_s: Floats
    following_error_rad: Floats  # of the drives, shape (samples, 3)


@dataclass(frozen=True)
class RestRecord:
    """Encoders of the disabled robot."""

    position_rad: Floats  # shape (samples, 3)
    moved_rad: Sequence[float]  # from enabled to the end of the record


class RunningRobot(Protocol):
    """A robot in cyclic operation, enabled and at rest; its motion is exclusive during the commissioning."""

    parameters: Parameters  # as read from its nodes
    channel: Channel  # service channels of its drives

    def angles_rad(self) -> Sequence[float]:
        """Return the commanded arm angles at rest."""

    def record(self, strokes: Strokes, excited: bool) -> AxisRecord:
        """Execute strokes, excited by the generator of the drive or not, and return the record.

        Raises
        ------
        ProgramError
            The robot or a drive rejects a request.
        RunError
            The robot does not respond, or stopped with a fault.

        """

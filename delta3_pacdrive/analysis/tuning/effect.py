"""What gains do to a program: following error, TCP error and currents of a simulated run."""

from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.analysis.tuning.tuned_drive import TOOL_AXIS, ArmDrive
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

ARMS = ArmDrive(1)  # figures of a program are those of all of them


@dataclass(frozen=True)
class Effect:
    """The effect of gains on a program is in these figures, which are None where a drive tripped.

    Attributes
    ----------
    following_error_max_rad, following_error_rms_rad
        Of all arms, or of the tool, dead time removed (7.3).
    tcp_error_max_m, tcp_error_rms_m
        Length of the TCP error, set-point delay removed.
    current_peak_a, current_rms_a
        Of the axis with the largest.
    fault
        Sentence about the drive that tripped; empty if none did.
    time_s, following_error_rad, tcp_error_m
        From the start of the program; shapes (cycles,), (cycles, 3) or (cycles, 1), (cycles,).

    """

    following_error_max_rad: float | None
    following_error_rms_rad: float | None
    tcp_error_max_m: float | None
    tcp_error_rms_m: float | None
    current_peak_a: float | None
    current_rms_a: float | None
    fault: str
    time_s: Floats
    following_error_rad: Floats
    tcp_error_m: Floats

    @property
    def axes(self) -> tuple[int, ...]:
        """Numbers of the axes whose following error it has."""
        count = self.following_error_rad.shape[1]
        return tuple(range(1, count + 1)) if count > 1 else (TOOL_AXIS,)

    def figures(self) -> dict[str, float | str | None]:
        """All but the signals, by name."""
        return {name: value for name, value in vars(self).items() if not isinstance(value, np.ndarray)}


def run(program: Program, parameters: Parameters, drive: ArmDrive = ARMS) -> Effect:
    """Simulate a program; a drive that trips is a finding, not an error.

    Raises
    ------
    ProgramError
        The program is refused.

    """
    nothing = np.empty(0)
    try:
        trace = simulation.run(program, parameters)
    except RunError as error:
        return Effect(None, None, None, None, None, None, str(error), nothing, np.empty((0, 3)), nothing)
    first = int(trace.meta['start_cycle'])
    following = drive.following_error(trace, parameters)[first:]
    tcp = np.linalg.norm(trace['tcp_error'][first:], axis=1)
    figures = trace.meta['figures']
    peak_a, rms_a = drive.currents(trace)
    return Effect(
        float(np.abs(following).max()),
        float(np.sqrt(np.mean(following**2))),
        float(figures['tcp_error_max_m']),
        float(figures['tcp_error_rms_m']),
        peak_a,
        rms_a,
        str(trace.meta['stopped']),
        trace.time_s[first:] - trace.time_s[first],
        following,
        tcp,
    )

"""Effect of drive gains on a simulated program: following error, TCP error and currents."""

from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.studies.drives.loops.tuned_drive import TOOL_AXIS, ArmDrive

ARMS = ArmDrive(1)  # an arm stands for all arms in the figures of a program


@dataclass(frozen=True)
class Effect:
    """Errors and currents of a program simulated with one set of gains; figures are None if a drive tripped."""

    following_error_max_rad: float | None  # maximum over the arms, or of the tool; dead time removed (7.3)
    following_error_rms_rad: float | None
    tcp_error_max_m: float | None  # length of the TCP error; set-point delay removed
    tcp_error_rms_m: float | None
    current_peak_a: float | None  # largest of all axes
    current_rms_a: float | None
    fault: str  # describes the drive that tripped; empty if none did
    time_s: Floats  # from the start of the program, shape (cycles,)
    following_error_rad: Floats  # shape (cycles, 3), or (cycles, 1) for the tool
    tcp_error_m: Floats  # shape (cycles,)

    @property
    def axes(self) -> tuple[int, ...]:
        """Numbers of the axes in ``following_error_rad``."""
        count = self.following_error_rad.shape[1]
        return tuple(range(1, count + 1)) if count > 1 else (TOOL_AXIS,)

    def figures(self) -> dict[str, float | str | None]:
        """Return all fields except the signals, by name."""
        return {name: value for name, value in vars(self).items() if not isinstance(value, np.ndarray)}


def run(program: Program, parameters: Parameters, drive: ArmDrive = ARMS) -> Effect:
    """Simulate a program; a tripped drive is reported in ``Effect.fault`` and does not raise.

    Raises
    ------
    ProgramError
        The program is invalid.

    """
    nothing = np.empty(0)
    try:
        trace = simulation.run(program, parameters)
    except RunError as error:
        return Effect(
            following_error_max_rad=None,
            following_error_rms_rad=None,
            tcp_error_max_m=None,
            tcp_error_rms_m=None,
            current_peak_a=None,
            current_rms_a=None,
            fault=str(error),
            time_s=nothing,
            following_error_rad=np.empty((0, 3)),
            tcp_error_m=nothing,
        )
    first = int(trace.meta['start_cycle'])
    following = drive.following_error(trace, parameters)[first:]
    tcp = np.linalg.norm(trace['tcp_error'][first:], axis=1)
    figures = trace.meta['figures']
    peak_a, rms_a = drive.currents(trace)
    return Effect(
        following_error_max_rad=float(np.abs(following).max()),
        following_error_rms_rad=float(np.sqrt(np.mean(following**2))),
        tcp_error_max_m=float(figures['tcp_error_max_m']),
        tcp_error_rms_m=float(figures['tcp_error_rms_m']),
        current_peak_a=peak_a,
        current_rms_a=rms_a,
        fault=str(trace.meta['stopped']),
        time_s=trace.time_s[first:] - trace.time_s[first],
        following_error_rad=following,
        tcp_error_m=tcp,
    )

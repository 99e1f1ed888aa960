"""Effect of drive gains on a simulated program: following error, TCP error and currents."""

from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.studies.drives.loops.tuned_drive import ArmDrive
from delta3_pacdrive.studies.framework.columns import HIDDEN, Column

ARMS = ArmDrive(1)  # an arm stands for all arms in the figures of a program


@dataclass(frozen=True)
class Effect:
    """Errors and currents of a program simulated with one set of gains; figures are None if a drive tripped."""

    # maximum over the arms, or of the tool; dead time removed (7.3)
    following_error_max_rad: Annotated[float | None, Column('following error max [rad]')]
    following_error_rms_rad: Annotated[float | None, Column('following error rms [rad]')]
    # length of the TCP error; set-point delay removed
    tcp_error_max_m: Annotated[float | None, Column('TCP error max [m]')]
    tcp_error_rms_m: Annotated[float | None, Column('TCP error rms [m]')]
    current_peak_a: Annotated[float | None, Column('current peak [A]')]  # largest of all axes
    current_rms_a: Annotated[float | None, Column('current rms [A]')]
    fault: Annotated[str, Column('fault')]  # describes the drive that tripped; empty if none did
    time_s: Annotated[Floats, HIDDEN]  # from the start of the program, shape (cycles,)
    following_error_rad: Annotated[Floats, HIDDEN]  # shape (cycles, 3), or (cycles, 1) for the tool
    tcp_error_m: Annotated[Floats, HIDDEN]  # shape (cycles,)
    axes: Annotated[tuple[int, ...], HIDDEN]  # numbers of the axes in ``following_error_rad``


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
        figures: dict[str, Any] = {field.name: None for field in fields(Effect)[:6]}
        return Effect(
            **figures,
            fault=str(error),
            time_s=nothing,
            following_error_rad=np.empty((0, 3)),
            tcp_error_m=nothing,
            axes=drive.axes,
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
        axes=drive.axes,
    )

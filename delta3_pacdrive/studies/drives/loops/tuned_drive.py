"""The tuned drive: that of an arm or of a rotary axis; loops and bench are the same for both."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delta3_pacdrive.axes import ARMS, numbered
from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import RATED_PAYLOAD_KG, Parameters, rotary_axis_parameters
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program, turns_of
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.sercos.configuration_check import require_axis
from delta3_pacdrive.studies.drives.loops.load import Load, extremes, load_at

HALF_TURN = 'half a turn and back'


@dataclass(frozen=True)
class ArmDrive:
    """Drive of an arm, axis 1 to 3."""

    axis: int
    usual_program = 'experiment1'  # packaged; empty for a program of this module

    @property
    def axes(self) -> tuple[int, ...]:
        """Numbers of the axes in ``following_error``."""
        return tuple(range(1, ARMS + 1))

    def in_loops(self, robot: Parameters) -> Parameters:
        """Return the parameters of its loops."""
        return robot

    def load(self, pose_m: Sequence[float] | None, robot: Parameters) -> Load:
        """Return the load in a pose, or at home; raises UnreachableError."""
        return load_at(pose_m or robot.motion.home_m, self.axis - 1, robot)

    def extremes(self, robot: Parameters) -> tuple[Load, Load]:
        """Return the lightest and the heaviest load over the workspace; raises TuningError."""
        return extremes(robot)

    def program(self, name: str | None, robot: Parameters) -> Program:
        """Return the program that shows the effect of gains; raises ProgramError."""
        return programs.load(name or self.usual_program, robot.motion)

    def following_error(self, trace: Trace, robot: Parameters) -> Floats:
        """Return the following error of a run [rad, motor side], shape (cycles, drives)."""
        return trace['following_error']

    def currents(self, trace: Trace) -> tuple[float, float]:
        """Return peak and rms current [A], each the largest over the axes."""
        figures = trace.meta['figures']
        return float(max(figures['current_peak_a'])), float(max(figures['current_rms_a']))


class ToolDrive(ArmDrive):
    """Drive of a rotary axis; bar, tool and part are its load in every pose. Raises TuningError without one."""

    usual_program = ''

    def __init__(self, axis: int, robot: Parameters) -> None:
        super().__init__(axis)
        require_axis(f'axis{axis}', robot.axes, TuningError, f'--axis is {axis}, but ')

    @property
    def axes(self) -> tuple[int, ...]:
        """Numbers of the axes in ``following_error``."""
        return (self.axis,)

    @property
    def _number(self) -> int:
        """Number of the rotary axis, from 0."""
        return self.axis - 1 - ARMS

    def in_loops(self, robot: Parameters) -> Parameters:
        """Return the parameters of its loops; the bar is modelled as a gear, elastic in a built robot."""
        own, rotary = rotary_axis_parameters(robot, self._number), robot.rotary_axes[self._number]
        gear = replace(
            own.rich,
            gear_stiffness_n_m_rad=rotary.bar_stiffness_n_m_rad,
            gear_damping_n_m_s_rad=rotary.bar_damping_n_m_s_rad,
        )
        return replace(own, rich=gear)

    def load(self, pose_m: Sequence[float] | None, robot: Parameters) -> Load:
        """Return the load: bar, tool, and a part with the mass of the payload."""
        if pose_m is not None:
            raise TuningError('--pose is for the arms: the load of the tool is the same everywhere')
        return self._load(robot.dynamics.payload_mass_kg, robot)

    def extremes(self, robot: Parameters) -> tuple[Load, Load]:
        """Return the load without a part, and with one of the rated payload or more."""
        heaviest = max(RATED_PAYLOAD_KG, robot.dynamics.payload_mass_kg)
        return self._load(0.0, robot), self._load(heaviest, robot)

    def _load(self, payload_kg: float, robot: Parameters) -> Load:
        part = f'a part of {payload_kg:g} kg' if payload_kg else 'no part'
        return Load(f'tool with {part}', robot.rotary_axes[self._number].shaft_inertia_kg_m2(payload_kg))

    def program(self, name: str | None, robot: Parameters) -> Program:
        """Return a program that turns the tool; without a name half a turn of this axis and back.

        Raises
        ------
        ProgramError
            The program is invalid.
        TuningError
            It does not turn the tool by this axis.

        """
        if name is None:
            return programs.parse({'name': HALF_TURN, 'moves': self._half_turn()}, robot.motion)
        program = programs.load(name, robot.motion)
        if not any(len(turns_of(statement)) > self._number for statement in program.statements):
            raise TuningError(
                f'{name} does not turn the tool by axis{self.axis}: it cannot show the effect on its drive'
            )
        return program

    def _half_turn(self) -> list[dict[str, Any]]:
        kept, dwell = [{'by_deg': 0}] * self._number, {'dwell': {'time_s': 0.2}}
        there, back = ({'turn': {'to_deg': [*kept, angle]}} for angle in (180, 0))
        return [there, dwell, back, dwell]

    def following_error(self, trace: Trace, robot: Parameters) -> Floats:
        """Return the error of the rotation [rad, motor side], shape (cycles, 1)."""
        gear = robot.rotary_axes[self._number].gear_ratio
        return np.asarray(trace[numbered('turn_error', self._number)] * gear)

    def currents(self, trace: Trace) -> tuple[float, float]:
        """Return peak and rms current [A] of its motor."""
        figures = trace.meta['figures']
        peak, rms = (numbered(f'turn_current_{name}_a', self._number) for name in ('peak', 'rms'))
        return float(figures[peak]), float(figures[rms])


def tuned_drive(axis: int, robot: Parameters) -> ArmDrive:
    """Return the drive of an axis, 1 to 5; raises TuningError."""
    return ToolDrive(axis, robot) if axis > ARMS else ArmDrive(axis)

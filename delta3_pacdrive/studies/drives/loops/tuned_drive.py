"""The tuned drive: that of an arm or of the rotary axis; loops and bench are the same for both."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import RATED_PAYLOAD_KG, Parameters, rotary_axis_parameters
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program, turns_of
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.drives.loops.load import Load, extremes, load_at

TOOL_AXIS = 4
HALF_TURN = {
    'name': 'half a turn and back',
    'moves': [
        {'turn': {'to_deg': 180}},
        {'dwell': {'time_s': 0.2}},
        {'turn': {'to_deg': 0}},
        {'dwell': {'time_s': 0.2}},
    ],
}


@dataclass(frozen=True)
class ArmDrive:
    """Drive of an arm, axis 1 to 3."""

    axis: int
    usual_program = 'experiment1'  # packaged; empty for a program of this module

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
    """Drive of the rotary axis; bar, tool and part are its load in every pose. Raises TuningError without one."""

    usual_program = ''

    def __init__(self, robot: Parameters) -> None:
        if not robot.rotary_axes:
            raise TuningError(
                f'--axis is {TOOL_AXIS}, but the robot has no rotary axis (rotary.present is false)'
            )
        super().__init__(TOOL_AXIS)

    def in_loops(self, robot: Parameters) -> Parameters:
        """Return the parameters of its loops; the bar is modelled as a gear, elastic in a built robot."""
        own, rotary = rotary_axis_parameters(robot, 0), robot.rotary
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
        return Load(f'tool with {part}', robot.rotary.shaft_inertia_kg_m2(payload_kg))

    def program(self, name: str | None, robot: Parameters) -> Program:
        """Return a program that turns the tool; without a name half a turn and back.

        Raises
        ------
        ProgramError
            The program is invalid.
        TuningError
            It does not turn the tool.

        """
        if name is None:
            return programs.parse(HALF_TURN, robot.motion)
        program = programs.load(name, robot.motion)
        if not any(map(turns_of, program.statements)):
            raise TuningError(f'{name} does not turn the tool: it cannot show the effect on its drive')
        return program

    def following_error(self, trace: Trace, robot: Parameters) -> Floats:
        """Return the error of the rotation [rad, motor side], shape (cycles, 1)."""
        return np.asarray(trace['turn_error'] * robot.rotary.gear_ratio)

    def currents(self, trace: Trace) -> tuple[float, float]:
        """Return peak and rms current [A] of its motor."""
        figures = trace.meta['figures']
        return float(figures['turn_current_peak_a']), float(figures['turn_current_rms_a'])


def tuned_drive(axis: int, robot: Parameters) -> ArmDrive:
    """Return the drive of an axis, 1 to 4; raises TuningError."""
    return ToolDrive(robot) if axis == TOOL_AXIS else ArmDrive(axis)

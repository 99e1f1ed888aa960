"""Excitation of one axis of the whole robot, recorded by the oscilloscopes of its drives.

All arms turn through the pose at a low constant speed, which avoids the friction of standstill. Each is controlled by
its drive, one of them excited by a multisine. Drives and plant exchange once per period of the velocity loop.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, INERTIA, Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.diagnostics import fault_text
from delta3_pacdrive.robot.drive.excitation import RATE_SHARE, Multisine, multisine
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.studies.drives.loops.bench import (
    ENABLING_CYCLES_MAX,
    SETTLING_S,
    Place,
    set_point_fields,
)
from delta3_pacdrive.studies.framework.study import OnProgress, silent
from delta3_pacdrive.studies.runs.oscilloscope import Added, Oscilloscope, finest

PERIODS = 4  # recorded periods of the multisine, after one for settling
PERIOD_S, LOWEST_HZ = 0.5, 4.0
HIGHEST_HZ = {Place.PLANT: 1500.0, Place.POSITION: 700.0}
RMS = {Place.PLANT: 0.2, Place.POSITION: 0.03}  # A, rad
ADDED = {Place.PLANT: 'current_added', Place.POSITION: 'position_added'}
REFERENCES = {
    'position_reference': 'reference',
    'speed_reference': 'speed_reference',
    'current_reference': 'current_reference',
}
SPEED_SHARE = 0.5  # of the speed of the bench; the travel of the robot is shorter


@dataclass(frozen=True)
class Excitation:
    """Excitation of one axis."""

    place: Place  # PLANT (current set point) or POSITION
    axis: int  # 0 to 2
    point_m: tuple[float, float, float]  # pose in the middle of the recording
    speed_rad_s: float  # of all shafts
    amplitude: float = 1.0  # multiple of the default


def record(parameters: Parameters, excitation: Excitation, on_progress: OnProgress = silent) -> Trace:
    """Excite one axis and return the signals of all three drives in every current period.

    Raises
    ------
    UnreachableError
        The arms do not reach the pose, or the start or end of the motion through it.
    RunError
        A drive trips, or cannot be enabled.

    """
    drive = parameters.drive
    # without a task no torque is commanded
    exact = finest(parameters).replace(control__feed_forward=INERTIA)
    rms = RMS[excitation.place] * excitation.amplitude
    hold = drive.velocity_period_s if excitation.place == Place.PLANT else drive.position_period_s
    highest = min(HIGHEST_HZ[excitation.place], RATE_SHARE / hold)
    sine = multisine(PERIOD_S, drive.current_period_s, highest, rms, LOWEST_HZ)
    seconds = SETTLING_S + (PERIODS + 1) * sine.period_s
    theta = kinematics.inverse(np.asarray(excitation.point_m), exact.kinematics)
    half = 0.5 * seconds * excitation.speed_rad_s / exact.dynamics.gear_ratio
    # both ends of the motion must be reachable
    ends = [kinematics.forward(theta + sign * half, exact.kinematics) for sign in (1.0, -1.0)]
    robot = _TurningRobot(exact.replace(motion__home_m=tuple(float(x) for x in ends[1])), excitation)
    robot.enable()
    robot.run(np.zeros(round(SETTLING_S / drive.current_period_s)))
    added = sine.periods(PERIODS + 1, round(hold / drive.current_period_s))
    robot.run(added[: sine.samples])
    signals = robot.run(added[sine.samples :], on_progress)
    return Trace(
        np.arange(PERIODS * sine.samples, dtype=np.float64) * drive.current_period_s,
        signals,
        _meta(parameters, excitation, sine),
    )


def _meta(parameters: Parameters, excitation: Excitation, sine: Multisine) -> dict[str, Any]:
    return {
        'program': 'excitation of one axis',
        'checksum': parameters.checksum,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'cycle_time_s': parameters.bus.cycle_time_s,
        'sample_time_s': sine.sample_s,
        'axis': excitation.axis + 1,
        'place': excitation.place.value,
        'pose_m': list(excitation.point_m),
        'speed_rad_s': excitation.speed_rad_s,
        'repeats_after': sine.samples,
        'lines': sine.lines.tolist(),
    }


class _TurningRobot:
    """Robot with three shafts at constant speed, one current period at a time."""

    def __init__(self, parameters: Parameters, excitation: Excitation) -> None:
        self._robot, self._excitation, self._parameters = Robot(parameters), excitation, parameters
        self._commands = np.array(self._robot.encoder_positions())
        self._per_cycle = round(parameters.bus.cycle_time_s / parameters.drive.current_period_s)
        self._speed = 0.0
        self._step = 0

    def enable(self) -> None:
        """Enable the drives at standstill, then set the speed."""
        for _ in range(ENABLING_CYCLES_MAX):
            self.run(np.zeros(self._per_cycle))
            if all(drive.drive_state == DriveState.ENABLED for drive in self._robot.drives[:ARMS]):
                break
        else:
            raise RunError('a drive could not be enabled')
        self._speed = self._excitation.speed_rad_s

    def run(self, added: Floats, on_progress: OnProgress = silent) -> dict[str, Floats]:
        """Add a set point, one value per current period; return the signals, each of shape (samples, 3)."""
        chosen, cycle_s = self._excitation, self._parameters.bus.cycle_time_s
        set_point = Added(chosen.axis, set_point_fields(chosen.place, cycle_s), added)
        scope = Oscilloscope(self._robot, len(added), list(REFERENCES.values()), set_point)
        for k in range(0, len(added), scope.per_exchange):
            if self._step % self._per_cycle == 0:
                scope.begin_cycle(self._commands.tolist(), CONTROL_ENABLE)
                for name, drive in zip(DRIVES, self._robot.drives, strict=False):
                    if drive.fault:
                        raise RunError(f'{name} of the robot: {fault_text(drive.fault)}')
                self._commands += self._speed * cycle_s
            scope.exchange()
            self._step += scope.per_exchange
            if k % 2048 == 0:
                on_progress('excitation', k, len(added))
        all_added = np.zeros((len(added), 3))
        all_added[:, chosen.axis] = added
        return {
            'motor_command': scope.found['command'],
            **scope.signals(),
            **{name: scope.left[field] for name, field in REFERENCES.items()},
            ADDED[chosen.place]: all_added,
        }

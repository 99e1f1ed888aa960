"""The closed loop replayed: the commands of a recording through simulated drives and plant, currents compared."""

import math
from collections.abc import Mapping

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.analysis.estimation.measurement import NOISE, moving_rows, sample_time_s
from delta3_pacdrive.analysis.estimation.problem import Block
from delta3_pacdrive.analysis.estimation.quantities import GROUPS, base_constants, values_of, with_values
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.sercos.words import CONTROL_ENABLE
from delta3_pacdrive.simulation.robot import Robot

STANDING_CYCLES = 150  # that the model stands in torque before the first command: enable, brake, integrators
OF_MOTOR = ('R', 'L', 'K_m', 'F_v', 'F_s', 'w_s')  # that parameters have to allow one by one
IDEAL_INCREMENTS = 2.0**40  # per revolution: an encoder without steps that anything could notice


class Replay:
    """The replay runs the closed loop with other parameters of motor and masses, on the commands of a trace.

    The model stands at the first command until its loops are at rest, then it takes the commands of the trace, from
    five cycles before the motion on.

    Parameters
    ----------
    trace
        Holds ``motor_command`` once per bus cycle.
    parameters
        The robot; its drives (P2) and geometry (P1) are known.
    ideal_encoder
        Let the model's encoders have no increments: signals then have slopes over the parameters instead of steps.

    Raises
    ------
    EstimationError
        The samples are not one bus cycle apart, or nothing moves.

    """

    def __init__(self, trace: Trace, parameters: Parameters, ideal_encoder: bool = True) -> None:
        cycle = parameters.bus.cycle_time_s
        if abs(sample_time_s(trace) - cycle) > 1e-3 * cycle:
            raise EstimationError(
                f'the samples are {sample_time_s(trace) * 1e3:g} ms apart, '
                f'but the replay takes one per bus cycle of {cycle * 1e3:g} ms'
            )
        rows = moving_rows(trace)
        self.rows = slice(max(0, rows.start - 5), rows.stop)
        self._commands = np.ascontiguousarray(trace['motor_command'][self.rows])
        arms = self._commands[0] / parameters.dynamics.gear_ratio
        home = kinematics.forward(arms, parameters.kinematics).tolist()
        self._parameters = parameters.replace(motion__home_m=tuple(home))
        self._known = values_of(parameters)
        self._ideal = ideal_encoder

    def run(self, values: Mapping[str, float]) -> dict[str, Floats]:
        """Return motor_position [rad], motor_speed [rad/s] and current [A] of the cycles, shapes (n, 3)."""
        whole = {**self._known, **values}
        parameters = with_values(self._parameters, {symbol: whole[symbol] for symbol in OF_MOTOR})
        robot = Robot(parameters)
        # masses come in by their sums: one of them may be negative for a while, where only sums can be seen
        record = robot.plant.record['inertia']
        arm, plate, moment = base_constants(whole, parameters)
        record['arm'], record['plate'] = arm, plate
        record['weight'] = (
            moment * parameters.dynamics.gravity_m_s2 / parameters.kinematics.upper_arm_length_m
        )
        # telegrams carry whole steps of the payload
        robot.grip(parameters.dynamics.payload_mass_kg)
        # the drives keep what they were set to, also the torque constant of the name plate
        for drive in robot.drives:
            drive.configure(self._parameters)
            if self._ideal:
                drive.constants['increments_per_rad'] = IDEAL_INCREMENTS / math.tau
        robot.run(np.tile(self._commands[0], (STANDING_CYCLES, 1)), CONTROL_ENABLE)
        out = robot.run(self._commands, CONTROL_ENABLE)
        out[:, 2] /= self._parameters.motor.torque_constant_n_m_a
        return {name: out[:, i] for i, name in enumerate(('motor_position', 'motor_speed', 'current'))}


class ReplayModel:
    """The model compares the current of a recording with that of the replay: for signals once per bus cycle.

    Everything that the drives do between two samples is simulated, so that the phase in which the samples catch the
    current's ripple does no harm.
    """

    step, accuracy = 1e-3, 3e-4
    depends = frozenset(GROUPS['motor'].possible)

    def __init__(self, trace: Trace, parameters: Parameters) -> None:
        self._replay = Replay(trace, parameters)
        rows = self._replay.rows
        self._current = trace['current'][rows]
        self.shapes = (self._current.shape,)
        period, start = parameters.bus.cycle_time_s, float(trace.time_s[rows.start])
        self.blocks = (Block('current by replay', 'A', NOISE.current_a, period, start),)

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured less replayed current [A], shape (n, 3)."""
        own = {symbol: value for symbol, value in values.items() if symbol in self.depends}
        return [self._current - self._replay.run(own)['current']]

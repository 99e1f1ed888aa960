"""Replay of the closed loop: drives and plant simulated on recorded commands, currents compared."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.studies.estimation.measurement import EVERY, NOISE, moving_rows, sample_time_s
from delta3_pacdrive.studies.estimation.problem import BAND_HZ, Block, MotionBand
from delta3_pacdrive.studies.estimation.quantities import GROUPS, OF_DRIVES, TABLE, values_of, with_values

STANDING_CYCLES = 150  # at rest in torque before the first command: enable, brake, integrators
OF_MOTOR = ('R', 'L', 'K_m', 'F_v', 'F_s', 'w_s')  # must each be valid parameters
OF_LOOPS = tuple(symbol for symbol in OF_DRIVES if TABLE[symbol].parameter)
OF_ROTOR = ('I_m', 'I_brake')  # of OF_MOTOR with elastic gears, where the rotor moves separately
IDEAL_INCREMENTS = 2.0**40  # per revolution: an encoder without noticeable steps
NOISY_SEED = 71  # first seed of the model's sensors for measuring their noise
NOISY_RUNS = 32  # averaged runs


class Replay:
    """Runs the closed loop with modified parameters on the commands of a trace.

    The model holds the first command until its loops have settled, then follows the commands of the trace, from five
    cycles before the motion. Its sensors have no noise.

    Parameters
    ----------
    trace
        Contains ``motor_command`` once per bus cycle, and ``torque_command`` if the robot's master sends it.
    parameters
        Parameters of the robot; its drives (P2) and geometry (P1) are known.
    ideal_encoder
        Use encoders without increments, so that signals are differentiable with respect to the parameters.

    Raises
    ------
    EstimationError
        The samples are not one bus cycle apart, nothing moves, or commanded torques are missing.

    """

    def __init__(self, trace: Trace, parameters: Parameters, ideal_encoder: bool = True) -> None:
        cycle = parameters.bus.cycle_time_s
        if abs(sample_time_s(trace) - cycle) > 1e-3 * cycle:
            raise EstimationError(
                f'the samples are {sample_time_s(trace) * 1e3:g} ms apart, '
                f'but the replay requires one per bus cycle of {cycle * 1e3:g} ms'
            )
        rows = moving_rows(trace)
        self.rows = slice(max(0, rows.start - 5), rows.stop)
        self._commands = np.ascontiguousarray(trace['motor_command'][self.rows])
        if parameters.sends_torque and 'torque_command' not in trace.signals:
            raise EstimationError(
                'the robot has control.feed_forward: model, but the trace contains no torque_command'
            )
        self._torques = (
            trace['torque_command'][self.rows] if parameters.sends_torque else self._commands * 0.0
        )
        arms = self._commands[0] / parameters.dynamics.gear_ratio
        home = kinematics.forward(arms, parameters.kinematics).tolist()
        self._noisy = parameters.replace(motion__home_m=tuple(home))
        self._parameters = self._noisy.replace(rich__current_noise_a=0.0, rich__encoder_noise_rad=0.0)
        self._known = values_of(parameters)
        effects = parameters.rich.effects
        self._single = (*OF_MOTOR, *OF_LOOPS, *(OF_ROTOR if effects.gear else ()))
        self._single += tuple(q.symbol for q in TABLE.values() if q.effect and q.is_on(parameters))
        self._ideal = ideal_encoder

    @property
    def is_noisy(self) -> bool:
        """Whether the robot's sensors have noise."""
        return self._noisy.rich.effects.sensors

    def run(self, values: Mapping[str, float]) -> dict[str, Floats]:
        """Return motor_position [rad], motor_speed [rad/s] and current [A] of the cycles, shapes (n, 3).

        The current is that of the AT, or that ``t_I`` earlier.
        """
        return self._run(values, self._parameters, self._ideal)

    def noise(self, values: Mapping[str, float], count: int) -> Floats:
        """Return the current caused by noise and increments of the model's own sensors [A], shape (count, n, 3)."""
        quiet = self.run(values)['current']
        seeded = [self._noisy.replace(rich__sensor_seed=NOISY_SEED + k) for k in range(count)]
        return np.array([self._run(values, own, ideal=False)['current'] - quiet for own in seeded])

    def _run(self, values: Mapping[str, float], own: Parameters, ideal: bool) -> dict[str, Floats]:
        whole = {**self._known, **values}
        parameters = with_values(own, {symbol: whole[symbol] for symbol in self._single})
        robot = Robot(parameters)
        _take_masses(robot, whole, parameters)
        # telegrams transmit the payload in discrete steps
        robot.grip(parameters.dynamics.payload_mass_kg)
        # the drives keep their settings, including the nominal torque constant, but for nuisance parameters
        for drive in robot.drives:
            drive.configure(replace(own, drive=parameters.drive))
            if ideal:
                drive.constants['increments_per_rad'] = IDEAL_INCREMENTS / math.tau
        robot.run(np.tile(self._commands[0], (STANDING_CYCLES, 1)), CONTROL_ENABLE, self._torques[0])
        out = robot.run(
            self._commands, CONTROL_ENABLE, self._torques, len(robot.currents) if whole['t_I'] else 0
        )
        out[:, 2] /= own.motor.torque_constant_n_m_a
        out[:, 2] = _earlier(out, whole['t_I'] / own.drive.current_period_s)
        return {name: out[:, i] for i, name in enumerate(('motor_position', 'motor_speed', 'current'))}


def _earlier(answers: Floats, periods: float) -> Floats:
    """Return the current some periods of the current loop before that of the AT, interpolated linearly."""
    if not periods:
        return answers[:, 2]
    samples = answers[:, 3:]
    begin = min(max(math.floor(periods), 0), samples.shape[1] - 2)
    share = periods - begin
    earlier = (1.0 - share) * samples[:, begin] + share * samples[:, begin + 1]
    # the error of the sensor changes slowly
    return np.asarray(answers[:, 2] - samples[:, 0] + earlier)


def _take_masses(robot: Robot, v: Mapping[str, float], parameters: Parameters) -> None:
    """Set the masses of a plant by their sums; a single mass may be negative while only sums are identifiable."""
    effects, p = parameters.rich.effects, parameters.dynamics
    record, l_a = robot.plant.record['inertia'], robot.plant.record['geometry']['l_a']
    share = 1.0 / 3.0 if effects.forearm_rods else p.forearm_share_at_elbow
    rod = v['m_fb'] / 6.0 if effects.forearm_rods else 0.0
    at_elbow = v['m_c'] + share * v['m_fb']
    record['arm'] = l_a**2 * (v['m_b'] / 3.0 + at_elbow)
    if not effects.gear:
        record['arm'] += p.gear_ratio**2 * (v['I_m'] + v['I_brake'])
    at_plate = v['m_fb'] if effects.forearm_rods else 3.0 * (1.0 - share) * v['m_fb']
    record['plate'] = v['m_n'] + v['m_payload'] + at_plate
    record['rod'] = rod
    record['weight'] = p.gravity_m_s2 * (v['m_b'] / 2.0 + at_elbow + rod)


class ReplayModel:
    """Compares the recorded current with that of the replay, for signals with one sample per bus cycle.

    The drives are simulated between samples, so the phase at which the samples catch the ripple of the current is
    correct. For a built robot only the band of the motion is compared, because the motion of gears and encoder noise
    above it is random. Its sensor noise, through the loops and through friction and backlash, shifts the mean current;
    ``settle`` measures that shift near the solution. ``measured`` is the compared part of the recorded current [A],
    shape (n, 3). In a log sampled every few bus cycles, only these cycles are compared.
    """

    accuracy = 3e-4

    def __init__(self, trace: Trace, parameters: Parameters) -> None:
        # backlash and bristle friction cause kinks: use wider steps
        self.step = 1e-2 if parameters.rich.enabled else 1e-3
        self._replay = Replay(trace, parameters)
        self.rows = rows = self._replay.rows
        count, cycle = rows.stop - rows.start, parameters.bus.cycle_time_s
        self._band: MotionBand | None = None
        every = int(trace.meta.get(EVERY, 1))
        self._sampled = slice(-rows.start % every, None, every)
        self.depends = frozenset(GROUPS['motor'].possible)
        sigma, period, start = NOISE.current_a, cycle, float(trace.time_s[rows.start])
        if parameters.rich.enabled:
            self._band = MotionBand(count, cycle, 'replay of a built robot')
            period, start = self._band.every * cycle, start + self._band.edge * cycle
            sigma *= math.sqrt(2.0 * BAND_HZ * cycle)
        else:
            period, start = every * cycle, start + self._sampled.start * cycle
        self.measured: Floats = self.seen(trace['current'][rows])
        self.shapes = (self.measured.shape,)
        self.blocks = (Block('current by replay', 'A', sigma, period, start),)
        self._mean: Floats = np.zeros(self.shapes[0])

    def settle(self, values: Mapping[str, float]) -> bool:
        """Measure mean and standard deviation of the sensor noise at ``values``; return whether there is any noise."""
        if self._band is None or not self._replay.is_noisy:
            return False
        found = np.array([self.seen(one) for one in self._replay.noise(self._own(values), NOISY_RUNS)])
        self._mean = found.mean(axis=0)
        (block,) = self.blocks
        self.blocks = (replace(block, sigma=max(block.sigma, float((found - self._mean).std()))),)
        return True

    def _own(self, values: Mapping[str, float]) -> dict[str, float]:
        return {symbol: value for symbol, value in values.items() if symbol in self.depends}

    def seen(self, values: Floats) -> Floats:
        """Return the compared part of a current [A], shape (cycles, 3)."""
        return values[self._sampled] if self._band is None else self._band(values)

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured less replayed current [A], shape (n, 3); nan for impossible parameters."""
        try:
            replayed = self._replay.run(self._own(values))['current']
        except EstimationError:
            return [np.full(self.shapes[0], np.nan)]
        return [self.measured - self.seen(replayed) - self._mean]

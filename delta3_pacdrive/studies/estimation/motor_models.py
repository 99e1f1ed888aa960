"""Models of the motors: winding (7.2, 8.2) and torque balance of the shafts (4.26, 4.31)."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from delta3_pacdrive import dynamics
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation.measurement import NOISE, moving_rows, sample_time_s
from delta3_pacdrive.studies.estimation.problem import Block
from delta3_pacdrive.studies.estimation.quantities import GROUPS, base_constants

BAND_HZ = 60.0  # low pass of the torque balance: motion below, mostly noise above
EDGE_PERIODS = 3.0  # periods of the band edge removed at either end for filter transients
SAMPLES_PER_BAND = 2.5  # kept samples per period of the band edge
STEPS_PER_TIME_CONSTANT = 10.0  # minimum samples per time constant L/R of a winding


class WindingModel:
    """Simulates the current of a winding from the voltage of its phase and the speed of the shaft.

    I(t + T) = I_f + (I(t) - I_f) exp(-T R/L),  I_f = (v - K_m/3 w)/(R/2), with v and w constant during a period T.
    This is an output error model: the current is simulated from its first sample and compared with the measured one.

    Raises
    ------
    EstimationError
        The trace contains no voltage, or is sampled too slowly for the winding.

    """

    step, accuracy = 1e-5, 1e-6
    depends = frozenset({'R', 'L', 'K_m'})

    def __init__(self, trace: Trace, parameters: Parameters) -> None:
        self._period = sample_time_s(trace)
        motor = parameters.motor
        memory = motor.winding_inductance_h / motor.winding_resistance_ohm
        slowest = memory / STEPS_PER_TIME_CONSTANT
        if self._period > slowest:
            raise EstimationError(
                f'the voltage is sampled every {self._period * 1e3:g} ms, '
                f'but L/R requires {slowest * 1e3:.2g} ms or less'
            )
        rows = moving_rows(trace)
        # one row per axis: the filter runs along the rows
        self._voltage, self._speed, self._current = (
            np.ascontiguousarray(trace[name][rows].T) for name in ('phase_voltage', 'motor_speed', 'current')
        )
        self.shapes = (self._current.T.shape,)
        start = float(trace.time_s[rows.start])
        self.blocks = (
            Block(
                name='current by voltage',
                unit='A',
                sigma=NOISE.current_a,
                period_s=self._period,
                start_s=start,
                memory_s=memory,
            ),
        )

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured less simulated current [A], shape (n, 3)."""
        resistance = values['R'] / 2.0
        decay = math.exp(-self._period * values['R'] / values['L'])
        final = (self._voltage - values['K_m'] / 3.0 * self._speed) / resistance
        # initial filter state: the first measured current
        begin = self._current[:, :1]
        driven, _ = lfilter([0.0, 1.0 - decay], [1.0, -decay], final, zi=begin)
        return [np.asarray((self._current - driven).T)]


class TorqueModel:
    """Balances the torques of the three shafts and compares the required current with the measured one.

    K_m I = (I_b Y_1 + m_nt Y_2 + m_br r_Gb Y_3)/k_r + F_v w + F_s tanh(w/w_s), Y of ``dynamics.regressor``: linear in
    the masses and inertias. Both sides pass the same zero-phase filter, which keeps the band of the motion;
    accelerations are slopes of the speed. Currents must be sampled faster than the bus cycle. With one sample per
    cycle they contain the ripple of the set points in a fixed phase, which is indistinguishable from an inertia.
    """

    step, accuracy = 1e-5, 1e-6
    depends = frozenset(GROUPS['masses'].possible) - {'R', 'L', 't_I'}

    def __init__(self, trace: Trace, parameters: Parameters, band_hz: float = BAND_HZ) -> None:
        self._parameters = parameters
        period, rows = sample_time_s(trace), moving_rows(trace)
        ratio = parameters.dynamics.gear_ratio
        self._section = butter(4, band_hz, fs=1.0 / period, output='sos')
        edge = round(EDGE_PERIODS / band_hz / period)
        self._every = max(1, round(1.0 / (SAMPLES_PER_BAND * band_hz * period)))
        self._speed = trace['motor_speed'][rows]
        if len(self._speed) < 4 * edge:
            raise EstimationError('the motion is too short for a balance of torques')
        self._kept = slice(edge, len(self._speed) - edge, self._every)
        arms = trace['motor_position'][rows] / ratio
        regressor = dynamics.regressor(
            arms, self._speed / ratio, slope(self._speed, period) / ratio, parameters
        )
        if not np.isfinite(regressor).all():
            raise EstimationError(
                'the forearms do not meet at angles of the trace: check that the geometry belongs to it'
            )
        self._inertial = [self._filtered(regressor[..., i] / ratio) for i in range(3)]
        self._viscous = self._filtered(self._speed)
        self._current = self._filtered(trace['current'][rows])
        self.shapes = (self._current.shape,)
        self._static: tuple[float, Floats] = (math.nan, self._viscous)
        # white noise of the current through the filter, and of the speed through slope and inertia
        share = 2.0 * band_hz * period
        inertia = parameters.drive.feedforward_inertia_kg_m2 / parameters.motor.torque_constant_n_m_a
        slopes = inertia * math.tau * band_hz * NOISE.motor_speed_rad_s / math.sqrt(3.0)
        sigma = math.sqrt(share) * math.hypot(NOISE.current_a, slopes)
        start = float(trace.time_s[rows.start]) + edge * period
        self.blocks = (Block('current by torques', 'A', sigma, self._every * period, start),)

    def _filtered(self, values: Floats) -> Floats:
        return np.asarray(sosfiltfilt(self._section, values, axis=0)[self._kept])

    def _static_friction(self, smoothing: float) -> Floats:
        if self._static[0] != smoothing:
            self._static = smoothing, self._filtered(np.tanh(self._speed / smoothing))
        return self._static[1]

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured current less that of the torques [A], shape (n, 3)."""
        constants = base_constants(values, self._parameters)
        torque = values['F_v'] * self._viscous + values['F_s'] * self._static_friction(values['w_s'])
        for constant, column in zip(constants, self._inertial, strict=True):
            torque = torque + constant * column
        return [self._current - torque / values['K_m']]


def slope(values: Floats, period_s: float) -> Floats:
    """Return the time derivative of the columns from five points, from two or three at the ends."""
    out = np.gradient(values, period_s, axis=0)
    out[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * period_s)
    return np.asarray(out)

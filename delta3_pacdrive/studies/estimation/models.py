"""Models of measured signals: geometry (4.4), winding (7.2, 8.2) and torque balance of the shafts (4.26, 4.31)."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from delta3_pacdrive import dynamics
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation.measurement import NOISE, moving_rows, sample_time_s
from delta3_pacdrive.studies.estimation.problem import BAND_HZ, Block, MotionBand
from delta3_pacdrive.studies.estimation.quantities import (
    FRAME,
    GROUPS,
    OF_ARMS,
    OF_DRIVES,
    OFFSETS,
    base_constants,
)

POSES_MAX = 1000


class GeometryModel:
    """Compares measured positions of the TCP with those that follow from the arm angles.

    Forearm i spans s_i = X - C_i(theta_i) and closes if |s_i| = l_B (4.4). S^-1 maps the three gaps e_i = |s_i| - l_B
    to a position error, with the directions s_i/|s_i| as rows of S. To first order this is the error of the forward
    kinematics, but it is also defined for a geometry that does not close. Arms may differ from one another.

    Raises
    ------
    EstimationError
        The trace contains no measured TCP.

    """

    step, accuracy = 1e-5, 1e-6
    depends = frozenset(GROUPS['geometry'].possible)

    def __init__(self, trace: Trace, parameters: Parameters) -> None:
        rows = moving_rows(trace)
        every = max(1, -(-(rows.stop - rows.start) // POSES_MAX))
        rows = slice(rows.start, rows.stop, every)
        self._angles = trace['motor_position'][rows] / parameters.dynamics.gear_ratio
        self._points = trace['tcp_measured'][rows]
        self.shapes = (self._points.shape,)
        period = sample_time_s(trace) * every
        self.blocks = (Block('TCP', 'm', NOISE.tcp_measured_m, period, float(trace.time_s[rows.start])),)

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured TCP less that of the arm angles [m], shape (n, 3)."""
        # rotation about the fixed axes of the measuring frame
        turned = Rotation.from_euler('xyz', _vector(values, FRAME[3:]))
        points = (self._points - _vector(values, FRAME[:3])) @ turned.as_matrix()
        theta = self._angles + _vector(values, OFFSETS)
        arm, forearm, radius, turn = (_vector(values, names) for names in OF_ARMS)
        alpha = _vector(values, ('alpha_1', 'alpha_2', 'alpha_3')) + turn
        arm, forearm = values['l_A'] + arm, values['l_B'] + forearm
        reach = values['R_A'] - values['R_B'] + radius + arm * np.cos(theta)
        elbows = np.stack([reach * np.cos(alpha), reach * np.sin(alpha), -arm * np.sin(theta)], axis=-1)
        forearms = points[:, None, :] - elbows
        lengths = np.linalg.norm(forearms, axis=-1)
        try:
            error = np.linalg.solve(forearms / lengths[..., None], (lengths - forearm)[..., None])
        except np.linalg.LinAlgError:
            raise EstimationError(
                'the geometry has become singular: the start values are too far off'
            ) from None
        return [np.asarray(error[..., 0])]


def _vector(values: Mapping[str, float], symbols: tuple[str, ...]) -> Floats:
    return np.array([values[symbol] for symbol in symbols])


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
    ``measured`` is the filtered current [A], shape (n, 3).
    """

    step, accuracy = 1e-5, 1e-6
    depends = frozenset(GROUPS['masses'].possible) - {'R', 'L', *OF_DRIVES}

    def __init__(self, trace: Trace, parameters: Parameters, band_hz: float = BAND_HZ) -> None:
        self._parameters = parameters
        period, rows = sample_time_s(trace), moving_rows(trace)
        ratio = parameters.dynamics.gear_ratio
        self._speed = trace['motor_speed'][rows]
        self._filtered = MotionBand(len(self._speed), period, 'balance of torques', band_hz)
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
        self.measured: Floats = self._filtered(trace['current'][rows])
        self.shapes = (self.measured.shape,)
        self._static: tuple[float, Floats] = (math.nan, self._viscous)
        # white noise of the current through the filter, and of the speed through slope and inertia
        share = 2.0 * band_hz * period
        inertia = parameters.drive.feedforward_inertia_kg_m2 / parameters.motor.torque_constant_n_m_a
        slopes = inertia * math.tau * band_hz * NOISE.motor_speed_rad_s / math.sqrt(3.0)
        sigma = math.sqrt(share) * math.hypot(NOISE.current_a, slopes)
        start = float(trace.time_s[rows.start]) + self._filtered.edge * period
        self.blocks = (Block('current by torques', 'A', sigma, self._filtered.every * period, start),)

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
        return [self.measured - torque / values['K_m']]


def slope(values: Floats, period_s: float) -> Floats:
    """Return the time derivative of the columns from five points, from two or three at the ends."""
    out = np.gradient(values, period_s, axis=0)
    out[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * period_s)
    return np.asarray(out)

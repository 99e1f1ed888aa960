"""Vibration modes of the built robot, and input shaping that does not excite them.

Input shaping modifies the master so that its start and stop do not excite a vibration of the robot.

The shaped distance over time is a weighted sum of delayed copies of the original. The TCP stays on its path, and speed,
acceleration and jerk along it do not increase. For a vibration of frequency f, damping ratio D and damped period T,
with K = exp(-pi D / sqrt(1 - D^2)), the weights are (Singer and Seering 1990)

    zero vibration (zv)                  1, K            at 0, T/2
    zero vibration and derivative (zvd)  1, 2 K, K^2     at 0, T/2, T
    smooth                               zv after a moving average over half a period that decays like the vibration
    modes                                zvd for several vibrations in series

zvd and smooth lengthen a motion by one period T, zv by half a period, modes by the sum of all periods.

Vibration modes are those of the built robot at rest: arms and plate on elastic gears, with motors in position control.
Small motions about a pose, arm side, with A of (4.26) without rotors (coupled arms and plate), rotor inertia J_m, and
stiffness c and damping d of a gear:

    A thetaddot + d (thetadot - thetadot_m) + c (theta - theta_m) = 0
    J_m thetaddot_m + d (thetadot_m - thetadot) + c (theta_m - theta) + s1 thetadot_m + s0 theta_m = tau

The torque tau results from the position and velocity loops (8.1) with a first-order lag of the current. The friction of
a shaft at rest is a spring s0 with damping s1 (elastic bristles); both are 0 for a sliding shaft.

Gears and drives of the three arms are identical. Therefore the arms vibrate along the principal axes of A, A u = a u,
each with its inertia a in place of A: an eigenproblem of three arms, then one of six states for each axis.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import MODES, SMOOTH, ZVD, Parameters
from delta3_pacdrive.planning.paths.virtual_master import PHASE_COLUMNS

SMOOTH_PARTS = 8  # samples of the moving average over half a period
SAME_S = 1e-9  # ends of phases closer than this are one
SLOWEST = math.tau  # [rad/s]: slower poles belong to the motion of the whole robot
LEAST_SWINGING = 0.9  # damping ratio above which the overshoot is negligible
NO_MODE = 'the robot has no vibration mode at its end: set control.shaping_frequency_hz'


@dataclass(frozen=True)
class Shaper:
    """Weights with sum 1 and delays from 0 on [s]."""

    weights: Floats
    delays_s: Floats

    @staticmethod
    def of(kind: str, frequency_hz: float, damping: float) -> 'Shaper':
        """Return the shaper for a vibration."""
        rest = math.sqrt(1.0 - damping * damping)
        half_s = 0.5 / (frequency_hz * rest)
        fades = math.exp(-math.pi * damping / rest)
        if kind in (ZVD, MODES):
            weights, delays = np.array([1.0, 2.0 * fades, fades * fades]), half_s * np.arange(3)
        else:
            weights, delays = np.array([1.0, fades]), half_s * np.arange(2)
        if kind == SMOOTH:
            part = np.arange(SMOOTH_PARTS) / SMOOTH_PARTS
            weights = np.outer(weights, fades**part).ravel()
            delays = np.add.outer(delays, half_s * part).ravel()
        return Shaper(np.asarray(weights / weights.sum()), np.asarray(delays, dtype=np.float64))

    @staticmethod
    def of_each(kind: str, vibrations: Sequence[tuple[float, float]]) -> 'Shaper':
        """Return the shaper for several vibrations (frequency [Hz], damping ratio) in series."""
        weights, delays = np.ones(1), np.zeros(1)
        for frequency_hz, damping in vibrations:
            one = Shaper.of(kind, frequency_hz, damping)
            weights = np.outer(weights, one.weights).ravel()
            delays = np.add.outer(delays, one.delays_s).ravel()
        order = np.argsort(delays, kind='stable')
        return Shaper(weights[order], delays[order])

    @property
    def duration_s(self) -> float:
        """Time by which a motion becomes longer [s]."""
        return float(self.delays_s[-1])

    def residual(self, frequency_hz: float, damping: float) -> float:
        """Return the residual vibration after a motion, relative to that without shaping."""
        decay = math.tau * frequency_hz * damping
        turn = math.tau * frequency_hz * math.sqrt(1.0 - damping * damping)
        grown = self.weights * np.exp((decay + 1j * turn) * self.delays_s)
        return float(abs(grown.sum()) * math.exp(-decay * self.duration_s))

    def shaped(self, phases: Floats) -> Floats:
        """Return the phases of the shaped master from rest to rest, shape (n, 5) -> (m, 5), without approximation."""
        edges = np.sort(np.add.outer(phases[:, 0], self.delays_s).ravel())
        times = edges[np.concatenate([[True], np.diff(edges) > SAME_S])]
        inside = np.append(0.5 * (times[1:] + times[:-1]), times[-1] + 1.0)
        shaped = np.zeros((len(times), PHASE_COLUMNS))
        for weight, delay in zip(self.weights, self.delays_s, strict=True):
            # look up the phases at their middle: at their ends the result would depend on rounding
            row = np.searchsorted(phases[:, 0], inside - delay, side='right') - 1
            delayed = phases[row.clip(0)]
            t = np.where(row < 0, 0.0, times - delay - delayed[:, 0])
            _, s, v, a, j = delayed.T * np.where(row < 0, 0.0, 1.0)
            shaped[:, 1] += weight * (s + t * (v + t * (a / 2.0 + t * j / 6.0)))
            shaped[:, 2] += weight * (v + t * (a + t * j / 2.0))
            shaped[:, 3] += weight * (a + t * j)
            shaped[:, 4] += weight * j
        shaped[:, 0] = times
        shaped[0, 1:3] = 0.0
        shaped[-1, 1:] = phases[-1, 1], 0.0, 0.0, 0.0
        return shaped


@dataclass(frozen=True)
class Mode:
    """One vibration mode of the robot at a pose."""

    frequency_hz: float  # natural frequency
    damping: float  # damping ratio
    inertia_kg_m2: float  # of the arms in this mode, arm side, without rotors
    arms: Floats  # mode shape: arm angles, unit vector, shape (3,)
    tcp_m_rad: Floats  # resulting TCP displacement, shape (3,)


def vibration_modes(
    tcp_m: Floats, payload_kg: float, parameters: Parameters, sticking: float = 0.0
) -> list[Mode]:
    """Return the vibration modes of the robot at a position [m] with a payload [kg] by frequency; at most three.

    Parameters
    ----------
    tcp_m
        Position of the TCP [m], shape (3,).
    payload_kg
        Carried payload [kg].
    parameters
        The parameters of a robot. Its gear stiffness is that known to the controller
        (``control.gear_stiffness_n_m_rad``), or else that of ``rich`` (data sheet), whether its effects are on or not.
    sticking
        Share of the bristle stiffness that holds the shafts: 0 for sliding shafts, 1 for shafts at rest.

    Raises
    ------
    UnreachableError
        The position is out of reach.

    """
    theta = kinematics.inverse(tcp_m, parameters.kinematics)
    loaded = parameters.replace(dynamics__payload_mass_kg=payload_kg)
    mass = dynamics.mass_matrix(theta, loaded, rods=parameters.rich.forearm_rods, rotors=False)
    jacobian = kinematics.jacobian(theta, tcp_m, parameters.kinematics)
    found = []
    values, vectors = np.linalg.eigh(mass)
    for inertia, arms in zip(values.tolist(), vectors.T, strict=True):
        poles = np.linalg.eigvals(_state_matrix(inertia, parameters, sticking))
        swings = poles[(poles.imag > SLOWEST) & (-poles.real < LEAST_SWINGING * np.abs(poles))]
        if len(swings):  # the highest ones belong to rotors and current loops
            lowest = complex(swings[np.argmin(np.abs(swings))])
            size = abs(lowest)
            found.append(Mode(size / math.tau, -lowest.real / size, inertia, arms, jacobian @ arms))
    return sorted(found, key=lambda mode: mode.frequency_hz)


def _state_matrix(inertia: float, parameters: Parameters, sticking: float) -> Floats:
    """Return the matrix of the states theta, thetadot, theta_m, thetadot_m, integral of the speed error, tau."""
    rich, drive = parameters.rich, parameters.drive
    ratio, rotor = parameters.dynamics.gear_ratio, dynamics.rotor_inertia(parameters)
    known = parameters.control.gear_stiffness_n_m_rad
    c, d = known if known > 0.0 else rich.gear_stiffness_n_m_rad, rich.gear_damping_n_m_s_rad
    s0 = sticking * rich.break_away_torque_n_m / rich.presliding_rad * ratio**2
    s1 = math.sqrt(s0 * rotor)
    lag = max(parameters.torque_dead_time_s, drive.current_period_s)
    # derivatives of the speed error [rad/s, motor side] by theta_m and thetadot_m
    by_angle, by_rate = -drive.position_gain_rad_s_rad * ratio, -ratio
    gain = ratio * parameters.motor.torque_constant_n_m_a / lag
    proportional, integral = gain * drive.velocity_gain_a_s_rad, gain * drive.velocity_integral_gain_a_rad
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [-c / inertia, -d / inertia, c / inertia, d / inertia, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            [c / rotor, d / rotor, -(c + s0) / rotor, -(d + s1) / rotor, 0.0, 1.0 / rotor],
            [0.0, 0.0, by_angle, by_rate, 0.0, 0.0],
            [0.0, 0.0, proportional * by_angle, proportional * by_rate, integral, -1.0 / lag],
        ]
    )


def mean_modes(tcp_m: Floats, payload_kg: float, parameters: Parameters) -> list[tuple[float, float]]:
    """Return frequency [Hz] and damping ratio of all modes at a position by frequency.

    The friction of a stopping shaft first slides and finally sticks; the mean of both is used. Parameters are those of
    ``vibration_modes``.
    """
    found: dict[float, list[tuple[float, float]]] = {}
    for sticking in (0.0, 1.0):
        for mode in vibration_modes(tcp_m, payload_kg, parameters, sticking):
            found.setdefault(mode.inertia_kg_m2, []).append(
                (mode.frequency_hz, mode.damping)
            )  # one inertia per mode
    if not found:
        raise ProgramError(NO_MODE)
    means = (np.mean(both, axis=0).tolist() for both in found.values())
    return sorted((frequency, damping) for frequency, damping in means)


def excited_mode(
    tcp_m: Floats, directions: Floats, payload_kg: float, parameters: Parameters
) -> tuple[float, float]:
    """Return frequency [Hz] and damping ratio of the mode that a move excites most at its end.

    The friction of a stopping shaft first slides and finally sticks; the mean of both is used.

    Parameters
    ----------
    tcp_m
        Final position of the TCP [m], shape (3,).
    directions
        Directions of the path, shape (n, 3): vibrations excited during the move persist at its end.
    payload_kg
        Carried payload [kg].
    parameters
        The parameters of a robot, as for ``vibration_modes``.

    Raises
    ------
    ProgramError
        The robot has no vibration mode at the end of the move.

    """
    theta = kinematics.inverse(tcp_m, parameters.kinematics)
    arms = np.linalg.solve(kinematics.jacobian(theta, tcp_m, parameters.kinematics), directions.T)

    def swing(mode: Mode) -> float:
        """Return the relative TCP amplitude after a stop from the worst direction; the gear twist is prop. to a / c."""
        ways = (mode.arms @ arms) * float(np.linalg.norm(mode.tcp_m_rad))
        return float(np.abs(ways).max()) * mode.inertia_kg_m2

    found = []
    for sticking in (0.0, 1.0):
        modes = vibration_modes(tcp_m, payload_kg, parameters, sticking)
        if not modes:
            raise ProgramError(NO_MODE)
        worst = max(modes, key=swing)
        found.append((worst.frequency_hz, worst.damping))
    frequency, damping = np.mean(found, axis=0).tolist()
    return frequency, damping

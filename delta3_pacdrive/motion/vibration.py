"""How the built robot swings where it stands: arms and plate on elastic gears, on motors that their drives hold.

Small motions about a pose, arm side, with A of (4.26) without rotors (coupled arms and plate), J_m of a rotor, and
stiffness c and damping d of a gear:

    A thetaddot + d (thetadot - thetadot_m) + c (theta - theta_m) = 0
    J_m thetaddot_m + d (thetadot_m - thetadot) + c (theta_m - theta) + s1 thetadot_m + s0 theta_m = tau

The drives answer with tau: position and velocity loop (8.1), and a lag for the current. The friction of a shaft that
stands is a spring s0 with its damping s1 (bristles that bend); of one that slides both are 0.

Gears and drives of the three arms are alike. So the arms swing along the principal axes of A, A u = a u, each with its
own inertia a in place of A above: an eigenproblem of three arms, then one of six states for each of its solutions.
"""

import math
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

SLOWEST = math.tau  # [rad/s]: what turns more slowly is the robot that moves as a whole
LEAST_SWINGING = 0.9  # damping ratio beyond which nothing overshoots that could be called a vibration


@dataclass(frozen=True)
class Mode:
    """One vibration of the robot at a pose.

    Attributes
    ----------
    frequency_hz, damping
        Natural frequency [Hz] and damping ratio.
    inertia_kg_m2
        Of the arms in it, arm side, without rotors.
    arms
        How the arms take part: angles of length 1, shape (3,).
    tcp_m_rad
        How far the TCP swings, and where to, shape (3,).

    """

    frequency_hz: float
    damping: float
    inertia_kg_m2: float
    arms: Floats
    tcp_m_rad: Floats


def vibration_modes(
    tcp_m: Floats, payload_kg: float, parameters: Parameters, sticking: float = 0.0
) -> list[Mode]:
    """Return the vibrations of the robot at a place [m] with a payload [kg], the lowest first; at most three.

    Parameters
    ----------
    tcp_m
        Where it stands [m], shape (3,).
    payload_kg
        What it carries.
    parameters
        Of the robot. Its gears are those that the controller knows of (``control.gear_stiffness_n_m_rad``), or else
        those of ``rich``, as the data sheet has them, whether its effects are on or not.
    sticking
        Share of the bristles' stiffness that holds the shafts: 0 of shafts that slide, 1 of shafts that stand.

    Raises
    ------
    UnreachableError
        The arms cannot reach the place.

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
        if len(swings):  # the highest are those of rotors and current loops
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
    # of the speed error [rad/s, motor side] by theta_m and by thetadot_m
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
    """Return frequency [Hz] and damping ratio of every vibration at a place, the lowest first.

    The friction of a shaft that stops slides at first and sticks in the end: both count half. Arguments are those of
    ``vibration_modes``.
    """
    found: dict[float, list[tuple[float, float]]] = {}
    for sticking in (0.0, 1.0):
        for mode in vibration_modes(
            tcp_m, payload_kg, parameters, sticking
        ):  # each direction has its own inertia
            found.setdefault(mode.inertia_kg_m2, []).append((mode.frequency_hz, mode.damping))
    if not found:
        raise ProgramError('nothing swings where it ends: tell control.shaping_frequency_hz')
    means = (np.mean(both, axis=0).tolist() for both in found.values())
    return sorted((frequency, damping) for frequency, damping in means)


def excited_mode(
    tcp_m: Floats, directions: Floats, payload_kg: float, parameters: Parameters
) -> tuple[float, float]:
    """Return frequency [Hz] and damping ratio of the vibration that a move excites most where it stops.

    The friction of a shaft that stops slides at first and sticks in the end: both count half.

    Parameters
    ----------
    tcp_m
        Where the TCP stops [m], shape (3,).
    directions
        Of its path, shape (n, 3): what is excited on the way swings at the end as well.
    payload_kg
        What it carries.
    parameters
        Of the robot, as for ``vibration_modes``.

    Raises
    ------
    ProgramError
        Nothing swings there.

    """
    theta = kinematics.inverse(tcp_m, parameters.kinematics)
    arms = np.linalg.solve(kinematics.jacobian(theta, tcp_m, parameters.kinematics), directions.T)

    def swing(mode: Mode) -> float:
        """How far the TCP swings when it is stopped from the worst direction: the twist of a gear goes by a / c."""
        ways = (mode.arms @ arms) * float(np.linalg.norm(mode.tcp_m_rad))
        return float(np.abs(ways).max()) * mode.inertia_kg_m2

    found = []
    for sticking in (0.0, 1.0):
        modes = vibration_modes(tcp_m, payload_kg, parameters, sticking)
        if not modes:
            raise ProgramError('nothing swings where it ends: tell control.shaping_frequency_hz')
        worst = max(modes, key=swing)
        found.append((worst.frequency_hz, worst.damping))
    frequency, damping = np.mean(found, axis=0).tolist()
    return frequency, damping

"""The manipulator as in the thesis: three linear motors with loads, and the coupling torque d as their input (4.9).

    tau_m = (A_bar / k_r^2) thetaddot_m + friction + d                                      (4.29)
    d = [(A - A_bar) thetaddot + C thetadot + G] / k_r                                      (4.31)

The first subsystem has d as an input and the motion as its output, the second the reverse (Fig. 4.9, 8.4): an algebraic
loop. The exact plant solves it. Here d is taken from the previous step, like a memory block in a block diagram. Each
step multiplies an error of d by 1 - A / A_bar, so the loop is stable if all eigenvalues of A are below 2 A_bar.
"""

import math

import numpy as np

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.dynamics import motion_terms, multiply
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.vector3 import middle, plus, triple
from delta3_pacdrive.parameters import DECOUPLED, Parameters
from delta3_pacdrive.robot.plant.brake import (
    acceleration_under_brakes,
    advance_brakes,
    caught_speeds,
    command_brakes,
)
from delta3_pacdrive.robot.plant.rigid import drive_torque, effective_currents

# grid of positions in the workspace at which the mass matrix is evaluated
RADII, AZIMUTHS, HEIGHTS = 6, 24, 4


@kernel
def step_linear(before, now, plant):
    """Advance three shafts, coupled only by ``coupling``, by one step with currents changing from before to now.

    Returns position and speed at the midpoint of the step, and the acceleration used.
    """
    s, c, m, h = plant.state, plant.constants, plant.motor, plant.constants.step
    theta, thetadot, last = triple(s.theta), triple(s.thetadot), triple(s.thetaddot)
    half_way, speed = plus(theta, 0.5 * h, plus(thetadot, 0.25 * h, last)), plus(thetadot, 0.5 * h, last)
    current = middle(before, now)
    force = (
        drive_torque(current[0], s.friction_share[0], half_way[0], speed[0], c, m)
        - c.gear_ratio * s.coupling[0],
        drive_torque(current[1], s.friction_share[1], half_way[1], speed[1], c, m)
        - c.gear_ratio * s.coupling[1],
        drive_torque(current[2], s.friction_share[2], half_way[2], speed[2], c, m)
        - c.gear_ratio * s.coupling[2],
    )
    mass = (c.linear_inertia, c.linear_inertia, c.linear_inertia, 0.0, 0.0, 0.0)
    last = acceleration_under_brakes(mass, force, speed, s, c)
    after = caught_speeds(thetadot, h, last, s)
    theta = plus(theta, h, middle(thetadot, after))
    for i in range(3):
        s.theta[i], s.thetadot[i], s.thetaddot[i] = theta[i], after[i], last[i]
    return half_way, speed, last


@kernel
def step_decoupled(before, now, plant):
    """Advance the arms by one step with the d of the previous step, and compute the d of this one (4.31)."""
    s, c = plant.state, plant.constants
    theta, thetadot, last = step_linear(before, now, plant)
    mass, bias = motion_terms(theta, thetadot, plant.geometry, plant.inertia)
    product = multiply(mass, last)
    for i in range(3):
        felt = product[i] + bias[i] - c.linear_inertia * last[i]
        s.coupling[i] = felt / c.gear_ratio + s.load_torque[i]


@kernel
def advance_single(currents, brakes, coupling, plant):
    """Integrate three separate motors with loads over an exchange period; fill positions and speeds of ``shafts``.

    Parameters
    ----------
    currents, brakes, plant
        As for ``plant.advance``.
    coupling
        Torque on each shaft in addition to inertia and friction [N m, motor side], shape (3,).

    """
    p = plant[0]
    s, c, shafts = p.state, p.constants, p.shafts
    command_brakes(brakes, s)
    for i in range(3):
        s.coupling[i] = coupling[i]
    for k in range(currents.shape[0]):
        now = effective_currents(currents, k, s)
        advance_brakes(triple(s.thetadot), s, c)
        step_linear(triple(s.current), now, p)
        for i in range(3):
            s.current[i] = now[i]
    for i in range(3):
        shafts[i], shafts[3 + i] = s.theta[i] * c.gear_ratio, s.thetadot[i] * c.gear_ratio


def largest_inertia_kg_m2(parameters: Parameters, payload_kg: float) -> float:
    """Return the largest eigenvalue of A in the workspace with a payload, arm side."""
    k = parameters.kinematics
    radius, azimuth, height = np.meshgrid(
        np.linspace(0.0, 0.5 * k.workspace_diameter_m, RADII),
        np.linspace(0.0, math.tau, AZIMUTHS, endpoint=False),
        np.linspace(k.workspace_bottom_m, k.workspace_top_m, HEIGHTS),
    )
    places = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1).reshape(-1, 3)
    theta = kinematics.inverse(places, parameters, unreachable='nan')
    theta = theta[np.isfinite(theta).all(axis=-1)]
    loaded = parameters.replace(dynamics__payload_mass_kg=payload_kg)
    return float(np.linalg.eigvalsh(dynamics.mass_matrix(theta, loaded)).max())


def require_stable(parameters: Parameters, payload_kg: float) -> None:
    """Raise ParameterError for a payload that makes the loop of a plant with decoupled arms unstable."""
    if parameters.dynamics.arm_coupling != DECOUPLED:
        return
    linear = parameters.drive.observer_arm_inertia_kg_m2
    largest = largest_inertia_kg_m2(parameters, payload_kg)
    if largest >= 2.0 * linear:
        raise ParameterError(
            f'dynamics.arm_coupling is {DECOUPLED}, but with a payload of {payload_kg:g} kg the mass matrix reaches '
            f'{largest:.2f} kg m2 in the workspace, and its loop is stable only below twice '
            f'drive.observer_arm_inertia_kg_m2, {2.0 * linear:.2f} kg m2'
        )

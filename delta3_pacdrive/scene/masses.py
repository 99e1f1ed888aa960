"""Masses of the parts as rigid bodies that move exactly as the dynamics have it.

An upper arm is a slender rod with the elbow's mass at its end. The two rods of a forearm share its mass. As the thesis
has it (4.8.1), the share r of it is a point at the elbow and the rest one at the plate: that is a rigid body, too, with

    centre (1 - r) l_B from the elbow,   inertia m r (1 - r) l_B^2 about it.

A built robot's forearms are uniform rods. Plate and payload are never turned, so that only their masses matter; on a
rotary axis they turn about z alone, where the tool has the inertia of bar and tool, and the payload that of its radius
of gyration. What the tool weighs is in the mass of the plate. Base
and motors do not move and have no masses; the rotors count as inertia of the motor axes (``dynamics.rotor_inertia``).
"""

from dataclasses import dataclass, replace

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.parameters.rotary import Rotary
from delta3_pacdrive.scene.parts import ARMS, RODS, arm_of, payload_edge

TINY_KG_M2 = 1e-14  # of slender rods about their length; the smallest that MuJoCo takes is 1e-15
TINY_KG = 1e-9  # of parts without a mass, which engines do not take


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre [m] and moments of inertia about it [kg m^2], along the axes of the part's frame."""

    mass_kg: float
    centre_m: tuple[float, float, float]
    moments_kg_m2: tuple[float, float, float]


def masses(parameters: Parameters, *, rods: bool | None = None) -> dict[str, Inertia]:
    """Return the inertia of each part that moves and has a mass.

    Parameters
    ----------
    parameters
        Of the robot, with what it carries.
    rods
        Whether forearms are uniform rods; without it, whether those of this robot are (``rich.forearm_rods``).

    Returns
    -------
    dict[str, Inertia]
        By name of the part: arms, forearms, plate, payload if there is one, and the tool of a rotary axis.

    """
    k, d = parameters.kinematics, parameters.dynamics
    rods = parameters.rich.effects.forearm_rods if rods is None else rods
    share = 0.5 if rods else d.forearm_share_at_elbow
    arms = [
        _along_x(
            d.upper_arm_mass_kg + d.elbow_mass_kg,
            (0.5 * d.upper_arm_mass_kg + d.elbow_mass_kg) * length,
            (d.upper_arm_mass_kg / 3.0 + d.elbow_mass_kg) * length**2,
        )
        for length in k.upper_arm_lengths_m
    ]
    forearms = [
        _along_x(
            0.5 * d.forearm_mass_kg,
            0.5 * d.forearm_mass_kg * (1.0 - share) * length,
            0.5 * d.forearm_mass_kg * (1.0 / 3.0 if rods else 1.0 - share) * length**2,
        )
        for length in k.forearm_lengths_m
    ]
    disc = 0.25 * d.plate_mass_kg * k.plate_radius_m**2
    found = {f'arm{i}': arms[i - 1] for i in ARMS} | {f'forearm{i}': forearms[arm_of(i)] for i in RODS}
    found['plate'] = Inertia(d.plate_mass_kg, (0.0, 0.0, 0.0), (disc, disc, 2.0 * disc))
    if d.payload_mass_kg > 0.0:
        edge = payload_edge(d.payload_mass_kg)
        moment = d.payload_mass_kg * edge**2 / 6.0
        found['payload'] = Inertia(d.payload_mass_kg, (0.0, 0.0, -0.5 * edge), (moment, moment, moment))
    if parameters.rotary.present:
        found |= _turning(parameters.rotary, found.get('payload'))
    return found


def _turning(rotary: Rotary, payload: Inertia | None) -> dict[str, Inertia]:
    """Return what turns about z with a rotary axis; across, it has at least what a body of this inertia has."""
    tool = rotary.tool_inertia_kg_m2
    found = {'tool': Inertia(TINY_KG, (0.0, 0.0, 0.0), (tool, tool, tool))}
    if payload is not None:
        about = max(payload.mass_kg * rotary.part_gyration_radius_m**2, TINY_KG_M2)
        across = max(payload.moments_kg_m2[0], about)
        found['payload'] = replace(payload, moments_kg_m2=(across, across, about))
    return found


def _along_x(mass_kg: float, first_kg_m: float, second_kg_m2: float) -> Inertia:
    """Return the inertia of masses on the x axis from their moments about the origin."""
    centre = first_kg_m / mass_kg if mass_kg else 0.0
    across = max(second_kg_m2 - mass_kg * centre**2, TINY_KG_M2)
    return Inertia(max(mass_kg, TINY_KG), (centre, 0.0, 0.0), (TINY_KG_M2, across, across))

"""Masses of the parts as rigid bodies that are dynamically equivalent to the model.

An upper arm is a slender rod with the elbow's mass at its end. The two rods of a forearm share its mass. In the thesis
(4.8.1) the share r of it is a point at the elbow and the remainder one at the plate, which is also a rigid body, with

    centre (1 - r) l_B from the elbow,   inertia m r (1 - r) l_B^2 about it.

The forearms of a built robot are uniform rods. Plate and payload never rotate, so only their masses matter; with a
rotary axis tool and payload rotate about z: the tool has the inertia of bar and tool, the payload that of its radius
of gyration. The mass of the plate includes the tool. Base and motors do not move and have no masses; the rotors are
part of the inertia of the motor axes (``dynamics.rotor_inertia``).
"""

from dataclasses import dataclass, replace

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.parameters.rotary import Rotary
from delta3_pacdrive.scene import tool_bar
from delta3_pacdrive.scene.parts import ARMS, RODS, arm_of, payload_edge

TINY_KG_M2 = 1e-14  # of slender rods about their axis; MuJoCo's minimum is 1e-15
TINY_KG = 1e-9  # of massless parts, which engines reject


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre [m] and moments of inertia about it [kg m^2], along the axes of the part's frame."""

    mass_kg: float
    centre_m: tuple[float, float, float]
    moments_kg_m2: tuple[float, float, float]


def masses(parameters: Parameters, *, rods: bool | None = None) -> dict[str, Inertia]:
    """Return the inertia of each moving part with a mass: arms, forearms, plate, payload, and tool of a rotary axis.

    Parameters
    ----------
    parameters
        Robot with its payload.
    rods
        Whether forearms are uniform rods; default: ``rich.forearm_rods``.

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
    for _, body, rotary in tool_bar.bodies(parameters):
        found |= _turning(body, rotary, found.get('payload'))
    return found


def _turning(body: str, rotary: Rotary, payload: Inertia | None) -> dict[str, Inertia]:
    """Return the bodies that rotate about z with a rotary axis; lateral moments are at least physically consistent."""
    tool = rotary.tool_inertia_kg_m2
    found = {body: Inertia(TINY_KG, (0.0, 0.0, 0.0), (tool, tool, tool))}
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

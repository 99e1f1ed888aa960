"""Parameters of a rotary axis in the format of an arm's drive: its drive is an MC-4, too."""

import math
from dataclasses import fields, replace
from typing import Any

from delta3_pacdrive.parameters.records import Drive, Motor
from delta3_pacdrive.parameters.robot import Parameters
from delta3_pacdrive.parameters.rotary import Rotary

BEYOND_DEG = 5.0  # beyond the limits of the tool angle: overtravel of the drive
SEED = 4  # offset of the sensor seed of the first rotary axis


def _shared(group: Motor | Drive, rotary: Rotary) -> dict[str, Any]:
    """Return the values of the axis that have the same names in a group of the arms."""
    names = {field.name for field in fields(group)} & {field.name for field in fields(rotary)}
    return {name: getattr(rotary, name) for name in names}


def rotary_axis_parameters(parameters: Parameters, number: int) -> Parameters:
    """Return ``parameters`` with motor, gear and drive of rotary axis ``number``, from 0, in place of an arm's."""
    p, rotary = parameters, parameters.rotary_axes[number]
    payload_kg = p.dynamics.payload_mass_kg
    inertia, gear = rotary.shaft_inertia_kg_m2(payload_kg), rotary.gear_ratio
    to_shaft = math.radians(gear)
    low, high = rotary.angle_min_deg, rotary.angle_max_deg
    no_correction = (0.0, 0.0, 0.0)
    return replace(
        p,
        kinematics=replace(
            p.kinematics,
            arm_angle_min_deg=low,
            arm_angle_max_deg=high,
            arm_angle_correction_deg=no_correction,
        ),
        dynamics=replace(
            p.dynamics,
            gear_in=gear,
            gear_out=1.0,
            end_stop_min_deg=low - BEYOND_DEG,
            end_stop_max_deg=high + BEYOND_DEG,
        ),
        motor=replace(
            p.motor,
            **_shared(p.motor, rotary),
            brake_inertia_kg_m2=0.0,
        ),
        drive=replace(
            p.drive,
            **_shared(p.drive, rotary),
            feedforward_inertia_kg_m2=inertia,
            observer_arm_inertia_kg_m2=inertia * gear**2,
            following_error_limit_rad=rotary.following_error_limit_deg * to_shaft,
            position_window_rad=rotary.position_window_deg * to_shaft,
            velocity_limit_rad_s=rotary.max_speed_rad_s,
            torque_limit_n_m=rotary.peak_current_a * rotary.torque_constant_n_m_a,
            # the filters of the arms' drives are tuned to the resonances of the arms
            notch_1_frequency_hz=0.0,
            notch_2_frequency_hz=0.0,
        ),
        rich=replace(
            p.rich,
            sensor_seed=p.rich.sensor_seed + SEED + number,
            break_away_torque_n_m=max(p.rich.break_away_torque_n_m, rotary.static_friction_n_m),
        ),
    )

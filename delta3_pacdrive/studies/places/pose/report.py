"""Report of a pose: JSON document, text and table."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.units import millimetres
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG, Parameters
from delta3_pacdrive.planning.limits.capability import Capability
from delta3_pacdrive.studies.framework.columns import fill, named_lines, to_dict
from delta3_pacdrive.studies.places.pose.study import Pose

# key in JSON: attribute of the capability
OF_CAPABILITY = {
    'speed_m_s': 'speed_m_s', 'acceleration_m_s2': 'acceleration_m_s2',
    'acceleration_nominal_m_s2': 'acceleration_nominal_m_s2', 'payload_max_kg': 'payload_kg',
    'payload_held_kg': 'payload_held_kg', 'payload_peak_kg': 'payload_peak_kg', 'tcp_per_increment_m': 'increment_m',
}  # fmt: skip
# key of a limit: name of the line and its text, from the values of one or three arms
LIMITS = {
    'radius': ('workspace', '{distance:.1f in mm} mm to the rim ({limit:g in mm} mm)'),
    'top': ('', '{distance:.1f in mm} mm to the top ({limit:g in mm} mm)'),
    'bottom': ('', '{distance:.1f in mm} mm to the bottom ({limit:g in mm} mm)'),
    'arm_angle_max': ('arm limits', '{distances:z.2f} deg below {limit:g} deg'),
    'arm_angle_min': ('', '{distances:z.2f} deg above {limit:g} deg'),
    'forearm_swing': ('swing', '{distances:z.2f} deg below {limit:g} deg'),
    'serial_singularity': ('singularity', 'serial {values:z.3f}, the limit is {limit:g}'),
    'parallel_singularity': ('', 'parallel {values:z.3f}, the limit is {limit:g}'),
}


def document(pose: Pose, parameters: Parameters) -> dict[str, Any]:
    """Return a pose for JSON, SI units unless a key names another."""
    angles, torque = pose.arm_angle_rad, pose.holding_torque_n_m
    result: dict[str, Any] = {
        'ok': pose.is_reachable,
        'reachable': pose.is_reachable,
        'refusals': pose.refusals,
        'point_m': pose.point_m,
        'arm_angles_rad': angles,
        'arm_angles_deg': None if angles is None else np.degrees(angles),
        'solution': pose.number,
        'mirror_point_m': pose.mirror_m,
        'solutions': pose.solutions,
        'limits': pose.margins,
        'jacobian_m_rad': pose.jacobian,
        'singular_values_m_rad': pose.singular_values,
        'condition': _condition(pose),
        'determinant_m3_rad3': None if pose.jacobian is None else np.linalg.det(pose.jacobian),
        'payload_kg': pose.payload_kg,
        'holding_torque_n_m': torque,
        'holding_motor_torque_n_m': None if torque is None else torque / parameters.dynamics.gear_ratio,
        'holding_current_a': pose.holding_current_a,
        'gear_torque_limit_n_m': parameters.gear_torque_max_n_m if parameters.gear.limit_moves else None,
        'rod_force_n': None if pose.forces is None else pose.forces.rod_n[0],
        'spring_force_n': None if pose.forces is None else pose.forces.spring_n[0],
    }
    for key, name in OF_CAPABILITY.items():
        result[key] = None if pose.capability is None else getattr(pose.capability, name)
    if pose.refusals:
        result['error'] = sentence(pose)
    found: dict[str, Any] = to_dict(result)
    return found


def _condition(pose: Pose) -> float | None:
    if pose.singular_values is None or pose.singular_values[-1] == 0.0:
        return None
    return float(pose.singular_values[0] / pose.singular_values[-1])


def sentence(pose: Pose) -> str:
    """Return the reasons why the pose is not allowed."""
    return '; '.join(pose.refusals)


def text(pose: Pose, parameters: Parameters) -> list[str]:
    """Return a pose as text in millimetres and degrees."""
    rows = [*_position_rows(pose)]
    if pose.jacobian is not None:
        rows += _jacobian_rows(pose)
    rows += _margin_rows(pose)
    rows += _load_rows(pose, parameters)
    rows += _force_rows(pose, parameters)
    if pose.capability is not None:
        rows += _capability_rows(pose.capability, parameters)
    rows += _solution_rows(pose)
    return named_lines(rows, 14)


Rows = list[tuple[str, str]]


def _position_rows(pose: Pose) -> Iterator[tuple[str, str]]:
    if pose.point_m is not None:
        yield 'TCP', millimetres(pose.point_m)
    if pose.arm_angle_rad is not None:
        yield 'arm angles', fill('{arm_angle_rad:z.3f deg}', pose)
    if pose.mirror_m is not None:
        yield 'mirror point', f'{millimetres(pose.mirror_m)}, above the elbow plane'
    yield 'reachable', 'yes' if pose.is_reachable else f'no: {pose.refusals[0]}'
    for refusal in pose.refusals[1:]:
        yield '', refusal


def _jacobian_rows(pose: Pose) -> Rows:
    assert pose.jacobian is not None  # noqa: S101
    lines = [' '.join(f'{value:z9.4f}' for value in row) for row in pose.jacobian]
    condition = _condition(pose)
    number = 'none, J is singular' if condition is None else f'{condition:.3f}'
    return [
        ('Jacobian', f'[{lines[0]} ]'),
        ('', f'[{lines[1]} ]'),
        ('', f'[{lines[2]} ] m/rad'),
        ('condition', fill(f'{number}; singular values {{singular_values:z.4f}} m/rad', pose)),
    ]


def _margin_rows(pose: Pose) -> Rows:
    """Return the distances to the limits; the three arms share a line."""
    rows: Rows = []
    for key, (name, template) in LIMITS.items():
        found = [margin for margin in pose.margins if margin.key == key]
        if found:
            lists = {
                'distances': [margin.distance for margin in found],
                'values': [margin.value for margin in found],
            }
            rows.append((name, fill(template, vars(found[0]) | lists)))
    return rows


def _load_rows(pose: Pose, parameters: Parameters) -> Rows:
    torque, current = pose.holding_torque_n_m, pose.holding_current_a
    if torque is None or current is None:
        return []
    motor, at_motor = parameters.motor, torque / parameters.dynamics.gear_ratio
    values = vars(pose) | {
        'at_motor': at_motor,
        'nominal': np.abs(current) / motor.nominal_current_a,
    }
    templates = [
        '{holding_torque_n_m:z.3f} N m at the arms with {payload_kg:g} kg',
        '{at_motor:z.4f} N m at the motors, {holding_current_a:z.3f A}',
        f'{{nominal:.1f %}} of the nominal current ({motor.nominal_current_a:g} A)',
    ]
    if motor.brake_torque_n_m > 0.0:
        values['brake'] = np.abs(at_motor) / motor.brake_torque_n_m
        templates.append(f'{{brake:.1f %}} of the brake torque ({motor.brake_torque_n_m:g} N m)')
    gear = parameters.gear
    values['gear'] = np.abs(torque) / gear.nominal_torque_n_m
    templates.append(f'{{gear:.1f %}} of the nominal torque of the gears ({gear.nominal_torque_n_m:g} N m)')
    return [('' if n else 'holding', fill(template, values)) for n, template in enumerate(templates)]


def _force_rows(pose: Pose, parameters: Parameters) -> Rows:
    if pose.forces is None:
        return []
    rods, spring = pose.forces.rod_n, max(float(pose.forces.spring_n.max()), 0.0)
    text = f'{rods.min():.2f} to {rods.max():.2f} N in the rods at rest; the ball joints need springs of {spring:.2f} N'
    return [('forces', f'{text} (they have {parameters.joints.spring_force_n:g} N)')]


def _capability_rows(can: Capability, parameters: Parameters) -> Rows:
    wanted = parameters.motion.acceleration_max_m_s2
    limit = parameters.gear.acceleration_torque_n_m
    of_gears = f' ({limit:g} N m at the gears)' if parameters.gear.limit_moves else ''
    templates = (
        ('speed', '{speed_m_s:.3f} m/s in every direction'),
        (
            'acceleration',
            f'{{acceleration_m_s2:.1f}} m/s2 from rest in every direction at peak torque{of_gears}, '
            '{acceleration_nominal_m_s2:.1f} at nominal current',
        ),
        ('payload', f'{{payload_kg:.1f}} kg, the limit of the robot is {PAYLOAD_MAX_KG:g} kg'),
        (
            '',
            'nominal current and brakes hold {payload_held_kg:.1f} kg at rest, peak torque accelerates '
            f'{{payload_peak_kg:.1f}} kg with {wanted:g} m/s2',
        ),
        ('increment', '{increment_m:.3f um} at the TCP for one of each motor'),
    )
    return [(name, fill(template, can)) for name, template in templates]


def _solution_rows(pose: Pose) -> Rows:
    rows: Rows = []
    if pose.solutions and all(np.isnan(one.loop_error_m) for one in pose.solutions):
        return [('solutions', 'none')]
    for one in pose.solutions:
        if not np.isfinite(one.arm_angle_rad).all():
            line = 'none'
        else:
            angles = ' '.join(f'{angle:z8.2f}' for angle in np.degrees(one.arm_angle_rad))
            line = f'{angles} deg   {"within" if one.is_legal else "beyond"} the limits of the arms'
        mark = '*' if one.number == pose.number else ' '
        rows.append(('' if rows else 'solutions', f'{mark} {" ".join(f"{e:<3}" for e in one.elbows)} {line}'))
    return rows

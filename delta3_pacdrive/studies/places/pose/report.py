"""Report of a pose: JSON document, text and table."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.units import millimetres
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG, Parameters
from delta3_pacdrive.studies.places.pose.study import Margin, Pose

MM, UM, CM = 1e3, 1e6, 1e2


def document(pose: Pose, parameters: Parameters) -> dict[str, Any]:
    """Return a pose for JSON, SI units unless a key names another."""
    result: dict[str, Any] = {
        'ok': pose.is_reachable,
        'reachable': pose.is_reachable,
        'refusals': list(pose.refusals),
        'point_m': _list(pose.point_m),
        'arm_angles_rad': _list(pose.arm_angle_rad),
        'arm_angles_deg': None if pose.arm_angle_rad is None else np.degrees(pose.arm_angle_rad).tolist(),
        'solution': pose.number,
        'mirror_point_m': _list(pose.mirror_m),
        'solutions': [
            {
                'number': one.number,
                'elbows': list(one.elbows),
                'arm_angles_rad': _list(one.arm_angle_rad),
                'within_arm_limits': one.is_legal,
                'loop_error_m': None if np.isnan(one.loop_error_m) else one.loop_error_m,
            }
            for one in pose.solutions
        ],
        'limits': [_margin(margin) for margin in pose.margins],
        'jacobian_m_rad': _list(pose.jacobian),
        'singular_values_m_rad': _list(pose.singular_values),
        'condition': _condition(pose),
        'determinant_m3_rad3': None if pose.jacobian is None else float(np.linalg.det(pose.jacobian)),
        'payload_kg': pose.payload_kg,
        'holding_torque_n_m': _list(pose.holding_torque_n_m),
        'holding_motor_torque_n_m': None
        if pose.holding_torque_n_m is None
        else (pose.holding_torque_n_m / parameters.dynamics.gear_ratio).tolist(),
        'holding_current_a': _list(pose.holding_current_a),
    }
    for name in (
        'speed_m_s',
        'acceleration_m_s2',
        'acceleration_nominal_m_s2',
        'payload_kg',
        'payload_held_kg',
        'payload_peak_kg',
        'increment_m',
    ):
        key = {'payload_kg': 'payload_max_kg', 'increment_m': 'tcp_per_increment_m'}.get(name, f'{name}')
        result[key] = None if pose.capability is None else float(getattr(pose.capability, name))
    if pose.refusals:
        result['error'] = sentence(pose)
    return result


def _list(values: Floats | None) -> Any:
    if values is None:
        return None
    cells = [value if np.isfinite(value) else None for value in values.ravel().tolist()]
    return cells if values.ndim == 1 else [cells[3 * n : 3 * n + 3] for n in range(len(values))]


def _margin(margin: Margin) -> dict[str, Any]:
    unit = f'_{margin.unit}' if margin.unit else ''
    return {
        'quantity': margin.key,
        'arm': margin.arm,
        f'value{unit}': margin.value,
        f'limit{unit}': margin.limit,
        f'distance{unit}': margin.distance,
        'kept': margin.is_kept,
    }


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
    if pose.jacobian is not None and pose.singular_values is not None:
        rows += _jacobian_rows(pose)
    rows += _margin_rows(pose)
    rows += _load_rows(pose, parameters)
    if pose.capability is not None:
        rows += _capability_rows(pose, parameters)
    rows += _solution_rows(pose)
    return [f'{name:>14}  {line}'.rstrip() for name, line in rows]


Rows = list[tuple[str, str]]


def _position_rows(pose: Pose) -> Iterator[tuple[str, str]]:
    if pose.point_m is not None:
        yield 'TCP', millimetres(pose.point_m)
    if pose.arm_angle_rad is not None:
        yield 'arm angles', f'{three(np.degrees(pose.arm_angle_rad), 3)} deg'
    if pose.mirror_m is not None:
        yield 'mirror point', f'{millimetres(pose.mirror_m)}, above the elbow plane'
    yield 'reachable', 'yes' if pose.is_reachable else f'no: {pose.refusals[0]}'
    for refusal in pose.refusals[1:]:
        yield '', refusal


def three(values: Iterable[float], digits: int) -> str:
    """Format the values of three arms."""
    return ' / '.join(f'{round(float(value), digits) + 0.0:.{digits}f}' for value in values)


def _jacobian_rows(pose: Pose) -> Rows:
    jacobian, values = pose.jacobian, pose.singular_values
    assert jacobian is not None and values is not None  # noqa: S101, PT018
    lines = [' '.join(f'{value:z9.4f}' for value in row) for row in jacobian]
    condition = _condition(pose)
    number = 'none, J is singular' if condition is None else f'{condition:.3f}'
    return [
        ('Jacobian', f'[{lines[0]} ]'),
        ('', f'[{lines[1]} ]'),
        ('', f'[{lines[2]} ] m/rad'),
        ('condition', f'{number}; singular values {three(values, 4)} m/rad'),
    ]


def _margin_rows(pose: Pose) -> Rows:
    """Return the distances to the limits; the three arms share a line."""
    names = {
        'radius': ('workspace', 'to the rim'),
        'top': ('', 'to the top'),
        'bottom': ('', 'to the bottom'),
        'arm_angle_max': ('arm limits', 'below'),
        'arm_angle_min': ('', 'above'),
        'forearm_swing': ('swing', 'below'),
        'serial_singularity': ('singularity', 'serial'),
        'parallel_singularity': ('', 'parallel'),
    }
    rows: Rows = []
    for key, (name, where) in names.items():
        found = [margin for margin in pose.margins if margin.key == key]
        if not found:
            continue
        limit = found[0].limit
        if found[0].unit == 'm':
            line = f'{MM * found[0].distance:.1f} mm {where} ({MM * limit:g} mm)'
        elif found[0].unit == 'deg':
            line = f'{three([margin.distance for margin in found], 2)} deg {where} {limit:g} deg'
        else:
            line = f'{where} {three([margin.value for margin in found], 3)}, the limit is {limit:g}'
        rows.append((name, line))
    return rows


def _load_rows(pose: Pose, parameters: Parameters) -> Rows:
    torque, current = pose.holding_torque_n_m, pose.holding_current_a
    if torque is None or current is None:
        return []
    motor, gear = parameters.motor, parameters.dynamics.gear_ratio
    share = np.abs(current) / motor.nominal_current_a * CM
    rows = [
        ('holding', f'{three(torque, 3)} N m at the arms with {pose.payload_kg:g} kg'),
        ('', f'{three(torque / gear, 4)} N m at the motors, {three(current, 3)} A'),
        ('', f'{three(share, 1)} % of the nominal current ({motor.nominal_current_a:g} A)'),
    ]
    if motor.brake_torque_n_m > 0.0:
        brake = np.abs(torque) / gear / motor.brake_torque_n_m * CM
        rows.append(('', f'{three(brake, 1)} % of the brake torque ({motor.brake_torque_n_m:g} N m)'))
    return rows


def _capability_rows(pose: Pose, parameters: Parameters) -> Rows:
    can = pose.capability
    assert can is not None  # noqa: S101
    wanted = parameters.motion.acceleration_max_m_s2
    return [
        ('speed', f'{can.speed_m_s:.3f} m/s in every direction'),
        (
            'acceleration',
            f'{can.acceleration_m_s2:.1f} m/s2 from rest in every direction at peak current, '
            f'{can.acceleration_nominal_m_s2:.1f} at nominal current',
        ),
        ('payload', f'{can.payload_kg:.1f} kg, the limit of the robot is {PAYLOAD_MAX_KG:g} kg'),
        (
            '',
            f'nominal current and brakes hold {can.payload_held_kg:.1f} kg at rest, peak current accelerates '
            f'{can.payload_peak_kg:.1f} kg with {wanted:g} m/s2',
        ),
        ('increment', f'{UM * can.increment_m:.3f} um at the TCP for one of each motor'),
    ]


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


def solution_columns(pose: Pose) -> tuple[Sequence[str], list[list[Any]]]:
    """Return header and rows of the table of the eight solutions."""
    header = ['solution', 'elbow 1', 'elbow 2', 'elbow 3', 'theta_1 [rad]', 'theta_2 [rad]', 'theta_3 [rad]',
              'within arm limits', 'loop error [m]']  # fmt: skip
    rows = [
        [one.number, *one.elbows, *one.arm_angle_rad.tolist(), one.is_legal, one.loop_error_m]
        for one in pose.solutions
    ]
    return header, rows

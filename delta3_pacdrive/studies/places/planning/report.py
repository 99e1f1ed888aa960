"""Report of a plan: JSON document, text and tables of each move and its limits."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.control.motion_state import percent_allowed
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.timing.blending import ROUNDING_M
from delta3_pacdrive.robot.motor import share_text, thermal_warnings
from delta3_pacdrive.studies.framework.report_folder import Table
from delta3_pacdrive.studies.framework.residual_vibration import Swing
from delta3_pacdrive.studies.places.planning.study import (
    MoveRow,
    PlanStudy,
    Quantity,
    StatementRow,
    TurnRow,
    Use,
)

RPM, MM = 60.0 / math.tau, 1e3
NAME_LENGTH = 30  # least width of names in the table
INDENT = '  '  # of the statements of a sequence
JSON_UNITS = {
    'm/s': 'm_s', 'm/s2': 'm_s2', 'm/s3': 'm_s3', 'rpm': 'rpm', 'V': 'v', 'A': 'a', 'N m/s': 'n_m_s', 's': 's'
}  # fmt: skip
DISTANCE_UNITS = {
    'radius': 'm',
    'top': 'm',
    'bottom': 'm',
    'arm_angle_max': 'deg',
    'arm_angle_min': 'deg',
    'forearm_swing': 'deg',
}


def document(found: PlanStudy, parameters: Parameters, with_limits: bool = False) -> dict[str, Any]:
    """Return a plan for JSON, SI units unless a key names another; ``with_limits`` adds all limits of each move."""
    planned = found.planned
    nominal = parameters.motor.nominal_current_a
    return {
        'ok': True,
        'program': planned.name,
        'time_s': planned.plan.duration_s,
        'repeat': planned.repeat,
        'length_m': float(sum(row.length_m for row in found.rows)),
        'moves': [move_document(row, with_limits) for row in found.rows],
        'rms_current_a': list(planned.rms_current_a),
        'rms_current_used': max(planned.rms_current_a) / nominal,
        'energy': asdict(found.energy),
        'override_max': planned.override_max,
        'rate': planned.rate,
        'used_max': {_key(quantity): used for quantity, used in used_max(found).items()},
        'distances': _distances(nearest(found)),
        'notices': list(planned.notices),
        'warnings': thermal_warnings(planned.rms_current_a, nominal),
    }


def _key(quantity: Quantity) -> str:
    return quantity.value.lower().replace(' ', '_')


def used_max(found: PlanStudy) -> dict[Quantity, float]:
    """Return the largest used share of each limit."""
    largest = dict.fromkeys(found.samples.used, 0.0)
    for row in found.rows:
        for use in row.uses:
            largest[use.quantity] = max(largest.get(use.quantity, 0.0), use.used)
    return largest


def move_document(row: MoveRow, with_limits: bool) -> dict[str, Any]:
    """Return a move for JSON; ``with_limits`` adds the use of every limit."""
    limits = {'limits': [_use(use) for use in row.uses]} if with_limits else {}
    return {
        'number': row.number,
        'statements': row.name,
        'kind': row.kind,
        'start_s': row.start_s,
        'time_s': row.duration_s,
        'length_m': row.length_m,
        'payload_kg': row.payload_kg,
        'speed_max_m_s': row.speed_max_m_s,
        'acceleration_max_m_s2': row.acceleration_max_m_s2,
        'jerk_max_m_s3': row.jerk_max_m_s3,
        'motor_speed_max_rad_s': list(row.motor_speed_max_rad_s),
        'motor_torque_max_n_m': list(row.motor_torque_max_n_m),
        'motor_current_rms_a': list(row.motor_current_rms_a),
        'limited_by': _use(row.limited_by),
        **limits,
        **({} if row.turn is None else {'turn': _turn(row.turn)}),
        'distances': _distances(row.distances),
        **({'by_statement': statement_documents(row.statements)} if row.statements else {}),
    }


def statement_documents(rows: Sequence[StatementRow]) -> list[dict[str, Any]]:
    """Return the statements of a blended sequence for JSON."""
    return [
        {
            'statement': row.name,
            'start_s': row.start_s,
            'time_s': row.duration_s,
            'length_m': row.length_m,
            'speed_min_m_s': row.speed_min_m_s,
            'speed_max_m_s': row.speed_max_m_s,
            'limited_by': _use(row.limited_by),
        }
        for row in rows
    ]


def _turn(turn: TurnRow) -> dict[str, float]:
    return {
        'from_deg': math.degrees(turn.start_rad),
        'to_deg': math.degrees(turn.end_rad),
        'speed_max_deg_s': math.degrees(turn.speed_max_rad_s),
        'acceleration_max_deg_s2': math.degrees(turn.acceleration_max_rad_s2),
        'motor_current_max_a': turn.current_max_a,
    }


def _use(use: Use) -> dict[str, Any]:
    unit = JSON_UNITS[use.unit]
    return {
        'quantity': _key(use.quantity),
        'axis': use.axis,
        f'peak_{unit}': use.peak,
        f'limit_{unit}': use.limit if math.isfinite(use.limit) else None,
        'used': use.used,
        'time_share': use.time_share,
    }


def _distances(distances: dict[str, float]) -> dict[str, float]:
    """Return distances by names with units."""
    return {
        f'{key}_{DISTANCE_UNITS[key]}' if key in DISTANCE_UNITS else key: value
        for key, value in distances.items()
    }


def nearest(found: PlanStudy) -> dict[str, float]:
    """Return the least distance of the plan to each limit of the pose."""
    return {key: min(row.distances[key] for row in found.rows) for key in found.rows[0].distances}


def table_of_moves(rows: Sequence[MoveRow]) -> list[str]:
    """Return the table of the moves, and of the statements of blended sequences, as lines."""
    single = [row.name for row in rows if not row.statements]
    parts = [INDENT + one.name for row in rows for one in row.statements]
    width = max(map(len, [NAME_LENGTH * ' ', *single, *parts]))
    lines = [
        f'{"":>5} {"statements":<{width}} {"kind":<8} {"length":>9} {"time":>8} {"speed":>7} {"accel.":>7} '
        f'{"jerk":>8} {"motor":>6} {"torque":>7}  limited by',
        f'{"":>5} {"":<{width}} {"":<8} {"mm":>9} {"s":>8} {"m/s":>7} {"m/s2":>7} '
        f'{"m/s3":>8} {"rpm":>6} {"N m":>7}  (share of its time)',
    ]
    for row in rows:
        lines.append(_line(row, width))
        lines += [_statement_line(one, width) for one in row.statements]
    return lines


def text(found: PlanStudy, parameters: Parameters) -> list[str]:
    """Return a plan as text: a table of the moves, then a summary."""
    planned = found.planned
    lines = [f'{planned.name}: {counted(len(found.rows), "move")}', *table_of_moves(found.rows)]
    rounds = f' in {planned.repeat} rounds' if planned.repeat > 1 else ''
    currents = ' / '.join(f'{value:.2f}' for value in planned.rms_current_a)
    nominal = parameters.motor.nominal_current_a
    used = sorted(((share, quantity) for quantity, share in used_max(found).items()), reverse=True)
    rows = [
        (
            'whole',
            f'{planned.plan.duration_s:.3f} s{rounds}, override up to {percent_allowed(planned.override_max)} %',
        ),
        ('rms current', f'{currents} A, {share_text(planned.rms_current_a, nominal, "nominal")}'),
        ('energy', found.energy.text(planned.repeat)),
        (
            'used',
            ', '.join(f'{100.0 * share:.0f} % {quantity.value}' for share, quantity in used if share > 0.0),
        ),
    ]
    rows += _turn_rows(found.rows, parameters)
    rows += _distance_rows(nearest(found))
    rows += [('note', notice) for notice in planned.notices]
    rows += [('warning', warning) for warning in thermal_warnings(planned.rms_current_a, nominal)]
    return [*lines, *(f'{name:>12}  {line}' for name, line in rows)]


def vibration(swings: Sequence[Swing]) -> list[dict[str, Any]]:
    """Return predicted vibrations for JSON."""
    return [
        {
            'move': one.number,
            'statements': one.name,
            'swing_m': one.swing_m,
            'unshaped_swing_m': one.unshaped_m,
            'less_db': one.less_db,
        }
        for one in swings
    ]


def vibration_text(swings: Sequence[Swing]) -> list[str]:
    """Return predicted vibrations as text."""
    texts = [one.text for one in swings] or ['no move of the first round is shaped']
    return [f'{"vibration" if n == 0 else "":>12}  {text}' for n, text in enumerate(texts)]


def _turn_rows(rows: Sequence[MoveRow], parameters: Parameters) -> list[tuple[str, str]]:
    """Return the rotations of the tool, one row per move."""
    turning = [(row, row.turn) for row in rows if row.turn is not None and row.turn.speed_max_rad_s > 0.0]
    if not turning:
        return []
    peak = parameters.rotary.peak_current_a
    lines = []
    for row, turn in turning:
        start, end, speed = (
            math.degrees(angle) + 0.0 for angle in (turn.start_rad, turn.end_rad, turn.speed_max_rad_s)
        )
        lines.append(
            f'move {row.number}: the tool from {start:.4g} to {end:.4g} deg, at most {speed:.0f} deg/s and '
            f'{math.degrees(turn.acceleration_max_rad_s2):.0f} deg/s2, '
            f'{turn.current_max_a:.2f} of {peak:g} A'
        )
    return [('turn', lines[0]), *(('', line) for line in lines[1:])]


def _distance_rows(least: dict[str, float]) -> list[tuple[str, str]]:
    rim, top, bottom = (MM * least[key] for key in ('radius', 'top', 'bottom'))
    high, low, swing = (least[key] for key in ('arm_angle_max', 'arm_angle_min', 'forearm_swing'))
    serial, parallel = least['serial_singularity'], least['parallel_singularity']
    return [
        (
            'distances',
            f'{rim:.1f} mm to the rim of the workspace, {top:.1f} to its top, {bottom:.1f} to its bottom',
        ),
        (
            '',
            f'{high:.1f} deg to the largest arm angle, {low:.1f} to the smallest, {swing:.1f} to the largest swing',
        ),
        ('', f'{serial:.3f} and {parallel:.3f} to the limits of the serial and parallel singularity'),
    ]


def _statement_line(row: StatementRow, width: int) -> str:
    limit = part_text(row.length_m, limit_text(row.limited_by))
    return (
        f'{"":>5} {INDENT + row.name:<{width}} {"":<8} {MM * row.length_m:9.3f} {row.duration_s:8.3f} '
        f'{row.speed_max_m_s:7.3f} {"least":>7} {row.speed_min_m_s:8.3f} {"":>14}  {limit}'
    )


def _line(row: MoveRow, width: int) -> str:
    # the statements of a sequence are named in the lines below it
    name = row.name if len(row.name) <= width else f'{len(row.statements)} statements'
    length = '' if row.kind in ('dwell', 'turn') else f'{MM * row.length_m:.3f}'
    return (
        f'{row.number:>5} {name:<{width}} {row.kind:<8} {length:>9} {row.duration_s:8.3f} '
        f'{row.speed_max_m_s:7.3f} {row.acceleration_max_m_s2:7.2f} {row.jerk_max_m_s3:8.0f} '
        f'{RPM * max(row.motor_speed_max_rad_s):6.0f} {max(row.motor_torque_max_n_m):7.3f}  {limited_text(row)}'
    )


def limited_text(row: MoveRow) -> str:
    """Return the limits of a move with the share of time in which each leads."""
    use = row.limited_by
    if _is_whole(use):
        return limit_text(use)
    others = [
        f'{other.quantity.value}{"" if other.axis is None else f" {other.axis}"} {100.0 * other.time_share:.0f} %'
        for other in sorted(row.uses, key=lambda other: -other.time_share)
        if other is not use and other.time_share >= 0.005
    ]
    return ', '.join([limit_text(use), *others])


def limit_text(use: Use) -> str:
    """Return the name of a limit and the share of time in which it leads."""
    name = use.quantity.value if use.axis is None else f'{use.quantity.value} {use.axis}'
    return name if _is_whole(use) else f'{name} {100.0 * use.time_share:.0f} %'


def limit_text_of(document: dict[str, Any]) -> str:
    """Return the limit of a statement in the form of ``statement_documents`` as text."""
    quantity = next(one for one in Quantity if _key(one) == document['quantity'])
    return limit_text(
        Use(
            quantity=quantity,
            axis=document['axis'],
            peak=0.0,
            limit=0.0,
            unit='',
            used=document['used'],
            time_share=document['time_share'],
        )
    )


def part_text(length_m: float, limit: str) -> str:
    """Return the limit of a statement of a sequence, or a remark if the blends leave none of its path."""
    return limit if length_m > ROUNDING_M else 'all of it is in the blend before'


def _is_whole(use: Use) -> bool:
    """Return whether a limit determines the duration of a whole move."""
    return use.time_share == 1.0 and use.quantity in (Quantity.TIME, Quantity.RMS_CURRENT, Quantity.ROTARY)


def tables(found: PlanStudy) -> list[Table]:
    """Return tables of the moves and of the plan over time."""
    return [
        Table('moves.csv', *_move_columns(found.rows)),
        Table.of_columns('plan.csv', _columns(found)),
    ]


def _move_columns(rows: Sequence[MoveRow]) -> tuple[list[str], list[list[Any]]]:
    header = [
        'move',
        'statements',
        'kind',
        'start [s]',
        'time [s]',
        'length [m]',
        'payload [kg]',
        'speed [m/s]',
        'acceleration [m/s2]',
        'jerk [m/s3]',
        *(f'motor speed {i} [rad/s]' for i in (1, 2, 3)),
        *(f'motor torque {i} [N m]' for i in (1, 2, 3)),
        *(f'rms current {i} [A]' for i in (1, 2, 3)),
        'limited by',
        'axis',
        'used',
        'share of its time',
    ]
    table = [
        [
            row.number,
            row.name,
            row.kind,
            row.start_s,
            row.duration_s,
            row.length_m,
            row.payload_kg,
            row.speed_max_m_s,
            row.acceleration_max_m_s2,
            row.jerk_max_m_s3,
            *row.motor_speed_max_rad_s,
            *row.motor_torque_max_n_m,
            *row.motor_current_rms_a,
            row.limited_by.quantity.value,
            row.limited_by.axis,
            row.limited_by.used,
            row.limited_by.time_share,
        ]
        for row in rows
    ]
    return header, table


def _columns(found: PlanStudy) -> dict[str, Any]:
    s = found.samples
    return {
        'time [s]': s.time_s,
        'move': s.move + 1,
        'distance [m]': s.distance_m,
        'speed [m/s]': s.speed_m_s,
        'acceleration [m/s2]': s.acceleration_m_s2,
        'jerk [m/s3]': s.jerk_m_s3,
        **{f'{name} [m]': s.position_m[:, i] for i, name in enumerate('xyz')},
        'TCP speed [m/s]': s.tcp_speed_m_s,
        'TCP acceleration [m/s2]': s.tcp_acceleration_m_s2,
        'TCP jerk [m/s3]': s.tcp_jerk_m_s3,
        'curvature [1/m]': s.curvature_1_m,
        **{f'arm angle {i + 1} [rad]': s.arm_angle_rad[:, i] for i in range(3)},
        **{f'motor speed {i + 1} [rad/s]': s.motor_speed_rad_s[:, i] for i in range(3)},
        **{f'motor torque {i + 1} [N m]': s.motor_torque_n_m[:, i] for i in range(3)},
        **{f'used: {quantity.value}': values for quantity, values in s.used.items()},
        'leading': np.asarray(s.leading),
    }

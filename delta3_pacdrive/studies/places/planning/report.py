"""Report of a plan: JSON document, text and tables of each move and its limits."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.control.motion_state import percent_allowed
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.rotating_move import tool_text
from delta3_pacdrive.planning.timing.blending import ROUNDING_M
from delta3_pacdrive.robot.motor import share_text, thermal_warnings
from delta3_pacdrive.studies.framework.columns import aligned, cells, csv_table, fill, named_lines, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table
from delta3_pacdrive.studies.framework.residual_vibration import Swing
from delta3_pacdrive.studies.places.planning.study import (
    MoveRow,
    PlanStudy,
    Quantity,
    Samples,
    StatementRow,
    Use,
)

RPM, MM = 60.0 / math.tau, 1e3
NAME_LENGTH = 30  # least width of names in the table
KEPT = 1.0 + 2e-3  # tolerance for maxima between two samples of the planner
INDENT = '  '  # of the statements of a sequence
WHOLE = (Quantity.TIME, Quantity.RMS_CURRENT, Quantity.ROTARY)  # may determine the duration of a whole move
ALIGNS = '><<>>>>>>><'
HEADINGS = (
    ('', 'statements', 'kind', 'length', 'time', 'speed', 'accel.', 'jerk', 'motor', 'torque', 'limited by'),
    ('', '', '', 'mm', 's', 'm/s', 'm/s2', 'm/s3', 'rpm', 'N m', '(share of its time)'),
)


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
        'energy': to_dict(found.energy),
        **({} if found.supply is None else {'supply': to_dict(found.supply)}),
        'gears': to_dict(found.gears.figures(parameters.gear)),
        'temperature': to_dict(found.temperature),
        'override_max': planned.override_max,
        'rate': planned.rate,
        'used_max': to_dict(used_max(found)),
        'distances': nearest(found),
        'notices': list(planned.notices),
        'warnings': warnings(found, parameters),
    }


def warnings(found: PlanStudy, parameters: Parameters) -> list[str]:
    """Return warnings of motors and gears that are overloaded by a plan."""
    gear = parameters.gear
    motors = thermal_warnings(found.planned.rms_current_a, parameters.motor.nominal_current_a)
    return [
        *motors,
        *found.temperature.warnings(),
        *found.gears.figures(gear).warnings(gear),
        *_force_warnings(found, parameters),
    ]


def _force_warnings(found: PlanStudy, parameters: Parameters) -> list[str]:
    """Return a warning for each limit of rods, ball joints and plate that a plan exceeds."""
    s, joints, sentences = found.samples, parameters.joints, []
    for number in range(3):
        rod, spring = float(np.abs(s.rod_force_n[:, number]).max()), float(s.spring_force_n[:, number].max())
        if rod > joints.rod_force_max_n * KEPT:
            sentences.append(
                f'a rod of arm {number + 1} carries {rod:.4g} N, the limit is {joints.rod_force_max_n:g} N'
            )
        if spring > joints.spring_force_n * KEPT:
            sentences.append(
                f'a ball joint of arm {number + 1} opens: it needs springs of {spring:.4g} N and has '
                f'{joints.spring_force_n:g} N'
            )
    moment = float(s.plate_moment_n_m.max())
    if moment > joints.plate_moment_max_n_m * KEPT:
        sentences.append(
            f'the payload tilts the plate with {moment:.4g} N m, the limit is {joints.plate_moment_max_n_m:g} N m'
        )
    return sentences


def used_max(found: PlanStudy) -> dict[Quantity, float]:
    """Return the largest used share of each limit."""
    largest = dict.fromkeys(found.samples.used, 0.0)
    for row in found.rows:
        for use in row.uses:
            largest[use.quantity] = max(largest.get(use.quantity, 0.0), use.used)
    return largest


def move_document(row: MoveRow, with_limits: bool) -> dict[str, Any]:
    """Return a move for JSON; ``with_limits`` adds the use of every limit."""
    found: dict[str, Any] = to_dict(row)
    if not with_limits:
        del found['limits']
    return found


def nearest(found: PlanStudy) -> dict[str, float]:
    """Return the least distance of the plan to each limit of the pose."""
    return {key: min(row.distances[key] for row in found.rows) for key in found.rows[0].distances}


def table_of_moves(rows: Sequence[MoveRow]) -> list[str]:
    """Return the table of the moves, and of the statements of blended sequences, as lines."""
    names = [row.name for row in rows if not row.statements]
    names += [INDENT + one.name for row in rows for one in row.statements]
    width = max(NAME_LENGTH, *map(len, names))
    lines: list[Sequence[str]] = list(HEADINGS)
    for row in rows:
        lines.append(_of_move(row, width))
        lines += [_of_statement(one) for one in row.statements]
    return aligned(lines, ALIGNS)


def _of_move(row: MoveRow, width: int) -> tuple[str, ...]:
    return (
        f'{row.number:>5}',
        # the statements of a sequence are named in the lines below it
        row.name if len(row.name) <= width else f'{len(row.statements)} statements',
        row.kind,
        '' if row.kind in ('dwell', 'turn') else f'{MM * row.length_m:.3f}',
        f'{row.duration_s:.3f}',
        f'{row.speed_max_m_s:.3f}',
        f'{row.acceleration_max_m_s2:.2f}',
        f'{row.jerk_max_m_s3:.0f}',
        f'{RPM * max(row.motor_speed_max_rad_s):.0f}',
        f'{max(row.motor_torque_max_n_m):.3f}',
        limited_text(row),
    )


def _of_statement(row: StatementRow) -> tuple[str, ...]:
    limit = part_text(row.length_m, limit_text(row.limited_by))
    numbers = f'{MM * row.length_m:.3f}', f'{row.duration_s:.3f}', f'{row.speed_max_m_s:.3f}'
    return '', INDENT + row.name, '', *numbers, 'least', f'{row.speed_min_m_s:.3f}', '', '', limit


DISTANCES = (
    ('distances', '{radius_m:.1f mm} to the rim of the workspace, {top_m:.1f in mm} to its top, '
                  '{bottom_m:.1f in mm} to its bottom'),
    ('', '{arm_angle_max_deg:.1f} deg to the largest arm angle, {arm_angle_min_deg:.1f} to the smallest, '
         '{forearm_swing_deg:.1f} to the largest swing'),
    ('', '{serial_singularity:.3f} and {parallel_singularity:.3f} to the limits of the serial and parallel '
         'singularity'),
)  # fmt: skip


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
        ('temperature', found.temperature.text),
        ('energy', found.energy.text(planned.repeat)),
        *(() if found.supply is None else found.supply.rows()),
        *zip(('gears', ''), found.gears.figures(parameters.gear).lines(parameters.gear), strict=True),
        *_force_rows(found.samples, parameters),
        (
            'used',
            ', '.join(f'{100.0 * share:.0f} % {quantity.value}' for share, quantity in used if share > 0.0),
        ),
    ]
    rows += _turn_rows(found.rows, parameters)
    rows += [(name, fill(text, nearest(found))) for name, text in DISTANCES]
    rows += [('note', notice) for notice in planned.notices]
    rows += [('warning', warning) for warning in warnings(found, parameters)]
    return [*lines, *named_lines(rows, 12)]


def _force_rows(samples: Samples, parameters: Parameters) -> list[tuple[str, str]]:
    """Return the extreme forces in rods and ball joints, and the load of the plate."""
    limits, rods = parameters.joints, samples.rod_force_n
    spring, axial, moment = (
        float(one.max())
        for one in (samples.spring_force_n, np.abs(samples.plate_force_n), samples.plate_moment_n_m)
    )
    return [
        (
            'rods',
            f'{rods.min():.1f} to {rods.max():.1f} N (limit {limits.rod_force_max_n:g} N); the ball joints need '
            f'springs of {max(spring, 0.0):.1f} N (they have {limits.spring_force_n:g} N)',
        ),
        (
            'plate',
            f'payload: {axial:.1f} N axial, {moment:.2f} N m tilting (limit {limits.plate_moment_max_n_m:g} N m)',
        ),
    ]


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
    return named_lines([('vibration', texts[0]), *(('', text) for text in texts[1:])], 12)


def _turn_rows(rows: Sequence[MoveRow], parameters: Parameters) -> list[tuple[str, str]]:
    """Return the rotations of the tool, one row per move and rotary axis."""
    texts = [
        fill(
            f'move {row.number}: {tool_text(parameters, number)} from {{from_deg:z.4g}} to {{to_deg:z.4g}} deg, at '
            'most {speed_max_deg_s:.0f} deg/s and {acceleration_max_deg_s2:.0f} deg/s2, {motor_current_max_a:.2f} of '
            f'{rotary.peak_current_a:g} A',
            turn,
        )
        for row in rows
        for number, (turn, rotary) in enumerate(zip(row.turns, parameters.rotary_axes, strict=False))
        if turn.speed_max_deg_s > 0.0
    ]
    return [('' if n else 'turn', text) for n, text in enumerate(texts)]


def limited_text(row: MoveRow) -> str:
    """Return the limits of a move with the share of time in which each leads."""
    use = row.limited_by
    if use.time_share == 1.0 and use.quantity in WHOLE:
        return limit_text(use)
    others = [
        f'{other.quantity.value}{"" if other.axis is None else f" {other.axis}"} {100.0 * other.time_share:.0f} %'
        for other in sorted(row.uses, key=lambda other: -other.time_share)
        if other is not use and other.time_share >= 0.005
    ]
    return ', '.join([limit_text(use), *others])


def limit_text(use: Use) -> str:
    """Return the name of a limit and the share of time in which it leads."""
    return limit_text_of(to_dict(use))


def limit_text_of(document: dict[str, Any]) -> str:
    """Return the limit of a statement in JSON as text."""
    quantity = next(one for one in Quantity if one.key == document['quantity'])
    axis = '' if document['axis'] is None else f' {document["axis"]}'
    share = document['time_share']
    return quantity.value + axis + ('' if share == 1.0 and quantity in WHOLE else f' {100.0 * share:.0f} %')


def part_text(length_m: float, limit: str) -> str:
    """Return the limit of a statement of a sequence, or a remark if the blends leave none of its path."""
    return limit if length_m > ROUNDING_M else 'all of it is in the blend before'


def tables(found: PlanStudy) -> list[Table]:
    """Return tables of the moves and of the plan over time."""
    return [csv_table('moves.csv', found.rows), Table.of_columns('plan.csv', cells(found.samples))]

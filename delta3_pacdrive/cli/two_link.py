"""``delta3 two-link``: kinematics of the planar two-link arm (chapter 3)."""

import argparse
import math
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cli.command import Command, JsonOptions, option
from delta3_pacdrive.cli.output import NAME_WIDTH, Output, with_provenance
from delta3_pacdrive.cli.studies import written

NUMBER_MAX = 1e6


def _number(text: str) -> float:
    """Read a number small enough that its square does not overflow."""
    try:
        value = float(text)
    except ValueError:
        value = float('nan')
    if not abs(value) <= NUMBER_MAX:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number from {-NUMBER_MAX:g} to {NUMBER_MAX:g}')
    return value


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    lengths: tuple[float, float] = option(
        'lengths of lower and upper arm [m]', ('A', 'B'), default=(0.4, 0.3), nargs=2, type=_number
    )
    point: tuple[float, float] = option(
        'tool position [m]', ('X', 'Y'), default=(0.5, 0.2), nargs=2, type=_number
    )
    velocity: tuple[float, float] | None = option(
        'tool velocity [m/s], to compute joint speeds', ('VX', 'VY'), nargs=2, type=_number
    )
    output: str | None = option(
        'write the figures as PNG files to this folder', 'FOLDER', names=('--figures',)
    )


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.studies.thesis.two_link_arm.kinematics import Branch, TwoLinkArm

    arm = TwoLinkArm(*options.lengths)
    result: dict[str, Any] = {
        'ok': True,
        'lengths_m': options.lengths,
        'reach_m': [arm.inner_reach_m, arm.outer_reach_m],
        'point_m': options.point,
        'velocity_m_s': options.velocity,
        'solutions': {branch.name.lower(): _solution(options, arm, branch) for branch in Branch},
        'files': [],
    }
    if options.output is not None:
        from delta3_pacdrive.studies.thesis.two_link_arm import figures

        drawings, tables = figures.by_name(arm, options.point), [figures.table(arm)]
        result['files'] = written(options, 'Two-link arm', _text(result), drawings, tables)
    return Output(with_provenance(result, options), _text(result))


def _solution(options: Options, arm: Any, branch: Any) -> dict[str, Any]:
    from delta3_pacdrive.studies.thesis.two_link_arm import kinematics as core

    theta = core.inverse(options.point, arm, branch)
    singular = bool(core.is_singular(theta))
    solution = {
        'theta_rad': theta.tolist(),
        'elbow_m': core.elbow(theta, arm).tolist(),
        'jacobian_m_rad': core.jacobian(theta, arm).tolist(),
        'determinant_m2': float(core.determinant(theta, arm)),
        'singular': singular,
        'any_theta_1': bool(arm.inner_reach_m == 0.0 and math.hypot(*options.point) == 0.0),
        'jacobian_inverse_rad_m': None if singular else core.jacobian_inverse(theta, arm).tolist(),
    }
    if options.velocity is not None:
        solution['joint_speeds_rad_s'] = core.joint_speeds(theta, options.velocity, arm).tolist()
    return solution


def _text(result: dict[str, Any]) -> list[str]:
    from delta3_pacdrive.studies.framework.columns import named_lines

    (a, b), (inner, outer), (x, y) = (result[key] for key in ('lengths_m', 'reach_m', 'point_m'))
    rows = [
        ('arm', f'a = {a:g} m, b = {b:g} m, reaches from {inner:g} to {outer:g} m'),
        ('point', f'({x:g}, {y:g}) m, {math.hypot(x, y):g} m from the base'),
    ]
    for name, solution in result['solutions'].items():
        theta_1, theta_2 = (math.degrees(angle) for angle in solution['theta_rad'])
        elbow_x, elbow_y = solution['elbow_m']
        rows += [
            ('', ''),
            (name.replace('_', ' '), f'theta_1 = {theta_1:z.4f} deg, theta_2 = {theta_2:z.4f} deg'),
            ('elbow', f'({elbow_x:z.6f}, {elbow_y:z.6f}) m'),
            *_matrix_rows('Jacobian', solution['jacobian_m_rad'], 'm/rad'),
            ('determinant', f'{solution["determinant_m2"]:z.8f} m2'),
        ]
        if solution['singular']:
            rows.append(('inverse', 'none: this pose is singular'))
            if solution['any_theta_1']:
                rows.append(
                    (
                        '',
                        'infinitely many solutions: with equal lengths the tool is at the base for any theta_1',
                    )
                )
        else:
            rows += _matrix_rows('inverse', solution['jacobian_inverse_rad_m'], 'rad/m')
        if 'joint_speeds_rad_s' in solution:
            first, second = (math.degrees(speed) for speed in solution['joint_speeds_rad_s'])
            rows.append(('joint speeds', f'{first:z.4f} deg/s, {second:z.4f} deg/s'))
    if result['files']:
        rows += [('', ''), *(('figure', file) for file in result['files'])]
    return named_lines(rows, NAME_WIDTH)


def _matrix_rows(name: str, matrix: list[list[float]], unit: str) -> list[tuple[str, str]]:
    lines = [' '.join(f'{value:z10.5f}' for value in row) for row in matrix]
    return [(name, f'[{lines[0]} ]'), ('', f'[{lines[1]} ] {unit}')]


main = Command(
    'two-link',
    'Compute both solutions of the planar two-link arm (chapter 3) for one point, with Jacobian, determinant and '
    'inverse.',
    Options,
    run,
)

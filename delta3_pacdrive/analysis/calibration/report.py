"""A calibration in numbers and in words."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from delta3_pacdrive.analysis.calibration.data import Left, Method, Poses, Wanted
from delta3_pacdrive.analysis.calibration.study import Found
from delta3_pacdrive.analysis.provenance import Provenance, write_text
from delta3_pacdrive.analysis.report_folder import Table
from delta3_pacdrive.motion.capability import capability
from delta3_pacdrive.parameters import Parameters

MM = 1e3
TABLES = ('corrections.csv', 'residuals.csv')
METHODS = {
    Method.BASE: 'points of an instrument in the frame base',
    Method.FRAME: 'points of an instrument in a frame of its own',
    Method.PLANE: 'touches of planes',
    Method.BALL: 'touches of balls',
    Method.LEVEL: 'touches of a level plane of known height',
}


def increment_m(robot: Parameters) -> float:
    """Return how far an increment of each motor moves the TCP at home at most [m]."""
    return float(capability(np.array(robot.motion.home_m), robot).increment_m)


def write_program(path: Path, document: dict[str, Any], origin: Provenance) -> Path:
    """Write the program that goes to all poses; raises ReportError."""
    head = ''.join(f'# {name}: {text}\n' for name, text in origin.lines().items())
    return write_text(head + yaml.safe_dump(document, sort_keys=False, default_flow_style=None), path)


def plan_document(poses: Poses, wanted: Wanted) -> dict[str, Any]:
    """Return a plan ready for JSON."""
    expected, before = poses.expected_m
    return {
        'method': str(wanted.method),
        'poses': int((~poses.checks).sum()),
        'checks': int(poses.checks.sum()),
        'objects': sorted(set(poses.objects)),
        'noise_m': wanted.noise_m,
        'uncertainty_before_m': before,
        'uncertainty_after_m': expected,
    }


def plan_text(told: dict[str, Any]) -> list[str]:
    """Return a plan as lines for people."""
    objects = f' of {", ".join(told["objects"])}' if told['objects'] else ''
    return [
        f'{told["poses"]} poses{objects} to estimate from, {told["checks"]} to check with, chosen D-optimal',
        f'  with {MM * told["noise_m"]:g} mm of noise the TCP will be known to '
        f'{MM * told["uncertainty_after_m"]:.3f} mm rms over the workspace; as a workshop leaves it '
        f'{MM * told["uncertainty_before_m"]:.2f} mm',
        'measure at each pose, fill in the table, and give it to delta3 calibrate '
        + ('home' if told['method'] == Method.LEVEL else 'fit'),
    ]


def document(found: Found, wanted: Wanted, calibrated: Path) -> dict[str, Any]:
    """Return a calibration ready for JSON."""
    truth: Sequence[float | None] = found.truth or [None] * len(found.told)
    return {
        'method': str(wanted.method),
        'parameter_file': str(calibrated),
        'measurements': int((~found.measurements.checks).sum()),
        'checks': int(found.measurements.checks.sum()),
        'directions': found.directions,
        'freedom': found.freedom,
        'scatter': found.scatter,
        'uncertainty_m': found.expected_m,
        'figures': [
            {
                'symbol': f'{one.symbol}_{one.arm}',
                'unit': one.unit,
                'before': one.before,
                'value': one.value,
                'half_width_95': one.half_width,
                'told': one.is_told,
                'hidden_share': one.hidden,
                'truth': true,
            }
            for one, true in zip(found.told, truth, strict=True)
        ],
        'not_told_apart': list(found.combinations),
        'left': [vars(one) for one in found.left],
        'limits_m': [{'what': what, 'size_m': size} for what, size in found.limits],
        'corrections': found.corrections,
    }


def text(told: dict[str, Any]) -> list[str]:
    """Return a calibration as lines for people: millimetres and degrees."""
    return [*_lines(told)]


def _lines(told: dict[str, Any]) -> Iterator[str]:
    yield (
        f'{told["measurements"]} measurements, {METHODS[Method(told["method"])]}: {told["directions"]} of '
        f'{len(told["figures"])} independent figures of the arms are told'
    )
    yield ''
    yield '  figure     before      after    95 % interval'
    for one in told['figures']:
        unit, scale = ('deg', np.degrees(1.0)) if one['unit'] == 'rad' else ('mm', MM)
        word = '' if one['told'] else '   not told apart from others'
        true = '' if one['truth'] is None else f'   in truth {scale * one["truth"]:z8.4f}'
        yield (
            f'  {one["symbol"]:<8}{scale * one["before"]:z9.4f}  {scale * one["value"]:z9.4f}  '
            f'+- {scale * one["half_width_95"]:.4f} {unit}{true}{word}'
        )
    if told['not_told_apart']:
        yield f'  not told apart: {"; ".join(told["not_told_apart"])}'
    yield ''
    yield '  left over [mm]                                    before rms / max      after rms / max'
    for one in told['left']:
        yield '  ' + _left(Left(**one))
    if told['freedom']:
        yield f'  scatter {told["scatter"]:.2f} of what was to be expected, {told["freedom"]} degrees of freedom'
    else:
        yield '  nothing is left to judge the measurements by: one more could contradict them'
    yield ''
    yield '  what limits it:'
    for one in told['limits_m']:
        yield f'    {MM * one["size_m"]:7.4f} mm  {one["what"]}'
    yield f'parameters: {told["parameter_file"]}'


def _left(one: Left) -> str:
    name = f'{one.what} ({one.count})'
    return (
        f'{name:<48}{MM * one.before_rms_m:7.3f} / {MM * one.before_max_m:.3f}      '
        f'{MM * one.after_rms_m:7.3f} / {MM * one.after_max_m:.3f}'
    )


def head(found: Found, origin: Provenance) -> list[str]:
    """Return what a parameter file tells about its corrections: where they come from, with intervals."""
    lines = [f'{name}: {text}' for name, text in origin.lines().items()]
    for one in found.told:
        unit, scale = ('deg', np.degrees(1.0)) if one.unit == 'rad' else ('mm', MM)
        word = '' if one.is_told else ', not told apart from others'
        lines.append(
            f'{one.symbol}_{one.arm}: correction {scale * one.value:z.4f} +- {scale * one.half_width:.4f} {unit}{word}'
        )
    return lines


def tables(found: Found) -> Iterable[Table]:
    """Return corrections, and what is left of each measurement."""
    yield Table(
        TABLES[0],
        ('figure', 'arm', 'unit', 'before', 'after', 'half width of 95 %', 'told'),
        [(t.symbol, t.arm, t.unit, t.before, t.value, t.half_width, t.is_told) for t in found.told],
    )
    before, after = found.residuals_m
    yield Table(
        TABLES[1],
        ('measurement', 'use', 'x [m]', 'y [m]', 'z [m]', 'before [m]', 'after [m]'),
        [
            (n + 1, 'check' if found.measurements.checks[n] else 'fit', *point, first, second)
            for n, (point, first, second) in enumerate(
                zip(found.points_m.tolist(), before.tolist(), after.tolist(), strict=True)
            )
        ],
    )

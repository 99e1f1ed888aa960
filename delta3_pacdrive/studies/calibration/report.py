"""Report of a calibration: JSON document, text and tables."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import capability
from delta3_pacdrive.studies.calibration.study import Method, Poses, Requirements, Residual, Result
from delta3_pacdrive.studies.framework.provenance import Provenance, write_text
from delta3_pacdrive.studies.framework.report_folder import Table

MM = 1e3
TABLES = ('corrections.csv', 'residuals.csv')
METHODS = {
    Method.BASE: 'points in the frame base',
    Method.FRAME: 'points in the frame of the instrument',
    Method.PLANE: 'touches of planes',
    Method.BALL: 'touches of balls',
    Method.LEVEL: 'touches of a level plane of known height',
}


def increment_m(robot: Parameters) -> float:
    """Return the largest displacement of the TCP at home by one increment of a motor [m]."""
    return float(capability(np.array(robot.motion.home_m), robot).increment_m)


def write_program(path: Path, document: dict[str, Any], origin: Provenance) -> Path:
    """Write the measuring program; raises ReportError."""
    head = ''.join(f'{line}\n' for line in origin.comments())
    return write_text(head + yaml.safe_dump(document, sort_keys=False, default_flow_style=None), path)


def plan_document(poses: Poses, requirements: Requirements) -> dict[str, Any]:
    """Return a plan ready for JSON."""
    expected, before = poses.expected_m
    return {
        'method': str(requirements.method),
        'poses': int((~poses.checks).sum()),
        'checks': int(poses.checks.sum()),
        'objects': sorted(set(poses.objects)),
        'noise_m': requirements.noise_m,
        'uncertainty_before_m': before,
        'uncertainty_after_m': expected,
    }


def plan_text(plan: dict[str, Any]) -> list[str]:
    """Return a plan as lines of text."""
    objects = f' of {", ".join(plan["objects"])}' if plan['objects'] else ''
    return [
        f'{plan["poses"]} poses{objects} for the estimation and {plan["checks"]} for the validation, D-optimal',
        f'  expected uncertainty of the TCP with {MM * plan["noise_m"]:g} mm of noise: '
        f'{MM * plan["uncertainty_after_m"]:.3f} mm rms over the workspace; uncalibrated '
        f'{MM * plan["uncertainty_before_m"]:.2f} mm',
        'measure at each pose, fill in the table and run delta3 calibrate '
        + ('home' if plan['method'] == Method.LEVEL else 'fit'),
    ]


def document(result: Result, requirements: Requirements, calibrated: Path) -> dict[str, Any]:
    """Return a calibration ready for JSON."""
    truth: Sequence[float | None] = result.truth or [None] * len(result.estimates)
    return {
        'method': str(requirements.method),
        'parameter_file': str(calibrated),
        'measurements': int((~result.measurements.checks).sum()),
        'checks': int(result.measurements.checks.sum()),
        'directions': result.directions,
        'freedom': result.freedom,
        'scatter': result.scatter,
        'uncertainty_m': result.expected_m,
        'figures': [
            {
                'symbol': f'{one.symbol}_{one.arm}',
                'unit': one.unit,
                'before': one.before,
                'value': one.value,
                'half_width_95': one.half_width,
                'told': one.is_identified,
                'hidden_share': one.hidden,
                'truth': true,
            }
            for one, true in zip(result.estimates, truth, strict=True)
        ],
        'not_told_apart': list(result.combinations),
        'left': [vars(one) for one in result.residuals],
        'limits_m': [{'what': what, 'size_m': size} for what, size in result.limits],
        'corrections': result.corrections,
    }


def text(summary: dict[str, Any]) -> Iterator[str]:
    """Yield a calibration as lines of text, in millimetres and degrees."""
    yield (
        f'{summary["measurements"]} measurements, {METHODS[Method(summary["method"])]}: {summary["directions"]} of '
        f'{len(summary["figures"])} independent parameters of the arms are identified'
    )
    yield ''
    yield '  parameter  before      after    95 % interval'
    for one in summary['figures']:
        unit, scale = ('deg', np.degrees(1.0)) if one['unit'] == 'rad' else ('mm', MM)
        word = '' if one['told'] else '   not identified separately'
        true = '' if one['truth'] is None else f'   true {scale * one["truth"]:z8.4f}'
        yield (
            f'  {one["symbol"]:<8}{scale * one["before"]:z9.4f}  {scale * one["value"]:z9.4f}  '
            f'+- {scale * one["half_width_95"]:.4f} {unit}{true}{word}'
        )
    if summary['not_told_apart']:
        yield f'  not identified: {"; ".join(summary["not_told_apart"])}'
    yield ''
    yield '  residuals [mm]                                    before rms / max      after rms / max'
    for one in summary['left']:
        yield '  ' + _left(Residual(**one))
    if summary['freedom']:
        yield f'  scatter {summary["scatter"]:.2f} of its expectation, {summary["freedom"]} degrees of freedom'
    else:
        yield '  no degrees of freedom: one more measurement would allow a check'
    yield ''
    yield '  sources of error:'
    for one in summary['limits_m']:
        yield f'    {MM * one["size_m"]:7.4f} mm  {one["what"]}'
    yield f'parameters: {summary["parameter_file"]}'


def _left(one: Residual) -> str:
    name = f'{one.what} ({one.count})'
    return (
        f'{name:<48}{MM * one.before_rms_m:7.3f} / {MM * one.before_max_m:.3f}      '
        f'{MM * one.after_rms_m:7.3f} / {MM * one.after_max_m:.3f}'
    )


def head(result: Result, origin: Provenance) -> list[str]:
    """Return the comments on corrections and intervals in the calibrated parameter file."""
    lines = [f'{name}: {text}' for name, text in origin.lines().items()]
    for one in result.estimates:
        unit, scale = ('deg', np.degrees(1.0)) if one.unit == 'rad' else ('mm', MM)
        word = '' if one.is_identified else ', not identified separately'
        lines.append(
            f'{one.symbol}_{one.arm}: correction {scale * one.value:z.4f} +- {scale * one.half_width:.4f} {unit}{word}'
        )
    return lines


def tables(result: Result) -> Iterable[Table]:
    """Return corrections and residuals as tables."""
    yield Table(
        TABLES[0],
        ('figure', 'arm', 'unit', 'before', 'after', 'half width of 95 %', 'told'),
        [
            (t.symbol, t.arm, t.unit, t.before, t.value, t.half_width, t.is_identified)
            for t in result.estimates
        ],
    )
    before, after = result.residuals_m
    yield Table(
        TABLES[1],
        ('measurement', 'use', 'x [m]', 'y [m]', 'z [m]', 'before [m]', 'after [m]'),
        [
            (n + 1, 'check' if result.measurements.checks[n] else 'fit', *point, first, second)
            for n, (point, first, second) in enumerate(
                zip(result.points_m.tolist(), before.tolist(), after.tolist(), strict=True)
            )
        ],
    )

"""Report of a tuning: JSON summary, sentences about instability, text, tables."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.drives.loops.analysis import LoopResult, Step, deviation
from delta3_pacdrive.studies.drives.loops.disturbance import LOAD_N_M
from delta3_pacdrive.studies.drives.loops.identification import Measured
from delta3_pacdrive.studies.drives.loops.response import Complex, decibels, degrees, margins
from delta3_pacdrive.studies.drives.tuning import drive_settings as settings
from delta3_pacdrive.studies.drives.tuning.effect import Effect
from delta3_pacdrive.studies.drives.tuning.measured_response import MeasuredResponse
from delta3_pacdrive.studies.drives.tuning.proposal import Proposal
from delta3_pacdrive.studies.drives.tuning.report_text import (
    changes_in_words,
    is_worthwhile,
    judged_figures,
    proposal_lines,
    rejection_line,
)
from delta3_pacdrive.studies.drives.tuning.study import Results, SweepPoint, Variant
from delta3_pacdrive.studies.framework.report_folder import Table, columns_of

OPEN = 'velocity', 'position', 'cascade', 'exchanged'


def summary(found: Results) -> dict[str, Any]:
    """Return the summary of a tuning for JSON."""
    robots = [variant.robot for variant in found.variants.values()]
    document: dict[str, Any] = {
        'load': asdict(found.operation.load),
        'speed_rad_s': found.operation.speed_rad_s,
        'amplitude': found.operation.amplitude,
        'changes': settings.changes(robots[0], robots[-1]),
        'program': found.program,
        'variants': {
            name: {
                'loops': _figures_by_name(variant.loops),
                'exchange_period_s': variant.robot.bus.exchange_period_s,
                'workspace': [
                    {'load': load.name, 'inertia_kg_m2': load.inertia_kg_m2} | _figures_by_name(loops)
                    for load, loops in variant.workspace
                ],
                'effect': variant.effect.figures(),
                'rejection': None if variant.rejection is None else variant.rejection.figures(),
                'instability': instability(variant),
            }
            for name, variant in found.variants.items()
        },
        'sweep': [
            {
                'value': point.value,
                'loops': _figures_by_name(point.loops),
                'overshoot': point.overshoot,
                'workspace_stable': point.workspace_stable,
                'effect': point.effect.figures(),
            }
            for point in found.points
        ],
        'recorded': [
            {
                'name': one.name,
                'title': one.title,
                'axis': one.axis,
                'averages': one.measured.averages,
                'trusted_hz': one.measured.band_hz(),
                'agreement': deviation(one.measured, one.linear),
                'margins': _measured_margins(one),
            }
            for one in found.measured
        ],
    }
    both = list(document['variants'].values())
    document['changed'] = changes_in_words(*both) if len(both) == 2 else []
    document['proposal'] = None
    if (proposal := found.proposal) is not None:
        figures = _proposal(proposal)
        judged = judged_figures(both[0], both[1], figures)
        proposed = found.margins_given or is_worthwhile(judged)
        document['proposal'] = figures | {'judged': judged, 'proposed': proposed}
    return document


def _proposal(proposal: Proposal) -> dict[str, Any]:
    return {
        'targets': asdict(proposal.targets),
        'payload_kg': proposal.payload_kg,
        'gains': {f'drive.{name}': value for name, value in proposal.gains.values().items()},
        'stiffness': proposal.gains.stiffness,
        'before': asdict(proposal.before),
        'kept': asdict(proposal.kept),
    }


def _figures_by_name(loops: list[LoopResult]) -> dict[str, Any]:
    return {loop.name: _figures(loop) for loop in loops}


def _figures(loop: LoopResult) -> dict[str, Any]:
    """Return the figures of merit of a loop, and the deviation of its open loop on the bench from the linear one."""
    result: dict[str, Any] = {'stable': loop.stable, **asdict(loop.margins)}
    result['bandwidth_hz'] = loop.bandwidth_hz if loop.stable else None
    if loop.step is not None:
        result['step'] = asdict(loop.step.figures)
    if (measured := loop.measured_open) is not None:
        linear = interpolated(measured.frequencies_hz, loop.frequencies_hz, loop.open_loop)
        result['agreement'] = deviation(measured, linear)
    if loop.fault:
        result['fault'] = loop.fault
    return result


def _measured_margins(one: MeasuredResponse) -> dict[str, float | None] | None:
    """Return the margins of an open loop within the trusted band; None for a closed loop."""
    inside = one.measured.in_band
    if one.name not in ('cascade', 'position') or inside.sum() < 2:
        return None
    return asdict(margins(one.measured.frequencies_hz[inside], one.measured.values[inside]))


def instability(variant: Variant) -> list[str]:
    """Return a sentence for each unstable loop, with its cause."""
    sentences = []
    inside = ''
    for loop in variant.loops:
        if loop.stable:
            continue
        if inside:
            sentences.append(f'{loop.name}: unstable with the {inside} loop inside it')
            continue
        m = loop.margins
        causes = []
        if m.gain_reduction_db is not None:
            causes.append(f'its gain is {-m.gain_reduction_db:.1f} dB too high')
        if m.phase_margin_deg is not None:
            causes.append(f'phase margin {m.phase_margin_deg:.0f} deg at {m.crossover_hz:.0f} Hz')
        sentences.append(f'{loop.name}: unstable, {", ".join(causes) or "it does not decay"}')
        inside = loop.name
    period = 1e3 * variant.robot.bus.exchange_period_s
    for load, loops in variant.workspace:
        of = {loop.name: loop for loop in loops}
        if not of['cascade'].stable and load is not variant.workspace[0][0]:
            sentences.append(f'cascade: unstable with the {load.name}')
        elif of['cascade'].stable and not of['exchanged'].stable:
            sentences.append(
                f'cascade: stable on its own, but not as simulated, with an exchange with the plant every '
                f'{period:g} ms: {load.name}'
            )
    return sentences


def interpolated(frequencies_hz: Floats, grid_hz: Floats, values: Complex) -> Complex:
    """Interpolate a linear curve: magnitude and phase over the logarithm of the frequency."""
    at, grid = np.log(frequencies_hz), np.log(grid_hz)
    size = np.exp(np.interp(at, grid, np.log(np.abs(values))))
    return np.asarray(size * np.exp(1j * np.interp(at, grid, np.unwrap(np.angle(values)))))


def text(document: dict[str, Any]) -> list[str]:
    """Return the lines of a summary as text."""
    load, variants = document['load'], document['variants']
    lines = [
        f'{load["name"]}: {1e4 * load["inertia_kg_m2"]:.3f}e-4 kg m2 and {load["gravity_n_m"]:.3f} N m at the shaft, '
        f'turning at {document["speed_rad_s"]:g} rad/s'
    ]
    if proposal := document['proposal']:
        lines += proposal_lines(proposal)
    for change in document['changes']:
        lines.append(f'{change["parameter"]}: {change["before"]:g} before, {change["after"]:g} after')
    lines += [*_loop_lines(variants), *_workspace_lines(variants), '', f'  {document["program"]}']
    lines += [_effect_line(name, variant['effect']) for name, variant in variants.items()]
    lines += ['', f'  load step of {LOAD_N_M:g} N m, motor side, and noise of the encoder']
    lines += [rejection_line(name, variant['rejection']) for name, variant in variants.items()]
    if document['changed']:
        lines += ['', '  changes', *(f'  - {sentence}' for sentence in document['changed'])]
    lines += [_measured_line(one) for one in document['recorded']]
    return lines + (_sweep_lines(document['sweep']) if document['sweep'] else [])


def _loop_lines(variants: dict[str, Any]) -> list[str]:
    lines = [
        '',
        '  loop      gains   crossover  phase m.  gain m.  delay m.    Ms  bandwidth     rise  overshoot  settling',
    ]
    for loop in next(iter(variants.values()))['loops']:
        for name, variant in variants.items():
            row = variant['loops'][loop]
            step = row.get('step') or {}
            cells = [
                _cell(row['crossover_hz'], '{:8.4g} Hz'), _cell(row['phase_margin_deg'], '{:6.1f} deg'),
                _cell(row['gain_margin_db'], '{:5.1f} dB'), _cell(row['delay_margin_s'], '{:6.2f} ms', 1e3),
                _cell(row['sensitivity_peak'], '{:5.2f}'), _cell(row['bandwidth_hz'], '{:7.4g} Hz'),
                _cell(step.get('rise_time_s'), '{:6.2f} ms', 1e3), _cell(step.get('overshoot'), '{:7.1f} %', 100.0),
                _cell(step.get('settling_time_s'), '{:6.1f} ms', 1e3),
            ]  # fmt: skip
            state = '' if row['stable'] else '  UNSTABLE'
            lines.append(f'  {loop:<9} {name:<7} {"  ".join(cells)}{state}')
            if 'fault' in row:
                lines.append(f'  {"":<9} {name:<7} on the bench: {row["fault"]}')
    for name, variant in variants.items():
        lines += [f'  {name}: {sentence}' for sentence in variant['instability']]
        near = [loop['agreement'] for loop in variant['loops'].values() if loop.get('agreement')]
        if near:
            distance = (max(a[unit] for a in near) for unit in ('decibels', 'degrees'))
            within = '{:.2f} dB and {:.1f} deg'.format(*distance)
            lines.append(
                f'  drive on the bench and linear loops, {name}: equal within {within} in the trusted band'
            )
    return lines


def _workspace_lines(variants: dict[str, Any]) -> list[str]:
    period = 1e3 * next(iter(variants.values()))['exchange_period_s']
    lines = [
        '',
        '  inertia at shaft  gains    velocity loop: crossover, phase m., gain m.  position  '
        f'cascade: Ms  gain m. exchanged every {period:g} ms',
    ]
    for name, variant in variants.items():
        for row in variant['workspace']:
            speed, position, cascade, exchanged = (row[key] for key in OPEN)
            margin = _cell(exchanged['gain_margin_db'], '{:5.1f} dB') if exchanged['stable'] else 'UNSTABLE'
            cells = [
                _cell(speed['crossover_hz'], '{:13.4g} Hz'), _cell(speed['phase_margin_deg'], '{:7.1f} deg'),
                _cell(speed['gain_margin_db'], '{:5.1f} dB'), _cell(position['phase_margin_deg'], '{:8.1f} deg'),
                _cell(cascade['sensitivity_peak'], '{:8.2f}'), f'{margin:>11}',
            ]  # fmt: skip
            lines.append(
                f'  {1e4 * row["inertia_kg_m2"]:6.2f}e-4 kg m2   {name:<7}{"  ".join(cells)}  {row["load"]}'
            )
    return lines


def _effect_line(name: str, effect: dict[str, Any]) -> str:
    if effect['following_error_max_rad'] is None:
        return f'  {name:<7} stops: {effect["fault"]}'
    return (
        f'  {name:<7} following error {_millidegrees(effect["following_error_max_rad"])} max, '
        f'{_millidegrees(effect["following_error_rms_rad"])} rms; TCP error '
        f'{1e6 * effect["tcp_error_max_m"]:.1f} um max, {1e6 * effect["tcp_error_rms_m"]:.1f} um rms; '
        f'current {effect["current_peak_a"]:.2f} A max{"; " + effect["fault"] if effect["fault"] else ""}'
    )


def _measured_line(one: dict[str, Any]) -> str:
    band, near, margin = one['trusted_hz'], one['agreement'], one['margins']
    result = 'no frequency is trusted' if band is None else (
        f'{band[0]:.3g} to {band[1]:.4g} Hz trusted, '
        f'within {near["decibels"]:.2f} dB and {near["degrees"]:.1f} deg of the linear response'
    )  # fmt: skip
    if margin is not None:
        phase, gain = (
            _cell(margin['phase_margin_deg'], '{:.1f} deg'),
            _cell(margin['gain_margin_db'], '{:.1f} dB'),
        )
        result += f'; margins {phase} and {gain}'
    return f'recorded, axis {one["axis"]}, {one["title"]}: {result}'


def _sweep_lines(points: list[dict[str, Any]]) -> list[str]:
    lines = [
        '',
        '  value       phase margin: current, velocity, position   overshoot: velocity, position   following error',
    ]
    for point in points:
        loops = point['loops'].values()
        margins = '  '.join(_cell(loop['phase_margin_deg'], '{:6.1f} deg') for loop in loops)
        over = '  '.join(_cell(point['overshoot'][n], '{:6.1f} %', 100.0) for n in ('velocity', 'position'))
        error = point['effect']['following_error_max_rad']
        shown = point['effect']['fault'] if error is None else _millidegrees(error)
        state = '' if point['workspace_stable'] else '  unstable in the workspace'
        if not all(loop['stable'] for loop in loops):
            state = '  UNSTABLE'
        lines.append(f'  {point["value"]:<10.5g}  {margins}   {over}   {shown}{state}')
    return lines


def _millidegrees(angle_rad: float) -> str:
    return f'{1e3 * math.degrees(angle_rad):.2f}e-3 deg'


def _cell(value: float | None, form: str, factor: float = 1.0) -> str:
    """Return a scaled number in its format, or a dash for None."""
    return '-'.rjust(len(form.format(0.0))) if value is None else form.format(factor * value)


def tables(found: Results) -> list[Table]:
    """Return tables of steps, frequency responses, workspace, effect on the program, sweep and recording."""
    made = []
    for name, results in found.by_loop.items():
        steps = {which: result.step for which, result in results.items() if result.step is not None}
        if len(steps) == len(results):
            made.append(_steps(name, steps))
        for which, result in results.items():
            made += _bode(name if len(results) == 1 else f'{name}_{which}', result)
    made += [_workspace(found.variants), *_effects(found.variants), *_rejections(found.variants)]
    if found.points:
        made.append(_sweep(found.points))
    for one in found.measured:
        columns = _measured_columns(one.measured, one.title) | _polar(f'{one.title}: linear', one.linear)
        made.append(Table.of_columns(f'recorded_{one.name}.csv', columns))
    return made


def _polar(title: str, values: Complex) -> dict[str, Floats]:
    return {f'{title} [dB]': decibels(values), f'{title} [deg]': degrees(values)}


def _measured_columns(measured: Measured, title: str) -> dict[str, Floats]:
    return {
        'frequency [Hz]': measured.frequencies_hz,
        **_polar(title, measured.values),
        'coherence [1]': measured.coherence,
        'relative error [1]': measured.error,
        'trusted [0/1]': measured.trusted.astype(np.float64),
    }


def _steps(name: str, steps: dict[str, Step]) -> Table:
    columns = {'time [s]': next(iter(steps.values())).time_s}
    for which, step in steps.items():
        columns |= {f'{which}: drive [1]': step.drive, f'{which}: linear [1]': step.linear}
    return Table.of_columns(f'step_{name}.csv', columns)


def _bode(name: str, result: LoopResult) -> list[Table]:
    columns = {'frequency [Hz]': result.frequencies_hz, **_polar('open loop', result.open_loop)}
    if result.closed_loop is not None:
        missing = np.full(len(result.frequencies_hz) - len(result.closed_loop), np.nan)
        for title, values in _polar('closed loop', result.closed_loop).items():
            columns[title] = np.concatenate([values, missing])
    made = [Table.of_columns(f'bode_{name}.csv', columns)]
    for kind, measured in (('open', result.measured_open), ('closed', result.measured_closed)):
        if measured is not None:
            columns = _measured_columns(measured, f'{kind} loop')
            made.append(Table.of_columns(f'bode_{name}_bench_{kind}.csv', columns))
    return made


def _workspace(variants: dict[str, Variant]) -> Table:
    rows = []
    for which, variant in variants.items():
        for load, loops in variant.workspace:
            row = {'gains': which, 'load': load.name, 'inertia [kg m2]': load.inertia_kg_m2}
            for name, loop in zip(OPEN, loops, strict=True):
                m = loop.margins
                row |= {
                    f'{name}: crossover [Hz]': m.crossover_hz,
                    f'{name}: phase margin [deg]': m.phase_margin_deg,
                }
                row |= {f'{name}: gain margin [dB]': m.gain_margin_db, f'{name}: Ms [1]': m.sensitivity_peak}
            rows.append(row)
    return Table.of_rows('workspace.csv', rows)


_EFFECT_TITLES = (
    'following error max [rad]', 'following error rms [rad]', 'TCP error max [m]', 'TCP error rms [m]',
    'current peak [A]', 'current rms [A]', 'fault',
)  # fmt: skip


def _effect_cells(effect: Effect) -> dict[str, Any]:
    return dict(zip(_EFFECT_TITLES, effect.figures().values(), strict=True))


def _effects(variants: dict[str, Variant]) -> list[Table]:
    effects = {which: variant.effect for which, variant in variants.items()}
    rows = [{'gains': which} | _effect_cells(effect) for which, effect in effects.items()]
    made = [Table.of_rows('effect.csv', rows)]
    ran = {which: effect for which, effect in effects.items() if len(effect.time_s)}
    if ran:
        columns = {'time [s]': next(iter(ran.values())).time_s}
        for which, effect in ran.items():
            labels = map(str, effect.axes)
            columns |= columns_of(f'{which}: following error {{}} [rad]', effect.following_error_rad, labels)
            columns[f'{which}: TCP error [m]'] = effect.tcp_error_m
        made.append(Table.of_columns('following_error.csv', columns))
    return made


def _rejections(variants: dict[str, Variant]) -> list[Table]:
    rejections = {which: variant.rejection for which, variant in variants.items() if variant.rejection}
    if not rejections:
        return []
    columns = {'time [s]': next(iter(rejections.values())).time_s}
    columns |= {f'{which}: deviation [rad]': one.deviation_rad for which, one in rejections.items()}
    return [Table.of_columns('load_step.csv', columns)]


def _sweep(points: list[SweepPoint]) -> Table:
    rows = []
    for point in points:
        row: dict[str, Any] = {'value [SI]': point.value}
        row |= {f'{loop.name}: phase margin [deg]': loop.margins.phase_margin_deg for loop in point.loops}
        row |= {f'{name}: overshoot [1]': value for name, value in point.overshoot.items()}
        row |= {f'{loop.name}: stable [0/1]': int(loop.stable) for loop in point.loops}
        rows.append(row | _effect_cells(point.effect))
    return Table.of_rows('sweep.csv', rows)

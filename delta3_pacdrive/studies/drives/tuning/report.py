"""Report of a tuning: JSON summary, sentences about instability, text, tables."""

from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.drives.loops.analysis import LoopResult, Step, deviation
from delta3_pacdrive.studies.drives.loops.disturbance import LOAD_N_M
from delta3_pacdrive.studies.drives.loops.identification import Measured
from delta3_pacdrive.studies.drives.loops.response import Complex, decibels, degrees, margins
from delta3_pacdrive.studies.drives.tuning import drive_settings as settings
from delta3_pacdrive.studies.drives.tuning.measured_response import MeasuredResponse
from delta3_pacdrive.studies.drives.tuning.proposal import Proposal
from delta3_pacdrive.studies.drives.tuning.report_text import (
    changes_in_words,
    is_worthwhile,
    judged_figures,
    proposal_lines,
    rejection_text,
)
from delta3_pacdrive.studies.drives.tuning.study import Results, SweepPoint, Variant
from delta3_pacdrive.studies.framework.columns import TextColumn, cells, fill, shown, text_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table, columns_of

OPEN = 'velocity', 'position', 'cascade', 'exchanged'
MARGINS = {
    'crossover [Hz]': 'crossover_hz', 'phase margin [deg]': 'phase_margin_deg', 'gain margin [dB]': 'gain_margin_db',
    'Ms [1]': 'sensitivity_peak',
}  # fmt: skip


def summary(found: Results) -> dict[str, Any]:
    """Return the summary of a tuning for JSON."""
    robots = [variant.robot for variant in found.variants.values()]
    document: dict[str, Any] = {
        'load': to_dict(found.operation.load),
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
                'effect': to_dict(variant.effect),
                'rejection': to_dict(variant.rejection),
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
                'effect': to_dict(point.effect),
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
        'targets': to_dict(proposal.targets),
        'payload_kg': proposal.payload_kg,
        'gains': {f'drive.{name}': value for name, value in proposal.gains.values().items()},
        'stiffness': proposal.gains.stiffness,
        'before': to_dict(proposal.before),
        'kept': to_dict(proposal.kept),
    }


def _figures_by_name(loops: list[LoopResult]) -> dict[str, Any]:
    return {loop.name: _figures(loop) for loop in loops}


def _figures(loop: LoopResult) -> dict[str, Any]:
    """Return the figures of merit of a loop, and the deviation of its open loop on the bench from the linear one."""
    result: dict[str, Any] = {'stable': loop.stable, **to_dict(loop.margins)}
    result['bandwidth_hz'] = loop.bandwidth_hz if loop.stable else None
    if loop.step is not None:
        result['step'] = to_dict(loop.step.figures)
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
    found: dict[str, float | None] = to_dict(
        margins(one.measured.frequencies_hz[inside], one.measured.values[inside])
    )
    return found


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
    variants = document['variants']
    lines = [
        fill(
            '{load[name]}: {load[inertia_kg_m2]:.3f e-4 kg m2} and {load[gravity_n_m]:.3f N m} at the '
            'shaft, turning at {speed_rad_s:g rad/s}',
            document,
        )
    ]
    if proposal := document['proposal']:
        lines += proposal_lines(proposal)
    lines += [
        fill('{parameter}: {before:g} before, {after:g} after', change) for change in document['changes']
    ]
    lines += [*_loop_lines(variants), *_workspace_lines(variants), '', f'  {document["program"]}']
    lines += [f'  {name:<7} {_effect_text(variant["effect"])}' for name, variant in variants.items()]
    lines += ['', f'  load step of {LOAD_N_M:g} N m, motor side, and noise of the encoder']
    lines += [f'  {name:<7} {rejection_text(variant["rejection"])}' for name, variant in variants.items()]
    if document['changed']:
        lines += ['', '  changes', *(f'  - {sentence}' for sentence in document['changed'])]
    lines += [_measured_line(one) for one in document['recorded']]
    return lines + (['', *text_table(document['sweep'], SWEEP_COLUMNS)] if document['sweep'] else [])


def _loop_lines(variants: dict[str, Any]) -> list[str]:
    missing = dict.fromkeys(('rise_time_s', 'overshoot', 'settling_time_s'))
    rows = [
        {'step': missing, 'gains': name, 'loop': loop} | variant['loops'][loop]
        for loop in next(iter(variants.values()))['loops']
        for name, variant in variants.items()
    ]
    lines = ['', *text_table(rows, LOOP_COLUMNS)]
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
    columns = [
        *WORKSPACE_COLUMNS,
        TextColumn(
            f'exchange {period:g} ms\ngain m.',
            lambda row: _gain_margin(row['exchanged']),
        ),
        TextColumn('', '{load}', '<'),
    ]
    rows = [{'gains': name} | row for name, variant in variants.items() for row in variant['workspace']]
    return ['', *text_table(rows, columns)]


def _gain_margin(loop: dict[str, Any]) -> str:
    return shown(loop['gain_margin_db'], '.1f =dB') if loop['stable'] else 'UNSTABLE'


def _effect_text(effect: dict[str, Any]) -> str:
    if effect['following_error_max_rad'] is None:
        return f'stops: {effect["fault"]}'
    text = fill(
        'following error {following_error_max_rad:.2f e-3 deg} max, {following_error_rms_rad:.2f e-3 deg} rms; '
        'TCP error {tcp_error_max_m:.1f um} max, {tcp_error_rms_m:.1f um} rms; current {current_peak_a:.2f A} max',
        effect,
    )
    return f'{text}; {effect["fault"]}' if effect['fault'] else text


def _measured_line(one: dict[str, Any]) -> str:
    result = 'no frequency is trusted'
    if one['trusted_hz'] is not None:
        result = fill(
            '{trusted_hz[0]:.3g} to {trusted_hz[1]:.4g} Hz trusted, within {agreement[decibels]:.2f} dB and '
            '{agreement[degrees]:.1f} deg of the linear response',
            one,
        )
    if one['margins'] is not None:
        result += fill('; margins {phase_margin_deg:.1f =deg} and {gain_margin_db:.1f =dB}', one['margins'])
    return f'recorded, axis {one["axis"]}, {one["title"]}: {result}'


def _followed(effect: dict[str, Any]) -> str:
    error = effect['following_error_max_rad']
    return str(effect['fault']) if error is None else shown(error, '.2f e-3 deg')


def _state(point: dict[str, Any]) -> str:
    if not all(loop['stable'] for loop in point['loops'].values()):
        return 'UNSTABLE'
    return '' if point['workspace_stable'] else 'unstable in the workspace'


LOOP_COLUMNS = [
    TextColumn('  loop', '  {loop}', '<'),
    TextColumn('gains', '{gains}', '<'),
    TextColumn('crossover', '{crossover_hz:.4g =Hz}'),
    TextColumn('phase m.', '{phase_margin_deg:.1f =deg}'),
    TextColumn('gain m.', '{gain_margin_db:.1f =dB}'),
    TextColumn('delay m.', '{delay_margin_s:.2f ms}'),
    TextColumn('Ms', '{sensitivity_peak:.2f}'),
    TextColumn('bandwidth', '{bandwidth_hz:.4g =Hz}'),
    TextColumn('rise', '{step[rise_time_s]:.2f ms}'),
    TextColumn('overshoot', '{step[overshoot]:.1f %}'),
    TextColumn('settling', '{step[settling_time_s]:.1f ms}'),
    TextColumn('', lambda row: '' if row['stable'] else 'UNSTABLE', '<'),
    TextColumn('', lambda row: f'on the bench: {row["fault"]}' if 'fault' in row else '', '<'),
]
WORKSPACE_COLUMNS = [
    TextColumn('\n  inertia at shaft', '{inertia_kg_m2:.2f e-4 kg m2}'),
    TextColumn('\ngains', '{gains}', '<'),
    TextColumn('velocity\ncrossover', '{velocity[crossover_hz]:.4g =Hz}'),
    TextColumn('velocity\nphase m.', '{velocity[phase_margin_deg]:.1f =deg}'),
    TextColumn('velocity\ngain m.', '{velocity[gain_margin_db]:.1f =dB}'),
    TextColumn('position\nphase m.', '{position[phase_margin_deg]:.1f =deg}'),
    TextColumn('cascade\nMs', '{cascade[sensitivity_peak]:.2f}'),
]
SWEEP_COLUMNS = [
    TextColumn('\n  value', '  {value:.5g}', '<'),
    TextColumn('current\nphase m.', '{loops[current][phase_margin_deg]:.1f =deg}'),
    TextColumn('velocity\nphase m.', '{loops[velocity][phase_margin_deg]:.1f =deg}'),
    TextColumn('position\nphase m.', '{loops[position][phase_margin_deg]:.1f =deg}'),
    TextColumn('velocity\novershoot', '{overshoot[velocity]:.1f %}'),
    TextColumn('position\novershoot', '{overshoot[position]:.1f %}'),
    TextColumn('following\nerror', lambda point: _followed(point['effect'])),
    TextColumn('', _state, '<'),
]


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
                row |= {f'{name}: {title}': getattr(loop.margins, key) for title, key in MARGINS.items()}
            rows.append(row)
    return Table.of_rows('workspace.csv', rows)


def _effects(variants: dict[str, Variant]) -> list[Table]:
    effects = {which: variant.effect for which, variant in variants.items()}
    rows = [{'gains': which} | cells(effect) for which, effect in effects.items()]
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
        rows.append(row | cells(point.effect))
    return Table.of_rows('sweep.csv', rows)

"""What a tuning leaves behind: a report as JSON, tables as CSV, and sentences about what is not stable."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.analysis.provenance import write_table
from delta3_pacdrive.analysis.tuning import settings
from delta3_pacdrive.analysis.tuning.analysis import deviation
from delta3_pacdrive.analysis.tuning.response import decibels, degrees, margins

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.analysis.tuning.analysis import LoopResult, OperatingPoint
    from delta3_pacdrive.analysis.tuning.identification import Measured
    from delta3_pacdrive.analysis.tuning.measured_response import MeasuredResponse
    from delta3_pacdrive.analysis.tuning.study import SweepPoint, Variant
    from delta3_pacdrive.numerics.types import Floats

OPEN = 'velocity', 'position', 'cascade', 'exchanged'


def document(
    variants: list[Variant],
    points: list[SweepPoint],
    found: list[MeasuredResponse],
    operation: OperatingPoint,
    program_name: str,
    provenance: Provenance,
) -> dict[str, Any]:
    """Return the report of a tuning, ready for JSON."""
    load = operation.load
    names = ('before', 'after') if len(variants) > 1 else ('now',)
    return {
        'ok': True,
        'provenance': provenance.lines(),
        'load': asdict(load),
        'speed_rad_s': operation.speed_rad_s,
        'amplitude': operation.amplitude,
        'changes': settings.changes(variants[0].robot, variants[-1].robot),
        'program': program_name,
        'variants': {
            name: {
                'loops': {loop.name: loop_figures(loop) for loop in variant.loops},
                'exchange_period_s': variant.robot.bus.exchange_period_s,
                'workspace': [
                    {'load': load.name, 'inertia_kg_m2': load.inertia_kg_m2}
                    | {loop.name: loop_figures(loop) for loop in loops}
                    for load, loops in variant.workspace
                ],
                'effect': variant.effect.figures(),
                'instability': instability(variant),
            }
            for name, variant in zip(names, variants, strict=True)
        },
        'sweep': [
            {
                'value': point.value,
                'loops': {loop.name: loop_figures(loop) for loop in point.loops},
                'overshoot': point.overshoot,
                'workspace_stable': point.workspace_stable,
                'effect': point.effect.figures(),
            }
            for point in points
        ],
        'recorded': [recorded_figures(one) for one in found],
    }


def loop_figures(loop: LoopResult) -> dict[str, Any]:
    """Return the figures of merit of a loop."""
    result: dict[str, Any] = {'stable': loop.stable, **asdict(loop.margins)}
    result['bandwidth_hz'] = loop.bandwidth_hz if loop.stable else None
    if loop.step is not None:
        result['step'] = asdict(loop.step.figures)
    if loop.measured_open is not None:
        result['agreement'] = agreement(loop)
    if loop.fault:
        result['fault'] = loop.fault
    return result


def agreement(loop: LoopResult) -> dict[str, Any] | None:
    """Distance of the open loop on the bench from the linear one, where it is trusted."""
    measured = loop.measured_open
    if measured is None:
        return None
    linear = interpolated(measured.frequencies_hz, loop.frequencies_hz, loop.open_loop)
    return _as_document(deviation(measured, linear))


def recorded_figures(one: MeasuredResponse) -> dict[str, Any]:
    """Return what a recorded response is worth."""
    return {
        'name': one.name,
        'title': one.title,
        'axis': one.axis,
        'averages': one.measured.averages,
        'trusted_hz': one.measured.band_hz(),
        'agreement': _as_document(deviation(one.measured, one.linear)),
        'margins': _recorded_margins(one),
    }


def _recorded_margins(one: MeasuredResponse) -> dict[str, float | None] | None:
    """Margins of an open loop within the band that is trusted; None for a closed one."""
    band = one.measured.band_hz()
    if one.name not in ('cascade', 'position') or band is None:
        return None
    frequencies = one.measured.frequencies_hz
    inside = (frequencies >= band[0]) & (frequencies <= band[1])
    return asdict(margins(frequencies[inside], one.measured.values[inside])) if inside.sum() > 1 else None


def instability(variant: Variant) -> list[str]:
    """Return a sentence about each loop that is unstable by itself, and about what follows from it."""
    sentences = []
    inside = ''
    for loop in variant.loops:
        if loop.stable:
            continue
        if inside:
            sentences.append(f'{loop.name}: unstable with the {inside} loop inside it')
            continue
        m = loop.margins
        why = []
        if m.gain_reduction_db is not None:
            why.append(f'its gain is {-m.gain_reduction_db:.1f} dB too high')
        if m.phase_margin_deg is not None:
            why.append(f'phase margin {m.phase_margin_deg:.0f} deg at {m.crossover_hz:.0f} Hz')
        sentences.append(f'{loop.name}: unstable, {", ".join(why) or "it does not decay"}')
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


def interpolated(
    frequencies_hz: Floats, grid_hz: Floats, values: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Linear curve between its points: magnitude and phase over the logarithm of the frequency."""
    at, grid = np.log(frequencies_hz), np.log(grid_hz)
    size = np.exp(np.interp(at, grid, np.log(np.abs(values))))
    return np.asarray(size * np.exp(1j * np.interp(at, grid, np.unwrap(np.angle(values)))))


def write_tables(
    variants: list[Variant],
    names: list[str],
    points: list[SweepPoint],
    found: list[MeasuredResponse],
    folder: Path,
    provenance: Provenance,
) -> list[Path]:
    """Write ``step_*.csv``, ``bode_*.csv``, ``workspace.csv``, ``effect.csv``, ``sweep.csv`` and ``recorded_*.csv``."""
    paths = []
    for number, loop in enumerate(variants[0].loops):
        results = [variant.loops[number] for variant in variants]
        if all(result.step is not None for result in results):
            paths.append(_write_steps(loop.name, results, names, folder, provenance))
        paths += _write_bode(loop.name, results, names, folder, provenance)
    paths.append(_write_workspace(variants, names, folder, provenance))
    paths += _write_effect(variants, names, folder, provenance)
    if points:
        paths.append(_write_sweep(points, folder, provenance))
    for one in found:
        columns, header = _measured_columns(one.measured, one.title)
        header += [f'{one.title}: linear [dB]', f'{one.title}: linear [deg]']
        rows = np.column_stack([*columns, decibels(one.linear), degrees(one.linear)]).tolist()
        paths.append(write_table(folder / f'recorded_{one.name}.csv', header, rows, provenance))
    return paths


def _write_steps(
    name: str, results: list[LoopResult], names: list[str], folder: Path, provenance: Provenance
) -> Path:
    steps = [result.step for result in results if result.step is not None]
    columns, header = [steps[0].time_s], ['time [s]']
    for step, which in zip(steps, names, strict=True):
        columns += [step.drive, step.linear]
        header += [f'{which}: drive [1]', f'{which}: linear [1]']
    return write_table(folder / f'step_{name}.csv', header, np.column_stack(columns).tolist(), provenance)


def _write_bode(
    name: str, results: list[LoopResult], names: list[str], folder: Path, provenance: Provenance
) -> list[Path]:
    paths = []
    for result, which in zip(results, names, strict=True):
        grid, suffix = result.frequencies_hz, '' if len(results) == 1 else f'_{which}'
        header = ['frequency [Hz]', 'open loop [dB]', 'open loop [deg]']
        columns = [grid, decibels(result.open_loop), degrees(result.open_loop)]
        if result.closed_loop is not None:
            header += ['closed loop [dB]', 'closed loop [deg]']
            for values in (decibels(result.closed_loop), degrees(result.closed_loop)):
                columns.append(np.concatenate([values, np.full(len(grid) - len(values), np.nan)]))
        rows = [['' if v != v else v for v in row] for row in np.column_stack(columns).tolist()]
        paths.append(write_table(folder / f'bode_{name}{suffix}.csv', header, rows, provenance))
        measured = [
            (one, title)
            for one, title in ((result.measured_open, 'open loop'), (result.measured_closed, 'closed loop'))
            if one is not None
        ]
        for one, title in measured:
            columns, header = _measured_columns(one, title)
            kind = title.split()[0]
            path = folder / f'bode_{name}{suffix}_bench_{kind}.csv'
            paths.append(write_table(path, header, np.column_stack(columns).tolist(), provenance))
    return paths


def _measured_columns(measured: Measured, title: str) -> tuple[list[Floats], list[str]]:
    header = [
        'frequency [Hz]',
        f'{title} [dB]',
        f'{title} [deg]',
        'coherence [1]',
        'relative error [1]',
        'trusted [0/1]',
    ]
    columns = [
        measured.frequencies_hz,
        decibels(measured.values),
        degrees(measured.values),
        measured.coherence,
        measured.error,
        measured.trusted.astype(np.float64),
    ]
    return columns, header


def _write_workspace(variants: list[Variant], names: list[str], folder: Path, provenance: Provenance) -> Path:
    header = ['gains', 'load', 'inertia [kg m2]']
    for name in OPEN:
        header += [
            f'{name}: crossover [Hz]',
            f'{name}: phase margin [deg]',
            f'{name}: gain margin [dB]',
            f'{name}: Ms [1]',
        ]
    rows = []
    for variant, which in zip(variants, names, strict=True):
        for load, loops in variant.workspace:
            row: list[Any] = [which, load.name, load.inertia_kg_m2]
            for loop in loops:
                m = loop.margins
                row += [m.crossover_hz, m.phase_margin_deg, m.gain_margin_db, m.sensitivity_peak]
            rows.append(['' if value is None else value for value in row])
    return write_table(folder / 'workspace.csv', header, rows, provenance)


_EFFECT_HEADER = (
    'following error max [rad]', 'following error rms [rad]', 'TCP error max [m]', 'TCP error rms [m]',
    'current peak [A]', 'current rms [A]', 'fault',
)  # fmt: skip


def _write_effect(
    variants: list[Variant], names: list[str], folder: Path, provenance: Provenance
) -> list[Path]:
    rows = [
        [which, *('' if value is None else value for value in variant.effect.figures().values())]
        for variant, which in zip(variants, names, strict=True)
    ]
    paths = [write_table(folder / 'effect.csv', ['gains', *_EFFECT_HEADER], rows, provenance)]
    ran = [(v.effect, n) for v, n in zip(variants, names, strict=True) if len(v.effect.time_s)]
    if ran:
        columns, header = [ran[0][0].time_s], ['time [s]']
        for effect, which in ran:
            columns += [*effect.following_error_rad.T, effect.tcp_error_m]
            header += [f'{which}: following error {i} [rad]' for i in (1, 2, 3)] + [f'{which}: TCP error [m]']
        rows = np.column_stack(columns).tolist()
        paths.append(write_table(folder / 'following_error.csv', header, rows, provenance))
    return paths


def _write_sweep(points: list[SweepPoint], folder: Path, provenance: Provenance) -> Path:
    loops = [loop.name for loop in points[0].loops]
    header = [
        'value [SI]',
        *(f'{n}: phase margin [deg]' for n in loops),
        *(f'{n}: overshoot [1]' for n in loops),
    ]
    header += [f'{n}: stable [0/1]' for n in loops] + list(_EFFECT_HEADER)
    rows = []
    for point in points:
        row: list[Any] = [point.value, *(loop.margins.phase_margin_deg for loop in point.loops)]
        row += [point.overshoot[n] for n in loops] + [int(loop.stable) for loop in point.loops]
        row += list(point.effect.figures().values())
        rows.append(['' if value is None else value for value in row])
    return write_table(folder / 'sweep.csv', header, rows, provenance)


def _as_document(found: tuple[float, float, float] | None) -> dict[str, float] | None:
    return None if found is None else dict(zip(('up_to_hz', 'decibels', 'degrees'), found, strict=True))

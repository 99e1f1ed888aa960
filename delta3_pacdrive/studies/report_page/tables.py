"""HTML tables of a page: moves, records, parts, statistics, differences, provenance; readable without scripts."""

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.recording.record_file import SavedRecord
from delta3_pacdrive.robot.motor import share_text, thermal_warnings
from delta3_pacdrive.robot.sercos.telegrams import BRAKE_FREE, BRAKE_HELD
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.report_page.document import signals_of
from delta3_pacdrive.studies.report_page.plots import PLOTS, quantity
from delta3_pacdrive.studies.report_page.surroundings import first_cycle, shown_stays
from delta3_pacdrive.studies.runs.alignment import BY_CORRELATION
from delta3_pacdrive.studies.runs.derived_signals import added
from delta3_pacdrive.studies.runs.run_comparison import Comparison, driven_currents, move_figures
from delta3_pacdrive.studies.runs.run_signals import energy_of_round, gears_of_round, temperatures_of_round
from delta3_pacdrive.studies.runs.run_supply import supply_of_run
from delta3_pacdrive.studies.runs.runs import Run, named

NOTHING = '&ndash;'
MOVES_SHOWN = 400  # rows of the table of moves
DRIVES_SHOWN = 400
PARTS_SHOWN = 400  # the newest parts
TEXT_MAX = 200  # characters of a text of a part, which comes from outside
_MOVE_COLUMNS = (
    ('duration', 's', 1.0, 3),
    ('TCP speed', 'm/s', 1.0, 3),
    ('peak current', 'A', 1.0, 2),
    ('rms current', 'A', 1.0, 2),
    ('TCP error', 'mm', 1e3, 3),
    ('following error', 'deg', math.degrees(1.0), 4),
)
# displayed unit of a signal and the factor to it
_READ_IN = {name: (plot.unit, plot.factor) for plot in PLOTS for name, _ in plot.signals}


def sections(
    runs: Sequence[Run],
    comparisons: Sequence[Comparison],
    origin: Provenance,
    records: Sequence[SavedRecord] = (),
) -> str:
    """Return all tables of a page."""
    names = named(runs)
    parts = [
        _notes(runs, names),
        *(_comparison(names, n, one) for n, one in enumerate(comparisons, start=1)),
        _moves(runs, names),
        _records(records),
        *(_parts(n, run, names[n] if len(runs) > 1 else '') for n, run in enumerate(runs)),
        *(_drives(run, name if len(runs) > 1 else '') for run, name in zip(runs, names, strict=True)),
        *(_statistics(run, name if len(runs) > 1 else '') for run, name in zip(runs, names, strict=True)),
        *(_parameters(run, name if len(runs) > 1 else '') for run, name in zip(runs, names, strict=True)),
        _origin(runs, names, origin),
    ]
    return '\n'.join(part for part in parts if part)


def _section(identity: str, title: str, body: str) -> str:
    return f'<section class="card" id="{escape(identity)}">\n<h2>{escape(title)}</h2>\n{body}\n</section>'


def _table(
    header: Iterable[str], rows: Iterable[Sequence[str]], attributes: Iterable[str] = (), kind: str = 'wide'
) -> str:
    """Return a table; cells are HTML, the header is text. Numbers are right-aligned."""
    heads = ''.join(f'<th scope="col">{escape(cell)}</th>' for cell in header)
    given = list(attributes)
    lines = []
    for n, row in enumerate(rows):
        more = f' {given[n]}' if given and given[n] else ''
        cells = ''.join(f'<td{" class=n" if _is_number(cell) else ""}>{cell}</td>' for cell in row)
        lines.append(f'<tr{more}>{cells}</tr>')
    body = '\n'.join(lines)
    return f'<div class="{kind}"><table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>'


def _is_number(cell: str) -> bool:
    return cell[:1].isdigit() or cell[:1] in ('-', '+') or cell == NOTHING


def _number(value: float, digits: int) -> str:
    """Return a rounded number; a dash if it is not finite."""
    return f'{round(value, digits) + 0.0:.{digits}f}' if math.isfinite(value) else NOTHING


def _notes(runs: Sequence[Run], names: Sequence[str]) -> str:
    several = len(runs) > 1
    lines = [
        (f'<b>{escape(name)}</b>: ' if several else '') + escape(note)
        for run, name in zip(runs, names, strict=True)
        for note in run.notes
    ]
    if not lines:
        return ''
    return _section('notes', 'Notes', f'<ul>{"".join(f"<li>{line}</li>" for line in lines)}</ul>')


def _comparison(names: Sequence[str], number: int, found: Comparison) -> str:
    first, second = escape(names[0]), escape(names[number])
    how = found.alignment
    alignment = (
        f'shifted by {how.shift_s:+.3f} s for the best correlation'
        if how.by == BY_CORRELATION
        else f'aligned by {how.by}'
    )
    correlation = '' if math.isnan(how.correlation) else f'; {how.of} correlate by {how.correlation:.6f}'
    lead = f'<p><b>{second}</b> minus <b>{first}</b>, {alignment}{correlation}.</p>'
    if found.same:
        lead += '<p>No signal differs by a single bit.</p>'
    elif found.equal:
        lead += '<p>No signal differs by a single bit in the cycles that both have.</p>'
    lead += ''.join(f'<p>Careful: {escape(text)}.</p>' for text in found.doubts)
    if found.uncompared:
        lead += f'<p>{found.uncompared} cycles were not compared: only one of the two has them.</p>'
    rows = []
    for name, figure in found.figures.items():
        unit, factor = _READ_IN.get(name, (figure.unit, 1.0))
        if name.startswith('motor_'):
            unit, factor = figure.unit, 1.0
        rows.append(
            [
                f'<code>{name}</code>',
                escape(quantity(name)[1]),
                f'{factor * figure.rms:.4g}',
                f'{factor * figure.largest:.4g}',
                unit,
                _number(figure.at_s, 3),
            ]
        )
    body = lead + _table(['signal', 'meaning', 'rms', 'largest', 'unit', 'at [s]'], rows)
    if found.parameters:
        body += '<h3>Parameters that differ</h3>' + _table(
            ['parameter', names[0], names[number]],
            [[f'<code>{name}</code>', _value(a), _value(b)] for name, (a, b) in found.parameters.items()],
        )
    else:
        body += '<p>All parameters are the same.</p>'
    title = 'Difference' if len(names) == 2 else f'Difference: {names[number]}'
    return _section(f'difference{number}', title, body)


def _moves(runs: Sequence[Run], names: Sequence[str]) -> str:
    """Return the table of moves; those of several runs are listed move by move."""
    several = len(runs) > 1
    header = ['move', *(['run'] if several else []), 'kind', 'start [s]', 'length [mm]']
    header += [f'{title} [{unit}]' for title, unit, _, _ in _MOVE_COLUMNS]
    header.append('limited by')
    numbers = sorted({move.number for run in runs for move in run.moves})
    if not numbers:
        return _section('moves', 'Moves', '<p>The recording contains no information on moves.</p>')
    by_number = [{move.number: move for move in run.moves} for run in runs]
    rows, attributes = [], []
    for number in numbers[:MOVES_SHOWN]:
        for n, (run, moves) in enumerate(zip(runs, by_number, strict=True)):
            if (move := moves.get(number)) is None:
                continue
            figures = vars(move_figures(run, move)).values()
            rows.append(
                [
                    str(number),
                    *([escape(names[n])] if several else []),
                    escape(move.kind),
                    _number(move.start_s, 3),
                    _number(1e3 * move.length_m, 1) if move.length_m else NOTHING,
                    *(
                        _number(factor * value, digits)
                        for value, (_, _, factor, digits) in zip(figures, _MOVE_COLUMNS, strict=True)
                    ),
                    escape(move.limited_by) or NOTHING,
                ]
            )
            attributes.append(f'data-from="{move.start_s:.6f}" data-to="{move.end_s:.6f}" data-run="{n}"')
    more = len(numbers) - MOVES_SHOWN
    hint = 'Click a row to see the move.' + (f' {counted(more, "more move")} not listed.' if more > 0 else '')
    table = _table(header, rows, attributes, 'wide tall')
    return _section(
        'moves', 'Moves', f'<p class="hint">{hint}</p>{table}{_currents(runs, names)}{_energies(runs, names)}'
    )


def _currents(runs: Sequence[Run], names: Sequence[str]) -> str:
    """Return peak and rms currents of each run relative to their limits, and a warning for each limit exceeded."""
    lines = []
    for run, name in zip(runs, names, strict=True):
        if (found := driven_currents(run)) is None:
            continue
        motor = run.robot.motor
        limits = (motor.peak_current_a, 'peak'), (motor.nominal_current_a, 'nominal')
        peak, rms = (
            f'{" / ".join(f"{value:.2f}" for value in one)} A, {share_text(one, *limit)}'
            for one, limit in zip(found, limits, strict=True)
        )
        whose = f' of <b>{escape(name)}</b>' if len(runs) > 1 else ''
        lines.append(f'<p>Currents{whose}: peak {peak}; rms {rms}.</p>')
        lines += [
            f'<p><b>Warning</b>: {escape(one)}.</p>'
            for one in thermal_warnings(found[1], motor.nominal_current_a)
        ]
    return ''.join(lines)


def _energies(runs: Sequence[Run], names: Sequence[str]) -> str:
    """Return energy, temperatures and load of the gears of each run, if known."""
    lines = []
    for run, name in zip(runs, names, strict=True):
        repeat = run.whole.meta.get('repeat', 1)
        found = energy_of_round(run.whole, run.robot, repeat)
        if found is not None:
            whose = f' of <b>{escape(name)}</b>' if len(runs) > 1 else ''
            lines.append(f'<p>Energy{whose}: {escape(found.text(repeat))}.</p>')
            if (supply := supply_of_run(run.whole, run.robot)) is not None:
                lines += [f'<p>{row.capitalize()}{whose}: {escape(text)}.</p>' for row, text in supply.rows()]
            if (temperature := temperatures_of_round(run.whole, run.robot)) is not None:
                lines.append(f'<p>Temperature{whose}: {escape(temperature.text)}.</p>')
                lines += [f'<p><b>Warning</b>: {escape(one)}.</p>' for one in temperature.warnings()]
        gears = gears_of_round(added(run.whole), run.robot)
        if gears is not None:
            whose = f' of <b>{escape(name)}</b>' if len(runs) > 1 else ''
            lines.append(f'<p>Gears{whose}: {escape("; ".join(gears.lines(run.robot.gear)))}.</p>')
            lines += [f'<p><b>Warning</b>: {escape(one)}.</p>' for one in gears.warnings(run.robot.gear)]
    return ''.join(lines)


def _records(records: Sequence[SavedRecord]) -> str:
    """Return the table of oscilloscope records; times are those of the first run."""
    if not records:
        return ''
    rows, attributes = [], []
    for one in records:
        last_s = one.first_s + one.step_s * (len(one.values) - 1)
        rows.append(
            [
                f'<code>{escape(one.path.name)}</code>',
                escape(', '.join(one.names)),
                str(len(one.values)),
                _number(1.0 / one.step_s, 0),
                _number(one.first_s, 4),
                escape(one.trigger) or NOTHING,
                NOTHING if one.trigger_s is None else _number(one.trigger_s, 6),
                f'<code>{escape(one.command)}</code>' if one.command else NOTHING,
            ]
        )
        attributes.append(f'data-from="{one.first_s:.6f}" data-to="{last_s:.6f}" data-run="0"')
    header = ['record', 'channels', 'samples', 'rate [Hz]', 'from [s]', 'trigger', 'seen [s]', 'command']
    return _section(
        'records',
        'Oscilloscope',
        '<p class="hint">Click a row to see the record.</p>' + _table(header, rows, attributes),
    )


def _parts(number: int, run: Run, name: str) -> str:
    """Return the table of the parts visible in the window of a run, and of those with unknown position."""
    story = run.cell
    if story is None or not story.parts:
        return ''
    there = {row for row, _ in shown_stays(run, story)}
    listed = [part for row, part in enumerate(story.parts) if row in there or not story.stays[row]][
        -PARTS_SHOWN:
    ]
    if not listed:
        return ''
    rows, attributes = [], []
    for part in listed:
        picked, released = (_time(run, part[key]) for key in ('picked_cycle', 'released_cycle'))
        in_box = part['where'] and part['place'] >= 0
        place = f'{part["where"]} {part["place"]}' if in_box else part['where']
        taken = part['picked_cycle'] >= 0
        rows.append(
            [
                str(part['number']),
                *(_text(part[key]) for key in ('type', 'source', 'outcome')),
                _number(picked, 3),
                _number(released, 3),
                _number(1e3 * math.hypot(*part['pick_error_m'][:2]), 2) if taken else NOTHING,
                _text(place),
                _number(1e3 * math.hypot(*part['place_error_m'][:2]), 2) if in_box else NOTHING,
                _number(100.0 * part['hold_use'], 0) if taken else NOTHING,
                _text(part['reason']),
            ]
        )
        end = released if math.isfinite(released) else float(run.window.time_s[-1])
        attributes.append(
            f'data-from="{picked:.6f}" data-to="{end:.6f}" data-run="{number}"' if taken else ''
        )
    header = ['part', 'type', 'from', 'outcome', 'picked [s]', 'released [s]', 'pick error [mm]', 'where']
    header += ['place error [mm]', 'hold use [%]', 'reason']
    counts = ', '.join(f'{count} {outcome}' for outcome, count in story.outcomes.items() if count)
    more = sum(story.outcomes.values()) - len(listed)
    hint = f'{counts}. Click a row to see the part in hand.' + (
        f' {more} more parts are not listed.' if more > 0 else ''
    )
    return _section(
        f'parts{number}',
        f'Parts {name}'.strip(),
        f'<p class="hint">{hint}</p>' + _table(header, rows, attributes, 'wide tall'),
    )


def _time(run: Run, cycle: int) -> float:
    """Return the time of the begin of a bus cycle [s], on the time of a run; nan for no cycle."""
    begin = float(run.window.time_s[0])
    return begin + (cycle - first_cycle(run)) * run.period_s if cycle >= 0 else math.nan


def _text(text: str) -> str:
    """Return a text of a part as HTML, or a dash if it is empty."""
    return escape(text if len(text) <= TEXT_MAX else f'{text[:TEXT_MAX]} ...') or NOTHING


def _drives(run: Run, name: str) -> str:
    """Return the table of the reported states of the drives in the window of a run."""
    first, last = float(run.window.time_s[0]), float(run.window.time_s[-1])
    rows = []
    for axis, changes in enumerate(run.drives, start=1):
        ends = [*(change.time_s for change in changes[1:]), math.inf]
        for change, end in zip(changes, ends, strict=True):
            if end > first and change.time_s <= last:
                brake = {None: NOTHING, True: BRAKE_FREE, False: BRAKE_HELD}[change.released]
                state = change.state.lower().replace('_', ' ')
                rows.append((max(change.time_s, first), [f'axis {axis}', state, brake]))
    if not rows:
        return ''
    rows.sort(key=lambda row: row[0])
    listed = [[_number(time_s, 3), *cells] for time_s, cells in rows[:DRIVES_SHOWN]]
    return _section(
        f'drives {name}'.strip().replace(' ', '-'),
        f'Drives {name}'.strip(),
        '<p class="hint">From the status words in the AT.</p>'
        + _table(['from [s]', 'drive', 'state', 'brake'], listed, (), 'wide tall'),
    )


def _statistics(run: Run, name: str) -> str:
    rows = []
    for signal, values in signals_of(run).items():
        unit, factor = _READ_IN.get(signal, (quantity(signal)[0], 1.0))
        if signal.startswith('motor_'):
            unit, factor = quantity(signal)[0], 1.0
        finite = values[np.isfinite(values).all(axis=1)]
        if not len(finite):
            continue
        low, high, rms = finite.min(axis=0), finite.max(axis=0), np.sqrt((finite**2).mean(axis=0))
        rows.append(
            [
                f'<code>{signal}</code>',
                escape(quantity(signal)[1]),
                *(' / '.join(f'{factor * value:.4g}' for value in one) for one in (low, high, rms)),
                unit,
            ]
        )
    header = ['signal', 'meaning', 'least', 'greatest', 'rms', 'unit']
    length = run.window.time_s[-1] - run.window.time_s[0]
    hint = f'<p class="hint">{len(run.window.time_s)} bus cycles of {1e3 * run.period_s:g} ms, {length:.3f} s.</p>'
    return _section('statistics', f'Statistics {name}'.strip(), hint + _table(header, rows))


def _parameters(run: Run, name: str) -> str:
    changed = run.changed_parameters()
    note = f'<p>{escape(run.robot_note)}.</p>' if run.robot_note else ''
    controller = f'<p>Controller: {escape(run.robot.controller)}.</p>'
    if not changed:
        body = f'{note}{controller}<p>All parameters are as packaged.</p>'
    else:
        body = f'{note}{controller}' + _table(
            ['parameter', 'value', 'packaged'],
            [[f'<code>{key}</code>', _value(own), _value(usual)] for key, (own, usual) in changed.items()],
        )
    return _section('parameters', f'Parameters {name}'.strip(), body)


def _value(value: Any) -> str:
    if isinstance(value, tuple | list):
        return escape(', '.join(f'{one:g}' for one in value))
    return escape(f'{value:g}' if isinstance(value, float) else str(value))


def _origin(runs: Sequence[Run], names: Sequence[str], origin: Provenance) -> str:
    lines: Mapping[str, str] = origin.lines()
    rows = [[escape(name), f'<code>{escape(text)}</code>'] for name, text in lines.items() if text]
    for run, name in zip(runs, names, strict=True):
        provenance = run.whole.meta.get('provenance')
        if isinstance(provenance, dict):
            rows += [
                [escape(f'{name}: {key}'), f'<code>{escape(str(text))}</code>']
                for key, text in provenance.items()
                if text
            ]
    return _section('origin', 'Provenance', _table(['', ''], rows))

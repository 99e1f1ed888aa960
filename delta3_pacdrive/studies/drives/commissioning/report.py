"""Report of a commissioning: JSON document, text and tables."""

import math
from typing import Any

import numpy as np

from delta3_pacdrive.studies.drives.commissioning.mechanics import Interval, Mechanics
from delta3_pacdrive.studies.drives.commissioning.responses import usable
from delta3_pacdrive.studies.drives.commissioning.study import Measurement, Results
from delta3_pacdrive.studies.drives.loops.response import decibels
from delta3_pacdrive.studies.drives.tuning.candidates import Gains, Least
from delta3_pacdrive.studies.framework.columns import TextColumn, csv_table, fill, text_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table

MARGINS, MECHANICS, RESPONSES = 'margins.csv', 'mechanics.csv', 'responses_{}.csv'


def summary(found: Results) -> dict[str, Any]:
    """Return the results, ready for JSON."""
    motor = found.parameters.motor
    return {
        'pose': {
            'tcp_m': to_dict(found.tcp_m),
            'angles_rad': to_dict(found.angles_rad),
            'payload_kg': found.parameters.dynamics.payload_mass_kg,
        },
        'model': {
            'static_friction_n_m': motor.static_friction_n_m,
            'viscous_friction_n_m_s_rad': motor.viscous_friction_n_m_s_rad,
            'torque_constant_n_m_a': motor.torque_constant_n_m_a,
        },
        'mechanics': [_mechanics(one) for one in found.mechanics],
        'margins': [to_dict(row) for one in found.measured.values() for row in one.margins],
        'workspace': {name: _least(one.least) for name, one in found.measured.items()},
        'proposal': None
        if found.proposed is None
        else {
            'targets': to_dict(found.proposed.targets),
            'before': _gains(found.proposed.before),
            'gains': _gains(found.proposed.gains),
            **_least(found.proposed.least),
        },
        'outcome': None if found.outcome is None else to_dict(found.outcome),
    }


def _mechanics(one: Mechanics) -> dict[str, Any]:
    return {
        'axis': one.axis + 1,
        'inertia_kg_m2': to_dict(one.inertia_kg_m2),
        'model_inertia_kg_m2': one.model_inertia_kg_m2,
        'gear': to_dict(one.gear) if one.gear else None,
        'dead_time_s': one.dead_time_s if math.isfinite(one.dead_time_s) else None,
        'static_friction_n_m': to_dict(one.static_friction_n_m),
        'viscous_friction_n_m_s_rad': to_dict(one.viscous_friction_n_m_s_rad),
    }


def _least(least: Least) -> dict[str, Any]:
    return {
        'phase_deg': float(least.phase_deg[0]),
        'gain_db': float(least.gain_db[0]),
        'stable': bool(least.stable[0]),
    }


def _gains(gains: Gains) -> dict[str, float]:
    return gains.values() | {'stiffness_a_rad_s': gains.stiffness}


def tables(found: Results) -> list[Table]:
    """Return margins, mechanics, and the responses of each measurement."""
    rows = [
        {
            'axis': one.axis + 1,
            **_interval('inertia', 'kg m2', one.inertia_kg_m2),
            'inertia of the model [kg m2]': one.model_inertia_kg_m2,
            'rotor [kg m2]': one.gear and one.gear.rotor_kg_m2,
            'resonance [Hz]': one.gear and one.gear.resonance_hz,
            'antiresonance [Hz]': one.gear and one.gear.antiresonance_hz,
            'dead time [s]': one.dead_time_s,
            **_interval('static friction', 'N m', one.static_friction_n_m),
            **_interval('viscous friction', 'N m s/rad', one.viscous_friction_n_m_s_rad),
        }
        for one in found.mechanics
    ]
    margins = [row for one in found.measured.values() for row in one.margins]
    return [
        csv_table(MARGINS, margins),
        Table.of_rows(MECHANICS, rows),
        *(Table.of_columns(RESPONSES.format(name), _responses(one)) for name, one in found.measured.items()),
    ]


def _interval(name: str, unit: str, interval: Interval) -> dict[str, float]:
    return {
        f'{name} [{unit}]': interval.value,
        f'{name}, low [{unit}]': interval.low,
        f'{name}, high [{unit}]': interval.high,
    }


def _responses(measured: Measurement) -> dict[str, Any]:
    columns: dict[str, Any] = {'frequency [Hz]': measured.responses[0].cascade.frequencies_hz}
    for one in measured.responses:
        loop, axis = one.cascade, one.axis + 1
        columns |= {
            f'open loop {axis} [dB]': decibels(loop.values),
            f'phase {axis} [deg]': np.degrees(np.angle(loop.values)),
            f'coherence {axis} [1]': loop.coherence,
            f'usable {axis} [1]': usable(loop).astype(np.float64),
            f'inertia {axis} [kg m2]': np.abs(one.inertia.values),
        }
    return columns


def text(document: dict[str, Any]) -> list[str]:
    """Return the report as lines of text."""
    pose = document['pose']
    lines = [
        fill('pose {tcp_m:.3f m}, payload {payload_kg:g} kg', pose),
        '',
        *text_table(document['mechanics'], _columns(document['mechanics'])),
        '',
        *_against_model(document),
        'margins of all loops, open at the current set point:',
        *text_table(
            document['margins'],
            [
                TextColumn('', '{gains}', '<'),
                TextColumn('axis', '{axis}'),
                TextColumn('phase margin\ndeg', '{phase_margin_deg:.1f}'),
                TextColumn('crossover\nHz', '{crossover_hz:.1f}'),
                TextColumn('gain margin\ndB', '{gain_margin_db:.1f}'),
                TextColumn('at\nHz', '{gain_margin_hz:.0f}'),
                TextColumn('measured\nHz', '{band_low_hz:.0f} to {band_high_hz:.0f}'),
            ],
        ),
        '',
        *(
            f'least margins of the loops over the workspace {name}: '
            + fill('{phase_deg:.1f} deg, {gain_db:.1f} dB', one)
            + ('' if one['stable'] else ', not stable')
            for name, one in document['workspace'].items()
        ),
    ]
    if (proposal := document['proposal']) is not None:
        lines += ['', *_proposal(proposal)]
    if (outcome := document['outcome']) is not None:
        lines += ['', outcome['sentence']]
    return [*lines, '']


def _columns(rows: list[dict[str, Any]]) -> list[TextColumn]:
    def interval(name: str, form: str) -> str:
        return f'{{{name}[value]:{form}}} ({{{name}[low]:{form}}} to {{{name}[high]:{form}}})'

    columns = [
        TextColumn('axis', '{axis}'),
        TextColumn('inertia\nkg cm2', interval('inertia_kg_m2', '.3f in kg cm2')),
        TextColumn('model\nkg cm2', '{model_inertia_kg_m2:.3f in kg cm2}'),
        TextColumn('dead time\nms', '{dead_time_s:.2f in ms}'),
        TextColumn('static friction\nN m', interval('static_friction_n_m', '.4f')),
        TextColumn(
            'viscous friction\n1e-4 N m s/rad', lambda row: _viscous(row['viscous_friction_n_m_s_rad'])
        ),
    ]
    if any(row['gear'] for row in rows):
        columns.insert(4, TextColumn('resonance\nHz', lambda row: _hertz(row, 'resonance_hz')))
        columns.insert(4, TextColumn('antiresonance\nHz', lambda row: _hertz(row, 'antiresonance_hz')))
    return columns


def _viscous(interval: dict[str, float]) -> str:
    return '{value:.2f} ({low:.2f} to {high:.2f})'.format(**{key: 1e4 * one for key, one in interval.items()})


def _hertz(row: dict[str, Any], name: str) -> str:
    return f'{row["gear"][name]:.0f}' if row['gear'] else '-'


def _against_model(document: dict[str, Any]) -> list[str]:
    """Return one sentence for each value whose interval does not contain that of the model."""
    found = []
    for one in document['mechanics']:
        for name, key, unit, model, size in (
            ('inertia', 'inertia_kg_m2', 'kg cm2', one['model_inertia_kg_m2'], 1e-4),
            ('static friction', 'static_friction_n_m', 'N m', document['model']['static_friction_n_m'], 1.0),
            (
                'viscous friction',
                'viscous_friction_n_m_s_rad',
                '1e-4 N m s/rad',
                document['model']['viscous_friction_n_m_s_rad'],
                1e-4,
            ),
        ):
            interval = one[key]
            if not interval['low'] <= model <= interval['high']:
                found.append(
                    f'axis {one["axis"]}: the {name} of the model, {model / size:.4g} {unit}, is outside the interval '
                    f'of the measured {interval["value"] / size:.4g} {unit}'
                )
    return [*found, ''] if found else []


def _proposal(proposal: dict[str, Any]) -> list[str]:
    targets, old, new = proposal['targets'], proposal['before'], proposal['gains']
    rows = [{'name': name, 'before': old.get(name), 'after': value} for name, value in new.items()]
    return [
        fill('gains for {phase_deg:g} deg and {gain_db:g} dB with the measured axes:', targets),
        *text_table(
            rows,
            [
                TextColumn('', '{name}', '<'),
                TextColumn('before', '{before:.5g}'),
                TextColumn('proposed', '{after:.5g}'),
            ],
        ),
        fill('  expected least margins: {phase_deg:.1f} deg, {gain_db:.1f} dB', proposal),
    ]

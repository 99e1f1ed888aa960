"""The numbers that belong in the cells of the tables of each study, by its summary."""

import math

from delta3_pacdrive.studies.estimation.thesis_setup import FACTORS

MM, UM, MS, PERCENT, DEG, RPM = 1e3, 1e6, 1e3, 100.0, math.degrees(1.0), 60.0 / math.tau


def _distributions(summary):
    titles = {'number': 'name', 'runs': 'runs', 'mean': 'mean', 'deviation': 'deviation', 'least': 'low',
              'greatest': 'high'}  # fmt: skip
    return [
        [*((title, one[key]) for title, key in titles.items()), *((s, v) for s, v in one['shares'].items())]
        for one in summary['distributions']
    ]


def _effects(summary):
    return [list(one.items()) for one in summary['effects']]


def _worst(summary):
    first = summary['worst'][0]
    return [[('run', one['run']), ('again with', one['command'])] for one in first['runs']]


def _corrections(summary):
    return [
        [
            ('figure', one['symbol'].rpartition('_')[0]),
            ('arm', int(one['symbol'].rpartition('_')[2])),
            ('unit', one['unit']),
            ('before', one['before']),
            ('after', one['value']),
            ('half width of 95 %', one['half_width_95']),
            ('told', one['told']),
        ]
        for one in summary['figures']
    ]


def _repetitions(summary):
    titles = {'repetition': 'number', 'TCP error max [m]': 'tcp_error_max_m', 'TCP error rms [m]': 'tcp_error_rms_m',
              'current peak [A]': 'current_peak_a', 'current rms [A]': 'current_rms_a',
              'learned torque max [N m]': 'torque_max_n_m'}  # fmt: skip
    return [[(title, one[key]) for title, key in titles.items()] for one in summary['repetitions']]


def _robots(summary):
    names = ('robot', 'picks', 'picks_per_min', 'busy', 'cycle_mean_s')
    return [
        [('belt', belt['belt']), *((name, one[name]) for name in names)]
        for belt in summary['belts']
        for one in belt['robots']
    ]


def _best(summary):
    best = summary['best'] or summary['nearest'] or summary['base']
    return [
        [
            ('quantity', key),
            ('base', summary['base']['values'].get(key)),
            ('best', value),
            ('importance', summary['importance'].get(key)),
        ]
        for key, value in best['values'].items()
    ]


def _figures(summary):
    best, base = summary['best'] or summary['nearest'] or summary['base'], summary['base']
    return [
        [
            ('figure', name),
            ('base', base['kept'].get(name)),
            ('best', best['kept'].get(name)),
            ('limit', summary['limits'].get(name)),
        ]
        for name in dict.fromkeys([*base['kept'], *best['kept']])
    ]


def _acceptance_checks(summary):
    keys = ('group', 'name', 'value', 'unit', 'limit', 'passed')
    titles = ('group', 'check', 'value', 'unit', 'limit', 'passed')
    return [list(zip(titles, map(row.get, keys), strict=True)) for row in summary['checks']]


def _commissioning_margins(summary):
    names = ('phase margin [deg]', 'crossover [Hz]', 'gain margin [dB]', 'gain margin at [Hz]')
    keys = ('phase_margin_deg', 'crossover_hz', 'gain_margin_db', 'gain_margin_hz')
    return [
        [
            ('gains', row['gains']),
            ('axis', row['axis']),
            *zip(names, map(row.get, keys), strict=True),
            ('measured from [Hz]', row['band_low_hz']),
            ('measured to [Hz]', row['band_high_hz']),
        ]
        for row in summary['margins']
    ]


def _commissioning_mechanics(summary):
    def interval(name, unit, values):
        return [(f'{name}{end} [{unit}]', values[key]) for end, key in
                (('', 'value'), (', low', 'low'), (', high', 'high'))]  # fmt: skip

    return [
        [
            ('axis', row['axis']),
            *interval('inertia', 'kg m2', row['inertia_kg_m2']),
            ('inertia of the model [kg m2]', row['model_inertia_kg_m2']),
            *((f'{key.removesuffix("_hz").removesuffix("_kg_m2")} [{unit}]', row['gear'] and row['gear'][key])
              for key, unit in (('rotor_kg_m2', 'kg m2'), ('resonance_hz', 'Hz'), ('antiresonance_hz', 'Hz'))),
            ('dead time [s]', row['dead_time_s']),
            *interval('static friction', 'N m', row['static_friction_n_m']),
            *interval('viscous friction', 'N m s/rad', row['viscous_friction_n_m_s_rad']),
        ]
        for row in summary['mechanics']
    ]  # fmt: skip


def _ripple(summary):
    return [
        [
            ('cycle time [s]', case['cycle_time_s']),
            ('interpolation', case['interpolation']),
            ('axis', axis + 1),
            ('set-point delay [s]', case['set_point_delay_s']),
            ('AT peak [A]', case['at_current_peak_a'][axis]),
            ('AT rms [A]', case['at_current_rms_a'][axis]),
            ('peak [A]', case['current_peak_a'][axis]),
            ('rms [A]', case['current_rms_a'][axis]),
            ('jerk [rad/s3]', case['jerk_rad_s3'][axis]),
            ('TCP error max [m]', case['tcp_error_max_m']),
            ('TCP error rms [m]', case['tcp_error_rms_m']),
        ]
        for case in summary['cases']
        for axis in range(3)
    ]


EFFECT = {
    'following error max [rad]': 'following_error_max_rad', 'following error rms [rad]': 'following_error_rms_rad',
    'TCP error max [m]': 'tcp_error_max_m', 'TCP error rms [m]': 'tcp_error_rms_m',
    'current peak [A]': 'current_peak_a', 'current rms [A]': 'current_rms_a', 'fault': 'fault',
}  # fmt: skip


def _effect(summary):
    return [
        [('gains', name), *((title, one['effect'][key]) for title, key in EFFECT.items())]
        for name, one in summary['variants'].items()
    ]


def _workspace(summary):
    titles = {'crossover [Hz]': 'crossover_hz', 'phase margin [deg]': 'phase_margin_deg',
              'gain margin [dB]': 'gain_margin_db', 'Ms [1]': 'sensitivity_peak'}  # fmt: skip
    return [
        [('gains', name), ('load', row['load']), ('inertia [kg m2]', row['inertia_kg_m2'])]
        + [
            (f'{loop}: {title}', row[loop][key])
            for loop in ('velocity', 'position', 'cascade', 'exchanged')
            for title, key in titles.items()
        ]
        for name, one in summary['variants'].items()
        for row in one['workspace']
    ]


def _sweep(summary):
    return [
        [
            ('value [SI]', point['value']),
            *((f'{name}: phase margin [deg]', loop['phase_margin_deg']) for name, loop in point['loops'].items()),
            *((f'{name}: overshoot [1]', value) for name, value in point['overshoot'].items()),
            *((f'{name}: stable [0/1]', loop['stable']) for name, loop in point['loops'].items()),
            *((title, point['effect'][key]) for title, key in EFFECT.items()),
        ]
        for point in summary['sweep']
    ]  # fmt: skip


def _statistics(summary):
    units = {'deviation_max_at_s': ' [s]', 'signal': '', 'column': '', 'unit': ''}
    return [
        [
            (key + (' [%]' if key.endswith('_percent') else units.get(key, ' [unit]')), value)
            for key, value in row.items()
            if key != 'text'
        ]
        for row in summary['signals']
    ]


def _attribution(summary):
    rows = []
    for one in summary['attribution']['outcomes']:
        begin = [('signal', one['signal']), ('statistic', one['statistic']), ('unit', one['unit'])]
        begin += [('model [unit]', one['model']), ('robot [unit]', one['robot'])]
        for name in summary['attribution']['effects']:
            values = [(f'{key} [unit]', one[key][name]) for key in ('alone', 'left_out', 'share')]
            rows.append([*begin, ('effect', name), *values])
        rows.append(begin)
    return rows


def _claims(summary):
    return [
        [
            ('section', one['section']),
            ('claim', one['text']),
            ('verdict', one['verdict']),
            ('value [unit]', one['value'] and one['value']['number']),
            ('lowest over seeds [unit]', one['low']),
            ('highest over seeds [unit]', one['high']),
            ('limit [unit]', one['value'] and one['value']['limit']),
        ]
        for one in summary['claims']
    ]


def _sensitivities(summary):
    if 'identifiability' in summary:  # of an estimation, else of the Jacobian
        units = {'relative_error': ' [1]'}
        return [
            [
                (key + (' [noise]' if key.startswith('sensitivity') else units.get(key, '')), value)
                for key, value in row.items()
            ]
            for row in summary['identifiability']['quantities']
        ]
    return [
        [
            ('trajectory', own['trajectory']),
            ('pose', own['pose']),
            ('length', own['symbol']),
            ('value [mm]', MM * own['value_m']),
            *(
                (f'{name} {title} [{unit}]', factor * own[name][key])
                for name in ('velocity', 'acceleration')
                for unit, factor in (('%/mm', 1.0), ('%/%', MM * own['value_m'] / PERCENT))
                for title, key in (('max of peak', 'of_peak'), ('rms of peak', 'of_peak_rms'),
                                   ('max momentary', 'momentary'))
            ),
            ('wanted deviation of velocity [%]', own['target_percent']),
            ('error for it of peak [mm]', own['needed_of_peak_m'] and MM * own['needed_of_peak_m']),
            ('error for it momentary [mm]', own['needed_momentary_m'] and MM * own['needed_momentary_m']),
        ]
        for row in summary['trajectories']
        for own in row['sensitivities']
    ]  # fmt: skip


def _estimates(summary):
    units = dict.fromkeys(('start', 'estimate', 'low_95', 'high_95', 'true', 'scale'), ' [unit]')
    units |= dict.fromkeys(('half_width_relative', 'error_relative'), ' [1]')
    return [[(key + units.get(key, ''), value) for key, value in row.items()] for row in summary['estimates']]


# least or largest: the end of each quantity of the workspace that is worse for a user, and the unit that people read
WORST = {
    'condition': ('largest', 'condition of the Jacobian', 1.0),
    'singular_min': ('least', 'smallest singular value of the Jacobian (m/rad)', 1.0),
    'serial': ('least', 'distance from the serial singularity, least of the arms', 1.0),
    'parallel': ('least', 'distance from the parallel singularity', 1.0),
    'speed': ('least', 'TCP speed in every direction (m/s)', 1.0),
    'acceleration_nominal': ('least', 'TCP acceleration in every direction at nominal current (m/s2)', 1.0),
    'acceleration': ('least', 'TCP acceleration in every direction at peak torque (m/s2)', 1.0),
    'payload_held': ('least', 'payload held at rest by nominal current and brakes (kg)', 1.0),
    'payload_peak': ('least', 'payload accelerated at peak torque (kg)', 1.0),
    'payload': ('least', 'payload within the limit of the robot (kg)', 1.0),
    'increment': ('largest', 'TCP motion for one increment of each motor (um)', UM),
}


def _extremes(summary):
    rows = []
    for key, one in summary['quantities'].items():
        least, largest = (zip(('x [m]', 'y [m]', 'z [m]'), one[f'{end}_at_m'], strict=True)
                          for end in ('least', 'largest'))  # fmt: skip
        name = next(name for name in WORST if key.startswith(name))
        rows.append(
            [('quantity', name), ('least', one['least']), *least, ('median', one['median']),
             ('largest', one['largest']), *largest]
        )  # fmt: skip
    return rows


def _moves(summary):
    three = {'motor speed {} [rad/s]': 'motor_speed_max_rad_s', 'motor torque {} [N m]': 'motor_torque_max_n_m',
             'rms current {} [A]': 'motor_current_rms_a'}  # fmt: skip
    one = {'move': 'number', 'statements': 'statements', 'kind': 'kind', 'start [s]': 'start_s', 'time [s]': 'time_s',
           'length [m]': 'length_m', 'payload [kg]': 'payload_kg', 'speed [m/s]': 'speed_max_m_s',
           'acceleration [m/s2]': 'acceleration_max_m_s2', 'jerk [m/s3]': 'jerk_max_m_s3'}  # fmt: skip
    return [
        [(title, row[key]) for title, key in one.items()]
        + [(title.format(i + 1), row[key][i]) for title, key in three.items() for i in range(3)]
        + [('axis', row['limited_by']['axis']), ('used', row['limited_by']['used'])]
        + [('share of its time', row['limited_by']['time_share'])]
        for row in summary['moves']
    ]


def _quotients(summary):
    titles = {'quantity': 'symbol', 'step [1]': 'step',
              'quotient through encoder [noise per 100 %]': 'through_encoder',
              'quotient with ideal encoder [noise per 100 %]': 'ideal', 'cosine to the true slope [1]': 'agreement',
              'largest change of a shaft [increments]': 'increments'}  # fmt: skip
    return [[(title, row[key]) for title, key in titles.items()] for row in summary['quotients']]


def _profiles(summary):
    return [
        [
            ('factor [1]', factor),
            *(
                (f'cost over {name} less its minimum [noise^2]', costs[n])
                for name, costs in summary['profiles'].items()
            ),
        ]
        for n, factor in enumerate(FACTORS)
    ]


def _attempts(summary):
    symbols = list(summary['profiles'])
    return [
        [('data', row['data']), ('step [1]', row['step']), ('start off [1]', row['off'])]
        + [(f'{symbol} moved [1]', moved) for symbol, moved in zip(symbols, row['moved'], strict=True)]
        + [
            ('largest error [1]', row['error']),
            ('cost at start [SI]', row['cost_start']),
            ('cost [SI]', row['cost']),
        ]
        + [('cost of the least [1]', row['excess']), ('simulations', row['evaluations'])]
        + [('outcome', row['outcome']), ('message', row['message'])]
        for row in summary['trials']
    ]


def _solutions(summary):
    return [
        [
            ('solution', one['number']),
            *((f'elbow {i + 1}', one['elbows'][i]) for i in range(3)),
            *((f'theta_{i + 1} [rad]', one['arm_angles_rad'][i]) for i in range(3)),
            ('within arm limits', one['within_arm_limits']),
            ('loop error [m]', one['loop_error_m']),
        ]
        for one in summary['solutions']
    ]


# the cells of each table by the summary; ``series_contents`` has the tables of samples
TABLES = {
    'distributions.csv': _distributions,
    'effects.csv': _effects,
    'worst.csv': _worst,
    'corrections.csv': _corrections,
    'repetitions.csv': _repetitions,
    'robots.csv': _robots,
    'best.csv': _best,
    'figures.csv': _figures,
    'ripple.csv': _ripple,
    'margins.csv': _commissioning_margins,
    'checks.csv': _acceptance_checks,
    'mechanics.csv': _commissioning_mechanics,
    'effect.csv': _effect,
    'workspace.csv': _workspace,
    'sweep.csv': _sweep,
    'table.csv': _statistics,
    'attribution.csv': _attribution,
    'claims.csv': _claims,
    'sensitivities.csv': _sensitivities,
    'estimates.csv': _estimates,
    'extremes.csv': _extremes,
    'moves.csv': _moves,
    'solutions.csv': _solutions,
    'cell.csv': lambda summary: [list(row.items()) for row in summary['rows']],
    'quotients.csv': _quotients,
    'profiles.csv': _profiles,
    'attempts.csv': _attempts,
}

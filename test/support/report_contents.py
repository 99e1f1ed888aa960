"""The numbers that belong in the cells of the tables and in the lines of the text of each study, by its summary."""

import math
import re

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


# the cells of each table by the summary; None: the summary does not hold them
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
    **dict.fromkeys(
        (
            'runs.csv', 'trials.csv', 'residuals.csv', 'contractions.csv', 'minutes.csv', 'missed.csv', 'picks.csv',
            'one_motor.csv', 'plan.csv', 'signals.csv', 'condition.csv', 'following_error.csv', 'load_step.csv',
            'quotients.csv', 'profiles.csv', 'attempts.csv',
        )
    ),
}  # fmt: skip
SERIES = re.compile(r'(recorded|step|bode|residuals)_\w+\.csv')


def _of_sweep(summary):
    yield 'mean deviation least median 99 % greatest', None
    for one in summary['distributions']:
        median, high = one['shares']['0.5'], one['shares']['0.99']
        yield one['name'], [one['mean'], one['deviation'], one['low'], median, high, one['high']]
    for one in summary['yields']:
        keeps = f'of the runs keep {one["name"]} <='
        yield keeps, [PERCENT * one['share'], one['limit'], PERCENT * one['low'], PERCENT * one['high']]


def _of_calibration(summary):
    yield 'figure before after 95 % interval', None
    for one in summary['figures']:
        scale, unit = (DEG, 'deg') if one['unit'] == 'rad' else (MM, 'mm')
        values = [one['before'], one['value'], one['half_width_95']]
        values += [] if one['truth'] is None else [one['truth']]
        yield one['symbol'], [scale * value for value in values]
        yield f'{one["symbol"]} {scale * one["before"]:z.4f}', None
        yield f'+- {scale * one["half_width_95"]:.4f} {unit}', None
    yield 'left over [mm] before rms / max after rms / max', None
    for one in summary['left']:
        keys = ('before_rms_m', 'before_max_m', 'after_rms_m', 'after_max_m')
        yield f'{one["what"]} ({one["count"]})', [MM * one[key] for key in keys]
    for one in summary['limits_m']:
        yield f'mm {one["what"]}', [MM * one['size_m']]


def _of_learning(summary):
    yield 'repetition TCP error, max / rms current, peak / rms learned torque', None
    for one in summary['repetitions']:
        error = [MM * one['tcp_error_max_m'], MM * one['tcp_error_rms_m']]
        yield (
            'N m',
            [one['number'], *error, one['current_peak_a'], one['current_rms_a'], one['torque_max_n_m']],
        )
    if summary['follow']:
        yield 'times smaller,', [summary['best'], summary['gain_max'], summary['gain_rms']]
    worst = summary['contraction']
    values = [worst['rate'], worst['at_hz'], PERCENT * worst['masses'], worst['payload_kg']]
    yield 'a repetition leaves', values


def _of_line(summary):
    for belt in summary['belts']:
        yield f'belt {belt["belt"]}:', [belt['picked'], belt['offered'], PERCENT * belt['share']]
        yield 'robot picks a minute busy mean cycle', None
        for one in belt['robots']:
            cycle = [] if one['cycle_mean_s'] is None else [one['cycle_mean_s']]
            yield one['robot'], [one['picks'], one['picks_per_min'], PERCENT * one['busy'], *cycle]


def _of_one_motor(summary):
    peak, peak_limit = summary['current_peak_a'], summary['current_peak_limit_a']
    rms, rms_limit = summary['current_rms_a'], summary['current_rms_limit_a']
    for begin, *values in (
        ('load I_Load', summary['load_inertia_kg_m2'], summary['load_torque_n_m'], summary['coupling_effect'],
         1e4 * summary['shaft_inertia_kg_m2']),
        ('A peak,', peak, PERCENT * peak / peak_limit, peak_limit, rms, PERCENT * rms / rms_limit, rms_limit),
        ('rad/s max, phase voltage', summary['speed_max_rad_s'], summary['voltage_max_v']),
        ('set point', MM * summary['position_error_max_rad'], MM * summary['position_error_rms_rad']),
        ('in robot', MM * summary['from_robot_max_rad'], MM * summary['from_robot_rms_rad']),
    ):  # fmt: skip
        yield begin, values


def _of_optimisation(summary):
    best, base = summary['best'] or summary['nearest'], summary['base']
    if best is None:
        return
    word = 'largest' if summary['maximise'] else 'least'
    yield (
        f'{word} {summary["goal"]}:',
        [best['value'], best['trial']] + ([] if base['value'] is None else [base['value']]),
    )
    yield 'base best importance', None
    for key, value in best['values'].items():
        values = [base['values'].get(key), value]
        if all(isinstance(one, float | int) for one in values):
            share = summary['importance'].get(key)
            yield key, values + ([] if share is None else [PERCENT * share])


def _of_ripple(summary):
    yield 'delay current in the AT all samples jerk > 100 Hz TCP error', None
    yield 'ms peak / rms A peak / rms A rad/s3 max / rms mm', None
    i = summary['axis'] - 1
    keys = ('at_current_peak_a', 'at_current_rms_a', 'current_peak_a', 'current_rms_a', 'jerk_rad_s3')
    for case in summary['cases']:
        error = [MM * case['tcp_error_max_m'], MM * case['tcp_error_rms_m']]
        values = [MS * case['set_point_delay_s'], *(case[key][i] for key in keys), *error]
        yield f'{MS * case["cycle_time_s"]:g} ms {case["interpolation"]}', values


def _of_experiment(summary):
    yield 'model max rms robot max rms apart max rms % of peak', None
    keys = ('model_max', 'model_rms', 'robot_max', 'robot_rms', 'deviation_max', 'deviation_rms',
            'deviation_max_percent')  # fmt: skip
    for row in summary['signals']:
        if row['column'] in ('', 'all'):
            values = [row[key] for key in keys]
            yield f'{row["text"]} {row["unit"]}', [value for value in values if value is not None]


def _of_jacobian(summary):
    for row in summary['trajectories']:
        for name in ('velocity', 'acceleration'):
            off = row['every_length_1_mm_off'][name]
            values = [
                row[which][name][key]['max']
                for which in ('exact', 'inexact')
                for key in ('of_peak', 'momentary')
            ]
            yield name, [*values, off['of_peak'], off['momentary']]


def _of_tuning(summary):
    for name, one in summary['variants'].items():
        for loop, row in one['loops'].items():
            step = row.get('step') or {}
            values = [
                (row['crossover_hz'], 1.0), (row['phase_margin_deg'], 1.0), (row['gain_margin_db'], 1.0),
                (row['delay_margin_s'], MS), (row['sensitivity_peak'], 1.0), (row['bandwidth_hz'], 1.0),
                (step.get('rise_time_s'), MS), (step.get('overshoot'), PERCENT), (step.get('settling_time_s'), MS),
            ]  # fmt: skip
            yield f'{loop} {name}', [value * scale for value, scale in values if value is not None]
        effect = one['effect']
        if effect['following_error_max_rad'] is not None:
            error = [DEG * effect[f'following_error_{key}_rad'] for key in ('max', 'rms')]
            tcp = [UM * effect[f'tcp_error_{key}_m'] for key in ('max', 'rms')]
            yield f'{name} following error', [*error, *tcp, effect['current_peak_a']]


def _of_estimation(summary):
    for row in summary['estimates']:
        if row['estimate'] is not None:
            yield row['quantity'], [row['estimate']]


# least or largest: the end of each quantity of the workspace that is worse for a user, and the unit that people read
WORST = {
    'condition': ('largest', 'condition of the Jacobian', 1.0),
    'singular_min': ('least', 'smallest singular value of the Jacobian (m/rad)', 1.0),
    'serial': ('least', 'distance from the serial singularity, least of the arms', 1.0),
    'parallel': ('least', 'distance from the parallel singularity', 1.0),
    'speed': ('least', 'TCP speed in every direction (m/s)', 1.0),
    'acceleration_nominal': ('least', 'TCP acceleration in every direction at nominal current (m/s2)', 1.0),
    'acceleration': ('least', 'TCP acceleration in every direction at peak current (m/s2)', 1.0),
    'payload_held': ('least', 'payload held at rest by nominal current and brakes (kg)', 1.0),
    'payload_peak': ('least', 'payload accelerated at peak current (kg)', 1.0),
    'payload': ('least', 'payload within the limit of the robot (kg)', 1.0),
    'increment': ('largest', 'TCP motion for one increment of each motor (um)', UM),
}


def _of_workspace(summary):
    rate = 1e-6 * summary['poses_per_s']
    known = [
        summary['poses'],
        MM * summary['resolution_m'],
        summary['seconds'],
        rate,
        summary['poses_in_reach'],
    ]
    yield 'the robot may be at', known
    yield 'accelerations with', [summary['payload_kg'], summary['acceleration_m_s2']]
    yield 'least median largest worst at (mm)', None
    for key, one in summary['quantities'].items():
        end, words, scale = WORST[next(name for name in WORST if key.startswith(name))]
        values = [scale * one[which] for which in ('least', 'median', 'largest')]
        yield words, [*values, *(MM * value for value in one[f'{end}_at_m'])]


def _of_plan(summary):
    yield 'statements kind length time speed accel. jerk motor torque limited by', None
    yield 'mm s m/s m/s2 m/s3 rpm N m (share of its time)', None
    for row in summary['moves']:
        motor = [RPM * max(row['motor_speed_max_rad_s']), max(row['motor_torque_max_n_m'])]
        length = [] if row['kind'] in ('dwell', 'turn') else [MM * row['length_m']]
        path = [row['speed_max_m_s'], row['acceleration_max_m_s2'], row['jerk_max_m_s3']]
        yield f'{row["number"]} {row["statements"]} {row["kind"]}', [*length, row['time_s'], *path, *motor]
    place = summary['distances']
    yield 'to the rim of the workspace', [MM * place[key] for key in ('radius_m', 'top_m', 'bottom_m')]
    angles = ('arm_angle_max_deg', 'arm_angle_min_deg', 'forearm_swing_deg')
    yield 'deg to the largest arm angle', [place[key] for key in angles]
    yield 'to the limits of the serial', [place['serial_singularity'], place['parallel_singularity']]


# words of the line, unit in keys, factor, and which number the line has
LIMITS_OF_A_POSE = {
    'radius': ('to the rim', '_m', MM, 'distance'),
    'top': ('to the top', '_m', MM, 'distance'),
    'bottom': ('to the bottom', '_m', MM, 'distance'),
    'arm_angle_max': ('arm limits', '_deg', 1.0, 'distance'),
    'arm_angle_min': ('deg above', '_deg', 1.0, 'distance'),
    'forearm_swing': ('swing', '_deg', 1.0, 'distance'),
    'serial_singularity': ('singularity serial', '', 1.0, 'value'),
    'parallel_singularity': ('parallel', '', 1.0, 'value'),
}


def _of_pose(summary):
    yield 'TCP', [MM * value for value in summary['point_m']]
    yield 'arm angles', [DEG * angle for angle in summary['arm_angles_rad']]
    yield 'arm angles', summary['arm_angles_deg']
    limits = {key: [one for one in summary['limits'] if one['quantity'] == key] for key in LIMITS_OF_A_POSE}
    for key, (words, unit, scale, what) in LIMITS_OF_A_POSE.items():
        own = limits[key]
        yield words, [*(scale * one[f'{what}{unit}'] for one in own), scale * own[0][f'limit{unit}']]
    yield 'mirror point', [MM * value for value in summary['mirror_point_m']]
    yield 'condition', [summary['condition'], *summary['singular_values_m_rad']]
    yield 'N m at the arms', [*summary['holding_torque_n_m'], summary['payload_kg']]
    yield 'N m at the motors', [*summary['holding_motor_torque_n_m'], *summary['holding_current_a']]
    yield 'in every direction', [summary['speed_m_s']]
    yield 'acceleration', [summary['acceleration_m_s2'], summary['acceleration_nominal_m_s2']]
    yield 'payload', [summary['payload_max_kg']]
    yield 'increment', [UM * summary['tcp_per_increment_m']]


# lines of the text, by a table of the study: words of the line, and its first other numbers; None: words alone
LINES = {
    'runs.csv': _of_sweep,
    'corrections.csv': _of_calibration,
    'repetitions.csv': _of_learning,
    'robots.csv': _of_line,
    'one_motor.csv': _of_one_motor,
    'best.csv': _of_optimisation,
    'ripple.csv': _of_ripple,
    'table.csv': _of_experiment,
    'condition.csv': _of_jacobian,
    'effect.csv': _of_tuning,
    'estimates.csv': _of_estimation,
    'extremes.csv': _of_workspace,
    'moves.csv': _of_plan,
    'solutions.csv': _of_pose,
}

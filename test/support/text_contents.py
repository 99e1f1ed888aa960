"""The numbers that belong in the lines of the text of each study, by its summary."""

from report_contents import DEG, MM, MS, PERCENT, RPM, UM, WORST


def _of_sweep(summary):
    yield 'mean deviation least median 99 % greatest', None
    for one in summary['distributions']:
        median, high = one['shares']['0.5'], one['shares']['0.99']
        yield one['name'], [one['mean'], one['deviation'], one['low'], median, high, one['high']]
    for one in summary['yields']:
        keeps = f'of the runs have {one["name"]} <='
        yield keeps, [PERCENT * one['share'], one['limit'], PERCENT * one['low'], PERCENT * one['high']]


def _of_calibration(summary):
    yield 'parameter before after 95 % interval', None
    for one in summary['figures']:
        scale, unit = (DEG, 'deg') if one['unit'] == 'rad' else (MM, 'mm')
        values = [one['before'], one['value'], one['half_width_95']]
        values += [] if one['truth'] is None else [one['truth']]
        yield one['symbol'], [scale * value for value in values]
        yield f'{one["symbol"]} {scale * one["before"]:z.4f}', None
        yield f'+- {scale * one["half_width_95"]:.4f} {unit}', None
    yield 'residuals [mm] before rms / max after rms / max', None
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
    yield 'contraction rate per repetition: at most', values


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


def _of_commissioning(summary):
    yield 'payload', [*summary['pose']['tcp_m'], summary['pose']['payload_kg']]
    for row in summary['margins']:
        keys = ('phase_margin_deg', 'crossover_hz', 'gain_margin_db', 'gain_margin_hz')
        yield f'{row["gains"]} {row["axis"]} ', [row[key] for key in keys if row[key] is not None]
    for name, row in summary['workspace'].items():
        yield f'over the workspace {name}', [row['phase_deg'], row['gain_db']]
    if summary['proposal']:
        for name, value in summary['proposal']['gains'].items():
            yield f'{name} ', [summary['proposal']['before'][name], value]


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
    rows = summary['trajectories']
    for row in rows:
        condition = row['condition']
        yield f'{row["name"]}:', [row['samples'], condition['min'], condition['max']]
        for name in ('velocity', 'acceleration'):
            off = row['every_length_1_mm_off'][name]
            values = [
                row[which][name][key]['max']
                for which in ('exact', 'inexact')
                for key in ('of_peak', 'momentary')
            ]
            yield name, [*values, off['of_peak'], off['momentary']]
    most = [
        max(row['exact'][name]['of_peak']['max'] for row in rows) for name in ('velocity', 'acceleration')
    ]
    yield 'With exact lengths joint velocities deviate by at most', most
    inside, pose = summary['condition']['workspace'], summary['pose']
    low, high = (of(row['condition'][end] for row in rows) for of, end in ((min, 'min'), (max, 'max')))
    numbers = [low, high, inside['condition']['max'], 1.0, inside[pose]['least'], inside[pose]['largest']]
    yield 'On the trajectories cond(J) is', numbers


def _of_tuning(summary):
    load = summary['load']
    yield f'{load["name"]}:', [load['inertia_kg_m2'], load['gravity_n_m'], summary['speed_rad_s']]
    for change in summary['changes']:
        yield f'{change["parameter"]}:', [change['before'], change['after']]
    yield 'loop gains crossover phase m. gain m. delay m. Ms bandwidth rise overshoot settling', None
    yield 'velocity velocity velocity position cascade exchange', None
    yield 'inertia at shaft gains crossover phase m. gain m. phase m. Ms gain m.', None
    for name, one in summary['variants'].items():
        for loop, row in one['loops'].items():
            step = row.get('step') or {}
            values = [
                (row['crossover_hz'], 1.0), (row['phase_margin_deg'], 1.0), (row['gain_margin_db'], 1.0),
                (row['delay_margin_s'], MS), (row['sensitivity_peak'], 1.0), (row['bandwidth_hz'], 1.0),
                (step.get('rise_time_s'), MS), (step.get('overshoot'), PERCENT), (step.get('settling_time_s'), MS),
            ]  # fmt: skip
            yield f'{loop} {name}', [value * scale for value, scale in values if value is not None]
        for row in one['workspace']:
            speed, stable = row['velocity'], row['exchanged']['stable']
            values = [
                row['inertia_kg_m2'],
                speed['crossover_hz'],
                speed['phase_margin_deg'],
                speed['gain_margin_db'],
            ]
            values += [row['position']['phase_margin_deg'], row['cascade']['sensitivity_peak']]
            values += [row['exchanged']['gain_margin_db']] if stable else []
            yield f'kg m2 {name}', [value for value in values if value is not None]
        effect, borne = one['effect'], one['rejection']
        if effect['following_error_max_rad'] is not None:
            error = [DEG * effect[f'following_error_{key}_rad'] for key in ('max', 'rms')]
            tcp = [UM * effect[f'tcp_error_{key}_m'] for key in ('max', 'rms')]
            yield f'{name} following error', [*error, *tcp, effect['current_peak_a']]
        if borne is not None:
            back = [] if borne['back_s'] is None else [MS * borne['back_s']]
            values = [DEG * borne['peak_rad'], MS * borne['peak_s'], 5.0, *back, MS * borne['noise_a']]
            yield f'{name} the shaft deflects by', values
    for one in summary['recorded']:
        if one['trusted_hz'] is not None:
            near, margins = one['agreement'], one['margins'] or {}
            values = [*one['trusted_hz'], near['decibels'], near['degrees']]
            values += [margins.get('phase_margin_deg'), margins.get('gain_margin_db')]
            words = f'recorded, axis {one["axis"]}, {one["title"]}:'
            yield words, [value for value in values if value is not None]
    for point in summary['sweep']:
        over, error = point['overshoot'], point['effect']['following_error_max_rad']
        values = [loop['phase_margin_deg'] for loop in point['loops'].values()]
        values += [over[name] and PERCENT * over[name] for name in ('velocity', 'position')]
        values.append(error and DEG * error)
        yield f'{point["value"]:.5g}', [value for value in values if value is not None]


def _of_estimation(summary):
    for row in summary['estimates']:
        if (value := row['estimate']) is None:
            continue
        low, high, values = row['low_95'], row['high_95'], [value]
        if low is not None:
            even = abs(low + high - 2.0 * value) <= 1e-6 * (high - low)
            values += [(high - low) / 2.0] if even else [low, high]
            values += [95.0, PERCENT * row['half_width_relative']]
        if row['true'] is not None:
            values.append(PERCENT * row['error_relative'])
        yield row['quantity'], values
    facts = summary['identifiability']
    yield 'condition', [facts['condition'], facts['condition_of_columns']]
    for group in facts['collinear']:
        yield f'{", ".join(group["symbols"])} (index', [group['condition_index']]
    for signal in summary['residuals']:
        lag = [] if signal['white'] else [signal['lag']]
        yield f'{signal["signal"]} residuals', [signal['rms'], signal['sensor_noise'], *lag]
    for trial in summary.get('trials', ()):
        off = [PERCENT * trial['off']] if trial['off'] else []
        moved = PERCENT * max(map(abs, trial['moved']))
        values = [trial['step'], *off, moved, PERCENT * trial['error'], trial['excess']]
        yield f'data of {trial["data"]}, step', values


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
    yield 'mirror point', [MM * value for value in summary['mirror_point_m']]
    for words, row in zip(('Jacobian', '', ''), summary['jacobian_m_rad'], strict=True):
        yield words, row
    yield 'condition', [summary['condition'], *summary['singular_values_m_rad']]
    limits = {key: [one for one in summary['limits'] if one['quantity'] == key] for key in LIMITS_OF_A_POSE}
    for key, (words, unit, scale, what) in LIMITS_OF_A_POSE.items():
        own = limits[key]
        yield words, [*(scale * one[f'{what}{unit}'] for one in own), scale * own[0][f'limit{unit}']]
    yield 'N m at the arms', [*summary['holding_torque_n_m'], summary['payload_kg']]
    yield 'N m at the motors', [*summary['holding_motor_torque_n_m'], *summary['holding_current_a']]
    yield 'in every direction', [summary['speed_m_s']]
    gear = [] if summary['gear_torque_limit_n_m'] is None else [summary['gear_torque_limit_n_m']]
    yield 'acceleration', [summary['acceleration_m_s2'], *gear, summary['acceleration_nominal_m_s2']]
    yield 'payload', [summary['payload_max_kg']]
    yield 'nominal current and brakes hold', [summary['payload_held_kg'], summary['payload_peak_kg']]
    yield 'increment', [UM * summary['tcp_per_increment_m']]
    for one in summary['solutions']:
        if None not in one['arm_angles_rad']:
            where = 'within' if one['within_arm_limits'] else 'beyond'
            yield f'deg {where} the limits of the arms', [DEG * value for value in one['arm_angles_rad']]


# lines of the text, by a table of the study: words of the line, and its first other numbers; None: words alone
LINES = {
    'runs.csv': _of_sweep,
    'corrections.csv': _of_calibration,
    'repetitions.csv': _of_learning,
    'robots.csv': _of_line,
    'one_motor.csv': _of_one_motor,
    'best.csv': _of_optimisation,
    'ripple.csv': _of_ripple,
    'mechanics.csv': _of_commissioning,
    'table.csv': _of_experiment,
    'condition.csv': _of_jacobian,
    'effect.csv': _of_tuning,
    'estimates.csv': _of_estimation,
    'extremes.csv': _of_workspace,
    'moves.csv': _of_plan,
    'solutions.csv': _of_pose,
}

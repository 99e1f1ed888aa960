"""Figures of merit of tables of samples: the values of the summary, computed again from their columns.

A function per table, of the summary, the columns by their headings, and the name of the table; it yields a text, the
number of the table, that of the summary, and how far they may be apart, relative to it.
"""

import math

import numpy as np

from figures_read import FACTORS

EXACT, PRINTED = 1e-9, 1e-5  # columns in full, and of six digits


def largest(values):
    return float(np.nanmax(np.abs(np.asarray(values, float))))


def rms(values):
    values = np.asarray(values, float)
    return math.sqrt(np.mean(values[np.isfinite(values)] ** 2))


def stacked(columns, title, labels='123'):
    return np.stack([np.asarray(columns[title.format(label)], float) for label in labels], axis=-1)


def numbers(values):
    """Return a column as numbers; nan where a cell is empty."""
    return np.array([math.nan if value is None or value == '' else float(value) for value in values])


def sweep_runs(summary, columns, name):
    outcomes = [str(one) for one in columns['outcome']]
    yield 'runs', len(outcomes), summary['runs'], 0.0
    for kind, count in summary['outcomes'].items():
        yield f'runs {kind}', outcomes.count(kind), count, 0.0
    done = np.array([one == 'done' for one in outcomes])
    for one in summary['distributions']:
        values = numbers(columns[one['name']])[done]
        values = values[np.isfinite(values)]
        yield f'runs with {one["name"]}', len(values), one['runs'], 0.0
        yield f'mean of {one["name"]}', values.mean(), one['mean'], EXACT
        yield f'least {one["name"]}', values.min(), one['low'], EXACT
        yield f'greatest {one["name"]}', values.max(), one['high'], EXACT


def trials(summary, columns, name):
    outcomes = [str(one) for one in columns['outcome']]
    yield 'trials', len(outcomes), summary['trials'], 0.0
    for kind, count in summary['outcomes'].items():
        yield f'trials {kind}', outcomes.count(kind), count, 0.0
    within = np.array(columns['keeps limits']) == 'yes'
    yield 'trials within the limits', within.sum(), summary['trials_within_limits'], 0.0
    best = summary['best'] or summary['nearest']
    if best is None or best['trial'] not in columns['trial']:
        return
    row = list(columns['trial']).index(best['trial'])
    yield 'value of the best trial', columns[summary['goal']][row], best['value'], EXACT
    for key, value in best['values'].items():
        if isinstance(value, int | float):
            yield f'{key} of the best trial', columns[key][row], value, EXACT
    if summary['best']:
        values = numbers(columns[summary['goal']])[within]
        of = np.nanmax if summary['maximise'] else np.nanmin
        yield 'value of the best trial of all', of(values), best['value'], EXACT


def calibration_residuals(summary, columns, name):
    use = np.array(columns['use'])
    for word, what in (('fit', 'used'), ('check', 'not used')):
        for one in summary['left']:
            if one['what'] == what:
                own = use == word
                yield f'measurements {what}', own.sum(), one['count'], 0.0
                for end in ('before', 'after'):
                    left = np.asarray(columns[f'{end} [m]'], float)[own]
                    yield f'{what}: rms {end}', rms(left), one[f'{end}_rms_m'], EXACT
                    yield f'{what}: largest {end}', largest(left), one[f'{end}_max_m'], EXACT


def contractions(summary, columns, name):
    worst = summary['contraction']
    row = int(np.argmax(columns['rate']))
    for title, key in (('rate', 'rate'), ('frequency [Hz]', 'at_hz'), ('payload [kg]', 'payload_kg'),
                       ('masses', 'masses')):  # fmt: skip
        yield title, columns[title][row], worst[key], EXACT
    for axis, value in zip('xyz', worst['place_m'], strict=True):
        yield axis, columns[f'{axis} [m]'][row], value, EXACT


def of_belts(summary, columns):
    for belt in summary['belts']:
        own = np.array(columns['belt']) == belt['belt']
        yield belt, {title: np.array(values)[own] for title, values in columns.items()}


def line_minutes(summary, columns, name):
    for belt, own in of_belts(summary, columns):
        yield 'parts that came', own['came'].sum(), belt['offered'], 0.0
        yield 'parts that were picked', own['picked'].sum(), belt['picked'], 0.0
        yield 'parts that were missed', own['missed'].sum(), sum(belt['missed'].values()), 0.0
        yield 'minutes', len(own['minute']), math.ceil(60.0 * summary['hours']), 0.0


def line_missed(summary, columns, name):
    for belt, own in of_belts(summary, columns):
        for reason, count in belt['missed'].items():
            yield reason, (own['reason'] == reason).sum(), count, 0.0


def line_picks(summary, columns, name):
    for belt, own in of_belts(summary, columns):
        for robot in belt['robots']:
            cycles = own['cycle_s'][own['robot'] == robot['robot']].astype(float)
            yield f'picks of {robot["robot"]}', len(cycles), robot['picks'], 0.0
            if robot['picks']:
                yield f'cycle of {robot["robot"]}', cycles.mean(), robot['cycle_mean_s'], EXACT
        starts = own['start_s'].astype(float)
        yield 'picks out of order', np.count_nonzero(np.diff(starts) < 0.0), 0, 0.0


def one_motor(summary, columns, name):
    driven = columns['time [s]'] >= -1e-9
    columns = {title: values[driven] for title, values in columns.items()}
    near = 0.05  # the table has one row in four of the samples
    for title, key in (
        ('current [A]', 'current_peak_a'),
        ('speed [rad/s]', 'speed_max_rad_s'),
        ('voltage [V]', 'voltage_max_v'),
    ):
        yield title, largest(columns[title]), summary[key], near
    balance = (
        columns['torque [N m]']
        - columns['friction [N m]']
        - columns['load [N m]']
        - columns['coupling [N m]']
    )
    speed, scale = columns['speed [rad/s]'], largest(columns['speed [rad/s]'])
    turned = np.trapezoid(balance, columns['time [s]']) / summary['shaft_inertia_kg_m2']
    yield 'speed from the torques', scale + speed[0] + turned, scale + speed[-1], near
    phases = stacked(columns, 'I{}s [A]')
    yield 'sum of the phase currents', largest(phases.sum(axis=1)) + 1.0, 1.0, 1e-6


def plan(summary, columns, name):
    move = np.asarray(columns['move']).astype(int)
    time, way, speed = (columns[title] for title in ('time [s]', 'distance [m]', 'speed [m/s]'))
    coarse = 1e-3  # of integrals over samples
    yield 'distance by the speed', np.trapezoid(speed, time), way[-1] - way[0], coarse
    yield (
        'speed by the acceleration',
        1.0 + np.trapezoid(columns['acceleration [m/s2]'], time),
        1.0 + speed[-1],
        coarse,
    )
    steps = np.diff(np.stack([columns[f'{axis} [m]'] for axis in 'xyz']), axis=1)
    yield 'distance by the places', np.linalg.norm(steps, axis=0).sum(), way[-1] - way[0], coarse
    for row in summary['moves']:
        own = move == row['number']
        if len(move) > 50_000 or not own.any():
            continue  # thinned out
        time, way = (np.asarray(columns[title])[own] for title in ('time [s]', 'distance [m]'))
        yield f'start of move {row["number"]}', time[0] + 1.0, row['start_s'] + 1.0, EXACT
        yield f'time of move {row["number"]}', time[-1] - time[0], row['time_s'], 1e-6
        yield f'length of move {row["number"]}', way[-1] - way[0] + 1.0, row['length_m'] + 1.0, 1e-6
        for title, key in (
            ('TCP speed [m/s]', 'speed_max_m_s'),
            ('TCP acceleration [m/s2]', 'acceleration_max_m_s2'),
            ('TCP jerk [m/s3]', 'jerk_max_m_s3'),
        ):
            yield f'{title} of move {row["number"]}', largest(columns[title][own]), row[key], EXACT
        for title, key in (('motor speed {} [rad/s]', 'motor_speed_max_rad_s'),
                           ('motor torque {} [N m]', 'motor_torque_max_n_m')):  # fmt: skip
            for i, value in enumerate(row[key]):
                yield title, largest(columns[title.format(i + 1)][own]), value, EXACT


def compared_signals(summary, columns, name):
    time = np.asarray(columns['time [s]'])
    for row in summary['signals']:
        if row['column'] == 'all' or row['signal'] == 'current':
            continue
        column = f'{row["signal"]}_{row["column"]}' if row['column'] else row['signal']
        unit = next(
            title.rpartition(' [')[2][:-1] for title in columns if title.startswith(f'{column} model [')
        )
        factor = FACTORS[row['unit'].replace('^2', '2')] / FACTORS[unit.replace('^2', '2')]
        model, robot = (np.asarray(columns[f'{column} {who} [{unit}]']) for who in ('model', 'robot'))
        counted = (time > -1e-9) & np.isfinite(model + robot)
        for what, values, key in (('model', model, 'model_max'), ('robot', robot, 'robot_max'),
                                  ('apart', robot - model, 'deviation_max')):  # fmt: skip
            yield f'{column}: {what}', factor * largest(values[counted]), row[key], 1e-6


def jacobian_signals(summary, columns, name):
    for row in summary['trajectories']:
        own = np.array(columns['trajectory']) == row['name']
        yield f'samples of {row["name"]}', own.sum(), row['samples'], 0.0
        condition = np.array(columns['condition of J [1]'])[own].astype(float)
        for end, value in (('min', condition.min()), ('max', condition.max())):
            yield f'{end} of the condition', value, row['condition'][end], PRINTED
        for lengths in ('exact', 'inexact'):
            for quantity in ('velocity', 'acceleration'):
                title = f'{lengths} {quantity}_{{}} deviation of peak [%]'
                values = np.stack([numbers(columns[title.format(i)])[own] for i in (1, 2, 3)])
                of_peak = row[lengths][quantity]['of_peak']
                yield title, largest(values), of_peak['max'], PRINTED
                yield f'{title}, rms', rms(values), of_peak['rms'], PRINTED


def condition_of_poses(summary, columns, name):
    number = numbers(columns['condition of J [1]'])
    for decade in summary['condition']['decades']:
        own = (number >= decade['from']) & (number < decade['to'])
        yield f'poses from condition {decade["from"]:g} on', own.sum(), decade['poses'], 1e-3
        for pose in ('recorded', 'forward', 'inverse'):
            each = [
                numbers(values)[own] for title, values in columns.items() if title.startswith(f'{pose}: ')
            ]
            median = float(np.median(np.linalg.norm(each, axis=0)))
            yield f'{pose}, median', median, decade[pose]['median'], 1e-3


def following_error(summary, columns, name):
    for which, variant in summary['variants'].items():
        own = [values for title, values in columns.items() if title.startswith(f'{which}: following error')]
        if own:
            error = variant['effect']
            yield f'{which}, largest', largest(own), error['following_error_max_rad'], EXACT
            yield f'{which}, rms', rms(own), error['following_error_rms_rad'], EXACT
            yield (
                f'{which}, TCP',
                largest(columns[f'{which}: TCP error [m]']),
                error['tcp_error_max_m'],
                EXACT,
            )


def load_step(summary, columns, name):
    for which, variant in summary['variants'].items():
        if (one := variant['rejection']) is not None:
            own = np.abs(columns[f'{which}: deviation [rad]'])
            yield f'{which}, deviation', own.max(), one['peak_rad'], EXACT
            yield f'{which}, when', columns['time [s]'][int(np.argmax(own))], one['peak_s'], EXACT


def bode(summary, columns, name):
    loop, _, which = name.removeprefix('bode_').removesuffix('.csv').partition('_')
    if 'bench' in which:
        return
    row = summary['variants'][which or next(iter(summary['variants']))]['loops'][loop]
    at, size, phase = (np.asarray(columns[title]) for title in
                       ('frequency [Hz]', 'open loop [dB]', 'open loop [deg]'))  # fmt: skip

    def there(frequency, values):
        return float(np.interp(math.log(frequency), np.log(at), values))

    if row['crossover_hz'] is not None:
        yield 'magnitude at the crossover', there(row['crossover_hz'], size) + 100.0, 100.0, 1e-3
        margin = (there(row['crossover_hz'], phase) - row['phase_margin_deg']) % 360.0
        yield 'phase at the crossover', margin, 180.0, 1e-2
    if row['gain_margin_db'] is not None:
        level = there(row['gain_margin_hz'], size)
        yield 'gain margin', 100.0 - level, 100.0 + row['gain_margin_db'], 1e-3


def step(summary, columns, name):
    loop = name.removeprefix('step_').removesuffix('.csv')
    for which, variant in summary['variants'].items():
        if f'{which}: drive [1]' in columns:
            own, figures = np.asarray(columns[f'{which}: drive [1]']), variant['loops'][loop]['step']
            yield f'{which}, overshoot', 1.0 + max(own.max() - 1.0, 0.0), 1.0 + figures['overshoot'], EXACT
            if (settling := figures['settling_time_s']) is not None:
                time = np.asarray(columns['time [s]'])
                outside = time[np.abs(own - 1.0) > 0.02]
                yield f'{which}, unsettled', float((outside >= settling).sum()), 0.0, 0.0


def recorded(summary, columns, name):
    one = next(row for row in summary['recorded'] if f'recorded_{row["name"]}.csv' == name)
    trusted = np.asarray(columns['trusted [0/1]']) == 1.0
    if one['trusted_hz'] is None:
        return
    at = np.asarray(columns['frequency [Hz]'])
    low, high = one['trusted_hz']
    inside = (at >= low) & (at <= high)
    yield 'frequencies of the band', at[inside][0] / at[inside][-1], low / high, EXACT
    yield 'untrusted in the band', (~trusted[inside]).sum(), 0, 0.0
    size = np.asarray(columns[f'{one["title"]} [dB]']) - columns[f'{one["title"]}: linear [dB]']
    yield 'distance from the linear one [dB]', largest(size[inside]), one['agreement']['decibels'], 1e-6


def estimation_residuals(summary, columns, name):
    one = summary['residuals'][int(name.removeprefix('residuals_').removesuffix('.csv')) - 1]
    own = [values for title, values in columns.items() if title.startswith('residual of')]
    if len(own[0]) == one['samples'][0]:
        yield f'rms of {one["signal"]}', rms(own), one['rms'], EXACT
    assert all(f'residual of {one["signal"]}' in title for title in columns if title != 'time [s]')
    assert all(title.endswith(f'[{one["unit"]}]') for title in columns if title != 'time [s]')


def signals(summary, columns, name):
    yield from (jacobian_signals if 'trajectories' in summary else compared_signals)(summary, columns, name)


def commissioning_responses(summary, columns, name):
    when = name.removeprefix('responses_').removesuffix('.csv')
    for row in summary['margins']:
        if row['gains'] == when and row['crossover_hz'] is not None:
            trusted = columns[f'usable {row["axis"]} [1]'] > 0.0
            at, size = columns['frequency [Hz]'][trusted], columns[f'open loop {row["axis"]} [dB]'][trusted]
            level = float(np.interp(row['crossover_hz'], at, size))
            yield f'magnitude at the crossover of axis {row["axis"]}', 1.0 + level / 20.0, 1.0, 0.05


SERIES = {
    'responses_': commissioning_responses,
    'runs.csv': sweep_runs,
    'trials.csv': trials,
    'residuals.csv': calibration_residuals,
    'contractions.csv': contractions,
    'minutes.csv': line_minutes,
    'missed.csv': line_missed,
    'picks.csv': line_picks,
    'one_motor.csv': one_motor,
    'plan.csv': plan,
    'signals.csv': signals,
    'condition.csv': condition_of_poses,
    'following_error.csv': following_error,
    'load_step.csv': load_step,
    'bode_': bode,
    'step_': step,
    'recorded_': recorded,
    'residuals_': estimation_residuals,
}


def series_of(name):
    """Return the entry of the summary for a table of samples, or None."""
    return SERIES.get(name) or next(
        (make for begin, make in SERIES.items() if begin.endswith('_') and name.startswith(begin)), None
    )

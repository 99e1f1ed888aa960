"""The curves of each figure, in SI units, by the signals that its titles and labels name.

A function per figure, of the arguments of the function that draws it: it returns words of the title, and the panels.
"""

import itertools
import math

import numpy as np

from delta3_pacdrive.planning.limits.temperature import continuous_torque
from delta3_pacdrive.recording.signals import columns_of
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.studies.runs.run_signals import ZOOM_S, busiest, derivatives, program_part, slope
from figures_read import Panel, band, bars, level, line, mark

START = 'time from program start'


def norm(values):
    return np.linalg.norm(values, axis=1)


def whole_time(run):
    return START if run.meta.get('start_cycle') is not None else 'bus time'


def columns(run, names, **curves):
    """Return a panel for each column of signals over time, by the name of each curve."""
    return [
        Panel(whole_time(run), run.time_s, name, *(line(values[:, i], label) for label, values in curves.items()))
        for i, name in enumerate(names)
    ]  # fmt: skip


def arms(symbol):
    return [symbol.format(i) for i in (1, 2, 3)]


def on_arm(run, signal):
    return run[signal] / run.meta['gear_ratio']


# figures of a run


def tcp_path_3d(trace):
    run = program_part(trace)
    known = run['tcp_actual'][np.isfinite(run['tcp_actual']).all(axis=1)]
    curves = {
        'actual': run['tcp_actual'],
        'command': run['tcp_command'],
        'start': known[:1],
        'end': known[-1:],
    }
    return 'TCP path', [Panel('', None, '', *(line(values, name) for name, values in curves.items()))]


def arm_angles(trace):
    run = program_part(trace)
    shown = {'actual': on_arm(run, 'motor_position'), 'command': on_arm(run, 'motor_command')}
    return 'Arm angles', columns(run, arms(r'$\theta_{}$'), **shown)


def arm_velocities(trace):
    run = program_part(trace)
    actual, command = on_arm(run, 'motor_speed'), on_arm(run, 'motor_command')
    speed = derivatives(command, run.meta['cycle_time_s'])[0]
    degrees = np.degrees(command)  # other units may decide between equally fast changes otherwise
    begin = busiest(run.time_s, derivatives(degrees, run.meta['cycle_time_s'])[0])
    part = (run.time_s >= begin) & (run.time_s <= begin + ZOOM_S)
    panels = []
    for i, name in enumerate(arms(r'$\dot\theta_{}$')):
        for rows, label in ((slice(None), name), (part, f'{name} [deg/s]')):
            time_s = run.time_s[rows]
            curves = line(actual[rows, i], 'actual'), line(speed[rows, i], 'command')
            panels.append(Panel(whole_time(run), time_s, label, *curves))
    return 'Arm speeds', panels


def arm_accelerations(trace):
    run = program_part(trace)
    period = run.meta['cycle_time_s']
    actual = slope(on_arm(run, 'motor_speed'), period)
    command = derivatives(on_arm(run, 'motor_command'), period)[1]
    return 'Arm accelerations', columns(run, arms(r'$\ddot\theta_{}$'), actual=actual, command=command)


def currents(trace):
    run = program_part(trace)
    names = arms(r'$I_{{\mathrm{{eff}},{}}}$')
    if 'current_mean' not in run.signals:
        return 'Motor currents', columns(run, names, actual=run['current'])
    middle = run.time_s + 0.5 * run.meta['cycle_time_s']
    return 'Motor currents', [
        Panel(
            whole_time(run), run.time_s, name, line(run['current'][:, i], 'sample in the AT'),
            line(run['current_mean'][:, i], 'their mean', middle),
            band(run['current_min'][:, i], run['current_max'][:, i], 'all samples', middle),
        )
        for i, name in enumerate(names)
    ]  # fmt: skip


def tcp_components(trace):
    run = program_part(trace)
    return 'TCP position', columns(run, 'xyz', actual=run['tcp_actual'], command=run['tcp_command'])


def tcp_error_norm(trace):
    run = program_part(trace)
    raw, aligned = norm(run['tcp_command'] - run['tcp_actual']), norm(run['tcp_error'])
    return 'Norm of the TCP error', [
        Panel(whole_time(run), run.time_s, 'error', line(aligned), title='set-point delay removed'),
        Panel(whole_time(run), run.time_s, 'error', line(raw),
              title='raw difference of command and actual position'),
    ]  # fmt: skip


def following_error(trace):
    run = program_part(trace)
    return 'Following error of the arms', columns(run, arms('$e_{}$'), actual=run['following_error'])


def master(trace):
    run = program_part(trace)
    names = ('distance', 'speed', 'acceleration')
    return 'Virtual master', columns(run, names, **{'': run['master']})


def tcp_speed(trace):
    run = program_part(trace)
    command = derivatives(run['tcp_command'], run.meta['cycle_time_s'])
    rows = zip(
        ('speed', 'acceleration'), (run['tcp_velocity'], run['tcp_acceleration']), command, strict=True
    )
    return 'TCP speed and acceleration', [
        Panel(whole_time(run), run.time_s, name, line(norm(own), 'actual'), line(norm(wanted), 'command'))
        for name, own, wanted in rows
    ]


def turn(trace, suffix='', axis=''):
    run = program_part(trace)
    shown = (('angle', {'actual': 'turn_position', 'true': 'turn_true', 'command': 'turn_command'}),
             ('error', {'by the encoder, set-point delay removed': 'turn_error'}),
             ('current', {'sample of the AT': 'turn_current'}))  # fmt: skip
    return f'Turn of the tool{axis}', [
        Panel(whole_time(run), run.time_s, name,
              *(line(run[own + suffix][:, 0], label) for label, own in curves.items() if own + suffix in run.signals))
        for name, curves in shown
    ]  # fmt: skip


def turn_2(trace):
    return turn(trace, '_2', ' by axis 5')


def supply(trace):
    run = program_part(trace)
    shown = {'voltage': 'dc_link_voltage', 'mains': 'mains_power', 'brake resistor': 'resistor_power'}
    return 'DC link', [
        Panel(whole_time(run), run.time_s, name, line(run[signal][:, 0])) for name, signal in shown.items()
    ]


def signal_panels(trace, signal):
    run = program_part(trace)
    names = [name for name, _ in columns_of(signal, quantities.unit_of(signal) or '1')]
    return quantities.meaning_of(signal), [
        Panel(whole_time(run), run.time_s, name or signal, line(values))
        for name, values in zip(names, run[signal].T, strict=True)
    ]


def oscilloscope(record):
    first = record.first + (record.trigger or 0)
    time_s = record.time_s - first * record.setting.sample_time_s
    known = record.trigger is not None
    return 'Oscilloscope', [
        Panel(
            'time from the trigger' if known else 'time from the first sample', time_s, '',
            *(line(own, name) for name, of, own in zip(record.names, record.units, record.values.T, strict=True)
              if of == unit),
            *([mark(0.0)] if known else []),
        )
        for unit in dict.fromkeys(record.units)
    ]  # fmt: skip


# experiments: model, robot and reference


def compared(comparison, title, name, symbol, shown=None, marked=None):
    from delta3_pacdrive.studies.thesis.experiments.compared_signals import QUANTITIES

    begin, end = shown or (-math.inf, math.inf)
    rows = (comparison.time_s >= begin) & (comparison.time_s <= end)
    model, robot = comparison.model, comparison.robot
    referred = name in model.reference and name in robot.reference
    sampled = name == 'current' and all('current_at' in run.actual for run in (model, robot))
    of = QUANTITIES[name]
    panels = []
    for i, column in enumerate(of.columns):
        own = [run.actual[name][rows, i] for run in (model, robot)]
        curves = [line(own[0], 'model'), line(own[1], 'robot')]
        bands = []
        if sampled:
            both = [run.actual for run in (robot, model)]
            curves = [line(run['current_at'][rows, i]) for run in both] + curves
            bands = [band(run['current_min'][rows, i], run['current_max'][rows, i]) for run in both]
        apart = [line(own[1] - own[0])]
        if referred:
            told = [run.reference[name][rows, i] for run in (model, robot)]
            curves.append(line(told[0], 'reference'))
            apart = [line(own[1] - told[1], 'robot'), line(own[0] - told[0], 'model')]
        head = f'{"deviation from the reference" if referred else "robot - model"} [{of.shown_unit}]'
        time_s = comparison.time_s[rows]
        panels += [
            Panel(START, time_s, symbol.format(column), *curves, *bands),
            Panel(START, time_s, head, *apart, title=head.replace('^2', '²') if i == 0 else ''),
        ]
    return of.text.partition(' I_eff')[0], panels


def compared_paths(comparison, title):
    model, robot = comparison.model, comparison.robot
    told = model.reference.get('tcp', robot.reference.get('tcp'))
    measured = comparison.measured
    curves = [line(measured(model.actual['tcp']), 'model'), line(measured(robot.actual['tcp']), 'robot')]
    curves += [] if told is None else [line(measured(told), 'reference')]
    reference = measured(model.actual['tcp'] if told is None else told)
    for name, label in (('tcp', 'robot, deviation'), ('tcp_true', 'its true TCP, deviation')):
        if name in robot.actual and name in robot.reference:
            base, off = robot.reference[name], robot.actual[name] - robot.reference[name]
            both = measured(np.hstack([base, off]))
            most = 0.06 * max(1e3 * np.ptp(reference, axis=0).max(), 1.0)
            most /= max(1e3 * norm(both[:, 3:]).max(), 1e-9)
            times = max(a * 10.0**b for a in (1, 2, 5) for b in range(-9, 10) if a * 10.0**b <= most)
            curves.append(line(both[:, :3] + times * both[:, 3:], rf'{label} $\times$ {times:g}'))
    return 'TCP path', [Panel('', None, '', *curves)]


def compared_errors(comparison, title):
    words = {'tcp_error_norm': 'by forward kinematics of the encoders, set-point delay removed',
             'tcp_error_norm_true': 'true TCP of the real arms',
             'tcp_error_norm_raw': 'by the encoders, command and actual position of the same cycle'}  # fmt: skip
    return 'norm of the TCP error', [
        Panel(START, comparison.time_s, 'error', line(comparison.model.actual[name], 'model'),
              line(comparison.robot.actual[name], 'robot'), title=words[name])
        for name in words if name in comparison.names
    ]  # fmt: skip


def attributed(attribution, title):
    from delta3_pacdrive.studies.thesis.experiments.compared_signals import QUANTITIES

    names = [name for name in ('tcp_error_norm', 'current', 'arm_angle', 'tcp_error_norm_true')
             if (name, 'deviation') in attribution.outcomes]  # fmt: skip
    panels = []
    places = np.arange(len(attribution.effects))
    for name in names:
        one = attribution.outcomes[name, 'deviation']
        total = one.total or math.nan
        share, alone, lost = ([of[key] / total for key in attribution.effects]
                              for of in (one.share, one.alone, one.left_out))  # fmt: skip
        rms, of = math.sqrt(max(one.total, 0.0)), QUANTITIES[name]

        def check(axes, rms=rms, of=of):
            assert axes.get_title('left').endswith(f'\n{of.factor * rms:.2g} {of.shown_unit} rms')

        panels.append((Panel('share', None, '', bars([*share, one.other / total], 'share (Shapley)'),
                             line(places, 'effect alone', alone), line(places, 'without it', lost),
                             mark(0.0)), check))  # fmt: skip
    return title, panels


# the currents inside a bus cycle


def inside_a_cycle(found, cases):
    panels = [[], [], [], []]
    period = cases[0].cycle_time_s
    first = round(found.shown_s / period)
    begin, end = (first - 1) * period - 1e-9, (first + 2) * period
    for case in cases:
        s = case.samples
        rows = (s.time_s >= begin) & (s.time_s < end - 1e-9)
        told = (s.at_time_s >= begin) & (s.at_time_s < end + 1e-9)
        time_s, at_s = s.time_s[rows] - first * period, s.at_time_s[told] - first * period
        after = time_s + (s.time_s[1] - s.time_s[0])
        for n, (name, *curves) in enumerate((
            ('set point', line(s.set_point[rows] - s.set_point[rows][0], 'set point')),
            ('speed', line(s.speed_reference[rows], 'reference'), line(s.speed[rows], 'shaft')),
            ('current', line(s.current_reference[rows], 'reference'), line(s.current[rows], 'all samples', after),
             line(s.at_current[told], 'sample in the AT', at_s)),
            ('voltage', line(s.voltage[rows], 'of a phase')),
        )):  # fmt: skip
            title = case.interpolation if n == 0 else ''
            panels[n].append(
                Panel('time from the start of the bus cycle', time_s, name, *curves, title=title)
            )
    title = f'Inside a bus cycle of {1e3 * period:g} ms: {found.program}, motor {found.axis}'
    return title, [*itertools.chain(*panels)]


def ripple_currents(found):
    times = sorted({case.cycle_time_s for case in found.cases})
    names = list(dict.fromkeys(case.interpolation for case in found.cases))
    panels = {(time, name): lambda axes: None for time in times for name in names}
    for case in found.cases:
        s, steps = case.samples, round(case.cycle_time_s / (case.samples.time_s[1] - case.samples.time_s[0]))
        of_cycles = s.current[: len(s.at_time_s) * steps].reshape(-1, steps)
        middle = s.at_time_s + 0.5 * case.cycle_time_s
        i = found.axis - 1
        note = (f'{case.current_peak_a[i]:.2f} / {case.current_rms_a[i]:.2f} A, AT '
                f'{case.at_current_peak_a[i]:.2f} / {case.at_current_rms_a[i]:.2f} A')  # fmt: skip

        def check(axes, note=note):
            assert [one.get_text() for one in axes.texts] == [note]

        panels[case.cycle_time_s, case.interpolation] = Panel(
            START, middle, 'current', line(of_cycles.mean(axis=1), 'mean of a cycle'),
            line(s.at_current, 'sample in the AT', s.at_time_s),
            band(of_cycles.min(axis=1), of_cycles.max(axis=1), 'all samples'),
            title=f'{1e3 * case.cycle_time_s:g} ms, {case.interpolation}',
        ), check  # fmt: skip
    return f'Motor currents: {found.program}, motor {found.axis}', list(panels.values())


def repetitions(found):
    numbers, kept = [one.number for one in found.repetitions], found.repetitions
    curves = (line([one.tcp_error_max_m for one in kept], 'largest'),
              line([one.tcp_error_rms_m for one in kept], 'rms'))  # fmt: skip
    return 'Learning', [Panel('repetition', numbers, 'TCP error', *curves, mark(found.best.number))]


def before_and_after(found):
    before, after = norm(found.before_m), norm(found.after_m)
    motors = [line(found.learned.torques[:, i], f'motor {i + 1}') for i in range(3)]
    rows = (
        ('TCP error', line(before, 'before'), line(after, 'after')),
        ('after', line(after)),
        ('learned', *motors),
    )
    return 'Before and after learning', [Panel(START, found.time_s, *row) for row in rows]


# one motor


def of_driven(found, title, *rows):
    """Return panels over the time in which the motor is driven: a name, and curves by their labels."""
    driven = found.driven
    return f'{title}: {found.program}, arm {found.axis}', [
        Panel(
            START,
            found.time_s[driven],
            name,
            *(line(values[driven], label) for label, values in curves.items()),
        )
        for name, curves in rows
    ]


def motor_and_drive(found):
    return of_driven(
        found, 'Figure 8.2: one MC-4, one motor',
        ('position', {'command on the bus': found.command, 'shaft': found.position}),
        ('deviation', {'set point less shaft': found.position_error,
                       'shaft in the robot less this one': found.in_robot - found.position}),
        ('speed', {'reference': found.speed_reference, 'shaft': found.speed}),
        ('current', {'reference': found.current_reference, '$I_{eff}$': found.current}),
    )  # fmt: skip


def phase_currents(found):
    return of_driven(
        found, 'Figure 8.3: currents of the motor',
        ('current', {f'$I_{{{n + 1}s}}$': found.phase_currents[:, n] for n in range(3)}),
        ('current', {'$I_{eff}$': found.current}), ('voltage', {'of a phase, rms': found.voltage}),
    )  # fmt: skip


def torques(found):
    rest = found.torque - found.friction - found.load - found.coupling
    return of_driven(
        found, 'Figure 8.4: motor with the coupling as input',
        ('torque', {'$K_m I_{eff}$': found.torque, 'friction': found.friction,
                    r'$\tau_{load} / k_r$': found.load, 'CE d': found.coupling}),
        ('torque', {'remainder': rest, 'inertia times acceleration': found.inertia_kg_m2 * found.acceleration}),
    )  # fmt: skip


# plans


def virtual_master(found):
    s = found.samples
    longest = max(found.rows, key=lambda row: row.length_m)
    here = int(np.searchsorted(s.time_s, longest.start_s + 0.4 * longest.duration_s))
    time, way = s.time_s[here], s.distance_m[here]
    marks = line([0.0, way, way], x=[time, time, s.time_s[-1]]), line(way, x=time)
    panels = [Panel(START, s.time_s, 's', line(s.distance_m), *marks)]
    for n, name in enumerate('xyz'):
        own = s.position_m[:, n]
        panels.append(Panel('s', s.distance_m, name, line(own), line(own[here], x=way), mark(way)))
    return 'Virtual master and slaves', [
        *panels,
        Panel('s', s.distance_m, 'speed', line(s.speed_m_s), mark(way)),
    ]


def position_and_velocity(found):
    s = found.samples
    panels = [Panel(START, s.time_s, 'distance', line(s.distance_m)),
              Panel(START, s.time_s, 'speed', line(s.tcp_speed_m_s), line(s.speed_limit_m_s))]  # fmt: skip
    for name, space, along, limit in (
        ('acceleration', s.tcp_acceleration_m_s2, s.acceleration_m_s2, s.acceleration_limit_m_s2),
        ('jerk', s.tcp_jerk_m_s3, s.jerk_m_s3, s.jerk_limit_m_s3),
    ):
        curves = (
            line(space, 'norm in space'),
            line(along, 'along the path'),
            line(limit, 'limit of the program'),
        )
        panels.append(Panel(START, s.time_s, name, *curves, line(-limit)))
    return 'Position and velocity path', panels


def path_points(found):
    points = found.samples.position_m

    def check(axes):
        (pieces,) = [one for one in axes.collections if hasattr(one, 'get_segments')]
        speed = found.samples.tcp_speed_m_s
        np.testing.assert_allclose(pieces.get_array(), 0.5 * (speed[1:] + speed[:-1]), rtol=1e-12)
        joints = np.array(axes.lines[0].get_data_3d()).T
        apart = np.linalg.norm(joints[:, None] - 1e3 * points[None], axis=2).min(axis=1)
        assert apart.max() < 5.0, 'a point of the path is not on it'
        for n, place in ((1, points[0]), (2, points[-1])):
            np.testing.assert_allclose(np.ravel(axes.lines[n].get_data_3d()), 1e3 * place, rtol=1e-12)
        assert [one.get_label() for one in axes.lines] == ['points of the path', 'start', 'end']

    def scale(axes):
        assert axes.get_xlabel() == 'TCP speed [m/s]'

    return 'Points of the path', [check, scale]


def over_path(found):
    s = found.samples
    starts = [s.distance_m[np.searchsorted(s.move, row.number)] for row in found.rows[1:]]
    marks = [mark(place) for place in starts] if len(found.rows) <= 40 else []
    rows = (('TCP speed', s.tcp_speed_m_s, s.speed_limit_m_s),
            ('TCP acceleration', s.tcp_acceleration_m_s2, s.acceleration_limit_m_s2),
            ('TCP jerk', s.tcp_jerk_m_s3, s.jerk_limit_m_s3), ('curvature', s.curvature_1_m))  # fmt: skip
    return 'Over the path', [
        Panel('distance along the path', s.distance_m, name, *map(line, curves), *marks)
        for name, *curves in rows
    ]


def motors(found, robot):
    s, motor, arm = found.samples, robot.motor, robot.kinematics
    peak, nominal = (motor.torque_constant_n_m_a * a for a in (motor.peak_current_a, motor.nominal_current_a))
    gear = robot.gear.acceleration_torque_n_m
    fastest = motor.max_speed_rpm * math.tau / 60.0
    panels = []
    for name, values, limits in (
        ('arm angle', s.arm_angle_rad, np.radians([arm.arm_angle_min_deg, arm.arm_angle_max_deg])),
        ('motor speed', s.motor_speed_rad_s, (-fastest, fastest)),
        ('motor torque', s.motor_torque_n_m, (-peak, peak, -nominal, nominal)),
        ('gear torque', s.gear_torque_n_m, (-gear, gear)),
    ):
        near = [level(one) for one in limits if abs(one) <= 2.0 * np.abs(values).max()]
        curves = [line(values[:, i], f'axis {i + 1}') for i in range(3)]
        panels.append(Panel(START, s.time_s, name, *curves, *near))
    return 'Arms and motors', panels


def continuous(found, robot):
    s = found.samples
    speed, torque = (np.abs(one) for one in (s.motor_speed_rad_s, s.motor_torque_n_m))
    weights = np.gradient(s.time_s)

    def panel(axes):
        assert (axes.get_xlabel(), axes.get_ylabel()) == ('motor speed [rpm]', 'motor torque [N m]')
        curve, *motors = axes.lines
        rpm = curve.get_xdata()
        # the end of the curve is the largest speed, where rounding must not decide
        expected = continuous_torque(rpm[:-1] * math.tau / 60.0, robot)
        np.testing.assert_allclose(curve.get_ydata()[:-1], expected, rtol=1e-9)
        for i in range(3):
            samples, mean = motors[2 * i : 2 * i + 2]
            np.testing.assert_allclose(samples.get_xdata(), speed[:, i] * 60.0 / math.tau, rtol=1e-12)
            np.testing.assert_array_equal(samples.get_ydata(), torque[:, i])
            expected = np.sqrt(
                np.average(np.stack([speed[:, i], torque[:, i]]) ** 2, axis=1, weights=weights)
            )
            found_rms = np.concatenate([mean.get_xdata() * math.tau / 60.0, mean.get_ydata()])
            np.testing.assert_allclose(found_rms, expected, rtol=1e-9)
        labels = [one.get_label() for one in axes.lines if not one.get_label().startswith('_')]
        assert labels == [
            f'S1 at {robot.thermal.ambient_degc:g} degC',
            *(f'axis {i + 1}, rms' for i in range(3)),
        ]

    return 'Continuous torque', [panel]


def limits(found):
    s = found.samples
    shown = {quantity: values for quantity, values in s.used.items() if values.max() > 0.0}

    def leading(axes):
        quantities = list(type(next(iter(s.used))))
        colours = {}
        for one in axes.figure.legends[0].get_patches():
            colours[one.get_facecolor()] = one.get_label()
        spans = [(one.get_x(), colours[one.get_facecolor()]) for one in axes.patches]
        changes = [0, *np.flatnonzero(np.diff(s.leading)) + 1]
        assert spans == [(s.time_s[n], quantities[s.leading[n]].value) for n in changes]
        assert axes.get_title('left') == 'the first limit that a faster plan would break'

    upper = Panel(START, s.time_s, 'share of the limit', *(line(own) for own in shown.values()), level(1.0))
    return 'What limits the plan', [upper, leading]

"""The curves of each figure of a study, in SI units, as ``figure_contents`` has those of runs."""

import math

import numpy as np

import figure_contents as runs
from delta3_pacdrive.planning.limits.capability import REACHED
from delta3_pacdrive.studies.drives.commissioning.responses import usable
from delta3_pacdrive.studies.drives.loops.response import decibels, degrees
from delta3_pacdrive.studies.fleet.line.report import by_minute
from delta3_pacdrive.studies.fleet.sweep.effects import effects as effects_of
from delta3_pacdrive.studies.framework.figure_style import label_of_key
from delta3_pacdrive.studies.places.workspace.evaluation import LIMITS
from delta3_pacdrive.studies.thesis.jacobian import condition
from delta3_pacdrive.studies.thesis.jacobian.mapping import LENGTHS, Pose
from figures_read import FACTORS, RAD, Panel, band, bars, dots, level, line, mark

PERCENT = 1e-2


def axis_of(key):
    """Return name and factor from the numbers of a key to SI units."""
    name, bracket, unit = label_of_key(key).partition(' [')
    return name, 1.0 / FACTORS.get(unit.rstrip(']'), 1.0) if bracket else 1.0


# sweeps and optimisations


def distributions(found, names):
    panels = []
    for name in names:
        values = found.kept[name][found.done & np.isfinite(found.kept[name])]
        counts = np.histogram(values, bins=min(60, max(10, len(values) // 20)))[0]
        limit = [mark(found.sweep.limits[name] * axis_of(name)[1])] if name in found.sweep.limits else []
        panels.append(Panel(axis_of(name)[0], None, 'runs', bars(counts), *limit))
    return f'{found.sweep.name}: distributions', panels


def sweep_effects(found, names):
    panels = []
    for name in names:
        rows = [one for one in effects_of(found) if one.name == name]
        if not rows:
            continue
        sobol = all(np.isfinite(one.total) for one in rows)
        rows.sort(key=lambda one: one.total if sobol else one.share)
        curves = [bars([one.share for one in rows])]
        if sobol:
            curves = [
                bars([one.first for one in rows], 'alone'),
                bars([one.total for one in rows], 'with others'),
            ]
        panels.append(
            Panel('share of its variance', None, '', *curves, title=name, ticks=[one.key for one in rows])
        )
    return f'{found.sweep.name}: sources of variance', panels


def scatter(found, name, keys):
    rows = np.flatnonzero(found.done & np.isfinite(found.kept[name]))[:5000]
    y_name, scale = axis_of(name)
    limit = [level(found.sweep.limits[name] * scale)] if name in found.sweep.limits else []
    panels = []
    for key in keys:
        x_name, along = axis_of(key)
        x = found.values[key][rows].astype(float) * along
        panels.append(Panel(x_name, x, y_name, line(found.kept[name][rows] * scale), *limit))
    return f'{found.sweep.name}: {name}', panels


def told(found):
    good, other = [], []
    for one in found.trials:
        if found.value(one) is not None:
            (good if one.keeps_limits else other).append(one)
    return good, other


def history(found):
    goal, scale = axis_of(found.optimisation.goal)
    good, other = told(found)
    curves = []
    for own, label in ((good, 'within the limits'), (other, 'beyond a limit')):
        if own:
            values = [scale * one.kept[found.optimisation.goal] for one in own]
            curves.append(dots([one.number for one in own], values, label))
    if good:
        best, steps = None, []
        for one in good:
            value = scale * one.kept[found.optimisation.goal]
            better = best is None or (value > best if found.optimisation.maximise else value < best)
            best = value if better else best
            steps.append(best)
        numbers = [*(one.number for one in good), len(found.trials)]
        curves.append(line([*steps, best], 'best so far', numbers))
    if (base := found.value(found.base)) is not None:
        curves.append(level(scale * base, 'values of the files'))
    return f'{found.optimisation.sweep.name}: history', [Panel('trial', None, goal, *curves)]


def trial_values(found):
    goal, scale = axis_of(found.optimisation.goal)
    good, other = told(found)
    best = [] if found.best is None else [found.best]
    panels = []
    for key in [one.key for one in found.optimisation.sweep.vary][:12]:
        name, along = axis_of(key)
        curves = []
        for own in (other, good, best):
            x = [one.values[key] for one in own]
            numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in x)
            x = [along * one for one in x] if numbers else None
            curves.append(dots(x, [scale * one.kept[found.optimisation.goal] for one in own]))
        panels.append(Panel(name, None, goal, *curves))
    return f'{found.optimisation.sweep.name}: values', panels


def importance(found):
    keys = list(found.importance)[:12][::-1]
    shares = bars([found.importance[key] for key in keys])
    return f'{found.optimisation.sweep.name}: importance', [Panel('share', None, '', shares, ticks=keys)]


# lines


def robots(results):
    picks, busy, names = [], [], []
    for belt in results.belts:
        for number, name in enumerate(belt.robots):
            own = belt.robot == number
            names.append(name)
            picks.append(own.sum() / results.line.shift_s)
            busy.append(belt.cycle_s[own].sum() / results.line.shift_s)
    return f'{results.line.name}: robots', [
        Panel('', None, 'picks', bars(picks), ticks=names),
        Panel('', None, 'busy', bars(busy), ticks=names),
    ]


def minutes(results):
    panels = []
    for belt in results.belts:
        counts = by_minute(belt, results.line.shift_s)
        step = -(-len(counts[0]) // 60)
        edges = range(0, len(counts[0]), step)
        curves = [
            line([np.mean(of[n : n + step]) / 60.0 for n in edges], label)
            for of, label in zip(counts, ('came', 'picked', 'missed'), strict=True)
        ]
        panels.append(Panel('time', 60.0 * np.array(edges), f'{belt.belt}: parts', *curves))
    return f'{results.line.name}: parts', panels


def belt_rates(result, *panels):
    made = []
    for name, key, factor in panels:
        curves = []
        for limit in result['limits']:
            rows = [
                one
                for one in result['rows']
                if one['speed_m_s'] == limit['speed_m_s'] and one[key] is not None
            ]
            rates = [one['rate_per_min'] / 60.0 for one in rows]
            curves.append(line([factor * one[key] for one in rows], f'{limit["speed_m_s"]:g} m/s', rates))
        made.append(Panel('parts', None, name, *curves))
    return 'Picking from a belt', made


def belt_picks(result):
    return belt_rates(result, ('picks', 'picks_per_min', 1.0 / 60.0), ('picked', 'share', 1.0))


def belt_errors(result):
    return belt_rates(result, ('rms error', 'error_rms_m', 1.0), ('largest error', 'error_max_m', 1.0))


# tuning


def together(items, alike):
    names = list(items)
    if len(names) == 2 and alike(items[names[0]], items[names[1]]):
        return {' and '.join(names): items[names[0]]}
    return items


def steps(variants):
    titles = ('Current loop, shaft held', 'Velocity loop', 'Position loop')
    panels = []
    for n, title in enumerate(titles):
        loops = together(
            {name: one.loops[n] for name, one in variants.items()},
            lambda a, b: bool(a.step and b.step) and np.array_equal(a.step.drive, b.step.drive),
        )
        curves = []
        for name, loop in loops.items():
            if loop.step is None:
                continue
            label = f'drive, {name}' + ('' if loop.stable else ': unstable')
            curves.append(line(loop.step.drive, label, loop.step.time_s))
            if loop.stable:
                curves.append(line(loop.step.linear, 'linear', loop.step.time_s))
        name = 'actual value, share of the step' if n == 0 else '[1]'
        panels.append(Panel('time', None, name, *curves, level(1.0), title=title))
    return 'Step responses', panels


def turned(measured, frequencies, linear):
    """Return the phase of a measured response [deg] on the turn of the linear one."""
    near = np.interp(np.log(measured.frequencies_hz), np.log(frequencies), degrees(linear))
    phase = np.degrees(np.angle(measured.values))
    return phase + 360.0 * np.round((near - phase) / 360.0)


def points(measured, frequencies, linear, label, rows=None):
    """Return magnitudes and phases of a measured response as curves; none where no frequency is shown."""
    rows = measured.trusted if rows is None else rows
    if not rows.any():
        return [], []
    at, phase = measured.frequencies_hz[rows], turned(measured, frequencies, linear)[rows]
    return [line(decibels(measured.values)[rows], label, at)], [line(phase / RAD, '', at)]


def bode(results):
    results = together(results, lambda a, b: np.array_equal(a.open_loop, b.open_loop) and a.fault == b.fault)
    first = next(iter(results.values()))
    opened, closed = ([], []), ([], [])

    def add(pair, curves):
        for whole, own in zip(pair, curves, strict=True):
            whole.extend(own)

    for name, one in results.items():
        label = f'linear, {name}' + ('' if one.stable else ': unstable')
        at, values = one.frequencies_hz, one.open_loop
        add(opened, ([line(decibels(values), label, at)], [line(degrees(values) / RAD, '', at)]))
        if one.measured_open is not None:
            add(opened, points(one.measured_open, at, values, f'drive, {name}'))
        m = one.margins
        if m.phase_margin_deg is not None and m.crossover_hz is not None:
            add(opened, ([line(0.0, '', m.crossover_hz)], [margin_line(m, at, values)]))
        if m.gain_margin_db is not None and m.gain_margin_hz is not None:
            label = f'gain margin {m.gain_margin_db:.1f} dB at {hertz(m.gain_margin_hz)}'
            ends = line([-m.gain_margin_db, 0.0], '', [m.gain_margin_hz] * 2)
            add(opened, ([ends], [line(-math.pi, label, m.gain_margin_hz)]))
    for one in results.values():
        if one.closed_loop is None or not one.stable:
            continue
        at = one.frequencies_hz[: len(one.closed_loop)]
        curves = [line(decibels(one.closed_loop), '', at)], [line(degrees(one.closed_loop) / RAD, '', at)]
        add(closed, curves)
        if one.measured_closed is not None:
            add(closed, points(one.measured_closed, at, one.closed_loop, ''))
        if one.bandwidth_hz is not None:
            add(closed, ([line(-3.0, f'bandwidth {hertz(one.bandwidth_hz)}', one.bandwidth_hz)], []))
    pairs = [(opened, 0.0, [level(-math.pi)])]
    if first.closed_loop is not None:
        pairs.append((closed, -3.0, []))
    top = [Panel('frequency', None, 'magnitude', *own[0], level(at)) for own, at, _ in pairs]
    bottom = [Panel('frequency', None, 'phase', *own[1], *more) for own, _, more in pairs]
    titles = {'current': 'Current loop', 'velocity': 'Velocity loop', 'position': 'Position loop',
              'cascade': 'All loops'}  # fmt: skip
    return titles[first.name], top + bottom


def margin_line(m, at, values):
    """Return the phase margin as a line from -180 deg, on the turn of the open loop."""
    phase = float(np.interp(np.log(m.crossover_hz), np.log(at), degrees(values)))
    turn = 360.0 * round((phase - (m.phase_margin_deg - 180.0)) / 360.0)
    ends = np.array([-180.0, m.phase_margin_deg - 180.0]) + turn
    label = f'phase margin {m.phase_margin_deg:.0f} deg at {hertz(m.crossover_hz)}'
    return line(ends / RAD, label, [m.crossover_hz] * 2)


def hertz(value):
    return f'{value:.0f} Hz' if value >= 100.0 else f'{value:.3g} Hz'


def measured_response(one, loop):
    at, own = one.measured.frequencies_hz, one.measured
    pair = [line(decibels(one.linear), 'linear')], [line(degrees(one.linear) / RAD)]
    bench = None
    if loop is not None:
        bench = loop.measured_closed if one.name == 'current' else loop.measured_open
    shown = [(own, 'recorded', own.trusted), (own, 'recorded, not trusted', ~own.trusted)]
    if bench is not None:
        inside = (bench.frequencies_hz >= at[0]) & (bench.frequencies_hz <= at[-1])
        shown.append((bench, 'drive on the bench', inside))
    for measured, label, rows in shown:
        for whole, more in zip(pair, points(measured, at, one.linear, label, rows), strict=True):
            whole.extend(more)
    band_hz = own.band_hz()
    title = 'nothing is trusted' if band_hz is None else (
        f'trusted (shaded): {band_hz[0]:.3g} to {band_hz[1]:.4g} Hz')  # fmt: skip
    return f'Recorded: {one.title}, axis {one.axis}', [
        Panel('frequency', at, 'magnitude', *pair[0], title=title),
        Panel('frequency', at, 'phase', *pair[1]),
        Panel('frequency', at, 'coherence', line(own.coherence)),
    ]


def accepted_following_error(ran, program):
    curves = [line(ran.following_error_rad[:, number], f'axis{number + 1}') for number in range(3)]
    return f'Following error: {program}', [Panel('time', ran.time_s, 'following error', *curves)]


def commissioned_loop(name, measured):
    def magnitude(axes):
        shown = [one for one in axes.lines if one.get_label().startswith('axis')]
        assert len(shown) == len(measured.responses)
        for one, response in zip(shown, measured.responses, strict=True):
            kept = usable(response.cascade)
            assert np.allclose(one.get_ydata()[kept], decibels(response.cascade.values[kept]))
        assert axes.get_ylabel() == 'magnitude [dB]'

    def phase(axes):
        assert axes.get_ylabel() == 'phase [deg]'

    at = measured.responses[0].cascade.frequencies_hz
    coherence = [line(one.cascade.coherence) for one in measured.responses]
    return f'All loops, open at the current set point: {name}', [
        (magnitude,),
        (phase,),
        Panel('frequency', at, 'coherence', *coherence),
    ]


def commissioned_inertia(measured, mechanics):
    def panel(response, fitted):
        def check(axes):
            drawn = {one.get_label(): one for one in axes.lines}
            kept = response.inertia.trusted
            points = drawn[f'axis {response.axis + 1}, measured'].get_ydata()
            assert np.allclose(points, 1e4 * np.abs(response.inertia.values[kept]))
            hertz, fit = drawn['fit'].get_data()
            assert np.allclose(fit, 1e4 * np.abs(fitted.curve(hertz)))
            assert drawn['model'].get_ydata()[0] == 1e4 * fitted.model_inertia_kg_m2
            assert axes.get_ylabel() == '[kg cm2]'

        return (check,)

    return 'Inertia at the pose, motor side', [
        panel(response, fitted) for response, fitted in zip(measured.responses, mechanics, strict=True)
    ]


def tuning_effects(variants):
    axes = next((v.effect.axes for v in variants.values() if len(v.effect.time_s)), (1, 2, 3))
    effects = {name: variant.effect for name, variant in variants.items()}
    shown = together(
        effects,
        lambda a, b: len(a.time_s) > 0 and np.array_equal(a.following_error_rad, b.following_error_rad),
    )
    ran = {name: one for name, one in shown.items() if len(one.time_s)}
    panels = [
        Panel(
            'time from the start of the program', None,
            f'arm {axis}' if axis != 4 else 'motor of the tool',
            *(line(one.following_error_rad[:, i], name if i == 0 else '', one.time_s) for name, one in ran.items()),
        )
        for i, axis in enumerate(axes)
    ]  # fmt: skip
    errors = (line(one.tcp_error_m, '', one.time_s) for one in ran.values())
    return 'Following error of the program', [
        *panels,
        Panel('time from the start of the program', None, 'TCP error', *errors),
    ]


def load_step(variants):
    borne = {name: variant.rejection for name, variant in variants.items() if variant.rejection}
    shown = together(borne, lambda a, b: np.array_equal(a.deviation_rad, b.deviation_rad))
    curves = [
        line(one.deviation_rad, f'{name}; current by noise of the encoder {1e3 * one.noise_a:.1f} mA rms', one.time_s)
        for name, one in shown.items()
    ]  # fmt: skip
    return 'Step of the load by 1 N m, motor side', [
        Panel('time', None, 'deviation of the shaft', *curves, level(0.0))
    ]


def gain_sweep(points, swept):
    values = [point.value for point in points]

    def of(read, scale=1.0):
        return [math.nan if (v := read(point)) is None else scale * v for point in points]

    names = [loop.name for loop in points[0].loops]
    rows = (
        ('following error of the arm',
         *(line(of(lambda p, k=key: getattr(p.effect, f'following_error_{k}_rad')), key) for key in ('max', 'rms'))),
        ('phase margin',
         *(line(of(lambda p, n=n: p.loops[n].margins.phase_margin_deg, 1.0 / RAD), name)
           for n, name in enumerate(names)),
         level(0.0)),
        ('overshoot of a step',
         *(line(of(lambda p, n=n: p.overshoot[p.loops[n].name] if p.loops[n].stable else None), name)
           for n, name in enumerate(names))),
    )  # fmt: skip
    return f'Sweep of {swept}', [Panel(swept, values, *row) for row in rows]


# the Jacobian


def of_trial(trial, names, values):
    return [
        Panel('time', trial.motion.time_s, name, line(own)) for name, own in zip(names, values.T, strict=True)
    ]


def jacobian_angles(trial):
    return 'arm angles', of_trial(trial, runs.arms(r'$\theta_{}$'), trial.motion.theta)


def jacobian_tcp(trial):
    return 'TCP position', of_trial(trial, 'xyz', trial.motion.tcp)


def three(trial, errors, quantity, recorded, i):
    return (
        line(getattr(trial.exact, quantity)[:, i], 'through J, exact lengths'),
        line(getattr(trial.inexact, quantity)[:, i], f'through J, {errors}'),
        line(recorded[:, i], 'recorded'),
    )


def joint_velocities(trial, errors):
    time_s, own = trial.motion.time_s, trial.motion.thetadot
    return 'joint velocities', [
        Panel('time', time_s, name, *three(trial, errors, 'velocity', own, i))
        for i, name in enumerate(runs.arms(r'$\dot\theta_{}$'))
    ]


def share_of_peak(calculated, recorded):
    own = np.abs(recorded).max(axis=0)
    return (calculated - recorded) / np.maximum(own, 0.01 * own.max())


def momentary(calculated, recorded):
    own = np.abs(recorded).max(axis=0)
    known = np.abs(recorded) > 0.05 * np.maximum(own, 0.01 * own.max())
    return np.where(known, (calculated - recorded) / np.where(known, recorded, 1.0), np.nan)


def velocity_deviation(trial, errors, said=''):
    motion, panels = trial.motion, []
    series = (trial.exact.velocity, 'exact lengths'), (trial.inexact.velocity, errors)
    courses = [one for one in trial.courses if one.quantity == 'velocity']
    limit = [] if motion.thesis is None else [
        level(sign * PERCENT * motion.thesis.deviation_percent, 'largest in the thesis') for sign in (-1.0, 1.0)
    ]  # fmt: skip
    for i in range(3):
        for share, more in ((share_of_peak, courses), (momentary, [])):
            curves = [line(share(values, motion.thetadot)[:, i], label) for values, label in series]
            curves += [line(PERCENT * one.of_peak[:, i], one.name) for one in more]
            title = {share_of_peak: 'share of the peak',
                     momentary: 'share of the momentary value, above 5 % of peak'}[share]  # fmt: skip
            panels.append(
                Panel('time', motion.time_s, f'joint {i + 1}', *curves, *limit, title=title if i == 0 else '')
            )
    return 'deviation of the joint velocities', panels


def joint_acceleration(trial, joint, errors, said=''):
    motion, i = trial.motion, joint - 1
    deviations = [
        line(share_of_peak(own.acceleration, motion.thetaddot)[:, i], label)
        for own, label in ((trial.exact, 'through J, exact lengths'), (trial.inexact, f'through J, {errors}'))
    ]
    courses = [one for one in trial.courses if one.quantity == 'acceleration']
    deviations += [line(PERCENT * one.of_peak[:, i], one.name) for one in courses]
    return f'acceleration of joint {joint}', [
        Panel('time', motion.time_s, rf'$\ddot\theta_{joint}$',
              *three(trial, errors, 'acceleration', motion.thetaddot, i)),
        Panel('time', motion.time_s, 'deviation', *deviations),
    ]  # fmt: skip


def causes(trials, errors):
    panels = []
    for quantity, recorded in (('velocity', 'thetadot'), ('acceleration', 'thetaddot')):
        groups = []
        for trial in trials:
            calculated, own = getattr(trial.inexact, quantity), getattr(trial.motion, recorded)
            largest = np.abs(share_of_peak(calculated, own)).max()
            others = [PERCENT * one.of_peak for one in trial.causes if one.quantity == quantity]
            groups.append(bars([largest, *others], trial.motion.name))
        names = [errors, *(one.name for one in trials[0].causes if one.quantity == quantity)]
        panels.append(Panel('', None, quantity, *groups, ticks=names))
    panels[1].names['x'] = ''
    return 'What makes calculated and recorded joint motion differ', panels


def jacobian_sensitivities(trials):
    panels = []
    for quantity in ('velocity', 'acceleration'):
        for pose in Pose:
            groups = [
                bars([PERCENT * getattr(row, quantity).of_peak for row in trial.sensitivities if row.pose is pose],
                     trial.motion.name)
                for trial in trials
            ]  # fmt: skip
            panels.append(Panel('', None, quantity, *groups))
    for panel in panels[len(Pose) :]:
        panel.ticks = [f'${symbol}$' for symbol in LENGTHS]
    return 'Deviation by 1 mm of error of one length', panels


def deviation_over_condition(found, arm):
    z = 0.5 * (arm.workspace_top_m + arm.workspace_bottom_m)
    ray = condition.along(np.array([[0.0, 0.0, z]]), np.array([[0.0, 1.0, 0.0]]), arm)
    bins = np.floor(4 * np.log10(found.condition)).astype(int)
    middle = 10.0 ** ((np.unique(bins) + 0.5) / 4)
    clouds, bands, medians, rays = [], [], [], []
    for pose in Pose:
        total = PERCENT * found.total(pose)
        low, half, high = np.transpose(
            [np.percentile(total[bins == n], (5.0, 50.0, 95.0)) for n in np.unique(bins)]
        )
        clouds.append(dots(found.condition, total))
        bands.append(band(low, high, '', middle))
        medians.append(line(half, '', middle))
        rays.append(line(PERCENT * ray.total(pose), '', ray.gap_m))
    worst = 'deviation in the worst direction'
    return 'Deviation of the joint velocities, each length 1 mm off', [
        Panel('condition number of J', None, worst, *clouds, *bands, *medians),
        Panel('distance to the singularity', None, worst, *rays, title=f'along y at z = {z:.3g} m'),
        Panel('', None, 'condition number of J (dashed)', line(ray.condition, '', ray.gap_m)),
    ]


# places: workspace, pose, calibration


def quantity_map(found, slices, parameters, quantity):
    scale = FACTORS.get(quantity.shown_unit, 1.0)
    known = [scale * grid.values[quantity.key] for grid in found.slices]
    assert (quantity.unit, quantity.shown_unit) in ((quantity.unit, quantity.unit), ('m', 'um'))

    def check(axes, values, plane):
        (filled, *_) = [one for one in axes.collections if hasattr(one, 'levels')]
        assert (filled.zmin, filled.zmax) == (np.nanmin(values), np.nanmax(values))
        places(axes, plane, parameters.kinematics)

    of = (lambda axes, v=v, p=p: check(axes, v, p) for v, p in zip(known, slices, strict=True))
    unit = {'': '', 'um': ' [µm]', 'm/s2': ' [m/s$^2$]'}.get(quantity.shown_unit, f' [{quantity.shown_unit}]')
    return f'{quantity.title[0].upper()}{quantity.title[1:]}{unit}', list(of)


def places(axes, plane, arm):
    """Require names of both coordinates, and the outline of the workspace in millimetres."""
    names = [name for n, name in enumerate('xyz') if n != plane.axis]
    assert [axes.get_xlabel(), axes.get_ylabel()] == [f'{name} [mm]' for name in names]
    assert axes.get_title('left') == f'{"xyz"[plane.axis]} = {1e3 * plane.position_m:g} mm'
    radius = 500.0 * arm.workspace_diameter_m
    for one in axes.patches:
        if plane.axis == 2:
            assert one.get_radius() == radius
        else:
            half = (
                math.hypot(radius, 0.0)
                if plane.position_m == 0.0
                else math.sqrt(radius**2 - 1e6 * plane.position_m**2)
            )
            assert (one.get_width(), one.get_height()) == (
                2.0 * half, 1e3 * arm.workspace_top_m - 1e3 * arm.workspace_bottom_m,
            )  # fmt: skip
            assert (one.get_x(), one.get_y()) == (-half, 1e3 * arm.workspace_bottom_m)


def reach_map(found, slices, parameters):
    from matplotlib.colors import to_hex

    def check(axes, codes, plane):
        (mesh,) = axes.collections
        coloured = mesh.cmap(mesh.norm(np.ma.getdata(mesh.get_array()).ravel()))
        names = {to_hex(one.get_facecolor()): one.get_label() for one in axes.figure.legends[0].get_patches()}
        wanted = np.squeeze(codes, axis=plane.axis).T.ravel()
        some = slice(None, None, 97)
        assert [names[to_hex(one)] for one in coloured[some]] == [LIMITS[code] for code in wanted[some]]
        assert LIMITS[REACHED] == 'the robot may be here'
        places(axes, plane, parameters.kinematics)

    pairs = zip(found.slices, slices, strict=True)
    return 'Reachable positions', [lambda axes, g=g, p=p: check(axes, g.limit, p) for g, p in pairs]

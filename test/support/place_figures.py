"""The curves of figures of places and estimates, in SI units, and the table of the contents of all figures."""

import math

import numpy as np

import figure_contents as runs
import study_figures as studies
from delta3_pacdrive.studies.estimation.identifiability import Verdict
from delta3_pacdrive.studies.estimation.thesis_setup import ATTEMPT_STEPS, FACTORS, STEPS, SYMBOLS
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, NORM_COLOUR
from delta3_pacdrive.studies.thesis.two_link_arm import kinematics as two_link
from figures_read import RAD, Panel, agree, bars, level, line, look, mark

PERCENT, MM = 1e-2, 1e3

# poses


def radial(arm):
    """Return the horizontal directions of the three arms, shape (3, 3)."""
    azimuth = np.array(arm.arm_azimuth_rad)
    return np.stack([np.cos(azimuth), np.sin(azimuth), 0.0 * azimuth], axis=-1)


def elbows_of(theta, arm):
    """Return shoulders and elbows of three arm angles [m], shapes (3, 3)."""
    out = radial(arm)
    shoulders = np.array(arm.base_radii_m)[:, None] * out
    bend = np.cos(theta)[:, None] * out - np.sin(theta)[:, None] * [0.0, 0.0, 1.0]
    return shoulders, shoulders + np.array(arm.upper_arm_lengths_m)[:, None] * bend


def places_of(axes):
    """Return the curves of axes in space [m] by colour, each of shape (n, 3)."""
    found = {}
    for one in axes.lines:
        found.setdefault(look(one)[0].upper(), []).append(np.transpose(one.get_data_3d()) / MM)
    return found


def near(found, expected, what):
    """Require that one of the curves is the expected one."""
    assert any(one.shape == np.shape(expected) and np.abs(one - expected).max() < 1e-9 for one in found), (
        f'{what}: {expected} is not drawn'
    )


def stands(axes, theta, point, arm):
    """Require the robot of a pose: its upper arms and its TCP."""
    found = places_of(axes)
    for colour, shoulder, elbow in zip(AXIS_COLOURS, *elbows_of(theta, arm), strict=True):
        near(found[colour.upper()], [shoulder, elbow], 'upper arm')
    near(found[NORM_COLOUR.upper()], [point], 'TCP')


def blocks(axes, first, second, name):
    texts = [one.get_text() for one in axes.texts if one.get_text()]
    assert texts == [name, *(text for pair in zip(first, second, strict=True) for text in pair)], texts


def coordinates(point):
    return [f'${name}$ = {MM * value:z.2f} mm' for name, value in zip('xyz', point, strict=True)]


def angles(theta):
    return [rf'$\theta_{i + 1}$ = {RAD * value:z.2f}°' for i, value in enumerate(theta)]


def written(point):
    return f'({", ".join(f"{MM * value:z.3f}" for value in point)}) mm'


def forward_kinematics(pose, robot):
    theta, point = pose.arm_angle_rad, pose.point_m

    def space(axes):
        stands(axes, theta, point, robot.kinematics)
        texts = [one.get_text() for one in axes.texts]
        assert [text for text in texts if text.startswith('TCP')] == [f'TCP {written(point)}'], texts
        assert [rf'$\theta_{i}$' for i in (1, 2, 3)] == [text for text in texts if 'theta' in text]

    def head(axes):
        blocks(axes, angles(theta), coordinates(point), 'forward\nkinematics')

    return 'Forward kinematics', [space, head]


def inverse_kinematics(pose, robot):
    point, arm = pose.point_m, robot.kinematics
    outward, inward = pose.solutions[0].arm_angle_rad, pose.solutions[7].arm_angle_rad

    def head(axes):
        blocks(axes, coordinates(point), angles(outward), 'inverse\nkinematics')

    turn = np.linspace(0.0, math.tau, 181)
    ring = np.stack([np.cos(turn), np.sin(turn)])
    panels = []
    for i, out in enumerate(radial(arm)):
        across = np.array([-out[1], out[0], 0.0])
        centre = np.array([arm.base_radius_m, 0.0])
        wrist = np.array([point @ out + arm.plate_radius_m, point[2]])
        reach = math.sqrt(arm.forearm_length_m**2 - (point @ across) ** 2)
        curves = []
        for middle, radius, label in (
            (centre, arm.upper_arm_length_m, 'reach of the elbow, radius $l_A$'),
            (wrist, reach, r'reach of the forearm, radius $\sqrt{l_B^2 - y^2}$'),
        ):
            x, y = middle[:, None] + radius * ring
            curves.append(line(y, label, x))
        for angle, label in ((inward[i], 'elbow inward'), (outward[i], 'elbow outward')):
            bend = centre + arm.upper_arm_length_m * np.array([math.cos(angle), -math.sin(angle)])
            assert (
                np.linalg.norm(wrist - bend) == np.float64(reach)
                or abs(np.linalg.norm(wrist - bend) - reach) < 1e-9
            )
            curves += [line([centre[1], bend[1]], label, [centre[0], bend[0]]),
                       line([bend[1], wrist[1]], '', [bend[0], wrist[0]]), line(bend[1], '', bend[0])]  # fmt: skip
        curves += [line(centre[1], '', centre[0]), line(wrist[1], '', wrist[0])]
        title = rf'arm {i + 1}: $\theta_{i + 1}$ = {RAD * outward[i]:z.1f}°, or {RAD * inward[i]:z.1f}°'
        panels.append(Panel('outward', None, 'z', *curves, title=title))
    return 'Inverse kinematics', [head, *panels]


def eight_solutions(pose, robot):
    def check(axes, n, one):
        stands(axes, one.arm_angle_rad, pose.point_m, robot.kinematics)
        where = 'the robot works here' if n == 0 else "within the arms' limits"
        where = where if one.is_legal else "beyond the arms' limits"
        degrees = ', '.join(f'{RAD * angle:z.0f}°' for angle in one.arm_angle_rad)
        assert [text.get_text() for text in axes.texts] == [', '.join(one.elbows), f'{degrees}: {where}']

    return f'All eight solutions for {written(pose.point_m)}', [
        lambda axes, n=n, one=one: check(axes, n, one) for n, one in enumerate(pose.solutions)
    ]


def three_spheres(pose, robot):
    arm = robot.kinematics
    centres = elbows_of(pose.arm_angle_rad, arm)[1] - arm.plate_radius_m * radial(
        arm
    )  # spheres meet in the TCP

    def check(axes):
        found = places_of(axes)
        for n, colour in enumerate(AXIS_COLOURS):
            near(found[colour.upper()], [centres[n]], 'elbow')
            rods = [one for one in axes.lines if look(one)[0] == colour.lower() and len(one.get_xdata()) == 2]
            dashed = [one.is_dashed() for one in rods]
            forearms = [one for one in found[colour.upper()] if len(one) == 2]
            for end, is_dashed in ((pose.point_m, False), (pose.mirror_m, True)):
                own = [one for one, other in zip(forearms, dashed, strict=True) if other is is_dashed]
                near(own, [centres[n], end], 'forearm')
                assert abs(np.linalg.norm(end - centres[n]) - arm.forearm_length_m) < 1e-9
        marks = [one for one in axes.lines if look(one)[0] == NORM_COLOUR.lower()]
        for one, end, is_filled in zip(marks, (pose.point_m, pose.mirror_m), (True, False), strict=True):
            agree(np.ravel(one.get_data_3d()), MM * end, 'where the spheres meet')
            assert (one.get_markerfacecolor() != 'white') is is_filled
        (circle,) = [one for one in found['#222222'] if len(one) > 10]
        for centre in centres[:2]:
            assert np.abs(np.linalg.norm(circle - centre, axis=1) - arm.forearm_length_m).max() < 1e-9
        texts = [one.get_text() for one in axes.texts]
        assert texts == [f'elbow {n}' for n in (1, 2, 3)] + [
            f'TCP {written(pose.point_m)}', f'above the elbow plane {written(pose.mirror_m)}',
        ]  # fmt: skip

    return 'Three spheres of radius $l_B$ around the elbows', [check]


# estimation


def estimates(rows):
    shown = list(reversed(rows))
    known = any(row['true'] is not None for row in rows)
    left, right = [], []
    for place, row in enumerate(shown):
        if row['estimate'] is None:
            left.append(line(place, '', 0.0))
            continue
        reference = row['estimate'] if row['true'] is None else row['true']
        start, value = ((row[key] - reference) / row['scale'] for key in ('start', 'estimate'))
        half = row['half_width_relative'] or 0.0
        left += [line([place, place], '', [start, value]), line(place, '', start), line(place, '', value)]
        right += [line([place - 0.3, place + 0.3], '', [half, half]), line([place, place], '', [1e-8, half])]
        if known:
            right.append(line(place, '', max(abs(row['error_relative']), 1e-8)))
    return 'Estimates', [
        Panel(f'distance from the {"truth" if known else "estimate"}', None, '', *left,
              ticks=[row['quantity'] for row in shown]),
        Panel('share of the value', None, '', *right, mark(0.01)),
    ]  # fmt: skip


def estimation_sensitivities(fit, problem):
    report = fit.identifiability
    findings = list(reversed(report.findings))
    groups = []
    for name in dict.fromkeys(block.name for block in problem.blocks):
        own = [k for k, block in enumerate(problem.blocks) if block.name == name]
        groups.append(
            bars([math.hypot(*(one.sensitivity_by_block[k] for k in own)) for one in findings], name)
        )
    names = [one.symbol + ('' if one.verdict is Verdict.IDENTIFIABLE else ' *') for one in findings]
    values, seen = np.array(report.singular_values), report.rank
    hidden = [line(values[:seen].min() / 3.0, '', n) for n in range(seen + 1, len(values) + 1)]
    last = 'singular value' + (' (x: below threshold)' if hidden else '')
    change = 'change of the signals for 100 % of the value'
    return 'Sensitivities of the signals', [
        Panel(change, None, '', *groups, mark(1.0), ticks=names),
        Panel(last, None, '', line(values[:seen], '', np.arange(1, seen + 1)), *hidden,
              title=f'condition {report.condition:.3g}'),
    ]  # fmt: skip


def residuals(fit, problem):
    panels = []
    for block, array, white in zip(problem.blocks, fit.residuals, fit.whiteness, strict=True):
        every = -(-len(array) // 3000)
        curves = [line(column[::every], label) for column, label in zip(array.T, block.columns, strict=True)]
        title = f'rms {white.rms:.3g} {block.unit}, sensor noise {block.sigma:.3g} {block.unit}'
        panels.append(Panel('time [s]', block.times(len(array))[::every], block.name, *curves, title=title))

        def right(axes, white=white):
            (stems,) = [one for one in axes.collections if hasattr(one, 'get_segments')]
            ends = np.array([one[1] for one in stems.get_segments()])
            shown = white.autocorrelation[:60]
            agree(ends[:, 1], shown, 'autocorrelation')
            agree(ends[:, 0], np.arange(len(shown)), 'lag')
            assert axes.get_title('left') == 'autocorrelation'

        panels.append(right)
    return 'Residuals', panels


def quotients(study):
    left, right = [], []
    for symbol in SYMBOLS:
        own = [one for one in study.quotients if one.symbol == symbol]
        true = [one for one in own if one.step >= 1e-5]
        left += [line([one.through_encoder for one in own], '', STEPS),
                 line([one.ideal for one in true], '', [one.step for one in true])]  # fmt: skip
        right.append(line([one.agreement for one in own], symbol, STEPS))
    step = 'step, share of the value'
    return 'Difference quotients of the current in the closed loop', [
        Panel(step, None, 'length of the quotient', *left, title='with encoders (solid), true slope (dashed)'),
        Panel(step, None, 'cosine to the true slope', *right),
    ]  # fmt: skip


def attempts(study):
    off = max(one.off for one in study.attempts)
    groups = [
        bars([max(abs(m), 1e-6) for m in one.moved], f'step {step:.2g}')
        for step in ATTEMPT_STEPS
        for one in study.attempts
        if one.step == step and one.off == off
    ]
    costs = [line(np.maximum(study.profiles[symbol], 0.03), symbol) for symbol in SYMBOLS]
    return 'The estimation of chapter 9, repeated', [
        Panel('', None, 'change of the value by the estimation', *groups, level(off / (1.0 + off)), ticks=SYMBOLS,
              title=f'from values {100.0 * off:g} % off, default settings'),
        Panel('factor on the true value', FACTORS, 'cost above its minimum', *costs, level(3.84)),
    ]  # fmt: skip


# calibration


def poses(title, points, checks, robot):
    used, not_used = points[~checks].T, points[checks].T
    panels = []
    for n in (1, 2):
        names = ('to estimate from', 'to check with') if n == 1 else ('', '')
        curves = [line(of[n], name, of[0]) for of, name in zip((used, not_used), names, strict=True)]
        panels.append(Panel('x', None, 'xyz'[n], *curves))
    arm = robot.kinematics

    def outline(axes):
        (one,) = axes.patches
        low, high = MM * arm.workspace_bottom_m, MM * arm.workspace_top_m
        size = (one.get_width(), one.get_height())
        wide = MM * arm.workspace_diameter_m
        expected = (wide, wide) if hasattr(one, 'radius') else (wide, high - low)
        np.testing.assert_allclose(size, expected, rtol=1e-12)

    return title, [(panel, outline) for panel in panels]


def plan_of(found, robot):
    return poses('Poses to be measured', found.points_m, found.checks, robot)


def measured_poses(found, robot):
    return poses('Measured poses', found.points_m, found.measurements.checks, robot)


def calibration_residuals(found):
    checks, curves = found.measurements.checks, []
    number = np.arange(1, len(checks) + 1)
    for values, word in zip(found.residuals_m, ('before', 'after'), strict=True):
        shown = np.maximum(values, 1e-7)
        curves.append(line(shown[~checks], f'{word}, used', number[~checks]))
        if checks.any():
            curves.append(line(shown[checks], f'{word}, not used', number[checks]))
    return 'Measurement less robot, before and after', [Panel('measurement', None, 'residual', *curves)]


def corrections(found):
    truth = found.truth or (math.nan,) * len(found.estimates)
    panels = []
    for symbol in dict.fromkeys(one.symbol for one in found.estimates):
        curves = []
        for one, true in zip(found.estimates, truth, strict=True):
            if one.symbol == symbol:
                for value in (one.value, one.value - one.half_width, one.value + one.half_width, true):
                    curves.append(line(value, '', one.arm))
        greek = {'alpha': r'$\alpha$', 'theta': r'$\theta$'}.get(symbol, f'${symbol}$')
        unit = {'m': 'mm', 'rad': 'deg'}[next(one.unit for one in found.estimates if one.symbol == symbol)]
        panels.append(Panel('arm', None, f'{greek} [{unit}]', *curves, title=f'{greek} [{unit}]'))
    return 'Corrections of the arms', panels


# the two-link arm


def ring_of(radius, label):
    azimuth = np.linspace(-math.pi, math.pi, 361)
    return line(radius * np.sin(azimuth), label, radius * np.cos(azimuth))


def circles(arm):
    outer, inner = arm.outer_reach_m, arm.inner_reach_m
    return (
        ring_of(outer, rf'singular, stretched: $\theta_2$ = 0°, r = {outer:.3g} m'),
        ring_of(inner, rf'singular, folded: $\theta_2$ = ±180°, r = {inner:.3g} m'),
    )


def two_solutions(arm, point):
    poses = {branch: two_link.inverse(np.asarray(point, float), arm, branch) for branch in two_link.Branch}

    def check(axes, branch, theta, other):
        drawn = [one.get_xydata() for one in axes.lines]
        for number, own in ((0, other), (None, theta)):
            knee = arm.lower_arm_length_m * np.array([math.cos(own[0]), math.sin(own[0])])
            tool = knee + arm.upper_arm_length_m * np.array([math.cos(sum(own)), math.sin(sum(own))])
            assert np.abs(tool - point).max() < 1e-9
            if number == 0:
                agree(drawn[0], np.stack([0.0 * knee, knee, tool]), 'other solution')
            else:
                agree(drawn[1], np.stack([0.0 * knee, knee]), 'lower arm')
                agree(drawn[2], np.stack([knee, tool]), 'upper arm')
                agree(drawn[4], tool[None], 'tool')
        first, second = np.degrees(theta)
        assert axes.get_title() == rf'{branch.value}: $\theta_1 = {first:z.1f}$°, $\theta_2 = {second:z.1f}$°'
        assert (axes.get_xlabel(), axes.get_ylabel() or 'y [m]') == ('x [m]', 'y [m]')

    (one, first), (two, second) = poses.items()
    return 'Both solutions for the point', [
        lambda axes: check(axes, one, first, second),
        lambda axes: check(axes, two, second, first),
    ]


def two_link_workspace(arm):
    best = math.hypot(arm.lower_arm_length_m, arm.upper_arm_length_m)
    curves = (*circles(arm), ring_of(best, rf'largest: $\theta_2$ = ±90°, r = {best:.3g} m'))

    def measure(axes):
        (mesh,) = [one for one in axes.collections if type(one).__name__ == 'QuadMesh']
        corners = mesh.get_coordinates()
        r2 = (corners**2).sum(axis=-1)
        a, b = arm.lower_arm_length_m, arm.upper_arm_length_m
        sine = np.sqrt(np.clip(1.0 - ((r2 - a * a - b * b) / (2.0 * a * b)) ** 2, 0.0, None))
        np.testing.assert_allclose(np.ravel(mesh.get_array()), a * b * sine.ravel(), atol=1e-6 * a * b)

    return 'Workspace, manipulability and singular circles', [(Panel('x', None, 'y', *curves), measure)]


def manipulability(arm):
    theta_2 = np.linspace(-math.pi, math.pi, 4001)
    theta = np.stack([0.0 * theta_2, theta_2], axis=-1)
    product = arm.lower_arm_length_m * arm.upper_arm_length_m * np.abs(np.sin(theta_2))
    marks = [mark(angle) for angle in (-math.pi, 0.0, math.pi)]
    number = np.linalg.cond(two_link.jacobian(theta, arm))
    return 'Manipulability and condition of the Jacobian', [
        Panel(r'$\theta_2$', theta_2, r'$|\det\,J|$', line(product), *marks),
        Panel(r'$\theta_2$', theta_2, 'condition number of J', line(number), *marks),
    ]


def joint_speeds(arm):
    width = arm.outer_reach_m - arm.inner_reach_m
    plane, rows = list(circles(arm)), ([], [], [])
    for share in (0.2, 0.05, 0.005):
        y = arm.inner_reach_m + share * width
        end = math.sqrt((arm.outer_reach_m - share * width) ** 2 - y * y)
        x = np.linspace(-end, end, 4001)
        points = np.stack([x, np.full(4001, y)], axis=-1)
        theta = two_link.inverse(points, arm, two_link.Branch.ELBOW_DOWN)
        j = two_link.jacobian(theta, arm)
        speeds = np.linalg.solve(j, np.broadcast_to([[1.0], [0.0]], (4001, 2, 1)))[..., 0]
        plane.append(line(points[:, 1], f'line {share * width:.2g} m from the circles', x))
        for row, values in zip(rows, (*speeds.T, np.abs(np.linalg.det(j))), strict=True):
            row.append(line(values, '', x))
    for pose in theta[::1000]:
        knee = arm.lower_arm_length_m * np.array([math.cos(pose[0]), math.sin(pose[0])])
        tool = two_link.forward(pose, arm)
        plane.append(line([0.0, knee[1], tool[1]], '', [0.0, knee[0], tool[0]]))
    names = (r'$\dot\theta_1$', r'$\dot\theta_2$', r'$|\det\,J|$')
    below = zip(('[m]', '[m]', 'x of the tool'), names, rows, strict=True)
    return 'Joint speeds on straight lines at 1 m/s, elbow down', [
        Panel('x', None, 'y', *plane),
        *(Panel(x, None, name, *row) for x, name, row in below),
    ]


CONTENTS = {
    'runs.run_figures.tcp_path_3d': runs.tcp_path_3d,
    'runs.run_figures.arm_angles': runs.arm_angles,
    'runs.run_figures.arm_velocities': runs.arm_velocities,
    'runs.run_figures.arm_accelerations': runs.arm_accelerations,
    'runs.run_figures.currents': runs.currents,
    'runs.run_figures.tcp_components': runs.tcp_components,
    'runs.run_figures.tcp_error_norm': runs.tcp_error_norm,
    'runs.run_figures.following_error': runs.following_error,
    'runs.run_figures.master': runs.master,
    'runs.run_figures.tcp_speed': runs.tcp_speed,
    'runs.run_figures.turn': runs.turn,
    'runs.run_figures.turn_2': runs.turn_2,
    'runs.run_figures.supply': runs.supply,
    'runs.run_figures.signal_panels': runs.signal_panels,
    'runs.scope_figure.figure_of': runs.oscilloscope,
    'thesis.experiments.figures.panels': runs.compared,
    'thesis.experiments.figures.tcp_path': runs.compared_paths,
    'thesis.experiments.figures.tcp_error_norm': runs.compared_errors,
    'thesis.experiments.figures.effects': runs.attributed,
    'drives.commissioning.figures.following_error': studies.accepted_following_error,
    'drives.commissioning.figures.loop': studies.commissioned_loop,
    'drives.commissioning.figures.inertia': studies.commissioned_inertia,
    'drives.ripple.figures.inside_a_cycle': runs.inside_a_cycle,
    'drives.ripple.figures.currents': runs.ripple_currents,
    'learning.figures.repetitions': runs.repetitions,
    'learning.figures.before_and_after': runs.before_and_after,
    'drives.one_motor.figures.motor_and_drive': runs.motor_and_drive,
    'drives.one_motor.figures.phase_currents': runs.phase_currents,
    'drives.one_motor.figures.torques': runs.torques,
    'places.planning.figures.virtual_master': runs.virtual_master,
    'places.planning.figures.position_and_velocity': runs.position_and_velocity,
    'places.planning.figures.path_points': runs.path_points,
    'places.planning.figures.over_path': runs.over_path,
    'places.planning.figures.motors': runs.motors,
    'places.planning.figures.limits': runs.limits,
    'places.planning.figures.continuous': runs.continuous,
    'fleet.sweep.figures.distribution_figure': studies.distributions,
    'fleet.sweep.figures.effect_figure': studies.sweep_effects,
    'fleet.sweep.figures.scatter_figure': studies.scatter,
    'fleet.optimisation.figures.history_figure': studies.history,
    'fleet.optimisation.figures.value_figure': studies.trial_values,
    'fleet.optimisation.figures.importance_figure': studies.importance,
    'fleet.line.figures.robots_figure': studies.robots,
    'fleet.line.figures.minutes_figure': studies.minutes,
    'delta3_pacdrive.benchmarks.belts.picks': studies.belt_picks,
    'delta3_pacdrive.benchmarks.belts.errors': studies.belt_errors,
    'drives.tuning.figures.steps': studies.steps,
    'drives.tuning.figures.bode': studies.bode,
    'drives.tuning.figures.measured_response': studies.measured_response,
    'drives.tuning.figures.effects': studies.tuning_effects,
    'drives.tuning.figures.load_step': studies.load_step,
    'drives.tuning.figures.sweep': studies.gain_sweep,
    'thesis.jacobian.figures.arm_angles': studies.jacobian_angles,
    'thesis.jacobian.figures.tcp_position': studies.jacobian_tcp,
    'thesis.jacobian.figures.joint_velocities': studies.joint_velocities,
    'thesis.jacobian.figures.velocity_deviation': studies.velocity_deviation,
    'thesis.jacobian.figures.joint_acceleration': studies.joint_acceleration,
    'thesis.jacobian.figures.causes': studies.causes,
    'thesis.jacobian.figures.sensitivities': studies.jacobian_sensitivities,
    'thesis.jacobian.figures.deviation_over_condition': studies.deviation_over_condition,
    'places.workspace.figures.quantity_map': studies.quantity_map,
    'places.workspace.figures.reach_map': studies.reach_map,
    'places.pose.figures.forward_kinematics': forward_kinematics,
    'places.pose.figures.inverse_kinematics': inverse_kinematics,
    'places.pose.figures.eight_solutions': eight_solutions,
    'places.pose.figures.three_spheres': three_spheres,
    'estimation.figures.estimates': estimates,
    'estimation.figures.sensitivities': estimation_sensitivities,
    'estimation.figures.residuals': residuals,
    'estimation.figures.quotients': quotients,
    'estimation.figures.attempts': attempts,
    'calibration.figures.plan_of': plan_of,
    'calibration.figures.measured_poses': measured_poses,
    'calibration.figures.residuals': calibration_residuals,
    'calibration.figures.corrections': corrections,
    'thesis.two_link_arm.figures.solutions': two_solutions,
    'thesis.two_link_arm.figures.workspace': two_link_workspace,
    'thesis.two_link_arm.figures.manipulability_over_theta_2': manipulability,
    'thesis.two_link_arm.figures.joint_speeds_along_lines': joint_speeds,
}

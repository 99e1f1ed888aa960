"""Tests of the two-link arm (thesis chapter 3) against an independent model: links as complex numbers."""

import json
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import FigureError, ParameterError, SingularityError, UnreachableError
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.thesis.two_link_arm import figures, kinematics
from delta3_pacdrive.studies.thesis.two_link_arm.kinematics import Branch, TwoLinkArm
from thoroughness import some

ARM = TwoLinkArm(0.4, 0.3)
ARMS = [ARM, TwoLinkArm(0.3, 0.4), TwoLinkArm(0.5, 0.5), TwoLinkArm(0.1, 0.9), TwoLinkArm(200.0, 150.0)]
FIGURES = ['arm_solutions.png', 'arm_workspace.png', 'arm_manipulability.png', 'arm_joint_speeds.png']
ROUNDING = 1e-14  # of the reach: a few dozen roundings of numbers of order one
STEP = 1e-4
DIFFERENCE = 1e-11  # central differences of fourth order: step^4, and rounding/step
INVERSE = 1e-9  # rounding times the largest condition number of the poses tried, 1e4

angles = st.floats(-np.pi, np.pi)
bent = st.floats(1e-3, np.pi - 1e-3)  # |theta_2| of poses whose inverse is well conditioned
lengths = st.floats(0.05, 2.0)
sides = st.sampled_from([-1.0, 1.0])


def links(theta, arm):
    """Both links as complex numbers."""
    lower = arm.lower_arm_length_m * np.exp(1j * theta[..., 0])
    return lower, arm.upper_arm_length_m * np.exp(1j * (theta[..., 0] + theta[..., 1]))


def vectors(numbers):
    return np.stack([np.real(numbers), np.imag(numbers)], axis=-1)


def poses(theta_2):
    """All combinations of 73 first angles with the given second ones, shape (73, n, 2)."""
    return np.stack(np.meshgrid(np.linspace(-np.pi, np.pi, 73), theta_2, indexing='ij'), axis=-1)


def points(arm):
    """Points all over the ring of the workspace, both singular circles included, shape (61, 72, 2)."""
    r = np.linspace(arm.inner_reach_m, arm.outer_reach_m, 61)
    return vectors(r[:, None] * np.exp(1j * np.radians(np.arange(0.0, 360.0, 5.0))))


@pytest.mark.parametrize(
    ('degrees', 'position'),
    [
        ((0, 0), (0.7, 0)),
        ((90, 0), (0, 0.7)),
        ((0, 180), (0.1, 0)),
        ((0, 90), (0.4, 0.3)),
        ((90, -90), (0.3, 0.4)),
    ],
)
def test_the_tool_is_where_a_drawing_has_it(degrees, position):
    assert kinematics.forward(np.radians(degrees), ARM) == pytest.approx(position, abs=ROUNDING)


@pytest.mark.parametrize('arm', ARMS, ids=str)
def test_elbow_and_tool_are_the_sums_of_the_links(arm):
    theta = poses(np.linspace(-np.pi, np.pi, 49))
    lower, upper = links(theta, arm)
    limit = ROUNDING * arm.outer_reach_m
    assert np.abs(kinematics.elbow(theta, arm) - vectors(lower)).max() < limit
    assert np.abs(kinematics.forward(theta, arm) - vectors(lower + upper)).max() < limit


def test_the_tool_frame_is_a_rotation_with_its_first_axis_along_the_upper_arm():
    theta = poses(np.linspace(-np.pi, np.pi, 49))
    frame = kinematics.orientation(theta)
    upper = kinematics.forward(theta, ARM) - kinematics.elbow(theta, ARM)
    assert np.abs(frame[..., 0] - upper / 0.3).max() < ROUNDING
    assert np.abs(np.swapaxes(frame, -1, -2) @ frame - np.eye(2)).max() < ROUNDING
    assert np.linalg.det(frame) == pytest.approx(1.0, abs=ROUNDING)


@pytest.mark.parametrize('branch', Branch)
@pytest.mark.parametrize('arm', ARMS, ids=str)
def test_forward_undoes_inverse_up_to_the_singular_circles(arm, branch):
    p = points(arm)
    theta = kinematics.inverse(p, arm, branch)
    assert np.abs(kinematics.forward(theta, arm) - p).max() < ROUNDING * arm.outer_reach_m
    assert np.abs(theta).max() <= np.pi


@given(lengths, lengths, angles, bent, sides)
def test_inverse_undoes_forward_on_the_branch_of_the_pose(a, b, theta_1, theta_2, side):
    arm, theta = TwoLinkArm(a, b), np.array([theta_1, side * theta_2])
    branch = Branch.ELBOW_DOWN if side > 0.0 else Branch.ELBOW_UP
    found = kinematics.inverse(kinematics.forward(theta, arm), arm, branch)
    turned = (found - theta + np.pi) % (2.0 * np.pi) - np.pi  # theta_1 = pi comes back as -pi, too
    assert np.abs(turned).max() < INVERSE


@pytest.mark.parametrize('arm', ARMS, ids=str)
def test_branches_mirror_each_other_and_are_named_by_the_elbow(arm):
    p = points(arm)[1:-1]
    up, down = (kinematics.inverse(p, arm, branch) for branch in (Branch.ELBOW_UP, Branch.ELBOW_DOWN))
    assert np.array_equal(up[..., 1], -down[..., 1])
    for theta, sign in ((up, 1.0), (down, -1.0)):
        elbow = kinematics.elbow(theta, arm)
        left = p[..., 0] * elbow[..., 1] - p[..., 1] * elbow[..., 0]
        assert (sign * left > 0.0).all()
    ahead = points(arm)[1:-1, 0]  # on the x axis
    assert (kinematics.elbow(kinematics.inverse(ahead, arm, Branch.ELBOW_UP), arm)[:, 1] > 0.0).all()


def test_branch_is_selected_by_its_name_only():
    assert np.array_equal(
        kinematics.inverse((0.5, 0.2), ARM, 'elbow up'),
        kinematics.inverse((0.5, 0.2), ARM, Branch.ELBOW_UP),
    )
    with pytest.raises(ValueError, match="'left' is not a valid Branch"):
        kinematics.inverse((0.5, 0.2), ARM, 'left')


@pytest.mark.parametrize('arm', ARMS, ids=str)
def test_the_branches_meet_on_the_singular_circles(arm):
    for circle, theta_2 in ((points(arm)[-1], 0.0), (points(arm)[0], np.pi)):
        for branch in Branch:
            theta = kinematics.inverse(circle, arm, branch)
            assert np.abs(theta[:, 1]) == pytest.approx(theta_2, abs=kinematics.SINGULAR_SINE)
            assert kinematics.is_singular(theta).all()


@pytest.mark.parametrize('x', [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_equal_links_reach_their_base_and_its_neighbourhood(x):
    arm = TwoLinkArm(0.5, 0.5)
    for branch in Branch:
        theta = kinematics.inverse((x, 0.0), arm, branch)
        assert kinematics.forward(theta, arm) == pytest.approx((x, 0.0), abs=ROUNDING)


@pytest.mark.parametrize('arm', ARMS, ids=str)
def test_the_jacobian_is_the_derivative_of_forward(arm):
    theta = poses(np.linspace(-np.pi, np.pi, 49))
    for joint in range(2):
        step = STEP * np.eye(2)[joint]
        near, far = (
            kinematics.forward(theta + n * step, arm) - kinematics.forward(theta - n * step, arm)
            for n in (1, 2)
        )
        column = (8.0 * near - far) / (12.0 * STEP)
        difference = kinematics.jacobian(theta, arm)[..., joint] - column
        assert np.abs(difference).max() < DIFFERENCE * arm.outer_reach_m


@given(lengths, lengths, angles, angles)
def test_the_determinant_is_a_b_sine_theta_2(a, b, theta_1, theta_2):
    arm, theta = TwoLinkArm(a, b), (theta_1, theta_2)
    expected = a * b * np.sin(theta_2)
    limit = ROUNDING * (a + b) ** 2
    assert np.linalg.det(kinematics.jacobian(theta, arm)) == pytest.approx(expected, abs=limit)
    assert kinematics.determinant(theta, arm) == pytest.approx(expected, abs=limit)
    assert kinematics.manipulability(theta, arm) == pytest.approx(abs(expected), abs=limit)


@given(lengths, lengths, angles, bent, sides)
def test_the_inverse_jacobian_times_the_jacobian_is_one(a, b, theta_1, theta_2, side):
    arm, theta = TwoLinkArm(a, b), (theta_1, side * theta_2)
    product = kinematics.jacobian_inverse(theta, arm) @ kinematics.jacobian(theta, arm)
    assert np.abs(product - np.eye(2)).max() < INVERSE


def test_joint_speeds_move_the_tool_at_its_velocity():
    theta = poses(np.concatenate([np.linspace(-3.0, -0.1, 20), np.linspace(0.1, 3.0, 20)]))
    speeds = kinematics.joint_speeds(theta, (0.3, -0.8), ARM)
    step = STEP * speeds / np.abs(speeds).max(axis=-1, keepdims=True)
    moved = (kinematics.forward(theta + step, ARM) - kinematics.forward(theta - step, ARM)) / 2.0
    velocity = moved * np.abs(speeds).max(axis=-1, keepdims=True) / STEP
    assert np.abs(velocity - (0.3, -0.8)).max() < 1e-6  # STEP^2 times joint speeds of up to 40 rad/s


@pytest.mark.parametrize(
    ('theta_2', 'shape'), [(0.0, 'stretched'), (-0.0, 'stretched'), (np.pi, 'folded'), (-np.pi, 'folded')]
)
def test_the_stretched_and_the_folded_arm_are_singular(theta_2, shape):
    assert kinematics.is_singular((0.3, theta_2))
    assert kinematics.manipulability((0.3, theta_2), ARM) < ROUNDING
    assert np.linalg.matrix_rank(kinematics.jacobian((0.3, theta_2), ARM), tol=ROUNDING) == 1
    sentence = rf'theta_2 = {np.degrees(theta_2) + 0.0:g} deg is singular \(the arm is {shape}\)'
    with pytest.raises(SingularityError, match=f'^{sentence}'):
        kinematics.jacobian_inverse((0.3, theta_2), ARM)
    with pytest.raises(SingularityError, match=f'^pose 1: {sentence}'):
        kinematics.joint_speeds([(0.3, 1.0), (0.3, theta_2)], (1.0, 0.0), ARM)


def test_no_configuration_between_the_limits_is_singular():
    theta_2 = np.linspace(1e-5, np.pi - 1e-5, 1001)
    assert not kinematics.is_singular(poses(np.concatenate([-theta_2, theta_2]))).any()


@pytest.mark.parametrize('branch', Branch)
@pytest.mark.parametrize(
    ('point', 'sentence'),
    [
        (
            (0.0, 0.8),
            r'\(0, 0.8\) m is 0.8 m from the base, but the stretched arm does not reach farther than 0.7 m',
        ),
        (
            (0.0, -0.05),
            r'\(0, -0.05\) m is 0.05 m from the base, but the folded arm does not reach closer than 0.1 m',
        ),
        ((0.7 + 1e-8, 0.0), r'\(0.7, 0\) m is 0.70000001 m from the base, but .* 0.7 m'),
        ((np.inf, 0.0), r'\(inf, 0\) m is inf m from the base, but .* 0.7 m'),
        ((np.nan, 0.0), r'\(nan, 0\) m is nan m from the base, but .* 0.7 m'),
        ([(0.5, 0.0), (0.5, 0.1), (3.0, 4.0)], r'point 2: \(3, 4\) m is 5 m from the base, but .* 0.7 m'),
    ],
)
def test_a_point_out_of_reach_is_rejected_with_distance_and_limit(point, sentence, branch):
    with pytest.raises(UnreachableError, match=f'^{sentence}$'):
        kinematics.inverse(point, ARM, branch)


@pytest.mark.parametrize('length', [0.0, -1.0, 1e-4, 2e3, np.nan, np.inf, '0.4', None])
def test_a_length_out_of_range_is_rejected_by_name(length):
    with pytest.raises(
        ParameterError, match=r'upper_arm_length_m is .*, but must be a number from 0.001 to 1000$'
    ):
        TwoLinkArm(0.4, length)


@pytest.mark.parametrize('values', [0.0, [0.0, 0.0, 0.0], []])
def test_invalid_pair_is_rejected(values):
    with pytest.raises(ValueError, match=r'theta must have shape \(\.\.\., 2\), not'):
        kinematics.forward(values, ARM)
    with pytest.raises(ValueError, match=r'p must have shape \(\.\.\., 2\), not'):
        kinematics.inverse(values, ARM, Branch.ELBOW_UP)


def test_the_module_needs_neither_ros_nor_matplotlib_nor_compilation():
    program = 'import sys, delta3_pacdrive.studies.thesis.two_link_arm.kinematics; print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {'rclpy', 'matplotlib', 'numba'}


def test_the_command_prints_its_lines_without_loading_heavy_modules():
    program = (
        'import sys\n'
        'from delta3_pacdrive.cli.main import main\n'
        'main(["two-link"])\n'
        'print("loaded:", *sys.modules)'
    )
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=True)
    assert 'determinant' in done.stdout
    assert not set(done.stdout.rpartition('loaded:')[2].split()) & {'numba', 'matplotlib'}


DRAWN = [(ARM, (-0.2, 0.4)), (TwoLinkArm(0.5, 0.5), (0.0, 0.0)), (TwoLinkArm(0.1, 0.9), (0.0, 1.0))]


@pytest.mark.parametrize(('arm', 'point'), some(DRAWN, DRAWN[:1]))
def test_every_figure_is_drawn_in_a_readable_size(arm, point, tmp_path, drawn):
    folder = ReportFolder(tmp_path, Provenance.of('test'))
    paths = folder.figures(figures.by_name(arm, point))
    table = folder.table(figures.table(arm))
    assert [path.name for path in paths] == FIGURES
    for path in paths:
        data = path.read_bytes()
        assert data[:8] == b'\x89PNG\r\n\x1a\n'
        width, height = struct.unpack('>II', data[16:24])
        assert width >= 800
        assert height >= 400
    theta_2, product, condition = np.loadtxt(table, delimiter=',', skiprows=6).T
    largest = arm.lower_arm_length_m * arm.upper_arm_length_m
    np.testing.assert_allclose(product, largest * np.abs(np.sin(theta_2)), atol=1e-15)
    assert condition.min() >= 1.0


def test_the_lines_of_the_figure_keep_their_clearance_from_both_singular_circles():
    for arm in ARMS:
        speeds = []
        for share in figures.CLEARANCES:
            clearance = share * (arm.outer_reach_m - arm.inner_reach_m)
            p = figures.line(arm, clearance)
            r = np.linalg.norm(p, axis=-1)
            assert r.min() == pytest.approx(arm.inner_reach_m + clearance)
            assert r.max() == pytest.approx(arm.outer_reach_m - clearance)
            theta = kinematics.inverse(p, arm, Branch.ELBOW_DOWN)
            speeds.append(np.abs(kinematics.joint_speeds(theta, (1.0, 0.0), arm)).max())
        assert speeds == sorted(speeds)  # the nearer, the faster


def test_unwritable_figures_give_one_message(tmp_path):
    (tmp_path / 'file').write_text('')
    folder = ReportFolder(tmp_path / 'file', Provenance.of('test'))
    with pytest.raises(FigureError, match=r'^cannot write figures to .*file: File exists$'):
        folder.figures(figures.by_name(ARM, (0.5, 0.2)))


def test_the_command_prints_both_solutions_with_jacobian_and_determinant(capsys):
    assert (
        main(['two-link', '--lengths', '0.4', '0.3', '--point', '0.4', '0.3', '--velocity', '0', '0.4']) == 0
    )
    text = capsys.readouterr().out
    for part in (
        'reaches from 0.1 to 0.7 m',
        '(0.4, 0.3) m, 0.5 m from the base',
        'elbow up  theta_1 = 73.7398 deg, theta_2 = -90.0000 deg',
        'elbow down  theta_1 = 0.0000 deg, theta_2 = 90.0000 deg',
        '(0.400000, 0.000000) m',
        '[  -0.30000   -0.30000 ]',
        '[   0.40000    0.00000 ] m/rad',
        'determinant  -0.12000000 m2',
        'determinant  0.12000000 m2',
        'joint speeds  57.2958 deg/s, -57.2958 deg/s',
    ):
        assert part in text


def test_the_command_gives_the_same_as_json_in_si_units(capsys, tmp_path):
    arguments = ['--point', '-0.2', '0.4', '--velocity', '0.1', '0', '--figures', str(tmp_path / 'new')]
    assert main(['two-link', '--json', *arguments]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['ok'] is True
    assert result['reach_m'] == pytest.approx([0.1, 0.7])
    assert result['files'] == [
        str(tmp_path / 'new' / name) for name in ['index.html', *FIGURES, 'arm_manipulability.csv']
    ]
    for branch in Branch:
        solution = result['solutions'][branch.name.lower()]
        theta = kinematics.inverse((-0.2, 0.4), ARM, branch)
        assert solution['theta_rad'] == theta.tolist()
        assert solution['elbow_m'] == kinematics.elbow(theta, ARM).tolist()
        assert solution['jacobian_m_rad'] == kinematics.jacobian(theta, ARM).tolist()
        assert solution['determinant_m2'] == kinematics.determinant(theta, ARM)
        assert solution['singular'] is False
        assert solution['jacobian_inverse_rad_m'] == kinematics.jacobian_inverse(theta, ARM).tolist()
        speeds = kinematics.joint_speeds(theta, (0.1, 0.0), ARM)
        assert solution['joint_speeds_rad_s'] == speeds.tolist()


def test_command_reports_a_singular_pose_without_inverse(capsys):
    assert main(['two-link', '--point', '0', '0.7']) == 0
    text = capsys.readouterr().out
    assert text.count('none: this pose is singular') == 2
    assert '-0.0' not in text.replace('-0.70000', '').replace('-0.30000', '')
    assert main(['two-link', '--point', '0', '0.7', '--json']) == 0
    solution = json.loads(capsys.readouterr().out)['solutions']['elbow_up']
    assert solution['singular'] is True
    assert solution['jacobian_inverse_rad_m'] is None


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (
            ['--point', '0.8', '0'],
            'error: (0.8, 0) m is 0.8 m from the base, but the stretched arm does not reach',
        ),
        (
            ['--lengths', '0', '0.3'],
            'error: lower_arm_length_m is 0.0, but must be a number from 0.001 to 1000',
        ),
        (['--point', '0.7', '0', '--velocity', '1', '0'], 'error: theta_2 = 0 deg is singular'),
        (
            ['--figures', '/dev/null/folder'],
            'error: cannot write figures to /dev/null/folder: Not a directory',
        ),
    ],
)
def test_command_rejects_with_one_message(arguments, sentence, capsys):
    assert main(['two-link', *arguments, '--json']) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith(sentence)
    assert printed.err.count('\n') == 1
    result = json.loads(printed.out)
    assert result == {'ok': False, 'error': printed.err.removeprefix('error: ').strip()}


@pytest.mark.parametrize('value', ['nan', 'inf', 'far', '1e300'])
def test_command_accepts_numbers_only(value, capsys):
    with pytest.raises(SystemExit) as end:
        main(['two-link', '--velocity', value, '0'])
    assert end.value.code == 2
    assert f"argument --velocity: '{value}' is not a number from -1e+06 to 1e+06" in capsys.readouterr().err


@pytest.mark.parametrize(('lengths', 'point', 'infinite'), [
    (['0.3', '0.3'], ['0', '0'], True),
    (['0.3', '0.3'], ['1e-9', '0'], False),
    (['0.3', '0.3'], ['0.6', '0'], False),
])  # fmt: skip
def test_an_arm_of_equal_lengths_has_infinitely_many_solutions_at_its_base_only(
    lengths, point, infinite, capsys
):
    assert main(['two-link', '--lengths', *lengths, '--point', *point]) == 0
    assert ('infinitely many solutions' in capsys.readouterr().out) == infinite

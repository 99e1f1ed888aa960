"""Every example runs and prints correct text; with a robot: ``test/system/test_examples.py``."""

import re
from pathlib import Path

import numpy as np
import pytest

import commands
import delta3_pacdrive as d3
from thoroughness import some

EXAMPLES = Path(__file__).parents[2] / 'examples'
LINES_MAX = 40
WITH_A_ROBOT = {
    'own_node', 'stream_of_moves', 'swing_the_arms', 'react_to_a_fault', 'a_second_robot', 'steer_onto_a_belt',
}  # fmt: skip


@pytest.fixture
def run(tmp_path):
    """Return a function that runs an example in an empty folder and returns the numbers of each line it prints."""

    def numbers(name, *arguments):
        done = commands.script(EXAMPLES / f'{name}.py', *arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        found = [
            [float(text) for text in re.findall(r'[-+]?\d+(?:\.\d+)?(?:e[-+]\d+)?', line)]
            for line in done.stdout.splitlines()
        ]
        return done.stdout, found

    return numbers


def test_examples_are_short_have_a_docstring_and_a_test_each():
    texts = {path.stem: path.read_text(encoding='utf-8') for path in EXAMPLES.glob('*.py')}
    assert len(texts) >= 10
    assert {name: text.count('\n') for name, text in texts.items() if text.count('\n') > LINES_MAX} == {}
    assert all(re.match(r'"""[A-Z][^"]*[.\])]"""\n', text) for text in texts.values())
    tested = {name.removeprefix('test_') for name in globals() if name.startswith('test_')}
    assert set(texts) - tested == WITH_A_ROBOT


def test_every_example_is_shown_in_the_documentation():
    page = (EXAMPLES.parent / 'docs/examples.md').read_text(encoding='utf-8')
    shown = re.findall(r'literalinclude\} \.\./examples/(\w+)\.py', page)
    assert sorted(shown) == sorted(path.stem for path in EXAMPLES.glob('*.py'))


@pytest.mark.long
def test_fill_a_box(run):
    _, ((parts, seconds), (apart,)) = run('fill_a_box')
    assert parts == 8
    assert 0.5 < seconds / parts < 2.0
    assert apart < 0.01  # mm: what the encoders and the model leave where the robot turns round


@pytest.mark.long
def test_turn_the_product(run):
    _, numbers = run('turn_the_product')
    robots, axes = numbers[:3], numbers[3:]
    places, ways = [row[-2] for row in robots], [row[-1] for row in robots]
    assert all(0.0 < place < way for place, way in zip(places, ways, strict=True))
    assert max(places) < 0.1  # deg, also on the built robot
    assert places[1] < 0.5 * places[0]  # the controller that knows the inertia of the tool
    most, seconds = [row[0] for row in axes], [row[-1] for row in axes]
    assert most == sorted(most, reverse=True)
    assert seconds[0] < seconds[1] < seconds[2]


def test_parts_in_motion(run):
    _, ((cycles, rods), (low, high), (radius,), (swing, limit)) = run('parts_in_motion')
    assert (rods, limit) == (6, 45.0)
    assert cycles > 1000
    robot = d3.load_parameters()
    assert -robot.kinematics.upper_arm_length_m < low < high < robot.kinematics.upper_arm_length_m
    assert 0.1 < radius < 0.6
    # the largest swing of a rod is that of the farthest place beside its arm
    assert 0.0 < np.sin(np.radians(swing)) <= (radius + 1e-3) / robot.kinematics.forearm_length_m


def test_parts_in_a_cell(run):
    text, numbers = run('parts_in_a_cell')
    rows = [row for row in numbers if len(row) == 4]
    assert [row[0] for row in rows] == [45, 50, 55, 60]
    uses = [row[3] for row in rows]
    assert uses == sorted(uses, reverse=True)
    # who needs more than all of the force is lost
    assert [(row[1], row[2]) for row in rows] == [(0, 10) if use > 100 else (10, 0) for use in uses]
    assert uses[0] > 100 > uses[-1]
    assert 'the first one: it slid off: it needed' in text


def test_script_with_decisions(run):
    text, numbers = run('script_with_decisions')
    *parts, (count, first_s) = numbers
    assert [line.split(' part')[0].split()[-1] for line in text.splitlines()[:-1]].count('bad') == 1
    assert [places for _, places in parts] == [3, 2, 1, 1, 0]
    assert count == 5
    assert 0.0 < first_s < 1.0


def test_pick_from_a_belt(run):
    text, numbers = run('pick_from_a_belt')
    rows = [row for row in numbers if len(row) == 5 and row[2] == 3]
    assert [row[0] for row in rows] == [0.5, 1.0, 1.5]
    for _, placed, _, rms, most in rows:
        assert 1 <= placed <= 3
        assert 0.0 < rms < 0.10
        assert rms < most < 0.25
    assert rows[-1][1] < 3
    assert 'pick_from_a_belt.py:' in text
    assert 'belt line: the part would be met at' in text


@pytest.mark.long
def test_belt_to_box(run):
    _, ((count, seconds, most),) = run('belt_to_box')
    assert count == 24
    assert seconds < 60.0
    assert 0.0 < most < 0.5


def test_belt_to_belt(run):
    _, ((count, *pitches),) = run('belt_to_belt')
    assert count == 6
    assert len(pitches) == 5
    assert all(0.998 < pitch < 2.0 for pitch in pitches)


def test_straighten_parts(run):
    _, (before, after) = run('straighten_parts')
    assert len(before) == len(after) == 6
    assert max(map(abs, before)) > 20.0
    assert max(map(abs, after)) < 0.5  # the camera is off by a tenth of a degree, rms


@pytest.mark.long
def test_two_types(run):
    text, numbers = run('two_types')
    assert sum(numbers[-1]) + text.count('left: ') == 10
    assert min(numbers[-1]) > 1
    assert re.search(r'\d+ bar in bars, \d+ disc in discs', text)


def test_log_against_model(run, tmp_path):
    text, numbers = run('log_against_model', str(tmp_path))
    (shift, correlation), apart = numbers[0], numbers[1:4]
    # the log begins 5 s after the bus, the program 0.12 s later
    assert shift == pytest.approx(-5.12, abs=2e-4)
    assert correlation > 0.999
    assert [line.partition(':')[0] for line in text.splitlines()[1:4]] == ['arm_angle', 'current', 'tcp']
    assert all(0.0 < rms < most for rms, most in apart)
    assert apart[0][1] < 0.02
    assert 'both are compared every 1.42857 ms' in text


def test_kinematics_of_a_grid(run):
    _, ((points, _, reached), (error,), (low, high), (best, worst)) = run('kinematics_of_a_grid')
    assert 0.5 * points < reached < points
    assert error < 1e-12
    limits = d3.load_parameters().kinematics
    assert limits.arm_angle_min_deg < low < high < limits.arm_angle_max_deg
    assert 2.0 <= best < worst < 4.4  # of the whole workspace


def test_map_of_the_workspace(run):
    text, ((places, slow, fast, *best), (*_, least, _), (increment,), *moves) = run('map_of_the_workspace')
    assert places == 3 * 2821  # of a square grid within a circle of 30 steps
    assert 5.1 < slow < fast < 7.8
    assert np.hypot(*best[:2]) < 0.3
    assert 20.0 < least < 56.0
    assert 0.3 < increment < 0.6
    assert len(moves) == 4
    assert 'TCP acceleration' in text


def test_compare_two_runs(run, tmp_path):
    told, lines = run('compare_two_runs', 'two.html')
    (correlation,), (rms, largest), (true_rms, true_largest), *moves, (megabytes,) = lines
    assert 0.999 < correlation <= 1.0
    assert 0.0 < rms < largest < true_largest < 3.0  # what encoders do not see is more than what they see
    assert rms < true_rms
    assert [move[0] for move in moves] == list(range(1, len(moves) + 1))
    assert all(0.95 * nominal < built < 1.5 * nominal for _, nominal, built, *_ in moves)
    assert 'limited by TCP' in told
    assert megabytes == pytest.approx((tmp_path / 'two.html').stat().st_size / 1e6, abs=0.05)


def test_simulate_and_plot(run, tmp_path):
    _, ((cycles, period_ms, *_), (error_mm,), (current, nominal)) = run('simulate_and_plot', 'run.png')
    figures = d3.simulate('experiment1').meta['figures']
    assert (cycles, period_ms, nominal) == (1603, 1, 4.1)
    assert error_mm == pytest.approx(1e3 * figures['tcp_error_max_m'], abs=1e-3)
    assert current == pytest.approx(max(figures['current_peak_a']), abs=0.01)
    assert (tmp_path / 'run.png').read_bytes().startswith(b'\x89PNG')


def test_program_in_python(run):
    _, ((moves, _), (fastest,), (error_mm,)) = run('program_in_python')
    assert moves == 1 + 2 * 5
    assert fastest == pytest.approx(1.0, rel=1e-3)  # on the cruise the TCP has the speed of the master (6.2)
    assert 0.0 < error_mm < 0.5


def test_torques_along_a_path(run):
    _, ((gravity,), (inertia,), (coriolis,), (current, error)) = run('torques_along_a_path')
    assert coriolis < gravity < inertia
    assert 1.0 < current < 1.7
    assert error < 0.1 * current


@pytest.mark.long
def test_propose_gains(run):
    text, numbers = run('propose_gains')
    (phase_before, _), (phase, gain) = numbers[3:5]
    assert phase_before < 50.0 <= phase < 50.4
    assert 8.0 <= gain < 12.0
    assert text.count('TCP error') == 2


def test_why_margins_differ(run):
    text, numbers = run('why_margins_differ')
    for lines in (numbers[:8], numbers[8:]):
        paper, *pieces, drive = (line[-1] if len(line) > 1 else line[0] for line in lines[1:])
        assert paper + sum(pieces) == pytest.approx(drive, abs=0.03)  # each has two digits
        assert 1.5 < drive - paper < 2.5
        assert pieces[0] + pieces[1] > 0.8 * (drive - paper)
    assert text.count('gain margin of the velocity loop') == 2


def test_tune_a_gain(run):
    _, (_, *rows, _) = run('tune_a_gain')
    gains, with_it, without = np.array(rows).T
    assert gains.tolist() == [30, 60, 120]
    np.testing.assert_allclose(gains * without, np.mean(gains * without), rtol=0.05)  # speed over gain
    assert (with_it < without / 50).all()


def test_current_inside_a_cycle(run):
    _, rows = run('current_inside_a_cycle')
    assert [row[0] for row in rows] == [1, 1, 2, 2, 4, 4]
    told, every, spread = np.array([row[1:] for row in rows]).T
    # linear: the slower the bus, the more the current is, and the less the AT tell of it
    assert (np.diff(told[::2]) < -0.15).all()
    assert (np.diff(every[::2]) > 0.15).all()
    # cubic: neither depends on the bus
    assert np.ptp(told[1::2]) < 0.02
    np.testing.assert_allclose(every[1::2], told[1::2], atol=0.015)
    assert (spread[1::2] < spread[::2] / 2).all()


def test_decoupled_arms(run):
    _, rows = run('decoupled_arms')
    age, tcp, torque = np.array(rows).T
    assert age.tolist() == [125.0, 62.5, 31.25]
    assert (np.diff(tcp) < 0.0).all()
    assert (np.diff(torque) < 0.0).all()
    assert tcp[1] < 6.0


def test_look_into_a_drive(run):
    _, ((_, linear_step, linear_swing), (_, cubic_step, cubic_swing)) = run('look_into_a_drive')
    assert linear_step > 3 * cubic_step  # the stair of the speed feed-forward
    assert linear_swing > 3 * cubic_swing


def test_signals_for_others(run):
    text, (shape, (carrying, fast, asked), (empty, fast_empty, asked_empty)) = run('signals_for_others')
    trace = d3.simulate('packaging')
    start = trace.meta['start_cycle']
    assert shape == [len(trace.time_s[start % 5 :: 5]), 14]
    assert 'payload [kg]: payload in the MDT' in text
    assert carrying == pytest.approx(empty, rel=0.02)
    assert max(fast, fast_empty) == pytest.approx(4.0, abs=0.05)
    assert 1.1 * asked_empty < asked < 1.5 * asked_empty


def test_feed_forward_of_the_model(run):
    _, rows = run('feed_forward_of_the_model')
    *rows, (torque,) = [[number for number in row if number != 1] for row in rows]
    error, rms, peak, current = np.array([row[-4:] for row in rows]).T
    assert (error[1::2] < error[::2] / 12).all()
    assert (rms[1::2] < rms[::2] / 9).all()
    assert (peak[1::2] <= peak[::2]).all()
    assert (current[1::2] <= current[::2]).all()
    assert torque == pytest.approx(0.78 * peak[3], rel=0.05)


def test_learn_a_program(run):
    _, (*repetitions, (largest, rms)) = run('learn_a_program')
    numbers, errors, rms_errors = np.array(repetitions).T
    assert list(numbers) == list(range(len(numbers)))
    assert errors[0] == pytest.approx(67.1, abs=0.5)
    assert errors[0] > 15.0 * largest
    assert rms_errors[0] > 25.0 * rms
    assert rms == min(rms_errors)


@pytest.mark.long
def test_rate_and_energy(run):
    text, rows = run('rate_and_energy')
    assert [line.split()[0] for line in text.splitlines()] == ['jerk_m_s3', 'jerk_m_s3', 'torque_rate_n_m_s']
    rate, lost, current, nominal, error = np.array([row[-5:] for row in rows]).T
    assert (np.diff(rate) > 0.0).all()
    assert rate[1] > 180.0
    assert lost[1] > 2.0 * lost[0]
    assert current[1:] == pytest.approx(nominal[1:], rel=0.06)
    assert current[0] < 0.8 * nominal[0]
    assert (error < 0.25).all()


def test_shaped_moves(run):
    text, rows = run('shaped_moves')
    assert [line.split(':')[0] for line in text.splitlines()] == ['none', 'zv', 'zvd', 'smooth']
    took_ms, swings_mm, less_db = np.array(rows).T
    assert swings_mm[0] > 0.4
    assert less_db[1] > 9.0
    assert (less_db[2:] > 20.0).all()
    assert (took_ms[2:] - took_ms[0] <= 21.0).all()  # a period


def test_fit_a_parameter(run):
    text, lines = run('fit_a_parameter')
    errors = [float(share) for share in re.findall(r'\(([-+]\d+\.\d+) %\)', text)]
    assert len(errors) == 3
    assert max(map(abs, errors[:2])) < 1.0
    assert abs(errors[2]) < 10.0
    residual, torque = lines[3]
    assert residual < 0.05 * torque


@pytest.mark.parametrize('ending', some(['', 'csv'], ['']))
def test_read_a_recording(ending, run, tmp_path):
    if ending:
        assert commands.delta3('simulate', 'experiment3', '--trace', tmp_path / 'run.csv').returncode == 0
    text, lines = run('read_a_recording', *(['run.csv'] if ending else []))
    assert 'experiment 3' in text
    assert 'coupling_torque' in text
    trace = d3.simulate('experiment3')
    worst = np.linalg.norm(trace['tcp_error'], axis=1).argmax()
    error_mm, time_s, *place = lines[2]
    assert error_mm == pytest.approx(1e3 * trace.meta['figures']['tcp_error_max_m'], abs=1e-3)
    assert [time_s, *place] == pytest.approx([worst * 1e-3, *trace['tcp_command'][worst]], abs=1e-3)


def test_nominal_and_built_robot(run):
    _, ((seen, true), (seen_built, true_built), lengths, (current, current_built)) = run(
        'nominal_and_built_robot'
    )
    assert true == 0.0
    assert true_built > 3 * seen_built
    assert seen_built > seen
    assert len(lengths) == 3
    assert current_built > current


def test_your_own_page(run):
    pytest.importorskip('viser', reason='the page needs the extra "view"')
    output, _ = run('your_own_page', '1')
    assert re.fullmatch(r'look at http://127\.0\.0\.1:\d+\n', output)


def test_calibrate_a_robot(run):
    text, lines = run('calibrate_a_robot')
    assert text.count('\n') == len(lines) == 7
    (used, before, after), (checks, unused_before, unused_after) = lines[:2]
    assert (used, checks) == (24, 8)
    assert after < 0.2 * before
    assert unused_after < 0.2 * unused_before
    for line, truth_mm in zip(lines[2:5], (0.1, -0.05, 0.07), strict=True):
        assert abs(line[1] - truth_mm) < line[2]
    assert lines[5][-1] > 0.25
    assert lines[6][-1] < 0.4 * lines[5][-1]

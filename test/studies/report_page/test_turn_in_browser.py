"""Tests of the rotary axis in a report in a real browser: angles of tool and bar."""

import math

import numpy as np
import pytest

from browser import Visit
from delta3_pacdrive import simulation
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.scene.poses import poses
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.report_page import page
from delta3_pacdrive.studies.runs import runs
from page_data import document_of
from report_views import READY, seek

INSTANTS_S = (0.0, 0.05, 0.1, 0.15)
ROUNDED = 2e-6  # of places [m] and quaternions: signals of a page are rounded
PLACES = 'delta3.stage.cell.places(delta3.clock.time, delta3.stage.robot.tcp, delta3.stage.robot.turned)'
PLACED = """
    (robot, name) => {
        const part = robot.parts.get(name);
        return [part.position.toArray(), part.quaternion.toArray()];
    }
"""


@pytest.fixture(scope='module')
def run(tmp_path_factory, robot):
    folder = tmp_path_factory.mktemp('runs')
    (folder / 'p.yaml').write_text(
        'payload_kg: 0.5\nmoves: [{move_l: {to_m: [0.2, 0.1, -0.8], turn_deg: [220, -40], speed_m_s: 4.0}}]'
    )
    turning = robot.replace(rotary__present=True, rotary_2__present=True)
    simulation.run(program_file.load(folder / 'p.yaml', turning.motion), turning).save(folder / 'p.npz')
    return runs.load(str(folder / 'p.npz'))


@pytest.fixture(scope='module')
def text(run):
    return page.page([run], Provenance.of('test'))


@pytest.fixture(scope='module')
def visit(browser, text, tmp_path_factory):
    path = tmp_path_factory.mktemp('pages') / 'turn.html'
    path.write_text(text)
    with Visit(browser, path.as_uri()) as found:
        found.page.wait_for_selector(READY, state='attached')
        yield found


def placed(visit, robot, name):
    """Return place and quaternion of a part of a robot in the browser."""
    position, quaternion = visit.page.evaluate(f'({PLACED})({robot}, {name!r})')
    return np.array(position), np.array(quaternion)


def there(run, time_s):
    row = round((time_s - run.window.time_s[0]) / run.period_s)
    theta = run.window['motor_position'][row] / run.robot.dynamics.gear_ratio
    return row, poses(theta, run.robot, tool_rad(run, 'turn_position', row))


def tool_rad(run, name, row):
    """Return the sum over both rotary axes [rad]."""
    return sum(run.window[signal][row, 0] for signal in (name, f'{name}_2'))


def test_tool_and_bar_are_drawn_as_the_run_has_them(visit, run):
    turned = []
    for time_s in INSTANTS_S:
        seek(visit, time_s)
        row, expected = there(run, time_s)
        turned.append(math.degrees(tool_rad(run, 'turn_position', row)))
        for name in ('plate', 'tool', 'payload', 'pointer', 'bar_tube', 'bar_rod', 'motor4'):
            position, quaternion = placed(visit, 'delta3.stage.robot', name)
            assert position == pytest.approx(expected.of(name)[0], abs=ROUNDED), name
            wanted = expected.of(name)[1]
            assert abs(quaternion @ wanted) == pytest.approx(1.0, abs=1e-9), name
        assert f'tool {turned[-1]:.2f} deg' in visit.page.locator('#told').text_content()
    assert turned == sorted(turned)
    assert turned[-1] - turned[0] > 90.0


def test_tool_of_the_ghost_is_offset_by_the_magnified_error(visit, run):
    visit.page.evaluate('magnify.value = 40; magnify.dispatchEvent(new Event("input"))')  # 100 times
    time_s = INSTANTS_S[2]
    seek(visit, time_s)
    row, _ = there(run, time_s)
    error = tool_rad(run, 'turn_error', row)
    angle = tool_rad(run, 'turn_position', row) + 100.0 * error
    _, (x, y, z, w) = placed(visit, 'delta3.stage.ghosts[0].robot', 'pointer')
    assert (x, y) == (0.0, 0.0)
    assert abs(error) > 1e-5
    assert math.remainder(2.0 * math.atan2(z, w) - angle, math.tau) == pytest.approx(0.0, abs=1e-4)


@pytest.fixture(scope='module')
def carried(tmp_path_factory, robot):
    """Return a run in which a part is carried to its box and turned."""
    folder = tmp_path_factory.mktemp('carried')
    (folder / 'p.yaml').write_text("""
        start_m: [-0.15, 0.002, -0.85]
        payload_kg: 0.0
        moves:
        - output: {name: gripper, value: true, payload_kg: 0.5}
        - dwell: {time_s: 0.05}
        - move_l: {to_m: {by_m: [0, 0, 0.05]}}
        - move_l: {to_m: {by_m: [0.2, 0, 0]}, turn_deg: 120}
    """)
    turning = robot.replace(rotary__present=True)
    program = program_file.load(folder / 'p.yaml', turning.motion)
    simulation.run(program, turning, cell=cell_file.load('cell')).save(folder / 'p.npz')
    return runs.load(str(folder / 'p.npz'))


@pytest.mark.long
def test_a_part_in_hand_turns_about_the_tcp_with_the_tool(browser, carried, tmp_path):
    page.write(tmp_path / 'page.html', [carried], Provenance.of('test'))
    part, angles = carried.window, []
    with Visit(browser, (tmp_path / 'page.html').as_uri()) as visit:
        visit.page.wait_for_selector(READY, state='attached')
        for row in (0, len(part.time_s) * 3 // 4, len(part.time_s) - 1):
            time_s = float(part.time_s[row])
            seek(visit, time_s)
            turn = part['turn_position'][row, 0]
            cycle = round(time_s / carried.period_s) + part.meta['start_cycle']
            expected = {
                one['number']: (place, angle)
                for one, place, angle in carried.cell.at(cycle, tuple(part['tcp_actual'][row]), turn)
            }
            drawn = {one['number']: one for one in visit.page.evaluate(PLACES)}
            assert drawn.keys() == expected.keys()
            for number, (place, angle) in expected.items():
                assert drawn[number]['at'] == pytest.approx(place, abs=ROUNDED)
                assert drawn[number]['angle'] == pytest.approx(angle, abs=ROUNDED)
            angles.append(math.degrees(expected[0][1]))
    assert angles[0] < 1.0 < 20.0 < angles[1] < angles[2]
    assert angles[2] == pytest.approx(120.0, abs=0.2)


def test_plots_of_the_rotation_are_on_the_page_in_degrees(text):
    plots = {plot['title']: plot for plot in document_of(text)['plots']}
    angle = plots['Angle of the tool']
    assert [(one['name'], one['role']) for one in angle['signals']] == [
        ('turn_position', 'actual'), ('turn_command', 'command'), ('turn_true', 'true'),
    ]  # fmt: skip
    assert (angle['unit'], angle['shown'], round(angle['factor'], 6)) == ('deg', True, 57.29578)
    assert {'Error of the angle of the tool', 'Current of the rotary axis'} < plots.keys()
    second = plots['Angle of the tool, axis 5']
    assert [one['name'] for one in second['signals']] == ['turn_position_2', 'turn_command_2', 'turn_true_2']
    assert (second['unit'], second['shown'], second['factor']) == ('deg', True, angle['factor'])
    assert {'Error of the angle of the tool, axis 5', 'Current of axis 5'} < plots.keys()


def test_page_of_a_robot_without_the_axis_does_not_contain_it():
    document = document_of(page.page([runs.load('packaging', to_s=0.2)], Provenance.of('test')))
    robot = document['runs'][0]['robot']
    assert 'bar_top' not in robot
    assert {part['name'] for part in robot['parts']}.isdisjoint({'motor4', 'bar_tube', 'bar_rod', 'pointer'})
    assert not [plot for plot in document['plots'] if 'tool' in plot['title']]

"""Tests of the maps of the workspace: the value of each place, and figures of every slice."""

import json

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG
from delta3_pacdrive.planning.limits.capability import capability
from delta3_pacdrive.planning.limits.joint_forces import joint_forces
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.places.workspace import evaluation, figures, report
from delta3_pacdrive.studies.places.workspace.study import Settings, Slice

SETTINGS = Settings(0.06, (Slice(2, -0.8), Slice(1, 0.1), Slice(0, 0.0)))


@pytest.fixture(scope='module')
def found(robot):
    return evaluation.study(SETTINGS, robot)


def places(grid):
    return np.stack(np.meshgrid(grid.x_m, grid.y_m, grid.z_m, indexing='ij'), axis=-1)


def test_the_volume_is_the_box_around_the_workspace_its_ends_included(found, robot):
    k, volume = robot.kinematics, found.volume
    assert volume.x_m[[0, -1]] == pytest.approx([-0.6, 0.6])
    assert volume.y_m[[0, -1]] == pytest.approx([-0.6, 0.6])
    assert volume.z_m[[0, -1]] == pytest.approx([k.workspace_bottom_m, k.workspace_top_m])
    for axis in (volume.x_m, volume.y_m, volume.z_m):
        assert np.diff(axis).max() <= SETTINGS.resolution_m + 1e-12
    assert found.poses == volume.limit.size == len(volume.x_m) * len(volume.y_m) * len(volume.z_m)


def test_each_value_is_that_of_its_place(found, robot):
    for grid in (found.volume, *found.slices):
        points, rng = places(grid).reshape(-1, 3), np.random.default_rng(3)
        chosen = rng.choice(len(points), 60, replace=False)
        values = evaluation.values_of(capability(points[chosen], robot))
        for key, wanted in values.items():
            here = grid.values[key].reshape(-1)[chosen]
            known = np.isfinite(here)
            np.testing.assert_allclose(here[known], wanted[known], rtol=1e-12)


def test_values_are_defined_exactly_in_the_reachable_region(found, robot):
    k = robot.kinematics
    for grid in (found.volume, *found.slices):
        points = places(grid)
        theta = np.degrees(kinematics.inverse(points, robot, unreachable='nan'))
        swing = np.degrees(kinematics.forearm_swing(points, k))
        with np.errstate(invalid='ignore'):
            legal = ((theta >= k.arm_angle_min_deg) & (theta <= k.arm_angle_max_deg)).all(axis=-1)
            legal &= (swing <= k.forearm_swing_max_deg).all(axis=-1)
            serial, parallel = kinematics.singularity(theta * np.pi / 180.0, points, robot)
            legal &= (serial >= k.serial_singularity_min).all(axis=-1) & (
                parallel >= k.parallel_singularity_min
            )
        np.testing.assert_array_equal(np.isfinite(grid.values['speed']), legal)
        radius, z = np.hypot(points[..., 0], points[..., 1]), points[..., 2]
        inside = (radius <= 0.6 + 1e-9) & (z <= -0.7 + 1e-9) & (z >= -0.95 - 1e-9)
        np.testing.assert_array_equal(grid.limit == 0, legal & inside)


def test_in_the_whole_workspace_the_robot_may_be(found):
    points = places(found.volume)
    inside = np.hypot(points[..., 0], points[..., 1]) <= 0.6
    assert (found.volume.limit[inside] == 0).all()


def test_extremes_are_those_of_the_workspace_with_their_places(found, robot):
    for quantity in evaluation.QUANTITIES:
        one, values = found.extremes[quantity.key], found.volume.values[quantity.key]
        inside = values[found.volume.limit == 0]
        assert (one.least, one.largest) == (inside.min(), inside.max())
        assert one.median == pytest.approx(np.median(inside))
        for value, place in ((one.least, one.least_at_m), (one.largest, one.largest_at_m)):
            there = evaluation.values_of(capability(place, robot))[quantity.key]
            assert value == pytest.approx(float(there))


def test_a_third_of_a_turn_maps_the_workspace_on_itself(robot):
    # the arms repeat every 120 degrees; the singular values and all that is asked of motors with them
    rng = np.random.default_rng(2)
    points = rng.uniform((-0.4, -0.4, -0.95), (0.4, 0.4, -0.7), (50, 3))
    cosine, sine = np.cos(2.0 * np.pi / 3.0), np.sin(2.0 * np.pi / 3.0)
    turned = points @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]).T
    here, there = (evaluation.values_of(capability(p, robot)) for p in (points, turned))
    for key, values in here.items():
        np.testing.assert_allclose(there[key], values, rtol=1e-9, err_msg=key)


def test_requested_payload_and_acceleration_reach_the_maps(robot):
    loaded = robot.replace(dynamics__payload_mass_kg=5.0)
    heavy = evaluation.study(Settings(0.3, ()), loaded)
    quick = evaluation.study(Settings(0.3, (), acceleration_m_s2=100.0), robot)
    usual = evaluation.study(Settings(0.3, ()), robot)
    assert heavy.extremes['acceleration'].least < usual.extremes['acceleration'].least
    assert quick.extremes['payload_peak'].median < usual.extremes['payload_peak'].median
    assert usual.extremes['payload'].largest == PAYLOAD_MAX_KG < usual.extremes['payload_held'].least
    assert report.document(heavy, Settings(0.3, ()), loaded)['payload_kg'] == 5.0


def test_a_volume_of_too_many_poses_is_rejected_before_it_is_computed(robot):
    with pytest.raises(ReportError, match=r'a resolution of 1 mm gives \d+ poses, the limit is 20000000'):
        evaluation.study(Settings(0.001, ()), robot)


def test_a_robot_whose_workspace_its_arms_do_not_reach_has_no_extremes(robot):
    small = robot.replace(kinematics__arm_angle_max_deg=0.0, kinematics__arm_angle_min_deg=0.0)
    found = evaluation.study(Settings(0.3, (Slice(2, -0.8),)), small)
    assert found.extremes == {}
    assert report.document(found, Settings(0.3, ()), small)['poses_in_reach'] == 0
    assert figures.quantity_map(found, (Slice(2, -0.8),), small, evaluation.QUANTITIES[0])


def test_every_quantity_is_drawn_in_every_slice(found, robot, tmp_path):
    drawings = figures.by_name(found, SETTINGS.slices, robot)
    assert set(drawings) == {'reach.png', *(f'{quantity.key}.png' for quantity in evaluation.QUANTITIES)}
    for name in ('reach.png', 'speed.png'):
        figure = drawings[name]()
        titles = {axes.get_title(loc='left') for axes in figure.axes}
        assert {'z = -800 mm', 'y = 100 mm', 'x = 0 mm'} <= titles
    folder = ReportFolder(tmp_path, Provenance.of('test'))
    (path,) = folder.figures({'payload.png': drawings['payload.png']})
    assert path.read_bytes().startswith(b'\x89PNG')


def test_volume_is_written_with_units_and_meaning_of_the_codes(found, tmp_path):
    path = report.save_volume(found.volume, tmp_path / 'volume.npz', {'command': 'test'})
    with np.load(path) as file:
        about = json.loads(str(file['about']))
        assert file['speed_m_s'].shape == found.volume.limit.shape
        np.testing.assert_allclose(file['increment_m'], found.volume.values['increment'], rtol=1e-6)
        assert about['limits'][int(file['limit'].min())] == 'the robot may be here'
        assert about['command'] == 'test'


def test_the_table_of_the_volume_has_the_values_of_each_place(found, robot):
    columns = report.volume_columns(found.volume)
    assert list(columns)[:5] == ['x [m]', 'y [m]', 'z [m]', 'limit', 'condition']
    assert {len(values) for values in columns.values()} == {
        int(np.isfinite(found.volume.values['speed']).sum())
    }
    here = np.stack([columns[f'{axis} [m]'] for axis in 'xyz'], axis=-1)
    assert [len(np.unique(axis)) for axis in here.T] == [21, 21, len(found.volume.z_m)]
    wanted = capability(here, robot)
    np.testing.assert_array_equal(columns['limit'], wanted.limit)
    for quantity in evaluation.QUANTITIES:
        name = f'{quantity.key} [{quantity.unit}]' if quantity.unit else quantity.key
        np.testing.assert_allclose(columns[name], evaluation.values_of(wanted)[quantity.key], rtol=1e-9)


def test_each_slice_has_the_names_of_its_axes_and_its_places(found, robot):
    quantity = evaluation.QUANTITIES[4]
    for figure in (
        figures.reach_map(found, SETTINGS.slices, robot),
        figures.quantity_map(found, SETTINGS.slices, robot, quantity),
    ):
        panels = {axes.get_title(loc='left'): axes for axes in figure.axes}
        for title, across, up in (
            ('z = -800 mm', 'x', 'y'),
            ('y = 100 mm', 'x', 'z'),
            ('x = 0 mm', 'y', 'z'),
        ):
            axes = panels[title]
            assert (axes.get_xlabel(), axes.get_ylabel()) == (f'{across} [mm]', f'{up} [mm]')
            low, high = axes.dataLim.intervaly
            assert (low < -900.0 and high < -400.0) if up == 'z' else low == pytest.approx(-high, rel=0.01)


def test_maps_of_forces_have_the_largest_of_six_directions_at_each_place(robot):
    settings = Settings(0.2, (Slice(2, -0.8),), 30.0, forces=True)
    found = evaluation.study(settings, robot)
    (grid,) = found.slices
    for i, j in ((120, 120), (150, 100)):
        place = [grid.x_m[i], grid.y_m[j], grid.z_m[0]]
        every = [
            joint_forces(place, np.zeros(3), 30.0 * sign * direction, robot)
            for direction in np.eye(3)
            for sign in (1.0, -1.0)
        ]
        rods, springs = grid.values['rod_force'][i, j, 0], grid.values['spring_force'][i, j, 0]
        assert rods == pytest.approx(max(np.abs(one.rod_n).max() for one in every))
        assert springs == pytest.approx(max(one.spring_n.max() for one in every))
        # upwards the six rods carry more than the weight times (1 + a / g), because they are inclined
        carried = robot.dynamics.payload_mass_kg + robot.dynamics.plate_mass_kg
        assert rods > carried * (30.0 + robot.dynamics.gravity_m_s2) / 6.0
    text = report.text(found, settings, robot)
    assert text[1].endswith('payloads with 30 m/s2, forces with both')
    assert any('force in a rod, accelerated along x, y or z (N)' in line for line in text)
    assert 'rod_force [N]' in report.volume_columns(found.volume)
    assert {'rod_force.png', 'spring_force.png'} < set(figures.by_name(found, settings.slices, robot))


def test_without_acceleration_the_forces_are_those_at_rest(robot):
    rest = joint_forces([0.0, 0.0, -0.8], np.zeros(3), np.zeros(3), robot)
    found = evaluation.forces_at(np.array([[0.0, 0.0, -0.8]]), 0.0, robot)
    assert found['rod_force'][0] == np.abs(rest.rod_n).max()
    assert found['spring_force'][0] == rest.spring_n.max()

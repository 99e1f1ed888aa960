"""Tests of the volume of a workspace on the page: slices of the file, in the colours of the legend."""

from unittest.mock import MagicMock

import numpy as np
import pytest

from browser import Visit
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.planning.limits.capability import REACHED
from delta3_pacdrive.studies.places.workspace import evaluation, report
from delta3_pacdrive.studies.places.workspace.study import Settings
from delta3_pacdrive.view.serving import HOST, held

pytest.importorskip('viser', reason='the page needs the extra "view"')

from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.workspace import GREY, Scale, Slices, Volume, colours, legend
from gui_stand_in import Gui

SPEED = 'speed_m_s'


@pytest.fixture(scope='module')
def path(robot, tmp_path_factory):
    found = evaluation.study(Settings(0.05, ()), robot)
    return report.save_volume(found.volume, tmp_path_factory.mktemp('volume') / 'volume.npz', {})


@pytest.fixture(scope='module')
def volume(path):
    return Volume.load(path)


def test_volume_is_distinguished_from_other_files(path, tmp_path):
    assert Volume.is_one(path)
    np.savez_compressed(tmp_path / 'trace.npz', time_s=np.zeros(3))
    (tmp_path / 'text.npz').write_text('no archive')
    for name in ('trace.npz', 'text.npz', 'nothing.npz', '.'):
        assert not Volume.is_one(tmp_path / name)


@pytest.mark.parametrize('absent', ['about', 'z_m', SPEED])
def test_incomplete_volume_is_rejected_with_one_message(absent, path, tmp_path):
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files if name != absent}
    if absent == SPEED:
        arrays[SPEED] = np.zeros((2, 2, 2))
    np.savez_compressed(tmp_path / 'broken.npz', **arrays)
    with pytest.raises(TraceError, match=r'broken\.npz is not a valid workspace volume: .'):
        Volume.load(tmp_path / 'broken.npz')


@pytest.mark.parametrize('axis', range(3))
def test_a_slice_is_the_layer_that_is_nearest_as_far_as_the_arms_reach(axis, volume):
    own = volume.axes_m[axis]
    places, index = volume.slice(axis, own[2] + 0.2 * (own[3] - own[2]))
    assert (places[:, axis] == own[2]).all()
    layer = np.take(volume.values[SPEED], 2, axis=axis)
    assert len(places) == np.isfinite(layer).sum() > 0
    assert np.isfinite(volume.values[SPEED][index]).all()


def test_colours_follow_the_values_where_the_robot_may_be(volume):
    _, index = volume.slice(2, -0.8)
    found, values = colours(volume, SPEED, index), volume.values[SPEED][index]
    here = volume.limit[index] == REACHED
    assert 0 < here.sum() < len(here)
    assert (found[~here] == GREY).all()
    # the map goes from dark to light
    light = found[here].sum(axis=1).astype(float)
    assert np.corrcoef(values[here], light)[0, 1] > 0.9


@pytest.mark.parametrize('scale', [Scale(2.0, 6.0, False), Scale(0.01, 10.0, True)])
def test_legend_gives_the_values_of_its_colours(scale):
    for share in (0.0, 0.3, 1.0):
        assert scale.share(np.array([scale.at(share)]))[0] == pytest.approx(share)
    assert scale.share(np.array([scale.low / 2.0, 2.0 * scale.high])).tolist() == [0.0, 1.0]
    assert all(f'<span>{scale.at(share):.3g}</span>' in legend('speed', scale) for share in (0.0, 0.5, 1.0))


@pytest.mark.long
def test_another_measure_is_shown_when_it_is_chosen(volume, robot, browser):
    with held(HOST, None) as place:
        page = Page(robot, place, 'volume')
    try:
        Slices(page, volume)
        with Visit(browser, page.url) as visit:
            first = next(iter(volume.values))
            visit.page.get_by_text(f'{volume.scale(first).at(0.5):.3g}', exact=True).first.wait_for()
            visit.page.get_by_label('colour').click()
            visit.page.get_by_role('option', name=SPEED, exact=True).click()
            visit.page.get_by_text(f'{volume.scale(SPEED).at(0.5):.3g}', exact=True).first.wait_for()
            # what only a robot that moves has
            panel = visit.page.get_by_role('tab', name='following error')
            panel.wait_for()
            page.hide_motion()
            panel.wait_for(state='hidden')
    finally:
        page.close()


def test_each_choice_of_a_volume_redraws_its_slices(volume):
    page = MagicMock()
    page.server.gui = gui = Gui()
    Slices(page, volume)
    drawn = page.server.scene.add_point_cloud

    def last():
        (path, places, shades), more = drawn.call_args
        drawn.reset_mock()
        return path, places, shades, more['visible']

    assert [call.args[0] for call in drawn.call_args_list] == ['/volume/x', '/volume/y', '/volume/z']
    drawn.reset_mock()
    for axis, letter in enumerate('xyz'):
        own = volume.axes_m[axis]
        gui[f'{letter} mm'].use(1e3 * float(own[3]))
        path, places, _, visible = last()
        assert path == f'/volume/{letter}'
        np.testing.assert_allclose(places[:, axis], own[3], atol=1e-6)
        assert visible is gui[f'slice {letter}'].value
        gui[f'slice {letter}'].use(not visible)
        assert last()[3] is not visible
    for name in volume.values:
        gui['colour'].use(name)
        _, index = volume.slice(2, volume.axes_m[2][3])
        np.testing.assert_array_equal(last()[2], colours(volume, name, index))
    assert set(gui.things) == {
        'colour',
        *(f'slice {letter}' for letter in 'xyz'),
        *(f'{letter} mm' for letter in 'xyz'),
    }

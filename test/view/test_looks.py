"""Tests of the visibility choices of the page: each affects only its own elements."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.cell_scene import things_of
from delta3_pacdrive.view.serving import HOST, held
from delta3_pacdrive.view.values import Instant

pytest.importorskip('viser', reason='the page needs the extra "view"')

import viser

from delta3_pacdrive.view import page as pages
from delta3_pacdrive.view.plots import Plots

PLACE = (0.1, -0.05, -0.85)
LAG = (1e-4, -2e-4, 3e-4)


@pytest.fixture(scope='module')
def shown(robot):
    """Return a page of a robot in its cell, its choices by label, and the nodes of its scene by name."""
    choices, nodes = {}, {}

    def keep(usual, found):
        def add(self, name, *given, **more):
            found[name] = usual(self, name, *given, **more)
            return found[name]

        return add

    with pytest.MonkeyPatch.context() as patch:
        for name in ('add_dropdown', 'add_checkbox'):
            patch.setattr(viser.GuiApi, name, keep(getattr(viser.GuiApi, name), choices))
        for name in [name for name in dir(viser.SceneApi) if name.startswith('add_')]:
            patch.setattr(viser.SceneApi, name, keep(getattr(viser.SceneApi, name), nodes))
        with held(HOST, None) as place:
            made = pages.Page(robot, place, 'a robot of the tests')
        made.show_cell(things_of(cell_file.load('cell')))
    try:
        yield made, choices, nodes
    finally:
        made.close()


NODES = {
    'workspace': ('/workspace/',),
    'planned path': ('/path/planned',),
    'travelled path': ('/path/travelled',),
    'labels': ('/labels/', '/cell/'),
    'cell': ('/cell',),
}


@pytest.mark.parametrize('name', NODES)
def test_checkbox_hides_only_its_own_element(name, shown):
    _, choices, nodes = shown
    before = {node for node, handle in nodes.items() if handle.visible}
    choices[name].value = False
    hidden = before - {node for node, handle in nodes.items() if handle.visible}
    choices[name].value = True
    assert hidden
    assert all(node.startswith(NODES[name]) for node in hidden), hidden
    if name == 'labels':
        assert {'/labels/axis1', '/labels/axis2', '/labels/axis3', '/labels/base'} <= hidden
    assert {node for node, handle in nodes.items() if handle.visible} == before


def test_the_box_for_a_dark_page_makes_it_dark(shown, monkeypatch):
    page, choices, _ = shown
    themes = []
    monkeypatch.setattr(page.server.gui, 'configure_theme', lambda **theme: themes.append(theme['dark_mode']))
    choices['dark'].value = True
    choices['dark'].value = False
    assert themes == [True, False]


@pytest.fixture
def drawn(shown, robot, monkeypatch):
    """Return the function that shows 40 s of a robot, and returns the requests to its plots and its ghost."""
    page, choices, _ = shown
    plots, ghosts = [], []
    monkeypatch.setattr(pages.Page, 'watched', True)
    monkeypatch.setattr(Plots, 'draw', lambda _, rows: plots.append(rows))
    monkeypatch.setattr(pages, 'ghost_of', lambda *given: ghosts.append(given[-2:]))
    theta = kinematics.inverse(np.array(PLACE), robot)

    def show():
        page.clear_history()
        for time_s in np.arange(0.0, 40.0, 0.5):
            monkeypatch.setattr(pages, 'PLOT_S', 0.0)
            page.show(Instant(float(time_s), theta, np.array(LAG)))
        return plots[-1], ghosts[-1]

    return choices, show


@pytest.mark.parametrize('seconds', pages.WINDOWS_S)
def test_plots_show_the_seconds_that_are_chosen(seconds, drawn):
    choices, show = drawn
    choices['plots, s'].value = seconds
    rows, _ = show()
    assert rows[-1, 0] - rows[0, 0] == pytest.approx(float(seconds))


@pytest.mark.parametrize('kind', pages.KINDS)
@pytest.mark.parametrize('times', [pages.MAGNIFIED[0], pages.MAGNIFIED[-1], '20'])
def test_the_ghost_is_of_the_kind_and_the_magnification_that_are_chosen(kind, times, drawn):
    choices, show = drawn
    choices['ghost'].value = kind
    choices['error x'].value = times
    assert show()[1] == (kind, float(times))


def test_every_visible_element_has_one_choice(shown):
    used = {*NODES, 'dark', 'plots, s', 'ghost', 'error x'}
    assert set(shown[1]) == used

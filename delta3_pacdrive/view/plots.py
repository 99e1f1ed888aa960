"""Plots over time of the last seconds, in a panel below the picture."""

from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.view.history import History
from delta3_pacdrive.view.values import AXES, Instant

COLOURS = ('#3a86ff', '#f5821e', '#2f9e5b')
LINE = '#868e96'  # of axes and grids: it can be read on white and on black
WIDTH, HEIGHT = 470, 130
SECONDS = (2.0, 5.0, 10.0, 30.0)
# name: first column, names of the series, unit
_XYZ = ('x', 'y', 'z')
PLOTS = {
    'TCP error': (0, _XYZ, 'mm'),
    'following error': (3, AXES, 'mdeg'),
    'torque': (6, AXES, 'N m'),
    'current': (9, AXES, 'A'),
    'TCP': (12, _XYZ, 'mm'),
    'arms': (15, AXES, 'deg'),
    'speed': (18, ('TCP',), 'm/s'),
}
COLUMNS = 19


def row_of(instant: Instant, tcp_m: Floats, error_m: Floats) -> Floats:
    """Return the numbers that are plotted of an instant, with the place and the error of the TCP [m]."""
    return np.concatenate(
        [
            1e3 * error_m,
            1e3 * np.degrees(instant.lag_rad),
            instant.torque_n_m,
            instant.current_a,
            1e3 * tcp_m,
            np.degrees(instant.theta_rad),
            [instant.speed_m_s],
        ]
    )


class Plots:
    """A tab for each kind of signal, fed from one history.

    Parameters
    ----------
    gui
        Of the viser server.
    rows
        Rows that are kept.

    """

    def __init__(self, gui: Any, rows: int) -> None:
        self.history = History(rows, COLUMNS)
        self.seconds = 10.0
        self._charts: dict[str, Any] = {}
        panel = gui.add_panel()
        for name, (_, series, unit) in PLOTS.items():
            with panel.add_tab(name):
                self._charts[name] = _chart(gui, series, f'{name} [{unit}]')
        panel.float(x=10, y=-10, width=WIDTH, height=HEIGHT + 100)
        self._newest_s = np.nan

    def draw(self) -> None:
        """Send the newest rows to the browsers."""
        rows = self.history.last(self.seconds)
        if len(rows) < 2 or rows[-1, 0] == self._newest_s:
            return
        self._newest_s = rows[-1, 0]
        time_s = rows[:, 0]
        for name, (first, series, _) in PLOTS.items():
            columns = [rows[:, 1 + first + n] for n in range(len(series))]
            self._charts[name].data = (time_s, *columns)


def _chart(gui: Any, names: tuple[str, ...], title: str) -> Any:
    nothing = tuple(np.zeros(2) for _ in range(1 + len(names)))
    series = (
        {'label': 't [s]'},
        *(
            {'label': name, 'stroke': colour, 'width': 1.5}
            for name, colour in zip(names, COLOURS, strict=False)
        ),
    )
    axis = {
        'stroke': LINE,
        'grid': {'stroke': LINE + '33', 'width': 1},
        'ticks': {'stroke': LINE + '66', 'width': 1},
    }
    return gui.add_uplot(
        nothing,
        series=series,
        scales={'x': {'time': False}},
        axes=(axis, axis | {'label': title, 'labelSize': 18, 'size': 52}),
        height=HEIGHT,
    )

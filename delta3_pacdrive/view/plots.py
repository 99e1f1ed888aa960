"""Plots over time in a panel below the scene, and their history."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES

COLOURS = ('#3a86ff', '#f5821e', '#2f9e5b', '#c2255c', '#7048e8', '#0b7285', '#a86b00', '#5c677d')
LINE = '#868e96'  # axes and grids: visible on white and on black
WIDTH, HEIGHT = 470, 130
TICKS = 18  # minimum distance of vertical ticks [pixels], so that low charts have more than one
# name: first column, series, unit
_XYZ = ('x', 'y', 'z')
PLOTS = {
    'TCP error': (0, _XYZ, 'mm'),
    'following error': (3, DRIVES, 'mdeg'),
    'torque': (6, DRIVES, 'N m'),
    'current': (9, DRIVES, 'A'),
    'TCP': (12, _XYZ, 'mm'),
    'arms': (15, DRIVES, 'deg'),
    'speed': (18, ('TCP',), 'm/s'),
}
COLUMNS = 19
ERROR, TCP = slice(1, 4), slice(13, 16)  # columns of a row that starts with its time [mm]


def rows_of(
    time_s: Floats,
    theta_rad: Floats,
    lag_rad: Floats,
    torque_n_m: Floats,
    current_a: Floats,
    speed_m_s: Floats,
    error_m: Floats,
    parameters: Parameters,
) -> Floats:
    """Return the plotted values of instants.

    Parameters
    ----------
    time_s, speed_m_s
        Bus time [s] and speed of the TCP [m/s], shape (n,).
    theta_rad, lag_rad, torque_n_m, current_a, error_m
        As in ``Instant``, shape (n, 3).
    parameters
        Parameters of the robot.

    Returns
    -------
    Floats
        Times, then the columns of ``PLOTS``, shape (n, 1 + COLUMNS); nan if forward kinematics has no solution.

    """
    tcp = kinematics.forward(theta_rad, parameters, unreachable='nan')
    return np.column_stack(
        [
            time_s,
            1e3 * error_m,
            1e3 * np.degrees(lag_rad),
            torque_n_m,
            current_a,
            1e3 * tcp,
            np.degrees(theta_rad),
            speed_m_s,
        ]
    )


class Plots:
    """A tab for each kind of signal."""

    def __init__(self, gui: Any) -> None:
        self._charts: dict[str, Any] = {}
        self._panel = panel = gui.add_panel()
        for name, (_, series, unit) in PLOTS.items():
            with panel.add_tab(name):
                self._charts[name] = chart(gui, series, unit)
        panel.float(x=10, y=-10, width=WIDTH, height=HEIGHT + 100)
        self._newest_s = np.nan

    def hide(self) -> None:
        """Hide the panel."""
        self._panel.visible = False

    def draw(self, rows: Floats) -> None:
        """Send rows of ``rows_of`` to the browsers."""
        if len(rows) < 2 or rows[-1, 0] == self._newest_s:
            return
        self._newest_s = rows[-1, 0]
        time_s = rows[:, 0]
        for name, (first, series, _) in PLOTS.items():
            columns = [rows[:, 1 + first + n] for n in range(len(series))]
            self._charts[name].data = (time_s, *columns)


def chart(gui: Any, names: Sequence[str], title: str, time: str = 't [s]') -> Any:
    """Add an empty chart of series over time to the current container; return its handle."""
    nothing = tuple(np.zeros(2) for _ in range(1 + len(names)))
    series = (
        {'label': time},
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
        axes=(axis, axis | {'label': title, 'labelSize': 18, 'size': 52, 'space': TICKS}),
        height=HEIGHT,
    )


class History:
    """Rows of numbers with their times; the oldest of ``rows`` are discarded."""

    def __init__(self, rows: int, columns: int) -> None:
        # twice the required length, so that rows are moved only occasionally
        self._values = np.empty((2 * rows, 1 + columns))
        self._rows, self._count = rows, 0

    def add(self, time_s: float, values: Floats) -> None:
        """Append a row; if time runs backwards, restart."""
        if self._count and time_s <= self._values[self._count - 1, 0]:
            if time_s == self._values[self._count - 1, 0]:
                return
            self._count = 0
        if self._count == len(self._values):
            self._values[: self._rows] = self._values[-self._rows :]
            self._count = self._rows
        self._values[self._count, 0] = time_s
        self._values[self._count, 1:] = values
        self._count += 1

    def clear(self) -> None:
        """Discard all rows."""
        self._count = 0

    def last(self, seconds: float = np.inf) -> Floats:
        """Return the rows of the last seconds, time first, shape (n, 1 + columns)."""
        rows = self._values[max(0, self._count - self._rows) : self._count]
        if not len(rows):
            return rows
        return rows[np.searchsorted(rows[:, 0], rows[-1, 0] - seconds) :]

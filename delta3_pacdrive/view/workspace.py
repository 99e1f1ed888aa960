"""The volume written by ``delta3 workspace --volume FILE.npz`` on the page: coloured slices around the robot."""

import html
import json
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import interrupts, kinematics
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.limits.capability import REACHED
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.values import Facts, Instant

COORDINATES = ('x_m', 'y_m', 'z_m')
ABOUT, LIMIT = 'about', 'limit'
MAP = 'viridis'
CLIPPED = (2.0, 98.0)  # percentiles at the ends of the colour scale
WIDE = 20.0  # ratio of highest to lowest value above which the scale is logarithmic
GREY = (170, 176, 186)  # reachable by the arms, but excluded by a limit
OVERLAP = 0.75  # size of a point over half the distance of neighbours
LEGEND_COLOURS = 9
LOOK_S = 0.2  # between two checks for a signal


@dataclass(frozen=True)
class Volume:
    """The volume of a workspace; all grids have the shape (nx, ny, nz)."""

    axes_m: tuple[Floats, Floats, Floats]  # coordinates of the grid
    limit: Any  # code of the limit that excludes a point, ``REACHED`` for none
    values: dict[str, Floats]  # by name and unit of the quantity; nan outside the reach of the arms

    @staticmethod
    def is_one(path: Path) -> bool:
        """Whether a file looks like a volume; traces are .npz files without limits."""
        try:
            whole_file.require_regular(path)
            with zipfile.ZipFile(path) as file:
                return {f'{LIMIT}.npy', f'{COORDINATES[0]}.npy'} <= set(file.namelist())
        except (OSError, zipfile.BadZipFile):
            return False

    @staticmethod
    def load(path: Path) -> 'Volume':
        """Read a file written by ``delta3 workspace --volume``; raises TraceError."""
        try:
            found = whole_file.arrays_of(path)
            json.loads(str(found.pop(ABOUT)))
            x, y, z = (found.pop(name).astype(np.float64) for name in COORDINATES)
            limit = found.pop(LIMIT)
            shape = len(x), len(y), len(z)
            if not found or min(shape) < 2 or any(grid.shape != shape for grid in (limit, *found.values())):
                raise ValueError(f'its grids do not have the shape {shape}')
            return Volume((x, y, z), limit, {name: grid.astype(np.float64) for name, grid in found.items()})
        except Exception as error:  # zipfile and numpy raise arbitrary exceptions for damaged files
            raise TraceError(f'{path} is not a valid workspace volume: {error}') from error

    def scale(self, name: str) -> 'Scale':
        """Return the colour scale of a quantity, from its values at reachable points."""
        values = self.values[name]
        reached = values[(self.limit == REACHED) & np.isfinite(values)]
        if not len(reached):
            return Scale(0.0, 1.0, False)
        low, high = np.percentile(reached, CLIPPED).tolist()
        return Scale(low, max(high, low + 1e-12), low > 0.0 and high > WIDE * low)

    def slice(self, axis: int, place_m: float) -> tuple[Floats, tuple[Any, ...]]:
        """Return the points [m], shape (n, 3), of the layer nearest to a position on an axis, and their indices."""
        number = int(np.argmin(np.abs(self.axes_m[axis] - place_m)))
        index = [np.arange(len(own)) for own in self.axes_m]
        index[axis] = np.array([number])
        grid = np.meshgrid(*index, indexing='ij')
        flat = tuple(one.ravel() for one in grid)
        finite = np.isfinite(next(iter(self.values.values()))[flat])
        chosen = tuple(one[finite] for one in flat)
        return np.stack([own[n] for own, n in zip(self.axes_m, chosen, strict=True)], axis=1), chosen


@dataclass(frozen=True)
class Scale:
    """A linear or logarithmic colour scale."""

    low: float
    high: float
    logarithmic: bool

    def share(self, values: Floats) -> Floats:
        """Return the positions of values on the scale, 0 to 1."""
        low, high = self.low, self.high
        if self.logarithmic:
            values, low, high = np.log(np.maximum(values, low)), np.log(low), np.log(high)
        return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))

    def at(self, share: float) -> float:
        """Return the value at a position on the scale."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)


def colours(volume: Volume, name: str, index: tuple[Any, ...]) -> Any:
    """Return the colours of points by a quantity, 0 to 255; grey where a limit excludes them."""
    from matplotlib import colormaps

    values = np.nan_to_num(volume.values[name][index])
    found = (255.0 * colormaps[MAP](volume.scale(name).share(values))[:, :3]).astype(np.uint8)
    found[volume.limit[index] != REACHED] = GREY
    return found


def legend(name: str, scale: Scale) -> str:
    """Return the colour scale as HTML."""
    from matplotlib import colormaps

    shares = np.linspace(0.0, 1.0, LEGEND_COLOURS)
    stops = ', '.join(
        f'rgb({", ".join(str(int(255 * part)) for part in colormaps[MAP](share)[:3])})' for share in shares
    )
    marks = ''.join(f'<span>{scale.at(share):.3g}</span>' for share in (0.0, 0.5, 1.0))
    return (
        f'<div style="padding:4px 12px;font-size:13px"><b>{html.escape(name)}</b>'
        f'<div style="height:12px;border-radius:3px;background:linear-gradient(90deg, {stops})"></div>'
        f'<div style="display:flex;justify-content:space-between">{marks}</div>'
        '<span style="opacity:.75">grey: within reach of the arms, but excluded by a limit</span></div>'
    )


class Slices:
    """Slices of a volume on a page, with their controls."""

    def __init__(self, page: Page, volume: Volume) -> None:
        self._volume, self._scene = volume, page.server.scene
        gui: Any = page.server.gui
        names = tuple(volume.values)
        with page.top:
            self._name = gui.add_dropdown('colour', names, initial_value=names[0])
            self._legend = gui.add_html('')
            self._shown, self._places = [], []
            for letter, own, shown in zip('xyz', volume.axes_m, (False, True, True), strict=True):
                low, high = (1e3 * float(end) for end in own[[0, -1]])
                middle = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)
                self._shown.append(gui.add_checkbox(f'slice {letter}', shown))
                step = 1e3 * float(own[1] - own[0])
                self._places.append(gui.add_slider(f'{letter} mm', low, high, step, middle))
        self._name.on_update(lambda _: self.draw())
        for axis, handles in enumerate(zip(self._shown, self._places, strict=True)):
            for handle in handles:
                handle.on_update(lambda _, axis=axis: self.draw(axis))
        self.draw()

    def draw(self, only: int | None = None) -> None:
        """Draw all slices, or only that of one axis."""
        volume, name = self._volume, self._name.value
        self._legend.content = legend(name, volume.scale(name))
        step = min(float(own[1] - own[0]) for own in volume.axes_m)
        for axis in range(3) if only is None else (only,):
            path = f'/volume/{"xyz"[axis]}'
            places, index = volume.slice(axis, 1e-3 * float(self._places[axis].value))
            self._scene.add_point_cloud(
                path,
                places.astype(np.float32),
                colours(volume, name, index),
                point_size=OVERLAP * step,
                point_shape='square',
                visible=bool(self._shown[axis].value),
            )


def run(page: Page, parameters: Any, volume: Volume, title: str) -> None:
    """Show a volume around a robot at its home position until a signal ends it."""
    over = interrupts.Flag()
    page.hide_motion()
    Slices(page, volume)
    page.open()
    instant = Instant(0.0, kinematics.inverse(np.array(parameters.motion.home_m), parameters))
    facts = Facts(state='paused', recording=title)
    with interrupts.answered_by(over.set, interrupts.PATIENCE_S):
        while not over:
            page.show(instant)
            page.read(facts)
            time.sleep(LOOK_S)

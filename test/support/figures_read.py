"""Reads titles, names and units of axes, legends, and every curve in the unit of its axis.

``figure_contents`` declares for each function that draws a figure which signals, in SI units, are its curves. A label
names its unit in square brackets; the drawn numbers must be the signal in that unit.
"""

import math
import re
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from delta3_pacdrive.studies.framework.figure_style import UNITS_OF_KEYS

RAD = math.degrees(1.0)
# drawn value = factor x value in SI units
FACTORS = dict.fromkeys(UNITS_OF_KEYS.values(), 1.0) | {
    'mm': 1e3, 'um': 1e6, 'µm': 1e6, 'ms': 1e3, 'min': 1.0 / 60.0, '1/min': 60.0, 'mrad': 1e3, 'deg': RAD,
    'mdeg': 1e3 * RAD, 'deg/s': RAD, 'deg/s2': RAD, 'rpm': 60.0 / math.tau, '%': 100.0, '% of the peak': 100.0,
    **dict.fromkeys(
        ('m2', 'A rms', '1/m', '1', 'bits', 'SI', 'm/rad', 'W', 'noise per 100 %', 'squares of the noise',
         'standard deviations of their noise'),
        1.0,
    ),
}  # fmt: skip
# names of axes that count, or that show a ratio
WITHOUT_UNIT = re.compile(
    r'|(trial|repetition|measurement|arm|runs|lag|share( of its variance)?|singular value( \(x: below threshold\))?'
    r'|condition number of J( \(dashed\))?|cosine to the true slope|factor on the true value'
    r'|step, share of the value|gripper|condition|[1-7]|Errors of centimetres .*|An error of .*|[a-z_0-9.[\]]+)',
    re.DOTALL,
)
RELATIVE = 1e-9  # of the largest value of a curve


class Curve(NamedTuple):
    """A curve is drawn in one of the ways that ``drawn`` distinguishes; an empty label is not compared."""

    kind: str
    label: str
    x: Any
    y: Any


def line(y, label='', x=None):
    return Curve('line', label, x, y)


def level(y, label=''):
    return Curve('level', label, None, y)


def mark(x, label=''):
    return Curve('mark', label, x, None)


def band(low, high, label='', x=None):
    return Curve('band', label, x, (low, high))


def bars(y, label=''):
    return Curve('bars', label, None, y)


def dots(x, y, label=''):
    return Curve('dots', label, x, y)


class Panel:
    """A panel has names of its axes and curves in SI units; ``title`` and ``ticks`` are compared where they are given.

    A name has a unit only where the figure leaves it to a neighbour or to the title of a panel. The third coordinate
    of a curve in space is ``z``, as part of its ``y``: (n, 3) values without ``x``.
    """

    def __init__(self, x_name, x, y_name, *curves, title=None, ticks=None):
        self.names, self.x, self.curves = {'x': x_name, 'y': y_name}, x, curves
        self.title, self.ticks = title, ticks


def read_figure(figure, title, panels):
    """Compare a figure with the words of its title and the contents of its panels, in the order of its axes."""
    assert ' '.join(title.split()) in ' '.join(figure.get_suptitle().split()), (title, figure.get_suptitle())
    axes = [own for own in figure.axes if own.get_label() != '<colorbar>']
    assert len(axes) == len(panels), f'{title}: {len(axes)} panels, not {len(panels)}'
    looks = read_legends(figure)
    for own, panel in zip(axes, panels, strict=True):
        for part in panel if isinstance(panel, tuple) else (panel,):
            if isinstance(part, Panel):
                read_panel(own, part, looks)
            else:
                part(own)
    for own in figure.axes:
        if own.get_label() == '<colorbar>':
            unit_of(own.get_ylabel() or own.get_xlabel())


def read_legends(figure):
    """Return the texts of the legends by the look of their handles; a curve of the same name must look the same."""
    from matplotlib.lines import Line2D

    of_axes = [own.get_legend() for own in figure.axes]
    looks, curves = {}, [one for own in figure.axes for one in own.lines]
    names = {name for own in figure.axes for name in own.get_legend_handles_labels()[1]}
    for legend in [*figure.legends, *filter(None, of_axes)]:
        assert len(legend.legend_handles) == len(legend.get_texts())
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            if not isinstance(handle, Line2D):
                continue
            name = text.get_text()
            same = [one for one in curves if one.get_label() == name]
            assert not same or any(look(one)[:2] == look(handle)[:2] for one in same), f'colour of {name!r}'
            if legend in of_axes:
                assert name in names, f'no curve has the label {name!r}'
            looks[look(handle)] = name
    return looks


def look(curve):
    """Return colour, dashes and marker of a line."""
    from matplotlib.colors import to_hex

    return to_hex(curve.get_color()), curve.get_linestyle(), str(curve.get_marker())


def drawn(axes):
    """Return the curves of a panel as they are drawn, in the units of its labels, with the artists."""
    found = []
    for one in axes.lines:
        label = one.get_label()
        x, y = one.get_xdata(), one.get_ydata()
        kind = 'line'
        if hasattr(one, 'get_data_3d'):
            x, y = None, np.transpose([np.atleast_1d(values) for values in one.get_data_3d()])
        elif one.get_transform() == axes.get_yaxis_transform():
            kind, x, y = 'level', None, y[0]
        elif one.get_transform() == axes.get_xaxis_transform():
            kind, x, y = 'mark', x[0], None
        found.append((Curve(kind, '' if label.startswith('_') else label, x, y), one))
    for one in axes.collections:
        if (
            type(one).__name__ in ('FillBetweenPolyCollection', 'PolyCollection')
            and len(one.get_paths()) == 1
        ):
            corners = one.get_paths()[0].vertices
            half = (len(corners) - 3) // 2
            x, low, high = corners[1 : half + 1, 0], corners[1 : half + 1, 1], corners[half + 2 : -1, 1][::-1]
            found.append((Curve('band', one.get_label(), x, (low, high)), None))
        elif type(one).__name__ == 'PathCollection':
            x, y = np.ma.getdata(one.get_offsets()).T
            found.append((Curve('dots', one.get_label(), x, y), None))
    for one in axes.containers:
        if getattr(one, 'orientation', None) in ('horizontal', 'vertical'):
            flat = one.orientation == 'horizontal'
            ends = [p.get_x() + p.get_width() if flat else p.get_y() + p.get_height() for p in one.patches]
            found.append((Curve('bars', one.get_label(), None, np.array(ends)), flat))
    return found


def read_panel(axes, panel, looks):
    """Compare titles, labels and curves of a panel."""
    title = axes.get_title('left') or axes.get_title() or axes.get_title('right')
    if panel.title is not None:
        assert title == panel.title
    space = hasattr(axes, 'get_zlabel')
    factors = {}
    for way, name in panel.names.items():
        if space:
            text = {getattr(axes, f'get_{own}label')() for own in 'xyz'}
            assert text == {f'{own} [mm]' for own in 'xyz'}, text
            factors[way] = FACTORS['mm']
        else:
            factors[way] = read_label(axes, way, name, title)
    if panel.ticks is not None:
        texts = [[tick.get_text() for tick in own.get_ticklabels()] for own in (axes.xaxis, axes.yaxis)]
        assert list(panel.ticks) in [[' '.join(t.split()) for t in of] for of in texts], (panel.ticks, texts)
    found = drawn(axes)
    for kind in ('line', 'level', 'mark', 'band', 'dots', 'bars'):
        own = [(curve, artist) for curve, artist in found if curve.kind == kind]
        wanted = [curve for curve in panel.curves if curve.kind == kind]
        place = f'{panel.names}: {kind}'
        assert len(own) == len(wanted), f'{place}: {len(own)} are drawn, not {len(wanted)}'
        for (curve, artist), expected in zip(own, wanted, strict=True):
            name = curve.label
            if kind == 'line' and not name:
                name = looks.get(look(artist), '')
            if expected.label:
                assert name == expected.label, f'{place}: {name!r} is not {expected.label!r}'
            where = f'{place} {expected.label}'
            along = factors['x' if kind == 'bars' and artist else 'y']
            if expected.y is not None:
                own_y, wanted_y = np.asarray(curve.y, float), along * np.asarray(expected.y, float)
                agree(
                    own_y, wanted_y.reshape(own_y.shape) if own_y.size == wanted_y.size else wanted_y, where
                )
            x = panel.x if expected.x is None and kind in ('line', 'band') else expected.x
            if x is not None and curve.x is not None:
                own_x, wanted_x = (np.atleast_1d(np.asarray(one, float)) for one in (curve.x, x))
                agree(own_x, factors['x'] * wanted_x, f'{where}, x')


def read_label(axes, way, name, title):
    """Return the factor of the unit of an axis; neighbouring axes may share a label."""
    shared = getattr(axes, f'get_shared_{way}_axes')().get_siblings(axes)
    text = getattr(axes, f'get_{way}label')() or next(
        filter(None, (getattr(own, f'get_{way}label')() for own in shared)), ''
    )
    if not text:
        assert '[' in name or WITHOUT_UNIT.fullmatch(name), f'no label says {name!r}'
        if '[' in name and '[' in title:
            assert unit_of(name)[1] == unit_of(title)[1], (name, title)
        return unit_of(name)[1]
    own, factor = unit_of(text)
    assert own == re.sub(r'(^| )\[[^\]]*\]$', '', name) or not name, f'{own!r} is not {name!r}'
    return factor


def unit_of(text):
    """Return name and factor of a label; a quantity that has a unit must name it in square brackets."""
    plain = ' '.join(text.replace('^2', '2').replace('^3', '3').replace('²', '2').split())
    if found := re.match(r'(?:(.*) |)\[([^\[\]]*)\]', plain):
        unit = re.sub(r'[$]', '', found[2]) if '$' in found[2] else found[2]
        assert unit in FACTORS or unit.startswith('samples of'), f'{text!r}: {unit!r} is not a unit'
        return found[1] or '', FACTORS.get(unit, 1.0)
    assert WITHOUT_UNIT.fullmatch(plain), f'{text!r} has no unit in square brackets'
    return plain, 1.0


def agree(values, expected, where):
    """Require drawn numbers to be those expected, within the rounding of their size."""
    values, expected = np.ma.getdata(values), np.asarray(expected)
    assert values.shape == expected.shape, f'{where}: {values.shape} are drawn, not {expected.shape}'
    size = float(np.nanmax(np.abs(expected), initial=0.0))
    same = np.isclose(values, expected, rtol=RELATIVE, atol=RELATIVE * size, equal_nan=True)
    assert same.all(), f'{where}: {values[~same][:3]} are drawn, not {expected[~same][:3]}'


def function_of(draw):
    """Return the function inside partial functions, with all arguments that they add."""
    arguments, named = (), {}
    while isinstance(draw, partial) or hasattr(draw, '__wrapped__'):
        if isinstance(draw, partial):
            arguments, named, draw = (*draw.args, *arguments), draw.keywords | named, draw.func
        else:
            draw = draw.__wrapped__
    return draw, arguments, named


def name_of(function):
    """Return the name of a drawing function: its module within the analysis, and its own."""
    return f'{function.__module__.removeprefix("delta3_pacdrive.studies.")}.{function.__name__}'

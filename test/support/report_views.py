"""A report page in a browser: choice of the instant, and checks of the drawing."""

import io

import matplotlib.image
import numpy as np

WAIT_MS = 30_000
READY = 'html[data-ready="yes"]'


def until(visit, condition):
    """Wait in the page until a condition holds."""
    visit.page.evaluate(
        'new Promise((done, failed) => {'
        f' setTimeout(() => failed(new Error("waited too long for {condition}")), {WAIT_MS});'
        f' const look = () => ({condition}) ? done() : requestAnimationFrame(look); look() }})'
    )


def seek(visit, time_s):
    """Go to an instant, and wait until it is drawn."""
    visit.page.evaluate(
        'time => new Promise(done => {'
        ' delta3.clock.seek(time); requestAnimationFrame(() => requestAnimationFrame(done)) })',
        time_s,
    )


def pixels(visit):
    """Return the image on the screen, shape (height, width, 3), 0 to 255."""
    picture = matplotlib.image.imread(io.BytesIO(visit.page.screenshot()), format='png')
    return np.rint(255.0 * picture[:, :, :3])


def place_of(visit, point_m):
    """Return the pixel (x, y) of a place [m], by the camera of the page."""
    view = visit.page.evaluate('delta3.stage.projection()')
    x, y, _, w = np.reshape(view['matrix'], (4, 4)).T @ [*point_m, 1.0]
    return np.array(
        [
            view['left'] + (0.5 + 0.5 * x / w) * view['width'],
            view['top'] + (0.5 - 0.5 * y / w) * view['height'],
        ]
    )


def middle_of(mask):
    """Return the middle (x, y) of the pixels that are chosen."""
    rows, columns = np.nonzero(mask)
    assert len(rows), 'nothing is drawn there'
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])

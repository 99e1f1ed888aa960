"""Tests of the barrier of time-optimal motions: value, gradient and curvature, for any size of the last block."""

import numpy as np
import pytest

from delta3_pacdrive.planning.timing import barrier
from delta3_pacdrive.planning.timing.barrier import LANES, Demand

SHARPNESS, HEAT = 1e3, 0.2
COUNTS = (LANES - 1, LANES, LANES + 1, 3 * LANES + 5)
KINDS = ('bounded', 'accelerated', 'jerked', 'rated')
SHAPES = ((6, 4), (2, 2), (6, 3), (6, 4))
STEP = 1e-6


def parts_of(count, kinds=KINDS, with_roots=True):
    """Return limits of some kinds that a spline of ones, more or less, keeps; by grid points."""
    random = np.random.default_rng(count)
    parts = [random.uniform(2.0, 3.0, count), random.uniform(5.0, 9.0, count) * count]
    for kind, shape in zip(KINDS, SHAPES, strict=True):
        rows = random.uniform(-0.2, 0.2, (count, *shape))[:, : shape[0] if kind in kinds else 0]
        rows[:, :, 1] /= count
        if kind in ('jerked', 'rated'):
            rows[:, :, 2] /= count**2
        if kind == 'bounded' and not with_roots:
            rows[:, :, 3] = 0.0
        parts.append(rows)
    parts[3][:, 1:, 1] = 0.0  # across the path there is nothing by y'
    return parts


def spline_of(count):
    return 1.0 + 0.02 * np.sin(np.arange(count + 2.0))


def evaluated(c, parts, heat=0.0):
    """Return value, gradient, and Hessian as a full matrix."""
    gradient, band = np.empty(len(c)), np.empty((3, len(c)))
    demand = Demand(*(barrier.in_blocks(part) for part in parts))
    value = barrier.evaluate(c, demand, SHARPNESS, heat, gradient, band)
    hessian = np.diag(band[0])
    for below in (1, 2):
        hessian += np.diag(band[below][:-below], -below) + np.diag(band[below][:-below], below)
    return value, gradient, hessian


def barrier_of(c, parts, heat=0.0):
    """Return the barrier as its definition has it."""
    square_max, change_max, bounded, accelerated, jerked, rated = parts
    h = 1.0 / (len(c) - 3)
    y = (c[:-2] + 4.0 * c[1:-1] + c[2:]) / 6.0
    d = (c[2:] - c[:-2]) / (2.0 * h)
    e = (c[:-2] - 2.0 * c[1:-1] + c[2:]) / h**2
    time = SHARPNESS * h / np.sqrt(y)
    time[[0, -1]] *= 0.5
    first, third = np.stack([y, d], axis=1)[:, None], np.stack([y, d, e], axis=1)[:, None]
    share = (bounded[..., :2] * first).sum(axis=2) + bounded[..., 2] + bounded[..., 3] * np.sqrt(y)[:, None]
    left = [1.0 - y / square_max, *((1.0 - share) * (1.0 + share)).T, 1.0 - (d / (change_max * y)) ** 2, y**2]
    if accelerated.shape[1]:
        left.append(1.0 - ((accelerated * first).sum(axis=2) ** 2).sum(axis=1))
    for side in np.split(jerked, 2, axis=1) if jerked.shape[1] else ():
        left.append(1.0 / y - ((side * third).sum(axis=2) ** 2).sum(axis=1))
    rate = (rated[..., :3] * third).sum(axis=2) + rated[..., 3]
    left.extend((1.0 / y[:, None] - rate**2).T)
    heated = heat * (time[:, None] * share[:, :3] ** 2).sum()
    return time.sum() + heated - sum(np.log(one).sum() for one in left)


@pytest.mark.parametrize('count', COUNTS)
def test_its_value_is_that_of_its_definition_however_many_points_there_are(count):
    c, parts = spline_of(count), parts_of(count)
    assert evaluated(c, parts, HEAT)[0] == pytest.approx(barrier_of(c, parts, HEAT), rel=1e-12)


@pytest.mark.parametrize('count', COUNTS)
def test_its_gradient_is_the_slope_of_its_value(count):
    c, parts = spline_of(count), parts_of(count)
    slope = np.empty(len(c))
    for n, step in enumerate(STEP * np.eye(len(c))):
        slope[n] = (barrier_of(c + step, parts, HEAT) - barrier_of(c - step, parts, HEAT)) / (2.0 * STEP)
    found = evaluated(c, parts, HEAT)[1]
    np.testing.assert_allclose(found, slope, rtol=0.0, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize('count', COUNTS)
def test_hessian_is_the_derivative_of_the_gradient_without_concave_terms(count):
    c, parts = spline_of(count), parts_of(count, ('bounded', 'accelerated'), with_roots=False)
    slopes = np.empty((len(c), len(c)))
    for n, step in enumerate(STEP * np.eye(len(c))):
        slopes[n] = (evaluated(c + step, parts, HEAT)[1] - evaluated(c - step, parts, HEAT)[1]) / (2.0 * STEP)
    found = evaluated(c, parts, HEAT)[2]
    np.testing.assert_allclose(found, slopes, rtol=0.0, atol=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize('kind', range(len(Demand._fields)))
@pytest.mark.parametrize('point', [0, LANES, -1])
def test_violation_of_one_limit_at_one_point_is_detected(kind, point):
    count = 2 * LANES + 3
    c, parts = spline_of(count), parts_of(count)
    assert np.isfinite(evaluated(c, parts)[0])
    if kind < 2:
        parts[kind][point] = 1e-3
    else:
        parts[kind][point, -1, 0] = 2.0
    assert evaluated(c, parts)[0] == np.inf


@pytest.mark.parametrize('wrong', [0.0, -1.0, np.nan])
def test_non_positive_square_exceeds_all_limits(wrong):
    c, parts = spline_of(LANES), parts_of(LANES)
    c[5:8] = wrong
    assert evaluated(c, parts)[0] == np.inf

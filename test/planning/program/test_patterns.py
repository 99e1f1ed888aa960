"""Tests of patterns of places."""

import math

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program.frames import Frame
from delta3_pacdrive.planning.program.patterns import Grid, Layers, Order

PITCH = (0.04, 0.05)
BOX = Frame.turned((0.1, -0.1, -0.85), yaw_rad=math.pi / 6)


def test_places_of_a_row_run_along_x_and_rows_along_y():
    grid = Grid(2, 3, PITCH)
    expected = [[0, 0, 0], [0.04, 0, 0], [0.08, 0, 0], [0, 0.05, 0], [0.04, 0.05, 0], [0.08, 0.05, 0]]
    np.testing.assert_array_equal(grid.places_m(), expected)
    assert len(grid) == 6


def test_snake_returns_along_every_other_row():
    snake = Grid(3, 3, PITCH, Order.SNAKE)
    x = [0, 0.04, 0.08, 0.08, 0.04, 0, 0, 0.04, 0.08]
    np.testing.assert_array_equal(snake.places_m()[:, 0], x)
    steps = np.diff(snake.places_m(), axis=0)
    assert np.linalg.norm(steps, axis=1) == pytest.approx([0.04, 0.04, 0.05, 0.04, 0.04, 0.05, 0.04, 0.04])
    assert sorted(snake) == sorted(Grid(3, 3, PITCH))


def test_one_layer_is_filled_after_the_other_and_every_other_one_is_shifted():
    layers = Layers(Grid(2, 2, PITCH), 3, 0.03, (0.02, -0.01))
    places = layers.places_m()
    assert len(layers) == 12
    grid = Grid(2, 2, PITCH).places_m()
    np.testing.assert_allclose(places[:4], grid, rtol=0, atol=0)
    np.testing.assert_allclose(places[4:8], np.add(grid, [0.02, -0.01, 0.03]), rtol=0, atol=1e-15)
    np.testing.assert_allclose(places[8:], np.add(grid, [0.0, 0.0, 0.06]), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    'pattern', [Grid(3, 4, PITCH, Order.SNAKE, BOX), Layers(Grid(2, 3, PITCH, frame=BOX), 2, 0.03)]
)
def test_places_are_in_base_by_number_in_a_loop_and_all_together(pattern):
    places = pattern.places_m()
    assert places.shape == (len(pattern), 3)
    assert (
        [pattern[n] for n in range(len(pattern))] == list(pattern) == [tuple(one) for one in places.tolist()]
    )
    assert [*reversed(pattern)] == [*pattern][::-1]
    assert pattern[-1] == pattern[len(pattern) - 1]
    np.testing.assert_allclose(BOX.from_base(pattern[1]), pattern.place_m(1), rtol=0, atol=1e-15)
    for outside in (len(pattern), -len(pattern) - 1):
        with pytest.raises(IndexError, match=f'there is no place {outside}, the pattern has {len(pattern)}'):
            pattern[outside]


def test_the_frame_at_a_place_begins_there_with_the_axes_of_the_pattern():
    grid = Grid(3, 4, PITCH, frame=BOX)
    place = grid.frame_at(5, 'place')
    np.testing.assert_allclose(place.to_base([0, 0, 0]), grid[5], rtol=0, atol=1e-15)
    np.testing.assert_allclose(place.in_base.axes, BOX.axes, rtol=0, atol=1e-15)


def test_pitch_may_be_negative():
    assert Grid(1, 2, (-0.04, 0.0))[1] == (-0.04, 0.0, 0.0)


@pytest.mark.parametrize(
    ('make', 'sentence'),
    [
        (lambda: Grid(0, 3, PITCH), 'rows of a grid must be a whole number from 1 to 1000000, not 0'),
        (lambda: Grid(2, 2.5, PITCH), 'columns of a grid must be a whole number'),
        (lambda: Grid(True, 2, PITCH), 'rows of a grid must be a whole number'),
        (lambda: Grid(1001, 1000, PITCH), 'a grid of 1001 x 1000 has more than 1000000 places'),
        (lambda: Grid(2, 2, (0.0, 0.05)), 'a grid has 2 columns, but pitch_m between them is 0'),
        (lambda: Grid(2, 2, (0.04, 0.0)), 'a grid has 2 rows, but pitch_m between them is 0'),
        (lambda: Grid(2, 2, (0.04, math.nan)), 'pitch_m of a grid must be a finite number [m], not nan'),
        (lambda: Grid(2, 2, 0.04), 'pitch_m of a grid must be 2 numbers [m], not 0.04'),
        (lambda: Grid(2, 2, (40, 50)), 'farther than 10 m: are these millimetres?'),
        (lambda: Grid(2, 2, PITCH, 'zigzag'), "order of a grid is 'zigzag', but must be rows or snake"),
        (lambda: Layers(Grid(2, 2, PITCH), 0, 0.03), 'count of layers must be a whole number'),
        (lambda: Layers(Grid(2, 2, PITCH), 2, 0.0), 'there are 2 layers, but height_m between them is 0'),
        (lambda: Layers(Grid(2, 2, PITCH), 2, math.inf), 'height_m of layers must be a finite number'),
        (lambda: Layers(Grid(2, 2, PITCH), 2, 0.03, (0.0,)), 'shift_m of layers must be 2 numbers'),
        (lambda: Layers(Grid(100, 100, PITCH), 101, 0.03), 'more than 1000000 places'),
        (lambda: Layers(BOX, 2, 0.03), 'layers are made of a grid, not of Frame'),
    ],
)
def test_invalid_pattern_is_rejected(make, sentence):
    with pytest.raises(ProgramError) as caught:
        make()
    assert sentence in str(caught.value)


def test_small_whole_numbers_of_numpy_do_not_overflow():
    grid = Grid(np.int8(20), np.int8(20), PITCH)
    assert len(grid) == 400
    assert len(Layers(grid, np.int8(2), 0.02)) == 800

"""Tests of the belt camera: reported parts, latency and missed parts."""

from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive.belts.camera import CameraState
from delta3_pacdrive.belts.model import Belt, BeltState, Camera, SpeedChange, Stream
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.world import World

CYCLE_S = 1e-3
LINE = Belt(
    'line', (0.0, 0.0, 0.0), 0.0, 2.0, 1e5, (SpeedChange(0.0, 0.5, 100.0),), stream=Stream('bar', 400, 0.1)
)
PLAIN = Camera(at_m=0.5, length_m=0.2, every_m=0.2, latency_s=0.03)


def told(camera, cycles, seed=1, dead_from=None, line=LINE):
    """Return all reports of a number of bus cycles, each with its cycle; the belt; and the camera."""
    belt = BeltState(line, CYCLE_S, 0, np.random.default_rng(5))
    state = CameraState(camera, CYCLE_S, np.random.default_rng(seed))
    found = []
    for cycle in range(cycles):
        belt.step(cycle)
        belt.leave()
        state.dead = dead_from is not None and cycle >= dead_from
        found += [(cycle, one) for one in state.step(cycle, belt)]
    return found, state


def test_picture_content_is_reported_its_latency_later_with_the_count_of_the_picture():
    found, state = told(PLAIN, 4000)
    assert state.pictures == 9
    # pictures at each 0.2 m, in each of which two or three parts lie
    cycle, first = found[0]
    way = (first.count + 0.5) / 1e5
    assert 0.4 <= way < 0.401 or 0.6 <= way < 0.601
    assert cycle == pytest.approx(way / 0.5 / CYCLE_S + 30, abs=4)
    assert all(0.4 <= one.along_m <= 0.6 for _, one in found)
    assert (first.type, first.across_m, first.angle_rad) == ('bar', 0.0, 0.0)


@pytest.mark.parametrize(
    ('latency_s', 'cycles'), [(0.0, 0), (0.001, 1), (0.0295, 30), (0.03, 30), (0.0301, 31)]
)
def test_latency_is_a_number_of_cycles_and_zero_reports_in_the_cycle_of_the_picture(latency_s, cycles):
    found, state = told(replace(PLAIN, latency_s=latency_s), 2000)
    belt, counts = BeltState(LINE, CYCLE_S, 0, np.random.default_rng(5)), []
    for cycle in range(2000):
        belt.step(cycle)
        counts.append(belt.count)
    assert len(found) > 4
    assert {cycle - counts.index(one.count) for cycle, one in found} == {cycles}
    assert state.latency_cycles == cycles


def test_adjoining_pictures_show_every_part_at_its_true_position_only():
    found, _ = told(PLAIN, 8000)
    places = np.array([one.along_m - (one.count + 0.5) / 1e5 for _, one in found])
    assert np.abs(places - np.round(places, 1)).max() < 1e-3
    numbers = set(np.rint(-places * 10).astype(int))
    assert set(range(30)) <= numbers


def test_noise_has_its_deviation_and_the_seed_its_bits():
    noisy = replace(PLAIN, noise_m=1e-3, noise_rad=0.02)
    found, _ = told(noisy, 60_000)
    across, angles = (
        np.array([getattr(one, name) for _, one in found]) for name in ('across_m', 'angle_rad')
    )
    assert len(across) > 200
    assert across.std() == pytest.approx(1e-3, rel=0.15)
    assert angles.std() == pytest.approx(0.02, rel=0.15)
    assert told(noisy, 4000)[0] == told(noisy, 4000)[0] != told(noisy, 4000, seed=2)[0]


def test_some_parts_are_missed_and_some_are_reported_twice():
    whole = len(told(PLAIN, 60_000)[0])
    assert len(told(replace(PLAIN, missed_share=0.3), 60_000)[0]) == pytest.approx(0.7 * whole, rel=0.12)
    assert len(told(replace(PLAIN, doubled_share=0.3), 60_000)[0]) == pytest.approx(1.3 * whole, rel=0.08)


def test_failed_camera_takes_no_pictures_and_resumes_in_step():
    found, state = told(PLAIN, 4000, dead_from=2000)
    assert state.pictures == 4
    assert max(cycle for cycle, _ in found) < 2000 + 30


CELL = {
    'parts': {'bar': {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'belts': {
        'line': {
            'origin_mm': [0, 0, 0], 'length_mm': 2000, 'encoder': {'bits': 14, 'circumference_mm': 200},
            'speed': [{'after_s': 0, 'speed_m_s': 0.5}],
            'stream': {'part': 'bar', 'count': 40, 'spacing_mm': 100},
            'camera': {
                'at_mm': 500, 'length_mm': 200, 'every_mm': 200, 'latency_s': 0.03, 'noise_mm': 1, 'noise_deg': 90,
                'missed_share': 0.1, 'doubled_share': 0.2,
            },
        }
    },
}  # fmt: skip


def test_camera_of_a_cell_file_has_si_units_and_reports_its_detections():
    cell = cell_file.parse(CELL)
    camera = cell.belts['line'].camera
    assert camera == Camera(0.5, 0.2, 0.2, 0.03, 0.001, pytest.approx(np.pi / 2), 0.1, 0.2)
    dead = {'faults': [{'fault': 'camera_dead', 'belt': 'line', 'after_s': 2.0}]}
    counts = []
    for more in ({}, dead):
        world, cycles = World(cell_file.parse(CELL | more), CYCLE_S), []
        for cycle in range(6000):
            world.step(cycle, (0.0, 0.0, 0.5), 0)
            cycles += [cycle] * len(world.sightings['line'])
        counts.append(cycles)
    assert len(counts[0]) > 20
    assert counts[1] == [cycle for cycle in counts[0] if cycle < 2030]

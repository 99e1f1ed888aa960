"""Tests of the history of a cell: positions of parts in traces and bags as in the simulation."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bags import CYCLES, messages, record
from cell_truth import bag_of, counted, packaging, picks_from_a_belt, text
from delta3_pacdrive.cell.cell_scene import Kind
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import cell_history as cell_story
from delta3_pacdrive.studies.runs import runs

EXACT_M = 1e-6
INCREMENT_M = 0.2 / 2**14  # of the encoder of the belt
RECORDED = range(1400, 2400)  # bus cycles of a bag
THING = {
    'kind': 'belt', 'name': 'line', 'at_m': [0, 0, 0], 'angle_rad': 0, 'size_m': [1, 1],
    'increments_per_m': 1000,
}  # fmt: skip


@pytest.fixture(scope='module')
def packaged():
    return packaging()


@pytest.fixture(scope='module')
def belted():
    return picks_from_a_belt(slip=0.01)


def differences_m(story, truth, cycles):
    """Return how far parts of a story are from their true places [m], by bus cycle and number."""
    found = {}
    for cycle in cycles:
        tcp, at = truth.cycles[cycle]
        for part, place, angle in story.at(cycle, tcp):
            true_place, true_angle = at[part['number']]
            assert angle == pytest.approx(true_angle, abs=1e-6)
            found[cycle, part['number']] = np.linalg.norm(np.subtract(place, true_place))
    return found


@pytest.mark.parametrize('run', ['packaged', 'belted'])
def test_parts_of_a_trace_are_where_the_simulation_has_them(run, request):
    trace, truth = request.getfixturevalue(run)
    found = differences_m(cell_story.of_trace(trace, run), truth, truth.cycles)
    assert len(found) > len(truth.cycles)  # more than one part at a time
    assert {number for _, number in found} == set(range(len(truth.made)))
    assert max(found.values()) < EXACT_M


def test_a_part_that_has_left_its_belt_or_its_box_is_not_there(belted):
    trace, truth = belted
    story = cell_story.of_trace(trace, 'trace')
    last = max(truth.cycles)
    assert [part['outcome'] for part in story.parts] == ['placed', 'placed', 'passed']
    assert list(story.at(last, truth.cycles[last][0])) == []


def test_trace_yields_objects_outcomes_and_paths(belted):
    trace, _ = belted
    story = cell_story.of_trace(trace, 'trace')
    assert [thing.kind for thing in story.things] == [Kind.BELT, Kind.WINDOW, Kind.BARRIER, Kind.BOX]
    assert (story.outcomes['placed'], story.outcomes['passed']) == (2, 1)
    np.testing.assert_array_equal(story.ways['line'], trace['cell_belts'][:, 0])
    assert story.way_m('line', 10.5) == pytest.approx(trace['cell_belts'][10:12, 0].mean(), abs=1e-12)
    assert math.isnan(story.way_m('line', len(trace.time_s)))
    assert math.isnan(story.way_m('another', 0))


def test_a_part_that_began_to_ride_before_the_recording_is_not_there(belted):
    trace, _ = belted
    late = Trace(trace.time_s[1000:], {k: v[1000:] for k, v in trace.signals.items()}, trace.meta)
    stories = cell_story.of_trace(trace, 'all'), cell_story.of_trace(late, 'late')
    ridden = [[part['number'] for part, _, _ in one.at(1100, (0.0, 0.0, -0.8))] for one in stories]
    assert ridden == [[0], []]
    assert 1 in [part['number'] for part, _, _ in stories[1].at(1300, (0.0, 0.0, -0.8))]


def test_bag_and_trace_yield_the_same_values(belted, tmp_path):
    trace, truth = belted
    path = bag_of(tmp_path / 'bag', truth.arrivals, truth.scene, RECORDED)
    of_bag, of_trace = runs.load(str(path)).cell, cell_story.of_trace(trace, 'trace')
    assert (of_bag.things, of_bag.name) == (of_trace.things, of_trace.name)
    assert of_bag.outcomes == of_trace.outcomes
    assert of_bag.stays == of_trace.stays
    # encoders do not see slip: 1 % of the way, which is 1.5 m at most
    near, exact = (differences_m(story, truth, RECORDED) for story in (of_bag, of_trace))
    assert near.keys() == exact.keys()
    assert max(near.values()) < 0.01 * 1.5 + 2 * INCREMENT_M


@pytest.mark.long
def test_parts_in_a_late_bag_are_where_encoders_place_them(tmp_path):
    _, truth = picks_from_a_belt()
    late = [one for n, one in enumerate(truth.arrivals) if one[0] == 'cell/parts' or n > RECORDED[0]]
    path = bag_of(tmp_path / 'bag', late, truth.scene, RECORDED)
    found = differences_m(runs.load(str(path)).cell, truth, RECORDED[20:])
    assert {number for _, number in found} >= {0, 1}
    assert max(found.values()) < 2 * INCREMENT_M


def test_belt_positions_are_interpolated_over_a_missing_message(belted, tmp_path):
    _, truth = belted
    arrivals = [one for n, one in enumerate(truth.arrivals) if one[0] == 'cell/parts' or n % 2]
    story = runs.load(str(bag_of(tmp_path / 'bag', arrivals, truth.scene, RECORDED))).cell
    steps = np.diff(story.ways['line'])
    assert np.abs(steps - 0.5e-3).max() < 2 * INCREMENT_M


SPOILT = {
    'a scene that is a number': ('cell/scene', text('5')),
    'a scene without end': ('cell/scene', text('[' * 100_000)),
    'a scene of things without names': ('cell/scene', text({'cell': 'a', 'things': [THING | {'name': 3}]})),
    'parts that are none': ('cell/parts', text({'parts': [{'number': 1}], 'misses': []})),
    'no JSON': ('cell/parts', text('nonsense')),
    'counts that are no numbers': ('sercos/at/belts', counted(100, {'line': math.nan})),
    'half a message': ('sercos/at/belts', counted(100, {'line': 1.0})[:40]),
}


def early_story(belted, folder, *more):
    _, truth = belted
    return runs.load(str(bag_of(folder, [*truth.arrivals[:200], *more], truth.scene, range(190)))).cell


@pytest.fixture(scope='module')
def own(belted, tmp_path_factory):
    return early_story(belted, tmp_path_factory.mktemp('own') / 'bag')


@pytest.mark.parametrize('case', SPOILT)
def test_cell_messages_of_another_publisher_are_ignored(case, own, belted, tmp_path):
    spoilt = early_story(belted, tmp_path / 'spoilt', SPOILT[case])
    assert (spoilt.things, spoilt.parts) == (own.things, own.parts)
    np.testing.assert_array_equal(spoilt.ways['line'], own.ways['line'])


def test_played_back_counts_are_ignored(tmp_path):
    from bags import STORE

    header = STORE.types['std_msgs/msg/Header'](STORE.types['builtin_interfaces/msg/Time'](0, 0), 'CP4 3fa9')
    phase = 'sercos/phase', bytes(STORE.serialize_cdr(header, 'std_msgs/msg/Header'))
    told = [(0, '3fa9', 0), (7, '3fa9', 7), (3, 'ffff', 5000)]
    arrivals = [phase, *(('sercos/at/belts', counted(c, {'line': n}, session)) for c, session, n in told)]
    scene = {'cell': 'a', 'things': [THING]}
    kinds = {'sercos/phase': 'std_msgs/msg/Header'}
    path = bag_of(tmp_path / 'bag', arrivals, scene, range(CYCLES), kinds)
    np.testing.assert_allclose(runs.load(str(path)).cell.ways['line'], np.arange(8) * 1e-3, atol=1e-12)


def test_recording_without_a_cell_yields_none(packaged, tmp_path):
    trace, _ = packaged
    bare = {name: value for name, value in trace.meta.items() if name not in ('cell', 'cell_scene')}
    assert cell_story.of_trace(replace(trace, meta=bare), 'bare') is None
    assert runs.load(str(record(tmp_path / 'bag', messages()))).cell is None


def test_older_trace_has_parts_without_their_positions(packaged):
    trace, truth = packaged
    meta = {name: value for name, value in trace.meta.items() if name != 'cell_scene'}
    old = [{k: v for k, v in part.items() if k not in ('stays', 'size_m')} for part in meta['cell']['parts']]
    story = cell_story.of_trace(replace(trace, meta=meta | {'cell': meta['cell'] | {'parts': old}}), 'old')
    assert len(story.parts) == len(truth.made)
    assert (story.things, list(story.at(500, (0.0, 0.0, -0.8)))) == ((), [])


@pytest.mark.parametrize(
    'told',
    [
        {'cell': 7},
        {'cell': {'cell': 'a'}},
        {'cell': {'cell': 'a', 'inputs': [], 'belts': [], 'parts': [{'number': 0}], 'misses': []}},
        {'cell_scene': 'nonsense'},
        {'cell_scene': {'cell': 'a', 'things': [THING | {'at_m': [0, 0, 1e9]}]}},
    ],
)
def test_trace_with_invalid_cell_metadata_is_rejected_with_one_message(told, packaged, tmp_path):
    trace, _ = packaged
    replace(trace, meta=trace.meta | told).save(tmp_path / 'spoilt.npz')
    with pytest.raises(TraceError, match=r'spoilt.npz: the data of its cell cannot be read$'):
        runs.load(str(tmp_path / 'spoilt.npz'))

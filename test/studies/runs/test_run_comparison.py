"""Tests of the comparison of two runs: alignment in time and differences."""

from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.studies.runs import runs
from delta3_pacdrive.studies.runs.alignment import BY_CORRELATION, BY_START, CORRELATION
from delta3_pacdrive.studies.runs.run_comparison import compare, move_figures, to_document

NEARLY_ONE = 1.0 - 1e-9


@pytest.fixture(scope='module')
def one():
    return runs.load('experiment1')


@pytest.fixture(scope='module')
def built():
    return runs.load('experiment1', 'rich')


def later(run, cycles, knows_start=False):
    """Return the run as a recording that began earlier and does not contain the start of the program."""
    meta = run.window.meta if knows_start else run.window.meta | {'start_cycle': None}
    part = replace(run.window, time_s=run.window.time_s + cycles * run.period_s, meta=meta)
    return replace(run, window=part)


def test_a_run_is_the_same_as_itself(one):
    found = compare(one, one)
    assert found.same
    assert found.alignment.by == BY_START
    assert found.alignment.correlation == pytest.approx(1.0)
    assert found.parameters == {}
    assert len(found.time_s) == len(one.window.time_s)


def test_the_difference_is_the_second_run_minus_the_first(one, built):
    found = compare(one, built)
    assert not found.same
    for name, values in found.differences.items():
        expected = built.window[name] - one.window[name]
        np.testing.assert_array_equal(values, expected, err_msg=name)
        norm = np.linalg.norm(expected, axis=1)
        assert found.figures[name].largest == norm.max()
        assert found.figures[name].rms == pytest.approx(np.sqrt((norm**2).mean()))
        assert found.figures[name].at_s == one.window.time_s[norm.argmax()]


def test_parameters_that_differ_are_named_with_both_values(one, built):
    assert compare(one, built).parameters == {
        'rich.enabled': (False, True),
        'bus.exchange_period_s': (0.001, 0.000125),
    }


@pytest.mark.parametrize('cycles', [-300, -1, 0, 17, 900])
def test_runs_without_a_common_clock_are_aligned_to_the_cycle(one, cycles):
    found = compare(one, later(one, cycles))
    assert found.alignment.by == BY_CORRELATION
    assert found.alignment.shift_s == pytest.approx(-cycles * one.period_s, abs=1e-9)
    assert found.alignment.correlation > NEARLY_ONE
    assert found.same


def test_runs_with_a_known_start_are_aligned_by_motion_on_request(one):
    moved = later(one, 40, knows_start=True)
    assert compare(one, moved).alignment.shift_s == 0.0
    assert not compare(one, moved).same
    assert compare(one, moved, CORRELATION).same


def test_the_built_robot_is_aligned_with_the_nominal_one_by_its_motion(one, built):
    found = compare(one, later(built, 250))
    assert found.alignment.shift_s == pytest.approx(-0.25, abs=one.period_s)
    assert found.alignment.correlation > 0.99


def test_a_run_with_another_bus_cycle_is_compared_between_its_cycles(one, tmp_path):
    slow = tmp_path / 'slow.yaml'
    from delta3_pacdrive import parameters

    parameters.write(parameters.load().replace(bus__cycle_time_s=0.004), slow)
    found = compare(one, runs.load('experiment1', str(slow)))
    assert found.parameters['bus.cycle_time_s'] == (0.001, 0.004)
    # straight lines between points 4 ms apart, at 20 m/s2
    assert found.figures['tcp_command'].largest < 20.0 * 0.004**2 / 8.0


def test_a_gap_in_a_recording_does_not_hide_the_rest(one):
    part = replace(one.window, signals={name: values.copy() for name, values in one.window.signals.items()})
    for values in part.signals.values():
        values[500:510] = np.nan
    found = compare(one, replace(one, window=part))
    assert found.figures['current'].largest == 0.0
    assert found.figures['current'].rms == 0.0
    assert (found.same, found.equal, found.uncompared) == (False, True, 10)
    assert compare(replace(one, window=part), replace(one, window=part)).same


def test_a_run_that_ends_before_the_other_is_not_the_same(one):
    part = replace(
        one.window,
        time_s=one.window.time_s[:-7],
        signals={name: v[:-7] for name, v in one.window.signals.items()},
    )
    for pair in ((one, replace(one, window=part)), (replace(one, window=part), one)):
        found = compare(*pair)
        assert (found.same, found.equal, found.uncompared) == (False, True, 7)


def test_runs_without_a_common_signal_or_time_are_rejected_with_one_message(one):
    alone = replace(one, window=replace(one.window, signals={'current': one.window['current']}))
    other = replace(one, window=replace(one.window, signals={'tcp_true': one.window['tcp_true']}))
    with pytest.raises(TraceError, match=r'^experiment1 and experiment1 have no signal in common$'):
        compare(alone, other)
    with pytest.raises(TraceError, match=r'have no time in common: -0.05 to 1.482 s, and 9.95 to 11.482 s$'):
        compare(one, later(one, 10_000, knows_start=True))
    with pytest.raises(TraceError, match=r'cannot be aligned: one does not contain the start of its program'):
        compare(alone, later(alone, 3))


def test_the_figures_of_a_move_are_those_of_its_cycles(one):
    move = one.moves[0]
    figures = move_figures(one, move)
    within = (one.window.time_s >= move.start_s - 1e-9) & (one.window.time_s < move.end_s + 1e-9)
    assert figures.duration_s == pytest.approx(one.whole.meta['program_s'] / len(one.moves), rel=0.5)
    part = one.window
    assert figures.current_peak_a == np.maximum(-part['current_min'], part['current_max'])[within].max()
    rms = np.sqrt((part['current_rms'][within] ** 2).mean(axis=0)).max()
    assert figures.current_rms_a == pytest.approx(rms, rel=1e-12)
    # a recording without all samples has those of the AT
    held = {name: values for name, values in part.signals.items() if not name.startswith('current_')}
    bare = move_figures(replace(one, window=replace(part, signals=held)), move)
    assert bare.current_peak_a == np.abs(part['current'][within]).max() < figures.current_peak_a
    assert figures.tcp_error_max_m == np.linalg.norm(one.window['tcp_error'][within], axis=1).max()
    assert sum(move_figures(one, each).duration_s for each in one.moves) == pytest.approx(
        one.whole.meta['program_s'], abs=1e-9
    )


def test_moves_are_compared_by_their_number(one, built):
    document = to_document(compare(one, built), one, built)
    assert [row['move'] for row in document['moves']] == [move.number for move in one.moves]
    assert document['moves'][0]['current_peak_a'][1] == move_figures(built, built.moves[0]).current_peak_a


def test_unrecorded_value_is_null_in_the_document(one, tmp_path):
    trace_file.save(replace(one.whole, signals={'current': one.whole['current']}), tmp_path / 'a.npz')
    few = runs.load(str(tmp_path / 'a.npz'))
    row = to_document(compare(few, few), few, few)['moves'][0]
    assert row['tcp_error_max_m'] == [None, None]
    assert row['current_peak_a'][0] > 0.0

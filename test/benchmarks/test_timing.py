"""Tests of the comparison of bus timings."""

import pytest

from delta3_pacdrive.benchmarks import timing


@pytest.fixture(scope='module')
def result():
    return timing.measure(('experiment2',), (1.5,), 3.0)


def test_the_raw_error_grows_with_the_dead_time_and_the_other_does_not(result):
    assert [(one['robot'], one['timing']) for one in result['runs']] == [
        (robot, own) for robot in ('nominal', 'built') for own in ('thesis', 'sercos2')
    ]
    before, after = result['runs'][:2]
    assert (before['dead_time_s'], after['dead_time_s']) == (1.75e-3, 2.75e-3)
    # 0.75 m/s at constant speed; the figures of the page
    assert after['raw_max_m'] - before['raw_max_m'] == pytest.approx(0.75e-3, rel=2e-3)
    assert before['raw_max_m'] == pytest.approx(1.341e-3, abs=1e-6)
    assert after['error_max_m'] == before['error_max_m'] == pytest.approx(0.106e-3, abs=1e-6)
    assert after['error_rms_m'] == pytest.approx(before['error_rms_m'], rel=1e-6)  # one cycle more at rest


def test_belts_account_for_the_timing(result):
    before, after = result['picks']
    assert before['picked'] == after['picked'] > 1
    assert after['error_max_m'] < 0.02e-3  # a cycle at 1.5 m/s would be 1.5 mm


def test_the_text_has_a_line_for_each_run_and_each_belt(result):
    title, *lines, last = timing.text(result)
    assert title.split()[:3] == ['program', 'robot', 'timing']
    assert lines[0].split()[:5] == ['experiment2', 'nominal', 'thesis', '1.75', 'ms']
    assert lines[0].split()[5:8] == ['1.341', '/', '1.239']
    assert lines[4].startswith(f'belt of 1.5 m/s, thesis: {result["picks"][0]["picked"]} parts, ')
    assert (len(lines), last) == (6, 'errors as maximum / rms')

"""Tests of recordings for other tools: patterns, windows, decimation and optional derived signals."""

import numpy as np
import pytest

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import trace_export

CYCLES = 200
META = {'cycle_time_s': 1e-3, 'start_cycle': 53, 'end_cycle': 150, 'program': 'a',
        'drive_status': [[[0, 0x4000], [60, 0xC008]], [[0, 0xC008]], [[10, 7], [12, 8]]]}  # fmt: skip


@pytest.fixture
def trace():
    time_s = np.arange(CYCLES) * 1e-3
    circle = np.column_stack([0.1 * np.sin(20.0 * time_s), 0.1 * np.cos(20.0 * time_s), 0.0 * time_s])
    return Trace(time_s, {'tcp_actual': circle, 'current': np.ones((CYCLES, 3))}, dict(META))


def test_patterns_select_signals_and_all_selects_every_one(trace):
    assert trace_export.matching(['tcp_*', 'current'], trace.signals) == ['tcp_actual', 'current']
    assert trace_export.matching(['all'], trace.signals) == list(trace.signals)
    assert list(trace_export.chosen(trace, ['current'], 'a').signals) == ['current']
    assert trace_export.chosen(trace, None, 'a') is trace


def test_a_signal_that_there_is_not_is_rejected_with_the_nearest_name(trace):
    with pytest.raises(TraceError, match=r"^there is no signal 'tcp_sped': did you mean tcp_speed\?$"):
        trace_export.require_known(['current', 'tcp_sped'])
    with pytest.raises(TraceError, match=r"^a contains no signal 'motor_speed'$"):
        trace_export.chosen(trace, ['current', 'motor_speed'], 'a')
    with pytest.raises(TraceError, match=r"^a contains no signal 'payload': .*on request"):
        trace_export.chosen(trace, ['payload'], 'a')


def test_speed_and_status_words_are_computed_on_request(trace):
    assert trace_export.completed(trace).signals.keys() == {
        *trace.signals, 'tcp_velocity', 'tcp_acceleration'
    }  # fmt: skip
    found = trace_export.completed(trace, ['tcp_speed', 'status_word', 'payload'])
    assert found['tcp_speed'][5:-5, 0] == pytest.approx(2.0, rel=1e-4)
    assert found['status_word'][[0, 59, 60], 0].tolist() == [0x4000, 0x4000, 0xC008]
    assert found['status_word'][[0, 11, 12], 2].tolist() == [7, 7, 8]
    assert 'payload' not in found.signals


def test_a_window_counts_from_the_start_of_the_program_and_keeps_bus_time(trace):
    part = trace_export.part(trace, 0.010, 0.012)
    assert part.time_s.tolist() == pytest.approx([0.063, 0.064, 0.065])
    assert part['tcp_actual'].tolist() == trace['tcp_actual'][63:66].tolist()
    assert trace_export.part(trace, None, -0.05).time_s.tolist() == pytest.approx([0.0, 0.001, 0.002, 0.003])
    with pytest.raises(TraceError, match=r'no cycle of that window: it goes from -0\.053 to 0\.146 s'):
        trace_export.part(trace, 7.0, None)


def test_every_tenth_cycle_counts_from_the_start_and_makes_a_table_without_a_bus_cycle(trace):
    thin = trace_export.thinned(trace, 10)
    assert np.rint(thin.time_s / 1e-3).astype(int).tolist() == list(range(3, CYCLES, 10))
    assert thin['tcp_actual'].tolist() == trace['tcp_actual'][3::10].tolist()
    assert thin.meta == {
        'program': 'a',
        'decimation': {'every': 10, 'cycle_time_s': 1e-3, 'program_start_s': pytest.approx(0.053)},
    }
    again = trace_export.thinned(thin, 2)
    assert again.time_s.tolist() == thin.time_s[::2].tolist()
    assert trace_export.thinned(trace, 1) is trace

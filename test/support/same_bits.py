"""Comparison of a run of the simulation with a recording of the same run on the graph, bit by bit."""

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.recording.signals import CURRENT_SIGNALS
from delta3_pacdrive.recording.trace import Trace

COMPARED = (
    'motor_command',
    'motor_position',
    'motor_speed',
    'current',
    'following_error',
    'tcp_command',
    'tcp_actual',
    'tcp_error',
    'shaft_position',
    'shaft_speed',
    'coupling_torque',
    *CURRENT_SIGNALS,
)
FIGURES = (
    'tcp_error_max_m', 'tcp_error_rms_m', 'final_tcp_m', 'current_peak_a', 'current_rms_a',
    'at_current_peak_a', 'at_current_rms_a',
)  # fmt: skip


def assert_same(simulated: Trace, recorded: Trace, result: dict) -> None:
    """Compare all cycles of the simulation, and its figures with the results of the graph."""
    cycles = len(simulated.time_s)
    assert len(recorded.time_s) >= cycles
    np.testing.assert_array_equal(recorded.time_s[:cycles], simulated.time_s)
    for name in COMPARED:
        np.testing.assert_array_equal(recorded[name][:cycles], simulated[name], err_msg=name)
    for name in FIGURES:
        assert result[name] == simulated.meta['figures'][name], name


def assert_same_where_recorded(simulated: Trace, recorded: Trace, cycle_time_s: float) -> NDArray[np.int_]:
    """Compare the cycles on record, as a recorder on a busy machine may miss some; return them."""
    cycles = [np.rint(trace.time_s / cycle_time_s).astype(int) for trace in (simulated, recorded)]
    common, ours, theirs = np.intersect1d(*cycles, return_indices=True)
    for name in COMPARED:
        np.testing.assert_array_equal(recorded[name][theirs], simulated[name][ours], err_msg=name)
    return common

"""Tests of the tuning report for other gains: text, and pictures without overlapping lines."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive.studies.drives.loops.analysis import LOOPS, OperatingPoint, linear_loop
from delta3_pacdrive.studies.drives.loops.load import load_at
from delta3_pacdrive.studies.drives.tuning import figures
from delta3_pacdrive.studies.drives.tuning.report_text import (
    changes_in_words,
    is_worthwhile,
    judged_figures,
    proposal_lines,
)

LOOP = {
    'stable': True, 'crossover_hz': 91.0, 'phase_margin_deg': 71.0, 'gain_margin_db': 17.3,
    'sensitivity_peak': 1.3,
}  # fmt: skip
BEFORE = {
    'loops': {'current': dict(LOOP), 'velocity': dict(LOOP)},
    'workspace': [{'exchanged': dict(LOOP)}, {'exchanged': LOOP | {'gain_margin_db': 7.6}}],
    'rejection': {'peak_rad': 0.01, 'back_s': 0.04, 'noise_a': 0.02},
    'effect': {'following_error_max_rad': 1e-4, 'tcp_error_max_m': 1e-4},
}


@pytest.fixture
def after():
    return copy.deepcopy(BEFORE)


def test_unchanged_values_are_not_reported_as_changed(after):
    assert changes_in_words(BEFORE, after) == [
        'current, velocity: as before',
        'the program is followed as before',
    ]


def test_each_changed_figure_is_reported_with_both_values(after):
    after['loops']['velocity'] |= {'crossover_hz': 120.0, 'phase_margin_deg': 65.0, 'gain_margin_db': 14.9}
    after['workspace'][1]['exchanged']['gain_margin_db'] = 6.1
    after['rejection'] = {'peak_rad': 0.008, 'back_s': 0.03, 'noise_a': 0.027}
    after['effect'] = {'following_error_max_rad': 0.8e-4, 'tcp_error_max_m': 0.9e-4}
    assert changes_in_words(BEFORE, after) == [
        'velocity: crossover 91 Hz to 120 Hz (better), phase margin 71 deg to 65 deg (worse), '
        'gain margin 17.3 dB to 14.9 dB (worse)',
        'current: as before',
        'least margins of the cascade, as it exchanges with its plant: 7.6 dB to 6.1 dB (worse), 71 deg',
        'a load of 1 N m moves the shaft by 0.573 deg to 0.458 deg (better), for 40 ms to 30 ms (better)',
        'noise of the encoder makes a current of 20.0 mA to 27.0 mA (worse) rms',
        'largest following error in the program 5.73e-3 deg to 4.58e-3 deg (better), '
        'TCP error 100.0 um to 90.0 um (better)',
    ]


def test_lost_loop_is_reported_and_unknown_state_is_not(after):
    after['loops']['velocity']['stable'] = False
    after['rejection'] = None
    after['effect']['tcp_error_max_m'] = None
    assert changes_in_words(BEFORE, after) == ['velocity: not stable any more', 'current: as before']


PROPOSAL = {
    'targets': {'phase_deg': 45.0, 'gain_db': 6.0},
    'payload_kg': 2.0,
    'before': {'phase_deg': 37.1, 'phase_where': 'heavy', 'gain_db': 7.0, 'gain_where': 'light'},
    'kept': {'phase_deg': 45.0, 'phase_where': 'heavy', 'gain_db': 6.0, 'gain_where': 'light'},
}


def test_gains_that_are_better_in_one_margin_only_are_not_worthwhile(after):
    after['rejection'] = {'peak_rad': 0.01, 'back_s': 0.05, 'noise_a': 0.027}
    judged = judged_figures(BEFORE, after, PROPOSAL)
    assert judged == {
        'phase margin': 'better', 'gain margin': 'worse', 'recovery from load': 'worse', 'noise': 'worse',
    }  # fmt: skip
    assert not is_worthwhile(judged)
    assert proposal_lines(PROPOSAL | {'judged': judged, 'proposed': False})[3:] == [
        '  better: phase margin; worse: gain margin, recovery from load, noise',
        '  not proposed: at most one figure is better. Keep the present gains, or request these margins with '
        '--phase-margin or --gain-margin',
    ]


def test_gains_better_in_two_figures_or_worse_in_none_are_worthwhile(after):
    after['rejection']['noise_a'] = 0.01
    assert is_worthwhile(judged_figures(BEFORE, after, PROPOSAL))
    better = PROPOSAL | {'kept': PROPOSAL['kept'] | {'gain_db': 7.0}}
    assert judged_figures(BEFORE, BEFORE, better) == {'phase margin': 'better'}
    assert is_worthwhile(judged_figures(BEFORE, BEFORE, better))


def test_curves_that_are_the_same_are_drawn_once_under_both_names(robot):
    operation = OperatingPoint(load_at(robot.motion.home_m, 0, robot), 10.0)
    one = linear_loop(LOOPS[0], robot, operation)
    other = linear_loop(LOOPS[0], robot.replace(drive__current_gain_v_a=20.0), operation)

    def curves(before, after):
        axes = figures.bode({'before': before, 'after': after}).axes[0]
        return [line.get_label() for line in axes.lines if line.get_label().startswith('linear')]

    assert curves(one, replace(one)) == ['linear, before and after']
    assert curves(one, other) == ['linear, before', 'linear, after']
    assert figures.merged({'before': 1, 'after': 1}, int.__eq__) == {'before and after': 1}
    assert figures.merged({'now': np.pi}, lambda *_: True) == {'now': np.pi}

"""Tests of proposed gains: margins, also on the bench, and nearly the largest possible stiffness."""

import dataclasses
import itertools
from functools import cache

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.studies.drives.loops.analysis import (
    OperatingPoint,
    analyse,
    exact_shaft,
    exchanged_shaft,
)
from delta3_pacdrive.studies.drives.loops.response import margins
from delta3_pacdrive.studies.drives.tuning import gains as gains_file
from delta3_pacdrive.studies.drives.tuning.candidates import Candidates, Gains
from delta3_pacdrive.studies.drives.tuning.proposal import Targets, margins_kept, propose, spread
from delta3_pacdrive.studies.framework.provenance import Provenance
from thoroughness import some

SPEED_RAD_S = 10.0
# what coherence and the grid of the lines leave of a margin that is measured on the bench
MEASURED_DB, MEASURED_DEG = 0.4, 2.0


@pytest.fixture(scope='module')
def robots():
    return {name: parameters.load(name) for name in ('delta3', 'rich')}


@pytest.fixture(scope='module')
def proposals(robots):
    """Return a function that proposes gains for a robot, once."""
    return cache(lambda name: propose(robots[name], Targets(), SPEED_RAD_S))


@pytest.mark.parametrize('name', some(['delta3', 'rich'], ['delta3']))
def test_proposed_gains_keep_the_requested_margins_closely(name, proposals, robots):
    found = proposals(name)
    kept = margins_kept(found.robot, spread(robots[name], 2.0), SPEED_RAD_S)
    assert kept == found.kept
    assert kept.stable
    assert 45.0 <= kept.phase_deg < 45.3
    assert 6.0 <= kept.gain_db < 6.1
    assert found.before.phase_deg < 45.0


@pytest.mark.long
def test_nominal_robot_has_a_stiff_drive_and_the_built_one_a_notch_filter(proposals):
    # COBYLA from the best of many starts got to 1063 with 44.7 deg and 5.9 dB, hill-climbing to 823
    assert 1000.0 < proposals('delta3').gains.stiffness < 1063.0
    assert proposals('delta3').gains.notch is None
    built = proposals('rich').gains
    assert built.stiffness > 350.0  # 325 by hand
    assert 150.0 < built.notch.frequency_hz < 300.0
    assert proposals('rich').robot.drive.notch_1_frequency_hz == built.notch.frequency_hz


@pytest.mark.parametrize('name', some(['delta3', 'rich'], ['delta3']))
def test_no_neighbour_of_proposed_gains_is_stiffer_and_keeps_the_margins(name, proposals, robots):
    found, loads = proposals(name).gains, spread(robots[name], 2.0)
    for factors in itertools.product((0.97, 1.03), repeat=3):
        if factors[1] * factors[2] < 1.0:
            continue
        velocity, integral, position = (
            value * factor for value, factor in zip(dataclasses.astuple(found)[:3], factors, strict=True)
        )
        other = dataclasses.replace(
            found, velocity_a_s_rad=velocity, integral_a_rad=integral, position_1_s=position
        )
        if other.stiffness > 1.005 * found.stiffness:
            kept = margins_kept(other.of(robots[name]), loads, SPEED_RAD_S)
            assert kept.phase_deg < 45.0 or kept.gain_db < 6.0 or not kept.stable


@pytest.mark.long
@pytest.mark.parametrize('name', ['delta3', 'rich'])
def test_the_drive_on_the_bench_has_the_margins_that_are_promised(name, proposals):
    robot = proposals(name).robot
    if name == 'rich':
        robot = robot.replace(rich__sensors=False, rich__ripple=False)
    for load in spread(robot, 2.0)[::2]:
        cascade = analyse(robot, OperatingPoint(load, SPEED_RAD_S), lambda *_: None)[-1]
        measured = cascade.measured_open
        inside = measured.in_band
        found = margins(measured.frequencies_hz[inside], measured.values[inside])
        assert found.gain_margin_db > 6.0 - MEASURED_DB
        assert found.phase_margin_deg > 45.0 - MEASURED_DEG


@pytest.mark.parametrize('name', ['delta3', 'rich'])
def test_margins_of_candidates_are_those_of_the_difference_equations(name, robots):
    robot = robots[name]
    loads = spread(robot, 2.0)
    shafts = [shaft(robot, load, SPEED_RAD_S) for load in loads for shaft in (exact_shaft, exchanged_shaft)]
    tried = [Gains(0.35, 20.0, 60.0), Gains(0.2, 10.0, 30.0), Gains(0.45, 25.0, 20.0)]
    least = Candidates(robot, shafts).least(tried)
    for k, gains in enumerate(tried):
        kept = margins_kept(gains.of(robot), loads, SPEED_RAD_S)
        assert least.stable[k] == kept.stable
        if not kept.stable:
            continue
        assert least.gain_db[k] == pytest.approx(kept.gain_db, abs=0.25)
        assert least.phase_deg[k] == pytest.approx(kept.phase_deg, abs=1.0)


def test_unstable_candidate_is_marked_as_unstable(robots):
    robot = robots['delta3']
    loads = spread(robot, 2.0)
    candidates = Candidates(robot, [exact_shaft(robot, load, SPEED_RAD_S) for load in loads])
    tried = [
        Gains(*found)
        for found in ((2.0, 20.0, 60.0), (0.35, 20.0, 1500.0), (0.02, 80.0, 60.0), (0.35, 20.0, 60.0))
    ]
    exact = [
        margins_kept(gains.of(robot.replace(bus__exchange_period_s=125e-6)), loads, SPEED_RAD_S).stable
        for gains in tried
    ]
    assert candidates.least(tried).stable.tolist() == exact == [False, False, False, True]


@pytest.mark.long
def test_same_robot_has_the_same_proposed_gains(robots, proposals):
    assert propose(robots['delta3'], Targets(), SPEED_RAD_S).gains == proposals('delta3').gains


@pytest.mark.long
def test_larger_margins_and_a_larger_payload_cost_stiffness(robots, proposals):
    usual = proposals('delta3').gains.stiffness
    assert propose(robots['delta3'], Targets(55.0, 8.0), SPEED_RAD_S).gains.stiffness < 0.6 * usual
    assert propose(robots['delta3'], Targets(), SPEED_RAD_S, 5.0).gains.stiffness < 0.8 * usual
    assert propose(robots['delta3'], Targets(), SPEED_RAD_S, 0.0).gains.stiffness > 1.2 * usual


@pytest.mark.long
def test_unreachable_margins_are_rejected_with_the_nearest(robots):
    late = robots['delta3'].replace(drive__current_gain_v_a=75.0)  # the current loop itself is near its end
    with pytest.raises(
        # enough digits to see which margin is missed
        TuningError,
        match=r'no gains keep 80 deg and 20 dB over .* 0 to 2 kg: the nearest keep (?!80.0 deg and 20.0 dB)',
    ):
        propose(late, Targets(80.0, 20.0), SPEED_RAD_S)


@pytest.mark.parametrize(
    ('values', 'told'),
    [((9.0, 6.0), 'phase margin is 9 deg'), ((45.0, 21.0), '21 dB'), ((np.nan, 6.0), 'nan')],
)
def test_margins_out_of_range_are_rejected(values, told):
    with pytest.raises(TuningError, match=told):
        Targets(*values)


@pytest.mark.parametrize(
    ('name', 'joined'), some([('delta3', 'delta3+'), ('rich', 'rich+')], [('delta3', 'delta3+')])
)
def test_the_file_of_gains_joined_with_the_robot_is_the_proposal(name, joined, proposals, tmp_path):
    path = tmp_path / gains_file.FILE
    found = proposals(name)
    origin = Provenance.of('tune --propose', found.robot, None, [])
    gains_file.write(found.gains, found.kept_text, path, origin)
    assert parameters.load(f'{joined}{path}') == proposals(name).robot
    assert '45.0 deg and 6.0 dB' in path.read_text()


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        (('--propose', '--set', 'K_Ppos=80'), '--propose cannot be combined with --set or --sweep'),
        (('--propose', '--sweep', 'K_Ppos=80:90:2'), '--propose cannot be combined with --set or --sweep'),
        (('--phase-margin', '50'), '--phase-margin requires --propose'),
        (('--gain-margin', '8'), '--gain-margin requires --propose'),
        (('--propose', '--excite', 'x.npz'), '--excite cannot be combined'),
    ],
)
def test_options_that_do_not_fit_auto_are_rejected(arguments, told, capsys):
    with pytest.raises(SystemExit) as caught:
        main(['tune', *arguments])
    assert caught.value.code == 2
    assert told in capsys.readouterr().err


def test_a_phase_margin_is_a_distance_on_either_side(robots):
    robot = robots['rich'].replace(drive__velocity_gain_a_s_rad=4.0)
    kept = margins_kept(robot, spread(robot, 2.0)[:1], SPEED_RAD_S)
    assert kept.phase_deg > 0.0

"""Tests of the energy of a run against that of its plan."""

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.places.planning import evaluation
from delta3_pacdrive.studies.runs.run_signals import NEEDED, energy_of_round


def test_run_uses_the_values_of_its_plan(robot):
    program = programs.load('packaging', robot.motion)
    run = energy_of_round(simulation.run(program, robot), robot, program.repeat)
    plan = evaluation.of_program(program, simulation.placed(robot, program)).energy
    assert run.copper_j == pytest.approx(plan.copper_j, rel=0.05)
    assert run.friction_j == pytest.approx(plan.friction_j, rel=0.05)
    assert run.drawn_j == pytest.approx(plan.drawn_j, rel=0.1)
    assert run.drawn_j - run.returned_j == pytest.approx(run.lost_j, rel=0.05)


def test_trace_without_currents_yields_no_energy(robot):
    assert energy_of_round(Trace(np.zeros(1), {}, {}), robot, 1) is None


def test_trace_with_a_missing_cycle_yields_no_energy(robot):
    program = programs.load('experiment1', robot.motion)
    whole = simulation.run(program, robot)
    assert energy_of_round(whole, robot, 1).copper_j > 0.0
    start, end = whole.meta['start_cycle'], whole.meta['end_cycle']
    for lost, told in ((start - 1, True), (start, False), (end - 1, False), (end + 1, True)):
        kept = np.arange(len(whole.time_s)) != lost
        part = Trace(whole.time_s[kept], {name: whole[name][kept] for name in NEEDED}, whole.meta)
        expected = energy_of_round(whole, robot, 1) if told else None
        assert energy_of_round(part, robot, 1) == expected

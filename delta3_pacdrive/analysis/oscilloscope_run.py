"""Simulation of a program with an oscilloscope in every drive: one sample per period of the current loop.

Drives and plant exchange data in every period of the velocity loop, so nothing is interpolated between exchanges. The
result is bit-identical to a simulation with that exchange period.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.analysis.oscilloscope import Oscilloscope
from delta3_pacdrive.analysis.study import OnProgress
from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.simulation.robot import Robot

EXCHANGE_MIN_S = 125e-6
PROGRESS_EVERY = 50  # cycles


@dataclass(frozen=True)
class Recorded:
    """Run recorded by oscilloscopes."""

    scope: Oscilloscope
    # position [rad], speed [rad/s] and torque [N m] in the AT of each axis, shape (cycles, 3, 3)
    answers: Floats
    tcp_error: Floats  # set-point delay removed [m], shape (cycles, 3)
    steps: int  # periods of the current loop per bus cycle
    meta: dict[str, Any]  # format of Trace.meta


def finest(parameters: Parameters) -> Parameters:
    """Return the robot with the shortest exchange period, which needs no interpolation."""
    return parameters.replace(bus__exchange_period_s=max(EXCHANGE_MIN_S, parameters.drive.velocity_period_s))


def run(
    program: Program, parameters: Parameters, on_progress: OnProgress, stage: str, left: Sequence[str] = ()
) -> Recorded:
    """Run a program and record the states of the drives, and their fields ``left``, in every period.

    Raises
    ------
    ProgramError
        The program is rejected.
    RunError
        A drive has no torque at or after the program start.

    """
    placed = simulation.placed(finest(parameters), program)
    robot, task = Robot(placed), Transformation(placed)
    planned = program_planner.plan(program, task.locate(robot.encoder_positions()), placed)
    task.load(planned.plan)
    task.enable(placed.motion.enable_cycle)
    task.start(placed.motion.start_cycle)
    cycles = task.last_cycle + 1
    steps = round(placed.bus.cycle_time_s / placed.drive.current_period_s)
    scope = Oscilloscope(robot, cycles * steps, left)
    answers, tcp_error = np.empty((cycles, 3, 3)), np.empty((cycles, 3))
    for cycle in range(cycles):
        commands = task.command(cycle)
        robot.take_payload(task.payload)
        status = scope.begin_cycle(commands, task.control(cycle), task.torques)
        for i, drive in enumerate(robot.drives):
            answers[cycle, :, i] = drive.answer
        for _ in range(steps // scope.per_exchange):
            scope.exchange(robot.payload)
        if cycle >= placed.motion.start_cycle and not all(drive.powered for drive in robot.drives):
            raise RunError(f'a drive has no torque in bus cycle {cycle}, status {status}')
        tcp_error[cycle] = task.receive(cycle, answers[cycle, 0], answers[cycle, 2])['tcp_error']
        if cycle % PROGRESS_EVERY == 0:
            on_progress(stage, cycle, cycles)
    meta = {
        'program': planned.name,
        'checksum': parameters.checksum,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'cycle_time_s': placed.bus.cycle_time_s,
        'sample_time_s': placed.drive.current_period_s,
        'start_cycle': placed.motion.start_cycle,
        'end_cycle': task.end_cycle,
    }
    return Recorded(scope, answers, tcp_error, steps, meta)

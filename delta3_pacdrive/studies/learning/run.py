"""Learning study: impulse responses, convergence criterion, repetitions, and the file of learned torques."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.errors import LearnedError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning import learned_torques as torques_file
from delta3_pacdrive.planning import plan_times
from delta3_pacdrive.planning.learned_torques import Learned, Origin
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import PathMove, Program
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.learning import figures, report
from delta3_pacdrive.studies.learning.lifted import AxisLearning, contraction
from delta3_pacdrive.studies.learning.responses import measured, with_masses
from delta3_pacdrive.studies.learning.study import Contraction, Repetition, Results, Settings
from delta3_pacdrive.studies.runs.inputs import with_digests

MASS_SHARES = (1.0, 0.7, 1.3)  # scaled masses for which learning must converge
PLACES = 3  # points of the path at which it must converge
RESPONSE_S = 0.2  # length of an impulse response in the update
CYCLES_MAX = 30_000  # of a program; the matrices then take 150 MB
LEAST_GAIN = 0.03  # relative improvement of the rms error below which learning ends
SEED_MAX = 2**31


@dataclass
class Study(studies.Study):
    """Learning study of a program."""

    settings: Settings
    robot: core.Parameters = field(init=False)  # parameters of the controller
    machine: core.Parameters = field(init=False)  # parameters of the simulated robot
    program: Program = field(init=False)
    # number of the repetition whose torques are in the file; 0: none
    kept: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        """Read the parameters and the program; raises Delta3Error."""
        chosen = self.settings
        robot = core.load(chosen.parameters)
        machine = robot if chosen.machine is None else core.load(chosen.machine)
        self.program = programs.load(chosen.program, robot.motion)
        if self.program.faults:
            raise LearnedError(f'{chosen.program} injects faults, which would be learned')
        if any(isinstance(one, PathMove) and one.in_position for one in self.program.statements):
            raise LearnedError(
                f'{chosen.program} waits at exact stops (in_position), whose duration is not known beforehand'
            )
        if not robot.sends_torque:
            raise LearnedError(
                'learning requires commanded torques: control.feed_forward must be model, as with --parameters model'
            )
        if machine.bus.cycle_time_s != robot.bus.cycle_time_s:
            raise LearnedError('bus.cycle_time_s of controller and machine must be equal')
        highest_hz = 0.5 / robot.bus.cycle_time_s
        if chosen.bandwidth_hz > highest_hz:
            raise LearnedError(
                f'the bandwidth is {chosen.bandwidth_hz:g} Hz, the limit for a bus cycle of '
                f'{1e3 * robot.bus.cycle_time_s:g} ms is {highest_hz:g} Hz'
            )
        self.robot = simulation.placed(robot, self.program)
        self.machine = simulation.placed(machine, self.program)
        simulation.require_homed(self.machine)

    def unfinished(self) -> str:
        """Return the message after an interrupt."""
        if not self.kept:
            return 'interrupted before the first result; nothing was written'
        return f'interrupted: the torques of repetition {self.kept} are in {self.file}'

    def run(self) -> dict[str, Any]:
        """Learn, write all results and return the report; raises Delta3Error.

        If it ends early, the torques of the best repetition so far remain in the folder.
        """
        chosen = self.settings
        origin = Provenance.of(self.command, self.robot, chosen.parameters, with_digests([chosen.program]))
        folder = ReportFolder(self.folder, origin)

        def begin() -> None:
            folder.clear([report.TABLE, report.CONTRACTIONS, report.LEARNED, *figures.NAMES])
            folder.make()

        def keep(learned: Learned, number: int) -> None:
            if not self.kept:
                begin()
            torques_file.save(learned, self.file)
            self.kept = number

        found = self.learned(keep)
        if self.kept:
            folder.add(self.file)
        else:
            begin()
        document = report.summary(found, chosen, self.file if self.kept else None)
        self.on_progress('table and figures', 0, 0)
        return folder.results(
            'Learned torques of a program',
            document,
            report.text(document),
            report.tables(found),
            figures.by_name(found),
        )

    @property
    def file(self) -> Path:
        """File of the torques."""
        return self.folder / report.LEARNED

    def learned(self, keep: Callable[[Learned, int], None] = lambda learned, number: None) -> Results:
        """Repeat the program and learn; raises Delta3Error.

        ``keep`` receives the torques and the number of each repetition that is the best so far.
        """
        chosen = self.settings
        planned = simulation.plan_of(self.program, self.robot, self.machine)
        cycle_s = self.robot.bus.cycle_time_s
        cycles = math.ceil(planned.plan.duration_s / cycle_s - 1e-9) + SETTLE_CYCLES
        if cycles > CYCLES_MAX:
            raise LearnedError(
                f'{self.program.name} takes {cycles} bus cycles, the limit is {CYCLES_MAX}: repeat it less often'
            )
        places = sample_plan(planned.plan, np.linspace(0.0, planned.plan.duration_s, PLACES))[0]
        payloads = {move.payload_kg for move in planned.plan.moves}
        payloads |= {
            change['payload_kg']
            for change in plan_times.output_changes(planned.plan)
            if change['payload_kg'] is not None
        }
        loads = [(place, payload) for place in places for payload in sorted({min(payloads), max(payloads)})]
        axes = self._axes(loads, cycles)
        contractions = self._contractions(axes, loads)
        worst = max(contractions, key=lambda one: one.rate)
        if worst.rate >= 1.0:
            raise LearnedError(
                f'learning does not converge: with {100.0 * worst.masses:.0f} % of the masses and '
                f'{worst.payload_kg:g} kg the contraction rate is {worst.rate:.3f} at {worst.at_hz:.0f} Hz, but must '
                f'be less than 1; choose a bandwidth below {chosen.bandwidth_hz:g} Hz'
            )
        origin = Origin.of(self.program.name, planned.plan, self.robot)
        return self._repeated(axes, contractions, Learned(np.zeros((cycles, 3)), origin), keep)

    def _axes(self, loads: list[tuple[Floats, float]], cycles: int) -> list[AxisLearning]:
        """Return the updates for the mean response of the controller's model over all loads."""
        chosen, cycle_s = self.settings, self.robot.bus.cycle_time_s
        known = self.robot.replace(rich__enabled=False)
        taps = math.ceil(RESPONSE_S / cycle_s)
        mean = np.mean([measured(known, *load)[:taps] for load in loads], axis=0)
        return [
            AxisLearning(
                response=mean[:, axis, axis],
                cycles=cycles,
                cycle_time_s=cycle_s,
                bandwidth_hz=chosen.bandwidth_hz,
                change_weight=chosen.change_weight,
                torque_weight=chosen.torque_weight,
            )
            for axis in range(3)
        ]

    def _contractions(
        self, axes: list[AxisLearning], loads: list[tuple[Floats, float]]
    ) -> tuple[Contraction, ...]:
        found = []
        for share in MASS_SHARES:
            robot = with_masses(self.machine, share)
            for number, (place, payload) in enumerate(loads):
                self.on_progress(f'responses with {100.0 * share:.0f} % of the masses', number, len(loads))
                rate, at_hz = contraction(axes, measured(robot, place, payload))
                x, y, z = (float(value) for value in place)
                found.append(Contraction(share, (x, y, z), payload, rate, at_hz))
        return tuple(found)

    def _repeated(
        self,
        axes: list[AxisLearning],
        contractions: tuple[Contraction, ...],
        nothing: Learned,
        keep: Callable[[Learned, int], None],
    ) -> Results:
        chosen = self.settings
        first = best_run = run = self._drive(nothing, 0)
        start = int(first.meta['start_cycle'])
        rows = slice(start, start + len(nothing.torques))
        model = first['torque_command'][rows]
        present = best = nothing
        repetitions = [_repetition(0, first, nothing)]
        at_end = f'{chosen.repetitions} repetitions are done'
        for number in range(1, chosen.repetitions + 1):
            self.on_progress('repetitions', number - 1, chosen.repetitions)
            errors = self._errors(run)[rows]
            torques = np.stack(
                [axes[i].update(present.torques[:, i], errors[:, i]) for i in range(3)], axis=-1
            )
            present = replace(present, torques=self._possible(torques, model))
            run = self._drive(present, number)
            repetitions.append(_repetition(number, run, present))
            least = min(repetitions[:-1], key=lambda one: one.tcp_error_rms_m).tcp_error_rms_m
            reached = repetitions[-1].tcp_error_rms_m
            if reached < least:
                best, best_run = present, run
                keep(best, number)
            if reached > (1.0 - LEAST_GAIN) * least:
                at_end = f'repetition {number} improved by less than {100.0 * LEAST_GAIN:.0f} %'
                break
        return Results(
            program=self.program.name,
            contractions=contractions,
            repetitions=tuple(repetitions),
            best=min(repetitions, key=lambda one: one.tcp_error_rms_m),
            learned=best,
            time_s=first.time_s[rows] - first.time_s[start],
            before_m=first['tcp_error'][rows],
            after_m=best_run['tcp_error'][rows],
            at_end=at_end,
        )

    def _drive(self, learned: Learned, number: int) -> Trace:
        """Run a repetition with its own seed of the sensor noise."""
        seed = (self.machine.rich.sensor_seed + number) % SEED_MAX
        machine = self.machine.replace(rich__sensor_seed=seed)
        run = simulation.run(self.program, self.robot, learned=learned, machine=machine)
        if stopped := run.meta['stopped']:
            raise LearnedError(f'repetition {number}: {stopped}')
        if unlearned := run.meta['unlearned']:
            raise LearnedError(f'repetition {number} did not apply the learned torques: {unlearned}')
        return run

    def _errors(self, run: Trace) -> Floats:
        """Return the errors of the motors [rad], shape (cycles, 3): delayed command less encoder."""
        delay = self.robot.set_point_delay_cycles
        whole, share = math.floor(delay), delay - math.floor(delay)
        command, cycle = run['motor_command'], np.arange(len(run.time_s))
        newer, older = (command[np.maximum(cycle - whole - more, 0)] for more in (0, 1))
        return np.asarray((1.0 - share) * newer + share * older - run['motor_position'])

    def _possible(self, torques: Floats, model: Floats) -> Floats:
        """Limit torques to the reserve of the motors beyond the torques of the model."""
        limit = self.robot.torque_max_n_m
        return np.clip(torques, np.minimum(-limit - model, 0.0), np.maximum(limit - model, 0.0))


def _repetition(number: int, run: Trace, learned: Learned) -> Repetition:
    figures = run.meta['figures']
    return Repetition(
        number=number,
        tcp_error_max_m=figures['tcp_error_max_m'],
        tcp_error_rms_m=figures['tcp_error_rms_m'],
        current_peak_a=max(figures['current_peak_a']),
        current_rms_a=max(figures['current_rms_a']),
        torque_max_n_m=float(np.abs(learned.torques).max()),
    )

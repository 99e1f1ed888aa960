"""Runner of the fault catalogue: executes each case on a robot of separate processes and evaluates the recovery."""

import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import dynamics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.bringup.scheduling import Schedule
from delta3_pacdrive.errors import Delta3Error, ProgramError, RobotFault, RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.robot.faults.fault import KINDS, PROCESS_FAULTS, UNIT_ROBOT
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, PLANT
from delta3_pacdrive.verification.fault_catalogue.cases import Case, Outcome, State
from delta3_pacdrive.verification.fault_catalogue.observer import (
    FaultObserver,
    distance_from_line,
    judge_reference,
)
from delta3_pacdrive.verification.fault_catalogue.signatures import OF_AXIS, AxisRecord, coupling_of_arms
from delta3_pacdrive.verification.operator import EXPLANATION_S, run_operated
from delta3_pacdrive.verification.telegram_log import MDT, SHAFTS

STEP_M = (0.2, 0.0, 0.0)  # from home to the other end of the line
SPEED_M_S = 0.4
GENTLE_M_S2 = 2.0  # of a move that is held: its stop must last long enough to be hit
MIDWAY_S = 0.25  # after the start of the move from home, at full speed
OBSERVED_S = 0.7  # bus time after which an undetected fault counts as without effect
AHEAD_S = 0.15  # bus time from the request to a fault in a short state
ENABLED_BEFORE, HELD_BEFORE = 30, 130  # cycles between the command that leads to such a state and the fault
ATTEMPTS = 8  # to hit it
HELD_FROM_M, HELD_TO_M = 0.02, 0.18  # range of the path in which a hold is commanded
ROUNDS = 40  # of a program that lasts longer than the planner's timeout
DISABLED_S = 0.3  # bus time without torque in the exercise
COOLING_S = 6.0  # bus time in which the I2t integral decays
HEAVY_KG = 2.0
SETTLE_S = 0.1
THERE_M, THERE_RAD = 0.01, 0.01
TURN_DEG = 90.0  # of the tool of a rotary axis at the other end
PAYLOAD_KG = 0.3  # tolerance of the payload estimated from arm torques


class _MissedError(RunError):
    """The fault missed its intended state; the case is repeated."""


class Catalogue(FaultObserver):
    """Runs the cases of the catalogue on a running robot."""

    def __init__(self, bringup: Bringup, robot: core.Parameters) -> None:
        super().__init__(bringup, robot)
        self._home = np.array(robot.motion.home_m)
        self._away = self._home + STEP_M
        self._ready = False  # the last case has left the robot enabled at home
        self._program: dict[str, Any] = {}  # fields of every program of the case besides its moves

    def run(self, case: Case) -> Outcome:
        """Run one case; problems are part of the outcome."""
        for _ in range(ATTEMPTS):
            outcome = Outcome(case)
            try:
                if not self._ready:
                    self.make_ready(self._home.tolist())
                self._ready = False
                self._run(case, outcome)
                break
            except _MissedError as error:
                outcome.problem = str(error)
            except Delta3Error as error:
                outcome.problem = str(error)
                break
        started = time.monotonic()
        try:
            self.make_ready(self._home.tolist())
            outcome.recovered_s = time.monotonic() - started
            if case.kind == 'overload':
                self.let_pass(COOLING_S)
            outcome.reference_m = self._move_for_reference()
            self._ready = True
        except Delta3Error as error:
            outcome.problem = outcome.problem or f'not recovered: {error}'
            self.replace_the_machine()
        return outcome

    def _move_for_reference(self) -> float:
        """Move away and back without faults; return the path deviation, or raise RunError if it is too large."""
        self._log.begin()
        self.drive(self._moves(self._away, self._home))
        self.wait(self.is_at_rest, 'end of the reference move')
        self.let_pass(SETTLE_S)
        return judge_reference(self._log.tcp(), self._home, self._away, self.progress.fault)

    def _moves(self, *points: Floats, **limits: float) -> list[dict[str, Any]]:
        """Return moves to these points; the tool of a rotary axis rotates on the way, and is at 0 at home."""
        moves: list[dict[str, Any]] = []
        for point in points:
            angle_deg = 0.0 if point is self._home else TURN_DEG
            angles = [angle_deg] * len(self._robot.rotary_axes)
            turn = dict.fromkeys(('turn_deg',)[: len(angles)], angles)
            moves.append({'move_l': {'to_m': point.tolist(), 'speed_m_s': SPEED_M_S, **turn, **limits}})
        return moves

    def make_ready(self, home_m: Sequence[float]) -> None:
        """Make the robot ready, and return the tool of a rotary axis to 0; raises Delta3Error."""
        super().make_ready(home_m)
        turns_rad = self.progress.turns_rad
        if any(abs(angle) > THERE_RAD for angle in turns_rad):
            self.drive([{'turn': {'to_deg': [0.0] * len(turns_rad)}}])
            self.wait(self.is_at_rest, 'end of the turn')

    def _run(self, case: Case, outcome: Outcome) -> None:
        self._program = {}
        if case.kind == 'payload_lost':
            self._grip()
        losses, repeated = self._counters(case)
        self._log.begin()
        self._first = self._failed_s = None
        self._process_fault = ''
        notes, processes = len(self._bringup.notes), list(self._bringup.processes())
        held = self._static_torque() if case.kind == 'payload_lost' else 0.0
        end = self._begin(case)
        outcome.reported = self._observe(case)
        outcome.deviation_m = distance_from_line(self._log.tcp(), self._home, end)
        self._time_detection(case, outcome)
        if not outcome.reported:
            self._exercise(case)
            self.fresh()
            outcome.reported = self.fault
            outcome.exercised = outcome.reported is not None
            outcome.deviation_m = max(
                outcome.deviation_m, distance_from_line(self._log.tcp(), self._home, self._away)
            )
        if KINDS[case.kind].telegram or case.kind in OF_AXIS:
            # telegrams must prove the fault: a log message that it begins is not sufficient
            outcome.evidence = self._evidence(case, losses, repeated)
        else:
            replaced = self._bringup.notes[notes:] if processes != self._bringup.processes() else []
            outcome.evidence = self._process_fault or '; '.join(replaced)
        if case.kind == 'payload_lost' and not outcome.reported:
            outcome.evidence = self._payload_evidence(held)

    def _observe(self, case: Case) -> RobotFault | None:
        """Return the fault if it has stopped the robot."""
        if case.state != State.STOPPED_BY_FAULT:
            return self.observe(OBSERVED_S + case.fault.get('for_s', 0.0))
        self.let_pass(OBSERVED_S)
        self.wait(lambda: self.fresh().phase == 'CP4', 'cyclic operation')
        self.let_pass(EXPLANATION_S)
        return self.fault

    def _time_detection(self, case: Case, outcome: Outcome) -> None:
        """Store the detection time: in bus time, or in wall time if bus time has paused."""
        fault = outcome.reported
        if fault is None or self._first is None or case.state == State.STOPPED_BY_FAULT:
            return
        if case.kind not in PROCESS_FAULTS:
            outcome.detected_s = (fault.cycle - self._first) * self._robot.bus.cycle_time_s
            return
        shafts = self._log.telegrams(SHAFTS)
        before = np.flatnonzero(shafts.cycles <= self._first)
        if len(before) and self._failed_s is not None:
            outcome.silent_s = self._failed_s - float(shafts.received_s[before[-1]])

    def _begin(self, case: Case) -> Floats:
        """Bring the robot into the state of the case and inject the fault; return the end point of its path."""
        end: Floats = getattr(self, f'_while_{case.state.name.lower()}')(case)
        return end

    def _while_disabled(self, case: Case) -> Floats:
        self._disable()
        self._inject(case)
        return self._home

    def _while_enabling(self, case: Case) -> Floats:
        self._disable()
        self._inject(case, AHEAD_S)
        first = self._await_cycle(ENABLED_BEFORE)
        begins = self._enable()
        drive, motor = self._robot.drive, self._robot.motor
        cycles = (drive.enable_settle_s + motor.brake_release_s) / self._robot.bus.cycle_time_s
        if not begins < first < begins + cycles:
            raise _MissedError(f'the fault in bus cycle {first} missed the enabling from cycle {begins} on')
        return self._home

    def _while_standing(self, case: Case) -> Floats:
        self._inject(case)
        return self._home

    def _while_moving(self, case: Case) -> Floats:
        fault = case.fault | {'after_s': MIDWAY_S}
        if case.target == UNIT_ROBOT and case.expected:
            back_and_forth = self._moves(self._away, self._home)
            self.drive(back_and_forth, [fault], repeat=ROUNDS, **self._program)
        else:
            self.drive(self._moves(self._away), [fault], **self._program)
        return self._away

    def _while_stopping(self, case: Case) -> Floats:
        way = self._moves(self._away, acceleration_m_s2=GENTLE_M_S2)
        self._first = None
        self.drive(way, [case.fault | {'after_s': MIDWAY_S + AHEAD_S}], **self._program)
        first = self._await_cycle(HELD_BEFORE)
        try:
            stop = self._hold()
        except ProgramError as error:
            raise _MissedError(f'the fault in bus cycle {first} came before the hold: {error}') from None
        after_s, stop_s = (first - stop.cycle) * self._robot.bus.cycle_time_s, stop.table[-1, 0]
        if not 0.0 < after_s < stop_s:
            raise _MissedError(
                f'the fault {after_s:g} s after the hold missed the stop, which takes {stop_s:g} s'
            )
        return self._away

    def _while_held(self, case: Case) -> Floats:
        self.drive(self._moves(self._away), **self._program)
        # before the move starts, the distance is that of the last program, which ended at the other end
        self.wait(lambda: HELD_FROM_M < self.progress.master_m < HELD_TO_M, 'motion')
        self.operator.call('hold')
        self.wait(lambda: self.operator.state == 'stopped', 'standstill')
        self._inject(case)
        return self._away

    def _while_stopped_by_fault(self, case: Case) -> Floats:
        self.operator.call('emergency_stop')
        self.wait(lambda: self.fresh().fault and not self.progress.in_torque, 'standstill')
        self._inject(case)
        return self._home

    def _while_starting(self, case: Case) -> Floats:
        """Suspend the plant until the phase falls, replace it, and meanwhile inject the fault."""
        plant = self._child(PLANT)
        plant.send(signal.SIGSTOP)
        try:
            self.wait(lambda: self.progress.phase == 'CP0', 'fall of the phase')
        finally:
            plant.send(signal.SIGKILL)
        self.wait(lambda: self._child(PLANT) is not plant, 'replacement of the plant')
        child = self._child(case.target)
        if case.kind == 'kill':
            child.send(signal.SIGKILL)
            self.wait(lambda: self._child(case.target) is not child, f'replacement of {case.target}')
            self._process_fault = f'{child.name} was killed in CP0'
            return self._home
        child.send(signal.SIGSTOP)
        try:
            over = time.monotonic() + case.fault['seconds']
            self.wait(lambda: time.monotonic() > over, 'end of the time that it hangs')
        finally:
            child.send(signal.SIGCONT)
        self._process_fault = f'{child.name} was stopped in CP0'
        return self._home

    def _exercise(self, case: Case) -> None:
        """Finish a held motion; then disable, enable, move away and back while the fault lasts."""
        operator = self.operator
        self.wait(lambda: operator.state != 'stopping' or self.progress.fault, 'standstill')
        if operator.state == 'stopped':
            self._resume()
        again = 'for_s' in case.fault
        if not (case.lasts or again or case.kind == 'payload_lost') or self.fresh().fault:
            return
        self._disable()
        if again:
            self._inject(case)  # the first injection has expired
        self.let_pass(DISABLED_S)
        if self.fresh().fault:
            self.observe(0.0)
            return
        operator.enable(True)
        self.wait(lambda: self.fresh().in_torque or self.progress.fault, 'torque')
        is_away = float(np.linalg.norm(self._log.tcp(MDT)[-1] - self._away)) < THERE_M
        way = (self._home, self._away, self._home) if is_away else (self._away, self._home)
        try:
            self.drive(self._moves(*way), **self._program)
        except ProgramError:
            if not self.fresh().fault:
                raise
        self.observe(0.0)

    def _resume(self) -> None:
        """Resume a held motion; abort it if the planner has been restarted and does not know it."""
        try:
            self.call('resume')
            self.wait(lambda: self.operator.state != 'stopped', 'motion')
        except Delta3Error:
            self.call('abort')
        self.wait(self.is_at_rest, 'end of the motion')

    def _grip(self) -> None:
        """Grip a heavy payload at home."""
        self._program = {'payload_kg': HEAVY_KG}
        moves: list[dict[str, Any]] = [
            {'dwell': {'time_s': SETTLE_S}},
            {'output': {'name': 'gripper', 'value': True, 'payload_kg': HEAVY_KG}},
        ]
        self.drive(moves)
        self.wait(lambda: self.is_at_rest() and self.progress.payload_kg == HEAVY_KG, 'payload')
        self.let_pass(SETTLE_S)

    def _static_torque(self) -> float:
        """Return the sum of the coupling torques [N m] of the three arms at rest."""
        self._log.begin()
        self.let_pass(SETTLE_S)
        return float(coupling_of_arms(self._log.telegrams(SHAFTS).values).sum(axis=1).mean())

    def _payload_evidence(self, held_n_m: float) -> str:
        """Return evidence that the payload was lost, from the arm torques; empty if it is still there."""
        theta = self._log.telegrams(SHAFTS).values[-1, :3] / self._robot.dynamics.gear_ratio
        with_it, without = (
            float(dynamics.gravity(theta, self._robot.replace(dynamics__payload_mass_kg=mass)).sum())
            for mass in (HEAVY_KG, 0.0)
        )
        ratio = self._robot.dynamics.gear_ratio
        lost = HEAVY_KG * ratio * abs(self._static_torque() - held_n_m) / abs(with_it - without)
        return f'{lost:.3f} kg lost' if abs(lost - HEAVY_KG) < PAYLOAD_KG else ''

    def _evidence(self, case: Case, losses: int, repeated: int) -> str:
        """Return evidence of the fault, empty if there is none."""
        if KINDS[case.kind].telegram:
            lost, late = (
                now - before for now, before in zip(self._counters(case), (losses, repeated), strict=True)
            )
            return f'{lost} lost' if lost else f'{late} repeated' if late else ''
        if self._first is None:
            return ''
        return OF_AXIS[case.kind](AxisRecord.of(self._log.kept(), ALL_DRIVES.index(case.target), self._first))


def run_catalogue(
    todo: Sequence[Case],
    logs: Path | None,
    outcomes: list[Outcome],
    show: Callable[[Outcome], None],
    parameters: Path | None = None,
) -> None:
    """Start a robot without a clock and run cases; adds to ``outcomes`` and passes each one to ``show``.

    Raises
    ------
    KeyboardInterrupt
        A signal ended the run.

    """
    robot = core.load(parameters)
    options = Options(program=None, parameters=parameters, real_time_factor=0.0, logs=logs)
    bringup = Bringup(options, schedule=Schedule.PREFERRED)

    def operate() -> None:
        catalogue = Catalogue(bringup, robot)
        for case in todo:
            outcomes.append(catalogue.run(case))
            show(outcomes[-1])

    run_operated(bringup, operate)

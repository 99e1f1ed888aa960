"""Requests of a script to a running robot: attach, wait for bus cycles, hold, work on belts, leave.

Pure: requests come in, replies go out. Motion of a script arrives as orders, as from the planner. A script needs
control of the robot; if it loses control, the robot stops on its path.
"""

import json
from collections.abc import Callable
from functools import partial
from typing import Any

from delta3_pacdrive.belts.image import belts_text
from delta3_pacdrive.belts.knowledge import TrackOrder
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.messages import Request
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.operation.control import Control
from delta3_pacdrive.control.operation.cyclic_operation import CyclicOperation
from delta3_pacdrive.control.operation.orders import Orders
from delta3_pacdrive.control.operation.robot_state import STOPPED_OFF_BELT, RobotState
from delta3_pacdrive.control.operation.script_gate import GateEvent, GateState, ScriptGate
from delta3_pacdrive.control.operation.script_operations import (
    ATTACH,
    CANCEL,
    END,
    GUIDE,
    HOLD,
    OPERATIONS,
    POLL,
    STEER,
    TRACK,
    TRACK_AGAIN,
    WAIT,
    Guide,
    Snapshot,
    Steer,
)
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, Delta3Error, Reason, shown
from delta3_pacdrive.robot.sercos.bus_time import NEVER

Reply = Callable[[Request, Reason | None, str, bool], None]
HELD = Reason(Code.STATE, 'an operator has stopped the robot on its path: resume() continues')
ABORTED = Reason(Code.WITHDRAWN, 'an operator has aborted the script')
LOST = Reason(Code.CONTROL, 'the script no longer has control of the robot')


class ScriptService:
    """Service for the script of one robot; one script at a time.

    ``reply`` is called with a request, the reason of a rejection, the text, and whether the reply is final.
    """

    def __init__(
        self,
        state: RobotState,
        task: Transformation,
        cycles: CyclicOperation,
        gate: ScriptGate,
        orders: Orders,
        control: Control,
        in_position_cycles: int = 1,
    ) -> None:
        self._state, self._task, self._cycles = state, task, cycles
        self._gate, self._orders, self._control = gate, orders, control
        self.reply: Reply = lambda *_: None
        self._in_position_cycles = in_position_cycles
        self._awaiting_rest = False  # the script has cancelled its motion and waits for standstill
        self._waiting: Request | None = None
        # set when an operator stops the robot while the script decides, until the script's next request
        self._held_outside: Reason | None = None
        gate.on_decision = self._decided
        self._acts: dict[str, Callable[[Request, Any], Reason | str | None]] = {
            ATTACH.name: self._attach,
            POLL.name: self._poll,
            WAIT.name: self._wait,
            HOLD.name: partial(self._stop, cancels_motion=False),
            TRACK.name: self._track,
            TRACK_AGAIN.name: self._track_again,
            STEER.name: self._steer,
            GUIDE.name: self._guide,
            CANCEL.name: partial(self._stop, cancels_motion=True),
            END.name: self._end,
        }

    @property
    def operator(self) -> str:
        """Identity of the active script, empty without one."""
        return self._orders.script

    # requests ---------------------------------------------------------------------------------------------------------

    def ask(self, request: Request) -> None:
        """Carry out a request; the reply is sent now or later."""
        outcome = self._rejection(request) or self._carry_out(request)
        if isinstance(outcome, Reason):
            self.reply(request, outcome, '', True)
        elif outcome is not None:
            self.reply(request, None, outcome, True)

    def _carry_out(self, request: Request) -> Reason | str | None:
        """Return the reply, or None if it follows later."""
        operation = OPERATIONS.get(request.action)
        if operation is None:
            return Reason(Code.CONTENT, f'a script cannot request {shown(request.action)}')
        try:
            argument = operation.read(request.text)
        except Delta3Error as error:
            return Reason(Code.CONTENT, f'{operation.name}: {error}')
        return self._acts[operation.name](request, argument)

    def _rejection(self, request: Request) -> Reason | None:
        operator = self._control.operator
        if operator is None or operator.identity != request.operator:
            return self._control.refusal(request.operator) or LOST
        if request.action == ATTACH.name:
            return None
        if self.operator != request.operator:
            return self._state_rejection() or Reason(Code.STATE, 'no script of this operator runs')
        if request.action == END.name:
            return None
        return self._state_rejection()

    def _state_rejection(self) -> Reason | None:
        fault = self._state.fault
        return None if fault is None else Reason(Code.FAULT, str(fault), fault)

    def _attach(self, request: Request, _: None) -> Reason | str:
        if self.operator and self.operator != request.operator:
            return Reason(Code.STATE, 'another script is active')
        refusal = self._state.refusal()
        if refusal is not None:
            held = self._state.motion is MotionState.STOPPED
            out = 'delta3 move abort ends its program'
            if self._orders.of_planner:
                out += ', delta3 move resume continues it'
            more = f': {out}' if held else ''
            return Reason(refusal.code, f'{refusal.sentence}{more}', refusal.fault)
        self._orders.script = request.operator
        if self._cycles.answered <= self._gate.begins < NEVER:
            self._orders.script = ''
            return Reason(Code.LATE, f'the script begins in bus cycle {self._gate.begins}: ask again then')
        tracking = self._task.tracking
        if not tracking.free:
            self._orders.script = ''
            return Reason(Code.LATE, 'the robot still follows a belt: try again once it has left it')
        self._gate.begins = NEVER
        self._held_outside = None
        self._gate.attach(self._cycles.answered)
        axes = '[]'
        if tracking.belts:
            axes = belts_text(tracking.belts)
            tracking.begin(self._gate.cycle)
        return self._snapshot(inputs=list(self._cycles.inputs.names), clock=self._gate.has_clock, axes=axes)

    def _poll(self, _: Request, __: None) -> str:
        self._gate.refresh(self._cycles.answered)
        return self._snapshot()

    def _wait(self, request: Request, condition: WaitCondition) -> Reason | None:
        held, self._held_outside = self._held_outside, None
        if held is not None and (held is not HELD or self._held_profile() is not None):
            return held
        return self._continue(request, condition)

    def _stop(self, request: Request, cycle: int, cancels_motion: bool) -> Reason | None:
        """Run the bus up to the requested cycle, in which the robot starts to stop."""
        cycle = self._possible(cycle)
        self._awaiting_rest = self._awaiting_rest or cancels_motion
        self._gate.hold_cycle, self._gate.cancels_motion = cycle, cancels_motion
        self._held_outside = None
        return self._continue(request, WaitCondition(cycle - 1, cycle - 1))

    def _possible(self, cycle: int) -> int:
        """Return the bus cycle of a request; with a clock, at least the next possible one."""
        return max(cycle, self._cycles.next_cycle + 1) if self._gate.has_clock else cycle

    def _track(self, _: Request, order: TrackOrder) -> Reason | str:
        tracking = self._task.tracking
        belts = tracking.belts
        if not 0 <= order.belt < len(belts) or belts[order.belt].window is None:
            return Reason(Code.CONTENT, f'the robot cannot work on belt number {order.belt}, of {len(belts)}')
        tracking.order(order)
        return 'the order counts for the next event that gets on a belt'

    def _track_again(self, _: Request, cycle: int) -> Reason | str:
        cycle, tracking = self._possible(cycle), self._task.tracking
        if tracking.free:
            return Reason(Code.STATE, 'the robot is on no belt')
        if self._state.motion is not MotionState.STOPPED:
            return Reason(
                Code.STATE,
                f'{motion_sentence(self._state.motion)}: only one that stopped next to a belt gets on again',
            )
        if cycle < self._cycles.next_cycle:
            return Reason(Code.LATE, f'bus cycle {cycle} is over, the next one is {self._cycles.next_cycle}')
        tracking.again_cycle = cycle
        return f'from bus cycle {cycle} on, if the robot resumes then'

    def _steer(self, _: Request, steer: Steer) -> Reason | str:
        return self._state.steer(steer.limits, self._possible(steer.cycle))

    def _guide(self, _: Request, guide: Guide) -> Reason | str:
        if self._state.motion is not MotionState.STEERED:
            held, self._held_outside = self._held_outside, None
            return held or Reason(Code.STATE, f'{motion_sentence(self._state.motion)}, not steered')
        cycle = self._possible(guide.cycle)
        self._task.servo.schedule(cycle, guide.point)
        return f'from bus cycle {cycle} on'

    def _wait_for_rest(self, request: Request) -> None:
        """Wait for the standstill, after which moves and belt are cleared."""
        gate, self._awaiting_rest = self._gate, False
        last = max(gate.rest_cycle, gate.cycle + 1) + self._in_position_cycles - 1
        self._waiting = request
        gate.wait(WaitCondition(last, last), self._cycles.inputs.bits)

    def _continue(self, request: Request, condition: WaitCondition) -> Reason | None:
        gate, cycles = self._gate, self._cycles
        self._waiting = None  # a new request replaces a waiting one
        gate.interrupt(cycles.answered)
        if gate.state is not GateState.WAITING:
            return Reason(Code.STATE, 'no script decides')
        self._waiting = request
        gate.refresh(cycles.answered)
        gate.wait(condition, cycles.inputs.bits)
        if not gate.closed:
            cycles.complete()
            if not self._gate.has_clock:
                cycles.start_due()
        return None

    def _end(self, _: Request, __: None) -> str:
        self._gate.handle(GateEvent.END)
        self._orders.script = ''
        self._cycles.complete()  # evaluate feedback that arrived while the bus waited
        return 'the script has ended'

    # events -----------------------------------------------------------------------------------------------------------

    def _decided(self) -> None:
        """Reply to the waiting request of the script: condition met, timed out or cancelled."""
        request, self._waiting = self._waiting, None
        if request is None:
            return
        fault = self._state_rejection()
        if fault is not None:
            self.reply(request, fault, '', True)
        elif self._gate.state is GateState.FREE:
            self.reply(request, LOST, '', True)
        elif request.action == CANCEL.name and self._awaiting_rest:
            if self._gate.hold_cycle < NEVER:  # the belt was lost before, and the robot is at rest
                self._gate.clear_hold()
                self._gate.rest_cycle = self._state.cancel_motion()
            self._wait_for_rest(request)
        elif self._gate.lost is not None:
            self.reply(request, self._gate.lost, '', True)
        elif request.action == HOLD.name:
            if self._held_profile() is None:
                sentence = 'hold: the moves had finished before it took effect'
                self.reply(request, Reason(Code.STATE, sentence), '', True)
            else:
                self.reply(request, None, self._snapshot(), True)
        else:
            self.reply(request, None, self._snapshot(met=self._gate.met), True)

    def hold(self) -> Reason | str:
        """Stop the robot on its path for an operator and notify the script; return why not, or the outcome."""
        outcome = self._state.hold_or_leave_belt()
        if isinstance(outcome, str):
            self._held(STOPPED_OFF_BELT if self._state.motion is MotionState.IDLE else HELD)
        return outcome

    def _held(self, reason: Reason) -> None:
        request, self._waiting = self._waiting, None
        self._awaiting_rest = False
        self._gate.clear_hold()
        if request is None:
            self._held_outside = reason
        else:
            self._gate.interrupt(self._cycles.answered)
            self.reply(request, reason, '', True)

    def abort(self) -> Reason | str:
        """Abort the motion for an operator and end the script; return why not, or the outcome.

        If nothing can be aborted, the script continues.
        """
        outcome = self._state.abort()
        if isinstance(outcome, str):
            self._cancel()
        return outcome

    def _cancel(self) -> None:
        request, self._waiting = self._waiting, None
        if self.operator:
            self._gate.handle(GateEvent.END)
            self._orders.script = ''
        if request is not None:
            self.reply(request, ABORTED, '', True)

    def poll(self) -> None:
        """Check that the script still has control, and keep its waiting request alive."""
        operator = self._control.operator
        if self.operator and (operator is None or operator.identity != self.operator):
            self._handle_control_loss()
        if self._waiting is not None:
            self.reply(self._waiting, None, '', False)
        if self._gate.state is GateState.FREE and self._state.fault:
            self._orders.script = ''

    def _handle_control_loss(self) -> None:
        holds = self._gate.handle(GateEvent.CONTROL_LOST)
        self._orders.script = ''
        if holds:
            self._state.hold_or_leave_belt()

    def _snapshot(self, **more: Any) -> str:
        """Return the state in the bus cycle that the script decides on, as JSON, with additional entries."""
        gate, tracking = self._gate, self._task.tracking
        commanded, inputs = gate.command_of(gate.cycle), self._cycles.inputs.bits
        seen = Snapshot.of(self._task, gate.cycle, commanded, self._state.motion, inputs).to_document()
        if commanded.tracked is None:
            del seen['planned_m']
        else:
            more['belts'] = tracking.to_document(gate.cycle, commanded.tracked)
        return json.dumps({'seen': seen, 'held': self._held_profile(), **more})

    def _held_profile(self) -> list[float] | None:
        """Return the motion profile of a robot that is stopping or held, as a row of numbers."""
        task = self._task
        profile = task.profile if task.loaded and task.held else None
        return None if profile is None else profile.to_array().tolist()

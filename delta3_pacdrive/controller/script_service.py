"""What a script on a robot that is up asks for: it begins, waits for bus cycles, holds the robot, ends.

Pure: requests come in, replies go out. What it wants to be driven comes as orders, as those of the planner do. Who has
control of the robot decides; if he loses it, the robot stops on its path.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, fields
from typing import Any

from delta3_pacdrive.controller.belt_axes import belts_text
from delta3_pacdrive.controller.belt_knowledge import TrackOrder
from delta3_pacdrive.controller.control import Control
from delta3_pacdrive.controller.cyclic_operation import CyclicOperation
from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.controller.motion_state import UNDER_WAY, MotionState
from delta3_pacdrive.controller.motion_state import sentence as motion_sentence
from delta3_pacdrive.controller.orders import Orders
from delta3_pacdrive.controller.robot_state import STOPPED_BESIDE, RobotState
from delta3_pacdrive.controller.script_gate import GateEvent, GateState, ScriptGate
from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.controller.wait_condition import Commanded, WaitCondition
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.sercos.bus_time import NEVER

ATTACH, LOOK, WAIT, HOLD, LEAVE = 'attach', 'look', 'wait', 'hold', 'leave'
GET_ON, GET_ON_AGAIN, ABANDON = 'get on', 'get on again', 'abandon'
Reply = Callable[[Request, Reason | None, str, bool], None]
HELD = Reason(Code.STATE, 'somebody has stopped the robot on its path: resume() goes on')
ABORTED = Reason(Code.WITHDRAWN, 'an operator has given the script up')
LOST = Reason(Code.CONTROL, 'the script does not have control of the robot any more')


class ScriptService:
    """The scripts of one robot, one at a time.

    Parameters
    ----------
    state, task, cycles, gate, orders, control
        Of the same controller.
    has_clock
        Whether bus cycles are due by a clock.
    in_position_cycles
        For how many cycles every drive has to be within its window.

    Attributes
    ----------
    reply
        Called with a request, why it is refused, what it is answered with, and whether that is all.

    """

    def __init__(
        self,
        state: RobotState,
        task: Transformation,
        cycles: CyclicOperation,
        gate: ScriptGate,
        orders: Orders,
        control: Control,
        has_clock: bool,
        in_position_cycles: int = 1,
    ) -> None:
        self._state, self._task, self._cycles = state, task, cycles
        self._gate, self._orders, self._control, self._has_clock = gate, orders, control, has_clock
        self.reply: Reply = lambda *_: None
        self._in_position_cycles = in_position_cycles
        self._comes_to_rest = False  # a robot whose script has abandoned it
        self._waiting: Request | None = None
        # why somebody has stopped the robot while the script decided: it does not know yet
        self._held_outside: Reason | None = None
        gate.on_decision = self._decided

    @property
    def operator(self) -> str:
        """Identity of the script, empty if there is none."""
        return self._orders.script

    # requests ---------------------------------------------------------------------------------------------------------

    def ask(self, request: Request) -> None:
        """Do what a script asks for; the reply comes now or later."""
        outcome: Reason | str | None = self._refusal(request)
        if outcome is None:
            acts: dict[str, Callable[[Request], Reason | str | None]] = {
                ATTACH: self._attach,
                LOOK: self._look,
                WAIT: self._wait,
                HOLD: self._hold,
                LEAVE: self._leave,
                GET_ON: self._get_on,
                GET_ON_AGAIN: self._get_on_again,
                ABANDON: self._abandon,
            }
            act = acts.get(request.action)
            content = Reason(Code.CONTENT, f'a script cannot ask for {shown(request.action)}')
            outcome = content if act is None else act(request)
        if isinstance(outcome, Reason):
            self.reply(request, outcome, '', True)
        elif outcome is not None:
            self.reply(request, None, outcome, True)

    def _refusal(self, request: Request) -> Reason | None:
        operator = self._control.operator
        if operator is None or operator.identity != request.operator:
            return self._control.refusal(request.operator) or LOST
        if request.action == ATTACH:
            return None
        if self.operator != request.operator:
            return self._state_refusal() or Reason(Code.STATE, 'no script of this operator runs')
        if request.action == LEAVE:
            return None
        return self._state_refusal()

    def _state_refusal(self) -> Reason | None:
        fault = self._state.fault
        return None if fault is None else Reason(Code.FAULT, str(fault), fault)

    def _attach(self, request: Request) -> Reason | str:
        if self.operator and self.operator != request.operator:
            return Reason(Code.STATE, 'another script decides')
        refusal = self._state.refusal()
        if refusal is not None:
            held = self._state.motion is MotionState.STOPPED
            out = 'delta3 move abort gives up what it drives'
            if self._orders.of_planner:
                out += ', delta3 move resume goes on with it'
            more = f': {out}' if held else ''
            return Reason(refusal.code, f'{refusal.sentence}{more}', refusal.fault)
        self._orders.script = request.operator
        if self._cycles.answered <= self._gate.begins < NEVER:
            self._orders.script = ''
            return Reason(Code.LATE, f'the script begins in bus cycle {self._gate.begins}: ask again then')
        tracking = self._task.tracking
        if tracking is not None and not tracking.free:
            self._orders.script = ''
            return Reason(Code.LATE, 'the robot still goes with a belt: ask again once it has left that')
        self._gate.begins = NEVER
        self._held_outside = None
        self._gate.attach(self._cycles.answered)
        axes = '[]'
        if tracking is not None:
            axes = belts_text(tracking.belts)
            tracking.begin(self._gate.cycle)
        return self._told(inputs=list(self._cycles.inputs.names), clock=self._has_clock, axes=axes)

    def _look(self, _: Request) -> str:
        self._gate.refresh(self._cycles.answered)
        return self._told()

    def _wait(self, request: Request) -> Reason | str | None:
        condition = read_condition(request.text)
        if isinstance(condition, Reason):
            return condition
        held, self._held_outside = self._held_outside, None
        if held is not None and (held is not HELD or self._held_profile() is not None):
            return held
        return self._go_on(request, condition)

    def _hold(self, request: Request) -> Reason | str | None:
        return self._stop(request, abandons=False)

    def _stop(self, request: Request, abandons: bool) -> Reason | None:
        """Let the bus go on to a cycle, from which on the robot stops."""
        cycle = self._cycle_of(request)
        if isinstance(cycle, Reason):
            return cycle
        self._gate.hold_cycle, self._gate.abandons = cycle, abandons
        self._held_outside = None
        return self._go_on(request, WaitCondition(cycle - 1, cycle - 1))

    def _cycle_of(self, request: Request) -> int | Reason:
        """Return the bus cycle that a request is about; on a bus with a clock that may be over."""
        if not request.text.isdecimal() or len(request.text) > 15:
            return Reason(
                Code.CONTENT, f'{request.action} is asked for a bus cycle, not {shown(request.text)}'
            )
        cycle = int(request.text)
        return max(cycle, self._cycles.next_cycle + 1) if self._has_clock else cycle

    def _get_on(self, request: Request) -> Reason | str:
        tracking = self._task.tracking
        try:
            order = TrackOrder.from_document(json.loads(request.text))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError):
            return Reason(Code.CONTENT, f'a script gets on a belt by an order, not by {shown(request.text)}')
        belts = () if tracking is None else tracking.belts
        if tracking is None or not 0 <= order.belt < len(belts) or belts[order.belt].window is None:
            return Reason(Code.CONTENT, f'nobody may work on belt number {order.belt}, of {len(belts)}')
        tracking.order(order)
        return 'the order counts for the next event that gets on a belt'

    def _get_on_again(self, request: Request) -> Reason | str:
        cycle, tracking = self._cycle_of(request), self._task.tracking
        if isinstance(cycle, Reason):
            return cycle
        if tracking is None or tracking.free:
            return Reason(Code.STATE, 'the robot is on no belt')
        if self._state.motion is not MotionState.STOPPED:
            return Reason(
                Code.STATE,
                f'{motion_sentence(self._state.motion)}: only one that stopped next to a belt gets on again',
            )
        if cycle < self._cycles.next_cycle:
            return Reason(Code.LATE, f'bus cycle {cycle} is over, the next one is {self._cycles.next_cycle}')
        tracking.again_cycle = cycle
        return f'from bus cycle {cycle} on, if the robot goes on then'

    def _abandon(self, request: Request) -> Reason | None:
        self._comes_to_rest = True
        return self._stop(request, abandons=True)

    def _come_to_rest(self, request: Request) -> None:
        """Wait until a robot stands that has been stopped, and is to forget moves and belt."""
        gate, self._comes_to_rest = self._gate, False
        last = max(gate.stands, gate.cycle + 1) + self._in_position_cycles - 1
        self._waiting = request
        gate.wait(WaitCondition(last, last), self._cycles.inputs.bits)

    def _go_on(self, request: Request, condition: WaitCondition) -> Reason | None:
        gate, cycles = self._gate, self._cycles
        self._waiting = None  # who asks anew does not wait for what he has asked for before
        gate.interrupt(cycles.answered)
        if gate.state is not GateState.WAITING:
            return Reason(Code.STATE, 'no script decides')
        self._waiting = request
        gate.refresh(cycles.answered)
        gate.wait(condition, cycles.inputs.bits)
        if not gate.closed:
            cycles.complete()
            if not self._has_clock:
                cycles.start_due()
        return None

    def _leave(self, _: Request) -> str:
        self._gate.happen(GateEvent.LEAVE)
        self._orders.script = ''
        self._cycles.complete()  # what was answered while the bus waited
        return 'the script has ended'

    # what happens -----------------------------------------------------------------------------------------------------

    def _decided(self) -> None:
        """Answer the script: what it waits for is there, or does not come any more."""
        request, self._waiting = self._waiting, None
        if request is None:
            return
        fault = self._state_refusal()
        if fault is not None:
            self.reply(request, fault, '', True)
        elif self._gate.state is GateState.FREE:
            self.reply(request, LOST, '', True)
        elif request.action == ABANDON and self._comes_to_rest:
            if self._gate.hold_cycle < NEVER:  # it has lost its belt before, and stands
                self._gate.forget()
                self._gate.stands = self._state.abandon()
            self._come_to_rest(request)
        elif self._gate.lost is not None:
            self.reply(request, self._gate.lost, '', True)
        elif request.action == HOLD:
            if self._held_profile() is None:
                sentence = 'hold: the moves were over before it took effect'
                self.reply(request, Reason(Code.STATE, sentence), '', True)
            else:
                self.reply(request, None, self._told(), True)
        else:
            self.reply(request, None, self._told(met=self._gate.met), True)

    def hold(self) -> Reason | str:
        """Stop the robot on its path for an operator, and let the script know; returns why not, or what happens."""
        outcome = self._state.stand()
        if isinstance(outcome, str):
            self._held(STOPPED_BESIDE if self._state.motion is MotionState.IDLE else HELD)
        return outcome

    def _held(self, reason: Reason) -> None:
        request, self._waiting = self._waiting, None
        self._comes_to_rest = False
        self._gate.forget()
        if request is None:
            self._held_outside = reason
        else:
            self._gate.interrupt(self._cycles.answered)
            self.reply(request, reason, '', True)

    def abort(self) -> Reason | str:
        """Give up for an operator what is driven, and a script with it: it must not go on with what comes next.

        Returns why not, or what happens. Where there is nothing to give up, a script goes on.
        """
        outcome = self._state.abort()
        if isinstance(outcome, str):
            self._give_up()
        return outcome

    def _give_up(self) -> None:
        request, self._waiting = self._waiting, None
        if self.operator:
            self._gate.happen(GateEvent.LEAVE)
            self._orders.script = ''
        if request is not None:
            self.reply(request, ABORTED, '', True)

    def look(self) -> None:
        """Look whether who decides still has control; tell a script that waits that it is not forgotten."""
        operator = self._control.operator
        if self.operator and (operator is None or operator.identity != self.operator):
            self._lose()
        if self._waiting is not None:
            self.reply(self._waiting, None, '', False)
        if self._gate.state is GateState.FREE and self._state.fault:
            self._orders.script = ''

    def _lose(self) -> None:
        holds = self._gate.happen(GateEvent.LOSE)
        self._orders.script = ''
        if holds:
            self._state.stand()

    def _told(self, **more: Any) -> str:
        """Return what a script sees of the bus cycle that it decides on, and more."""
        gate, answer = self._gate, self._task.answer
        commanded = gate.command_of(gate.cycle)
        seen = {
            'cycle': gate.cycle,
            'motion': str(self._motion_of(commanded)),
            'command_m': answer['tcp_command'].tolist(),
            'position_m': answer['tcp_actual'].tolist(),
            'outputs': commanded.outputs,
            'payload_kg': commanded.payload_kg,
            'inputs': self._cycles.inputs.bits,
        }
        if commanded.turn_rad is not None:
            seen['turn_rad'] = commanded.turn_rad
        tracking, tracked = self._task.tracking, commanded.tracked
        if tracking is not None and tracked is not None:
            seen['planned_m'] = commanded.planned_m
            more['belts'] = tracking.told(gate.cycle, tracked)
        return json.dumps({'seen': seen, 'held': self._held_profile(), **more})

    def _motion_of(self, commanded: Commanded) -> MotionState:
        """Return what is done with the TCP by a command: a later one may have done more already."""
        motion = self._state.motion
        if motion not in UNDER_WAY:
            return motion
        if not commanded.held:
            return MotionState.MOVING
        return MotionState.STOPPED if self._gate.cycle >= commanded.end_cycle else MotionState.STOPPING

    def _held_profile(self) -> list[float] | None:
        """Return the motion profile of a robot that stops or stands on its path, as a row of numbers."""
        task = self._task
        profile = task.profile if task.loaded and task.held else None
        return None if profile is None else profile.to_array().tolist()


def condition_text(condition: WaitCondition) -> str:
    """Return a condition as a request has it."""
    return json.dumps(asdict(condition))


def read_condition(text: str) -> WaitCondition | Reason:
    """Return the condition of a request, or why it is none."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        values = None
    names = {field.name for field in fields(WaitCondition)}
    if not isinstance(values, dict) or set(values) != names:
        return Reason(Code.CONTENT, f'a script waits for a condition, not for {shown(text)}')
    whole = {name: value for name, value in values.items() if name not in ('over', 'left_cycles')}
    if values['left_cycles'] is not None:
        whole['left_cycles'] = values['left_cycles']
    for name, value in whole.items():
        if isinstance(value, bool) or not isinstance(value, int) or not -1 <= value < NEVER:
            return Reason(
                Code.CONTENT, f'{name} of a condition is {shown(value)}, but must be a whole number'
            )
    if not isinstance(values['over'], bool):
        return Reason(
            Code.CONTENT, f'over of a condition is {shown(values["over"])}, but must be true or false'
        )
    return WaitCondition(**values)

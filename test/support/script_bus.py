"""A robot on its bus for scripts, without ROS: the controller of the nodes, and simulated drives."""

from collections import deque
from typing import Any

import numpy as np

from delta3_pacdrive.belts.image import belts_text
from delta3_pacdrive.belts.knowledge import RemoteBelts
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.control.actions import AccessRequested, Replied
from delta3_pacdrive.control.cycle.plan_intake import MoreMoves, Order
from delta3_pacdrive.control.messages import PROFILE, Origin, Request
from delta3_pacdrive.control.operation.control import Operator
from delta3_pacdrive.control.operation.cyclic_operation import Timing
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.control.operation.script_gate import GateState
from delta3_pacdrive.control.operation.script_operations import ScriptOperation, Snapshot
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, Reason, RefusedError, RunError
from delta3_pacdrive.planning.extension import Row
from delta3_pacdrive.planning.program.output_names import OWN
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, PARTICIPANTS, Identity
from delta3_pacdrive.robot.sercos.participants import Announcement, Occasion
from delta3_pacdrive.robot.sercos.service_channel import Answer
from delta3_pacdrive.simulation.belts import axes_of, readings
from delta3_pacdrive.simulation.robot import Robot

# which of them reach the master first, if not the answers of the drives: those come a bus cycle later still
BELTS_FIRST, ANSWERS_LATE = 'belts first', 'answers a cycle late'


class BusPort:
    """The bus port of the controller: commands wait for their answers, up to the limit of outstanding ones."""

    def __init__(self, parameters: Any, first_decision: int, around: Any) -> None:
        self.machine = Robot(parameters)
        self.world = None if around is None else World(around, parameters.bus.cycle_time_s, first_decision)
        self._outputs = 0  # of the MDT before: they are there now
        self.sent: deque[Any] = deque()
        self.most_outstanding = 0
        self._first_decision = first_decision
        self.controller = RobotController(
            parameters, Timing(0.0, 0.2, lambda: 0.0, lambda: 0), False, Schedule(), self
        )

    def announce(self, _: Any) -> None:
        """Announce nothing."""

    def start_ticks(self, delay_s: float) -> None:
        """Start no timer."""

    def greet(self, _: Any) -> None:
        for index, position in enumerate(self.machine.encoder_positions()):
            self.controller.receive_greeting(index, ((position, 0.0, 0.0), 0, 0))

    def send(self, cycle: int, command: Any) -> None:
        kept = command._replace(motors=command.motors.copy(), torques=np.copy(command.torques))
        self.sent.append((cycle, kept))
        self.most_outstanding = max(self.most_outstanding, len(self.sent))

    def drive(self, cycle: int, command: Any) -> float:
        """Advance the cell to a bus cycle; return the attached payload from then on [kg]."""
        if self.world is None:
            return command.payload
        self.world.step(cycle, self.machine.plant.tcp().tolist(), self._outputs)
        self._outputs = command.outputs
        if self.world.carried_kg is None:
            return command.payload
        self.machine.grip(self.world.carried_kg)
        return self.world.carried_kg

    def publish_answers(self, cycle: int) -> None:
        if cycle == self._first_decision:
            self.controller.gate.attach(cycle + 1)

    def reject_telegram(self, reason: str) -> None:
        raise AssertionError(reason)

    def check_faults(self, _: Any) -> None:
        """Find nothing wrong."""

    def run_actions(self) -> None:
        actions, self.controller.state.actions = self.controller.state.actions, []
        for action in actions:
            if isinstance(action, Replied):
                action.request(action.reason, action.sentence)
            elif isinstance(action, AccessRequested):  # drives without a fault have nothing to say against it
                action.done(action.index, Answer(action.access.idn, 0))

    def publish_status(self) -> None:
        self.run_actions()


class ScriptBus:
    """The link of a script to a controller without a clock, which sends as far ahead of the answers as it may.

    Attributes
    ----------
    controller
        Of the robot.
    commands, answers
        Motor shafts [rad] that were commanded, and those that the drives have answered, by bus cycle.

    """

    inputs: tuple[str, ...] = ()

    def __init__(self, parameters: Any, around: Any = None, order: str = '') -> None:
        self.parameters, self._belts_first = parameters, order != ''
        self.tracking = RemoteBelts(parameters, ())
        self._answers_late = order == ANSWERS_LATE
        self._waiting: deque[Any] = deque()  # answers that have not reached the master
        first = parameters.motion.start_cycle - parameters.decision_cycles
        self._port = BusPort(parameters, first, around)
        belts = '[]' if around is None else belts_text(axes_of(around))
        self.outputs = OWN if around is None else around.output_names
        self.controller = self._port.controller
        self.lose_answer = -1  # bus cycle in which the second drive is not heard
        self.commands: list[list[float]] = []
        self.answers: list[list[float]] = []
        ours = Identity.of(parameters)
        while not self.controller.bus.cyclic:
            for name in PARTICIPANTS:
                session = self.controller.bus.session.decode()
                occasion = Occasion.CALLED
                told = Announcement(name, 'first', session, occasion, ours, DRIVES, 0, belts=belts)
                self.controller.receive_announcement(told)
            self.controller.poll_start_up(None)
        while self.controller.gate.state is GateState.FREE:
            self.exchange()

    @property
    def most_outstanding(self) -> int:
        """How many cycles were outstanding at most."""
        return self._port.most_outstanding

    @property
    def session(self) -> str:
        """Of the bus."""
        return self.controller.bus.session.decode()

    def exchange(self) -> bool:
        """Let the drives answer the oldest command; return whether there was one."""
        cycles = self.controller.cycles
        cycles.start_due()
        if not self._port.sent:
            return self._answer()
        cycle, command = self._port.sent.popleft()
        machine, world = self._port.machine, self._port.world
        payload = self._port.drive(cycle, command)
        if world is not None and self._belts_first:
            cycles.take_belts(cycle, readings(world))
        machine.cycle(command.motors, command.control, payload, torques=command.torques)
        self.commands.append(command.motors.tolist())
        self.answers.append(machine.answers[0].tolist())
        words = machine.status.tolist()
        told = [(tuple(machine.answers[:, index].tolist()), word, 0) for index, word in enumerate(words)]
        self._waiting.append((cycle, told))
        if not self._answers_late or len(self._waiting) > 1:
            self._answer()
        if world is not None and not self._belts_first:
            cycles.take_belts(cycle, readings(world))
        return True

    def _answer(self) -> bool:
        """Let the drives be heard of the oldest bus cycle of which they are not yet; return whether there was one."""
        if not self._waiting:
            return False
        cycle, told = self._waiting.popleft()
        for index, content in enumerate(told):
            if index != 1 or cycle != self.lose_answer:
                self.controller.cycles.take(index, cycle, content, 0)
        return True

    def poll(self) -> Snapshot:
        gate, answer = self.controller.gate, self.controller.task.answer
        commanded = gate.command_of(gate.cycle)
        command, actual = (tuple(answer[name].tolist()) for name in ('tcp_command', 'tcp_actual'))
        motion = self.controller.state.motion
        return Snapshot(
            gate.cycle, motion, command, actual, commanded.outputs, commanded.payload_kg, 0, command
        )

    @staticmethod
    def _require(reason: Reason | None) -> None:
        if reason is not None:
            raise RefusedError(reason)

    extra_cycles = 0

    def start(self, planned: Any, cycle: int, override: float) -> int:
        self._require(self.controller.state.start(Order(planned.plan, cycle, override, (), exact=True)))
        return cycle

    def extend(self, extension: Any) -> int:
        order = extension.more.tables.order.astype(float)
        row = Row(0, extension.first, extension.kept, order, extension.profile)
        self._require(self.controller.state.extend(MoreMoves(row, extension.more), lambda *_: None))
        return int(extension.profile.cycle)

    def change(self, profile: Any) -> int:
        self._require(self.controller.state.change(profile))
        return int(profile.cycle)

    def hold(self, cycle: int) -> Any:
        self.controller.gate.hold_cycle = cycle
        self.wait(WaitCondition(cycle - 1, cycle - 1))
        return self.controller.task.profile

    def wait(self, condition: WaitCondition) -> bool:
        gate, cycles = self.controller.gate, self.controller.cycles
        gate.wait(condition)
        while gate.state is GateState.RUNNING:
            cycles.complete()
            if gate.state is GateState.RUNNING:
                self.exchange()
        while gate.closed and self._port.sent:  # the drives know nothing of a script
            self.exchange()
        if self.controller.state.fault:
            raise RunError(str(self.controller.state.fault))
        return gate.met


class ServedNode:
    """The client of a script on the graph, in one process: requests and rows reach the same controller.

    Attributes
    ----------
    bus
        The robot.
    replies
        To the newest request: reason, text, whether that was all.
    instead
        Functions of the argument that are called instead of requests.

    """

    identity = 'a1b2c3d4e5f60718'

    def __init__(self, parameters: Any, around: Any = None, order: str = '') -> None:
        self.bus = ScriptBus(parameters, around, order)
        self.controller = self.bus.controller
        self.controller.control.take(Operator(self.identity, 'script test'), False, 0.0)
        self.controller.scripts.reply = lambda _, *reply: self.replies.append(reply)
        self.replies: list[Any] = []
        self._numbers = self.number = 0
        self.instead: dict[ScriptOperation, Any] = {}

    def outputs(self) -> Any:
        """Return the outputs that a script may name."""
        return self.bus.outputs

    def stands(self, cycles: int = 8) -> bool:
        """Return whether the commanded position of the robot is constant for some bus cycles."""
        return bool(np.ptp(np.array(self.bus.commands[-cycles:]), axis=0).max() == 0.0)

    def goes_on(self, cycles: int = 400) -> None:
        """Let bus cycles go by for which no script decides."""
        for _ in range(cycles):
            self.bus.exchange()

    def ask(self, action: ScriptOperation | str, text: str = '', operator: str = identity) -> Any:
        """Ask, and let bus cycles go by until that is answered; return reason and text."""
        self.post(action, text, operator)
        for _ in range(100_000):
            if self.replies and self.replies[-1][2]:
                break
            self.bus.exchange()
        while self.controller.gate.closed and self.bus.exchange():  # the drives know nothing of a script
            pass
        assert self.replies[-1][2], f'no answer to {action}'
        return self.replies[-1][:2]

    def post(self, action: ScriptOperation | str, text: str = '', operator: str = identity) -> None:
        """Ask, and leave it at that."""
        self.replies.clear()
        self._numbers += 1
        name = action if isinstance(action, str) else action.name
        self.controller.scripts.ask(Request(self.bus.session, operator, self._numbers, 0, name, text))

    def request(self, operation: ScriptOperation, argument: Any = None) -> str:
        if operation in self.instead:
            return str(self.instead[operation](argument))
        reason, told = self.ask(operation, operation.write(argument))
        if reason is not None:
            raise RefusedError(reason)
        return str(told)

    def spin_for(self, seconds: float) -> None:
        """Let no time go by."""

    def order(self, kind: str, plan: Any, row: Any) -> int:
        self.number += 1
        orders = self.controller.orders
        for n, move in enumerate(plan.moves):
            orders.take_row(self._label(move.kind.name), move.to_array(n, len(plan.moves)))
        orders.take_row(self._label(kind), np.asarray(row, dtype=np.float64))
        while orders.waiting:
            orders.check_row()
        return self._verdict()

    def change(self, profile: Any) -> int:
        self.number += 1
        self.controller.orders.take_profile(self._label(PROFILE), profile.to_array())
        return self._verdict()

    def _label(self, kind: str) -> str:
        return Origin(kind, self.identity, self.bus.session, self.number).label()

    def _verdict(self) -> int:
        ((_, verdict),) = self.controller.orders.verdicts
        self.controller.orders.verdicts = []
        if not verdict.accepted:
            raise RefusedError(Reason(Code.of(verdict.code), verdict.sentence))
        return int(verdict.sentence)

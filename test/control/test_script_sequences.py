"""After any sequence of requests by a script and operators, the documented requests make the robot ready."""

import os
import random
from contextlib import suppress

import numpy as np

from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.control import Operator
from delta3_pacdrive.control.operation.script_operations import ATTACH, END, HOLD, POLL, WAIT
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Delta3Error, Reason
from delta3_pacdrive.scripting.connected_link import ConnectedLink
from delta3_pacdrive.scripting.robot import Robot
from script_bus import ServedNode

SEQUENCES = max(8, int(os.environ.get('DELTA3_SEQUENCES', '0')) // 20)
LENGTH = 50
STRANGER = '0011223344556677'
PLACES = (
    [30, 0, -760],
    [0, 20, -750],
    [-20, -20, -755],
    [0, 0, -750],
    [0, 0, -200],
)  # the last is out of reach


class Sequence:
    """One random sequence of calls of a script, requests of other clients, and events at the robot."""

    def __init__(self, robot, seed):
        self.node, self.parameters, self.chance = ServedNode(robot), robot, random.Random(seed)
        self.controller = self.node.controller
        self.script = None
        self.told, self.now_s, self.driven = [], 0.0, 0
        self.begin()

    def begin(self):
        self.script = None
        self.script = Robot(ConnectedLink(self.node, self.parameters), 'script')

    def step(self):
        kind = self.chance.random()
        what = (
            self.call
            if kind < 0.75
            else self.ask
            if kind < 0.8
            else self.operate
            if kind < 0.9
            else self.handle
        )
        what()
        self.now_s += 0.1
        self.controller.poll(self.now_s)
        for _ in range(self.chance.randrange(4)):
            self.node.bus.exchange()

    def attempt(self, what, action):
        try:
            answer = action()
        except Delta3Error as error:
            answer = f'refused: {error}'
            assert answer != 'refused: '
        else:
            self.driven += what.startswith('move')
            if isinstance(answer, Reason):
                assert str(answer)
        self.told.append(f'{what}: {answer} ({self.controller.state.motion})')

    def call(self):
        """Call a function of the script interface."""
        chance, script = self.chance, self.script
        if script is None or self.controller.scripts.operator != self.node.identity:
            self.take(self.node.identity, chance.random() < 0.8)
            self.attempt('begin', self.begin)
            return
        place, blend = chance.choice(PLACES), chance.choice((0, 5))
        calls = {
            f'move to {place}': lambda: script.move_l(to_mm=place, blend_mm=blend),
            'dwell': lambda: script.dwell(0.01),
            'output': lambda: script.output('gripper', chance.random() < 0.5, payload_kg=0.2),
            'output of nothing': lambda: script.output('nothing', True),
            'wait for a while': lambda: script.wait_time(0.02),
            'wait': script.wait,
            'hold': script.hold,
            'resume': script.resume,
            'override': lambda: script.override(chance.choice((50, 150, 100, 999))),
            'payload': lambda: script.payload(chance.choice((0.1, 0.5, -1.0))),
            'state': script.state,
            'position': script.position,
            'give up': self.give_up,
        }
        what = chance.choice([*calls, *(name for name in calls if name[:4] in ('move', 'wait'))])
        self.attempt(what, calls[what])

    def give_up(self):
        """End the script as one that dies does."""
        script, self.script = self.script, None
        script.abort()
        return self.node.ask(END)[0]

    def ask(self):
        """Ask as a client that keeps to nothing."""
        chance = self.chance
        action = chance.choice((ATTACH, POLL, WAIT, HOLD, END, 'explode'))
        cycle = self.controller.gate.cycle + chance.randrange(-5, 50)
        texts = {WAIT: WaitCondition(0, max(cycle, 0)).to_json(), HOLD: str(cycle)}
        whose = chance.choice((self.node.identity, STRANGER))
        text = chance.choice((texts.get(action, ''), '', 'nonsense'))
        self.attempt(
            f'{whose[:4]} asks to {getattr(action, "name", action)} {text}',
            lambda: self.node.ask(action, text, whose)[0],
        )
        if action == END and whose == self.node.identity:
            self.script = None

    def operate(self):
        """Ask as an operator does."""
        chance, controller = self.chance, self.controller
        acts = {
            'hold': controller.scripts.hold,
            'abort': controller.scripts.abort,
            'emergency stop': controller.state.emergency_stop,
            'disable': controller.enabling.disable,
            'reset': lambda: self.answer(controller.enabling.reset),
            'enable': lambda: self.answer(controller.enabling.enable),
            'take control': lambda: self.take(STRANGER, chance.random() < 0.5),
            'take control back': lambda: self.take(self.node.identity, chance.random() < 0.8),
            'release control': lambda: controller.control.release(STRANGER),
        }
        what = chance.choice(list(acts))
        self.attempt(what, acts[what])

    def handle(self):
        """Let something happen: time passes, or an answer is lost."""
        if self.chance.random() < 0.3:
            self.node.bus.lose_answer = self.controller.cycles.answered + 1
            self.told.append('an answer is lost')
        cycles = self.chance.randrange(200)
        self.node.goes_on(cycles)
        self.told.append(f'{cycles} cycles: {self.controller.state.motion}')

    def take(self, identity, by_force):
        return self.controller.control.take(Operator(identity, identity[:4]), by_force, self.now_s)

    def answer(self, request):
        """Return the reply to a request, immediate or later."""
        answers = []
        outcome = request(lambda reason, sentence: answers.append(reason or sentence))
        if outcome is not None:
            return outcome
        for _ in range(100):
            if answers:
                return answers[0]
            if (
                self.controller.gate.closed
            ):  # a bus without a clock waits for the script, and the answer with it
                self.attempt('the script goes on', lambda: self.script.wait_time(0.02))
            self.node.goes_on(20)
            self.now_s += 0.1
            self.controller.poll(self.now_s)
        raise AssertionError('nobody has answered')

    def check(self):
        """The robot is where it may be, and nothing that was commanded has jumped."""
        commands = np.array(self.node.bus.commands)
        assert np.isfinite(commands).all()
        most = self.parameters.motor.max_speed_rad_s * self.parameters.bus.cycle_time_s
        assert np.abs(np.diff(commands, axis=0)).max() <= most
        tcp = self.controller.task.answer['tcp_actual']
        assert abs(tcp[0]) < 0.1
        assert -0.8 < tcp[2] < -0.7

    def lead_out(self):
        """Follow the documentation: take control, abort, reset, enable; then a script starts and moves."""
        assert self.take(self.node.identity, True) is None
        if self.controller.state.motion in (MotionState.MOVING, MotionState.STOPPING, MotionState.STOPPED):
            self.attempt('abort', self.controller.scripts.abort)
        self.node.goes_on(1500)
        with suppress(Delta3Error):
            self.node.ask(END)
        self.node.goes_on(300)
        if self.controller.state.fault:
            assert not isinstance(self.answer(self.controller.enabling.reset), Reason)
        assert not isinstance(self.answer(self.controller.enabling.enable), Reason)
        self.node.goes_on(300)
        self.begin()
        x, y, z = self.script.position()
        self.script.move_l(to_m=[x, y, z - 0.01])
        self.script.finish()
        assert np.abs(self.controller.task.answer['tcp_actual'] - [x, y, z - 0.01]).max() < 2e-4


def test_after_any_sequence_a_script_begins_and_moves_by_the_documented_requests(robot):
    driven = 0
    for seed in range(SEQUENCES):
        sequence = Sequence(robot, seed)
        try:
            for _ in range(LENGTH):
                sequence.step()
            sequence.check()
            sequence.lead_out()
            sequence.check()
        except BaseException:
            print(f'seed {seed}:\n' + '\n'.join(sequence.told[-25:]))
            raise
        driven += sequence.driven
    assert driven > SEQUENCES  # many of them did move the robot

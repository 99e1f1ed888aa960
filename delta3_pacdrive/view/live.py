"""A robot that is up, on the page: what it tells is drawn, what people ask for on the page is asked of it.

The view is an operator like ``delta3 move``, in a process of its own. It reads what the robot tells anyway: joint
states (100 Hz), reports and states; and one cyclic topic, the following error, of which only the newest message is
looked at when a picture is due. Nothing of it wakes this process a thousand times a second.
"""

import json
import signal
import time
from contextlib import suppress
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

from delta3_pacdrive import interrupts, kinematics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.controller.messages import EXTEND, FAULT, ORDER, REVOKE, Origin
from delta3_pacdrive.errors import Delta3Error, ProgramError, RunError, RunInterruptedError, TelegramError
from delta3_pacdrive.motion import program_file
from delta3_pacdrive.motion.plan import Move
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import cdr, discovery, interfaces, node_process
from delta3_pacdrive.ros.numbers import row_of
from delta3_pacdrive.ros.parameters import shows
from delta3_pacdrive.ros.qos import NEWEST
from delta3_pacdrive.ros.robot_client import OperatorNode
from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.view.jog import (
    DIRECTIONS,
    JOG_ACCELERATION_M_S2,
    JOG_JERK_M_S3,
    Button,
    Turn,
    edge,
)
from delta3_pacdrive.view.page import PICTURES_HZ, Page
from delta3_pacdrive.view.values import DriveFacts, Facts, Instant, Wish

PICTURE_S = 1.0 / PICTURES_HZ
UNSEEN_S = 0.1  # between two looks at the robot while nobody watches: only the plots go on
FACTS_S = 0.2
SILENT_S = 2.0  # without a report, after which no robot is there
APPEAR_S = 10.0  # for a robot to be found, unless one is being brought up
GONE_S = 2.0  # without a browser, after which what the page has set off is held: a page may be loaded anew meanwhile
RELEASE_S = 0.5  # standing, after which the page gives control back
PLAN_ROWS_MAX, PLAN_POINTS_MAX = 400, 4000  # of a plan that are drawn
MOVE_POINTS = 24
TELL_PARAMETERS = {
    'plant': 'plant',
    'mc4_drive_1': 'mc4_drive',
    'transformation_task': 'transformation_task',
}  # kinds
# stops are free for all and wait for nothing that is under way
URGENT = ('hold', 'abort', 'emergency_stop', 'disable')
NAME = 'delta3 view'
OVERLOAD = 'overload_s'


class Robot:
    """What is known of a robot, from its topics.

    Attributes
    ----------
    parameters
        Of the robot, as far as they are known.
    planned
        Points of the path that was planned last [m], shape (n, 3), and how often that changed.

    """

    def __init__(self, operator: OperatorNode, parameters: Parameters) -> None:
        self.operator = operator
        self.parameters = parameters
        self.planned: tuple[Floats, int] = np.empty((0, 3)), 0
        self._joints = interfaces.JOINT_STATES.polled_subscription(operator, profile=NEWEST)
        self._lags = interfaces.FOLLOWING_ERROR.polled_subscription(operator, profile=NEWEST)
        self._joint_codec = cdr.codec(telegrams.JOINT_STATES)
        self._lag_codec = cdr.codec(telegrams.FOLLOWING_ERROR)
        self._lag = np.zeros(3)
        self._overload = np.zeros(3)
        self._drives = [DriveFacts()] * len(DRIVES)
        self._prefix = operator.get_namespace().rstrip('/') + '/mc4_drive_'
        interfaces.DIAGNOSTICS.subscription(operator, self._on_diagnostics)
        # whoever only looks must not hold the planner up: what is lost of a plan is not drawn
        seen = QoSProfile(depth=PLAN_ROWS_MAX, reliability=ReliabilityPolicy.BEST_EFFORT)
        operator.create_subscription(
            Float64MultiArray, interfaces.MOTION_PLAN.name, self._on_plan, seen, raw=True
        )
        self._rows: list[Floats] = []
        self._order = ('', -1)
        # all parameters of the robot, each of a node that shows it
        self._questions = {
            node: operator.create_client(GetParameters, f'{node}/get_parameters') for node in TELL_PARAMETERS
        }
        self._answers: dict[str, tuple[list[str], Any]] = {}  # by node: names, and what is to come
        self._asked_in = ''  # session

    @property
    def here(self) -> bool:
        """Whether the robot has said something lately."""
        return bool(self.operator.progress) and time.monotonic() - self.operator.progress_s < SILENT_S

    def instant(self) -> Instant | None:
        """Return the newest joint states, None if there are no new ones."""
        found = None
        while (taken := self._lags()) is not None:
            with suppress(TelegramError):
                self._lag = np.array(self._lag_codec.decode(taken[0])[3])
        while (taken := self._joints()) is not None:
            with suppress(TelegramError):  # joints of somebody else: the topic belongs to everybody
                found = self._joint_codec.decode(taken[0])
        if found is None:
            return None
        sec, nanosec, _, values = found
        theta, speed, torque = np.array(values).reshape(3, -1)[:, :3]  # behind them come the passive joints
        return Instant(
            sec + nanosec / NANOSECONDS, theta, self._lag, torque,
            torque / self.parameters.motor.torque_constant_n_m_a, self._overload, self._tcp_speed(theta, speed),
        )  # fmt: skip

    def _tcp_speed(self, theta: Floats, speed: Floats) -> float:
        tcp = kinematics.forward(theta, self.parameters, unreachable='nan')
        if not np.isfinite(tcp).all():
            return 0.0
        return float(np.linalg.norm(kinematics.jacobian(theta, tcp, self.parameters) @ speed))

    def facts(self) -> Facts:
        """Return what there is to read."""
        p, queue = self.operator.progress, self.operator.queue
        if not self.here:
            where = self.operator.get_namespace()
            return Facts(waiting=f'no word of a robot in namespace {where}')
        return Facts(
            state=p['state'],
            enabled=p['enabled'],
            in_torque=p['in_torque'],
            phase=p['phase'],
            cycle=int(p['cycles']),
            bus_time_s=p['bus_time_s'],
            override=queue.override if queue else p['rate'],
            overruns=int(p['overruns']),
            lost_telegrams=int(p['lost_telegrams']),
            waiting=p['waiting'],
            fault=p['fault'],
            sources=tuple(filter(None, p['fault_source'].split(', '))),
            drives=tuple(self._drives),
            move=int(p['move']),
            moves=int(p['moves']),
            remaining_s=p['remaining_s'],
            queue=queue.moves if queue else 0,
            working=queue.working if queue else '',
            operator=p['operator'],
            payload_kg=p['payload_kg'],
            outputs=int(p['outputs']),
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            number = status.name.removeprefix(self._prefix)
            if number == status.name or number not in ('1', '2', '3'):
                continue
            facts = {item.key: item.value for item in status.values}
            with suppress(ValueError, TypeError):
                warnings = tuple(str(text) for text in json.loads(facts.get('warnings', '[]')))
                index = int(number) - 1
                self._drives[index] = DriveFacts(facts.get('state', ''), facts.get('brake', ''), warnings)
                self._overload[index] = (
                    float(facts.get(OVERLOAD, 0.0)) / self.parameters.drive.overload_time_s
                )

    def _on_plan(self, data: bytes) -> None:
        with suppress(Delta3Error, RuntimeError, ValueError, UnicodeDecodeError):  # a foreign writer
            label, row = row_of(deserialize_message(data, Float64MultiArray))
            origin = Origin.from_label(label)
            order = origin.planner, origin.number
            if order != self._order:
                self._order, self._rows = order, []
            if origin.kind in (FAULT, REVOKE):
                return
            if origin.kind in (ORDER, EXTEND):
                points = np.concatenate(self._rows) if self._rows else np.empty((0, 3))
                self.planned = points[:PLAN_POINTS_MAX], self.planned[1] + 1
            elif len(self._rows) < PLAN_ROWS_MAX:
                move, _, _ = Move.from_array(row, self.parameters.kinematics)
                count = MOVE_POINTS if len(move.segments) < MOVE_POINTS else 2 * len(move.segments)
                distances = np.linspace(move.master[0, 1], move.length_m, count)
                self._rows.append(move.sample(distances)[:, 0])

    def learn(self) -> bool:
        """Ask for the parameters of the robot once in each session; whether others than before are known now."""
        session = str(self.operator.progress.get('session', '')) if self.here else ''
        ready = all(question.service_is_ready() for question in self._questions.values())
        if session and session != self._asked_in and ready:
            self._asked_in = session
            self._ask_for_parameters()
        if not self._answers or not all(answer.done() for _, answer in self._answers.values()):
            return False
        answers, self._answers = self._answers, {}
        plain: dict[str, Any] = {}
        for names, answer in answers.values():
            response = answer.result()
            for name, told in zip(names, response.values if response else (), strict=False):
                value = parameter_value_to_python(told)
                if value is not None:
                    plain[name] = value if isinstance(value, (bool, int, float, str)) else list(value)
        try:
            found = core.from_flat(plain)
        except Delta3Error:
            return False  # a robot of another version
        before, self.parameters = self.parameters, found
        return found.checksum != before.checksum

    def _ask_for_parameters(self) -> None:
        left = list(core.flatten(self.parameters))
        for node, question in self._questions.items():
            names = [name for name in left if shows(TELL_PARAMETERS[node], name)]
            left = [name for name in left if name not in names]
            self._answers[node] = names, question.call_async(GetParameters.Request(names=names))


class View:
    """The view draws a robot on a page, and carries out what is asked for there, until it is stopped.

    Parameters
    ----------
    page
        Shows it.
    robot
        What is known of it.
    process
        Spins the node.

    """

    def __init__(self, page: Page, robot: Robot, process: node_process.Process) -> None:
        self._page, self._robot, self._process = page, robot, process
        self._operator = robot.operator
        self._operator.show = page.tell
        self._button = Button()
        self._jog_speed = 0.05
        self._planned = self._session = ''
        self._drawn_s = self._read_s = 0.0
        self._moving_s = self._watched_s = time.monotonic()
        self._urgent = False
        self._wishes: list[Wish] = []
        self._stopping = False

    def stop(self) -> None:
        """Let ``run`` end."""
        self._stopping = True

    def run(self, patience_s: float) -> None:
        """Draw until it is stopped; what the page has set off is held then. Raises RunError if no robot is found."""
        try:
            self._go_on(time.monotonic() + patience_s)
        except RunInterruptedError:
            self._stopping = False
            self._end()

    def _go_on(self, deadline: float) -> None:
        found = False
        while True:
            self.spin_for(PICTURE_S)
            found = found or self._robot.here
            if not found and time.monotonic() > deadline:
                raise RunError(f'no robot is up in namespace {self._operator.get_namespace()} (delta3 up)')
            if self._wishes:
                self._carry_out(self._wishes.pop(0))
            self._give_back()

    def _end(self) -> None:
        """Hold what the page has set off, and give control back."""
        with suppress(Delta3Error):
            if self._operator.in_control and self._operator.state == 'moving':
                self._operator.call('hold')
            self._operator.release_control()

    def spin_for(self, seconds: float) -> None:
        """Spin, draw when a picture is due, and stop the robot when that is asked for, whoever waits for what."""
        end = time.monotonic() + seconds
        period_s = PICTURE_S if self._page.watched else UNSEEN_S
        while True:
            now = time.monotonic()
            self._process.spin_for(max(0.0, min(end, self._drawn_s + period_s) - now))
            now = time.monotonic()
            if now >= self._drawn_s + period_s:
                self._drawn_s = now
                self._draw(now)
            self._sort()
            if self._stopping and not self._urgent:
                raise RunInterruptedError(interrupts.sentence(interrupts.asked() or signal.SIGINT))
            if now >= end:
                return

    def _draw(self, now: float) -> None:
        robot, page = self._robot, self._page
        if robot.learn():
            page.use(robot.parameters)
            page.plan(robot.planned[0])
        session = str(self._operator.progress.get('session', ''))
        if session != self._session:
            self._session = session
            page.forget()
        instant = robot.instant()
        if instant is not None:
            page.show(instant)
        if now - self._read_s >= FACTS_S:
            self._read_s = now
            page.read(robot.facts())
            points, number = robot.planned
            if str(number) != self._planned:
                self._planned = str(number)
                page.plan(points)
        if page.watched:
            self._watched_s = now

    # wishes -----------------------------------------------------------------------------------------------------------

    def _sort(self) -> None:
        """Take wishes from the page: beats of a button count at once, stops overtake all others."""
        now = time.monotonic()
        while self._page.wishes:
            wish = self._page.wishes.popleft()
            if wish.action == 'press':
                direction, speed = wish.text.split()
                self._jog_speed = 1e-3 * float(speed)
                self._button.beat(direction, now)
            elif wish.action in URGENT:
                self._wishes.clear()
                self._button.drop()
                self._stop(wish)
            else:
                self._wishes.append(wish)
        turn = self._button.look(now)
        if turn is Turn.PRESSED:
            self._wishes.append(Wish('jog', self._button.direction))
        elif turn is Turn.RELEASED:
            self._stop(Wish('abort'), quiet=True)

    def _stop(self, wish: Wish, quiet: bool = False) -> None:
        """Stop the robot, in the middle of whatever else is being waited for."""
        before, self._urgent = self._urgent, True
        try:
            operator = self._operator
            self._page.tell(
                operator.enable(False) if wish.action == 'disable' else operator.call(wish.action)
            )
        except (RunError, ProgramError) as error:
            if not quiet:
                self._page.tell(str(error), refused=True)
        finally:
            self._urgent = before

    def _carry_out(self, wish: Wish) -> None:
        try:
            sentence = self._done(wish)
        except RunInterruptedError:
            raise
        except Delta3Error as error:
            self._button.drop()
            self._page.tell(str(error), refused=True)
            return
        if sentence:
            self._page.tell(sentence)

    def _done(self, wish: Wish) -> str:
        """Carry a wish out; return the answer."""
        operator, text = self._operator, wish.text
        if wish.action == 'inject':
            return operator.inject(text)
        if wish.action == 'teach':
            return self._teach(text)
        if not operator.in_control:
            operator.take_control(NAME, wish.by_force)
        self._moving_s = time.monotonic()
        if wish.action == 'packaged':
            return operator.send_program(program_file.find(text).read_text(encoding='utf-8'))
        if wish.action == 'program':
            return operator.send_program(text)
        if wish.action == 'override':
            return operator.override(float(text))
        if wish.action == 'enable':
            return operator.enable(True)
        if wish.action == 'step':
            direction, step, speed = text.split()
            way = 1e-3 * float(step) * np.array(DIRECTIONS[direction])
            self._send_line({'by_m': way.tolist()}, 1e-3 * float(speed))
            return operator.call('start')
        if wish.action == 'jog':
            return self._jog(text)
        return operator.call(wish.action)

    def _send_line(self, to: Any, speed_m_s: float) -> None:
        """Send a slow straight line that ends softly wherever it is stopped."""
        queue = self._operator.queue
        if queue is not None and queue.moves:
            raise ProgramError(f'there are {queue.moves} moves in the queue: clear it before you jog')
        limits = {
            'speed_m_s': speed_m_s,
            'acceleration_m_s2': JOG_ACCELERATION_M_S2,
            'jerk_m_s3': JOG_JERK_M_S3,
        }
        self._operator.send_program(json.dumps({'moves': [{'move_l': {'to_m': to, **limits}}]}))

    def _jog(self, direction: str) -> str:
        """Set off for the edge of the workspace; whoever lets the button go stops that on the way."""
        if self._button.direction != direction:
            return ''
        to = edge(self._place(), direction, self._robot.parameters.kinematics)
        self._send_line(to.tolist(), self._jog_speed)
        if self._button.direction != direction:
            return self._operator.call('clear')
        sentence = self._operator.call('start')
        if self._button.direction != direction:
            self._operator.call('abort')
        return sentence

    def _place(self) -> Floats:
        """Return where the robot stands [m]; raises RunError if it is not there."""
        if not self._robot.here:
            raise RunError('there is no robot')
        return np.array(self._operator.progress['tcp_m'], dtype=np.float64)

    def _teach(self, name: str) -> str:
        if not name.strip() or not name.isprintable():
            raise ProgramError('a point needs a name')
        x, y, z = self._place().tolist()
        if self._page.controls is not None:
            self._page.controls.teach(name.strip(), (x, y, z))
        return f'{name.strip()} is at ({1e3 * x:.3f}, {1e3 * y:.3f}, {1e3 * z:.3f}) mm'

    def _give_back(self) -> None:
        """Hold the robot when nobody looks any more, and give control back once it stands."""
        now = time.monotonic()
        if not self._operator.in_control:
            return
        if self._operator.state in ('moving', 'stopping'):
            self._moving_s = now
            if self._operator.state == 'moving' and now - self._watched_s > GONE_S:
                self._stop(Wish('hold'))
        elif not self._wishes and now - self._moving_s > RELEASE_S:
            try:
                self._operator.release_control()
            except Delta3Error:
                self._operator.in_control = False


def run(page: Page, parameters: Parameters, namespace: str, patience_s: float = APPEAR_S) -> None:
    """Show a robot that is up until a signal asks for the end; what the page has set off is held then.

    Parameters
    ----------
    page
        Shows it.
    parameters
        Of the robot, until it tells its own.
    namespace
        Of the robot.
    patience_s
        For a robot to be found [s].

    Raises
    ------
    RunError
        No robot is found.

    """
    discovery.keep_to_this_machine()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    process = node_process.Process()
    operator = OperatorNode(process.spin_for, namespace='/' + namespace.strip('/'))
    process.add(operator)
    view = View(page, Robot(operator, parameters), process)
    operator.spin_for = view.spin_for
    try:
        with interrupts.answered_by(view.stop):
            view.run(patience_s)
    finally:
        process.close()
        rclpy.try_shutdown()

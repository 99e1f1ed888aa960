"""The table of interfaces: every topic and service of a robot.

Publishers, subscriptions, recorder, the check for a second writer and the documentation are derived from it. Names are
relative; ``axisN`` represents one topic per axis of the robot.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import PointStamped, PoseArray, PoseStamped, TwistStamped
from nav_msgs.msg import Path
from rclpy.client import Client
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.service import Service as Server
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, Header, String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from delta3_pacdrive.errors import Code, Delta3Error, Reason, TelegramError, shown
from delta3_pacdrive.recording.motion_progress import NO_REPORT
from delta3_pacdrive.recording.telegram_signals import TELEGRAM_SIGNALS
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES, ROTARY_DRIVES
from delta3_pacdrive.robot.sercos.telegrams import AT_FRAME, BASE_FRAME, CURRENT_FRAME, MDT_FRAME, Telegram
from delta3_pacdrive.ros.deferred_service import Respond, create_deferred_service
from delta3_pacdrive.ros.wire import cdr, discovery, qos
from delta3_pacdrive.ros.wire.polling import PollingNode, Taken

TASK, PLANNER, DRIVE, PLANT = 'transformation_task', 'unit_robot', 'mc4_drive', 'plant'
RECORDER, VISUALIZATION, OPERATOR = 'recorder', 'robot_visualization', 'operator'
SCRIPT = 'script'
EVERY_AXIS = 'axisN'
TEXT_BYTES_MAX = 64 * 1024  # default size limit of a message
PROGRAM_BYTES_MAX = 1024 * 1024
TRAJECTORY_BYTES_MAX = 4 * PROGRAM_BYTES_MAX  # 30,000 points with speeds and accelerations
REQUEST_BYTES_MAX = 2 * PROGRAM_BYTES_MAX  # of a request to the planner, with escaped characters
# of a request to the transformation task, which must not delay its bus cycles
TASK_REQUEST_BYTES_MAX = 4096
ROW_BYTES_MAX = 16 * 1024 * 1024  # of a row of a plan


@dataclass(frozen=True)
class Delivery:
    """Quality of service of a topic, with its reason."""

    name: str
    publisher: QoSProfile  # offered by the writer
    subscription: QoSProfile  # requested by readers within the robot
    reason: str

    @property
    def robot(self) -> QoSProfile:
        """Profile of readers within the robot, on one host or several."""
        return qos.CYCLIC_FROM_AFAR if self is CYCLIC and discovery.exposure() else self.subscription

    @property
    def recorder(self) -> QoSProfile:
        """Profile of the recorder."""
        if self is PLAN:
            return qos.PLAN_LATECOMER
        if self in (LATCHED, LATCHED_FROM_MANY, FACTS):
            return qos.LATCHED_RECORDER
        return qos.RECORDER if self in (CYCLIC, CYCLIC_NEWEST, REPORT) else self.subscription

    @property
    def view(self) -> QoSProfile:
        """Profile of viewers, which may skip messages."""
        return qos.PLAN_SHOWN if self is PLAN else self.subscription


CYCLIC = Delivery(
    'cyclic',
    qos.CYCLIC_PUBLISHER,
    qos.CYCLIC_SUBSCRIPTION,
    'Any client may request reliable delivery, and lag by as many cycles as the queue is deep. The robot itself uses '
    'best effort: on one host the flow control of the bus (at most 16 outstanding cycles) keeps queues from '
    "overflowing, so acknowledgements would cost a third of the bus's processor time without benefit. A lost telegram "
    'is detected by its stamp, as on a real SERCOS bus, where cyclic telegrams are never repeated either. '
    'Across several hosts the robot uses reliable delivery, and telegrams lost by the network are repeated.',
)
CYCLIC_NEWEST = Delivery(
    'cyclic, newest', qos.CYCLIC_PUBLISHER, qos.NEWEST, 'The robot itself needs only the newest message.'
)
LATCHED = Delivery('latched', qos.LATCHED, qos.LATCHED, 'States and facts, also for late subscribers.')
LATCHED_FROM_MANY = Delivery(
    'latched, many writers', qos.LATCHED, qos.LATCHED_FROM_MANY,
    'The newest message of every participant, also for late subscribers.',
)  # fmt: skip
PLAN = Delivery(
    'plan', qos.PLAN_WRITER, qos.PLAN,
    'The moves of a program are published in one burst and none may be lost. Recorders and views that join later get '
    'the newest rows; the transformation task does not request them, because it must not mistake an old plan for a new '
    'one.',
)  # fmt: skip
CHANGE_OF_PLAN = Delivery(
    'change', qos.PLAN, qos.PLAN,
    'No change of a motion profile may be lost; a late subscriber must not mistake an old one for a new one.',
)  # fmt: skip
REQUEST = Delivery(
    'request', qos.REQUEST, qos.REQUEST,
    'Requests of operators in their original order, and the replies.',
)  # fmt: skip
FAULTS = Delivery(
    'faults', qos.FAULTS, qos.FAULTS,
    'No injected fault may be lost, however many a program contains; late subscribers do not need them.',
)  # fmt: skip
FACTS = Delivery(
    'facts',
    qos.FACTS,
    qos.FACTS,
    'Events, message by message, also for slightly late subscribers.',
)
SET_POINT = Delivery(
    'set points', qos.REPORT, qos.NEWEST_FEW, 'Best effort: of set points that wait, only the newest count.'
)
REPORT = Delivery('report', qos.REPORT, qos.REPORT, 'Slow topics for users and tools.')
SAMPLES = Delivery(
    'samples', qos.SAMPLES, qos.SAMPLES,
    'Blocks of an oscilloscope, of which none may be lost. A drive does not wait for readers: one that lags by more '
    'than the queue is deep loses blocks, counts them and rejects its record.',
)  # fmt: skip
DELIVERIES = (
    CYCLIC,
    CYCLIC_NEWEST,
    LATCHED,
    LATCHED_FROM_MANY,
    PLAN,
    CHANGE_OF_PLAN,
    REQUEST,
    FAULTS,
    FACTS,
    SAMPLES,
    REPORT,
)


@dataclass(frozen=True)
class Topic:
    """A row of the table: one topic, or one per axis."""

    name: str
    type: type
    delivery: Delivery
    writers: tuple[str, ...]  # names of nodes
    readers: tuple[str, ...]  # that the robot requires: not recorder or operator
    content: str
    rate: str
    frame: str = ''  # format of ``header.frame_id``
    telegrams: tuple[Telegram, ...] = ()  # fixed layout, per axis
    one_writer: bool = False  # a second writer keeps the bus in CP0
    recorded: bool = False
    answer: str = ''  # published field of ``control.cycle.task_arrays.ANSWER``
    axis: str = ''  # only on robots with this rotary axis
    bytes_max: int = TEXT_BYTES_MAX  # size limit of a message

    def of(self, axis: str = '') -> str:
        """Return the name of the topic, or of that of an axis."""
        return self.name.replace(EVERY_AXIS, axis) if axis else self.name

    def names_of(self, axes: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all topics of this row on a robot with these axes."""
        if EVERY_AXIS in self.name:
            return tuple(self.of(axis) for axis in axes)
        return (self.name,) if self.axis in ('', *axes) else ()

    @property
    def of_exchange(self) -> bool:
        """Whether it is published once per exchange between drives and plant."""
        return self.rate == EXCHANGE

    @property
    def cyclic(self) -> bool:
        """Whether it is published in every bus cycle or exchange."""
        return self.rate in (CYCLE, EXCHANGE) or bool(self.axis)

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals of a trace that it contains."""
        return TELEGRAM_SIGNALS.get(self.telegrams[0], ()) if self.telegrams else ()

    @property
    def type_name(self) -> str:
        """ROS name of the message type."""
        return f'{self.type.__module__.split(".")[0]}/msg/{self.type.__name__}'

    def publisher(self, node: Node, axis: str = '', **options: Any) -> Publisher:
        """Create a publisher."""
        return node.create_publisher(self.type, self.of(axis), self.delivery.publisher, **options)

    def subscription(
        self,
        node: Node,
        callback: Callable[[Any], None],
        axis: str = '',
        raw: bool = False,
        profile: QoSProfile | None = None,
    ) -> Subscription:
        """Create a subscription; with ``raw`` the callback receives bytes."""
        return node.create_subscription(
            self.type, self.of(axis), callback, profile or self.delivery.robot, raw=raw
        )

    def bounded_subscription(
        self,
        node: Node,
        callback: Callable[[Any], None],
        refuse: Callable[[str], None] | None = None,
        profile: QoSProfile | None = None,
    ) -> Subscription:
        """Create a subscription that rejects messages that are too large, invalid, or fail with a Delta3Error.

        The reason goes to ``refuse``, or to the log at most once a second.
        """

        def receive(data: bytes) -> None:
            try:
                if len(data) > self.bytes_max:
                    raise TelegramError(f'a message has {len(data)} bytes, the limit is {self.bytes_max}')
                try:
                    message = deserialize_message(data, self.type)
                except (RuntimeError, ValueError, UnicodeDecodeError) as error:
                    raise TelegramError(
                        f'a message is not a valid {self.type.__name__}: {shown(str(error))}'
                    ) from error
                callback(message)
            except Delta3Error as error:
                if refuse is not None:
                    refuse(str(error))
                else:
                    node.get_logger().warning(f'{self.name}: {error}', throttle_duration_sec=1.0)

        return self.subscription(node, receive, raw=True, profile=profile)

    def polled_subscription(
        self, node: PollingNode, axis: str = '', profile: QoSProfile | None = None
    ) -> Callable[[], Taken | None]:
        """Create a subscription that wakes no executor; the returned function takes the next serialised message."""
        return node.create_polled_subscription(self.type, self.of(axis), profile or self.delivery.robot)


CYCLE, EXCHANGE, CHANGE, ASKED = 'every cycle', 'every exchange', 'on a change', 'on request'
JOINT_MOTION_RATE = 'every cycle, if the parameter `joint_motion` of the node is true'
_BASE = BASE_FRAME.decode()


def _telegram(
    telegram: Telegram,
    content: str,
    readers: tuple[str, ...] = (),
    rate: str = CYCLE,
    recorded: bool = False,
    answer: str = '',
    axis: str = '',
) -> Topic:
    """Return the row of a telegram that the transformation task publishes in every cycle."""
    delivery, kind = CYCLIC_NEWEST if PLANNER in readers else CYCLIC, cdr.TYPES[telegram.type]
    row = Topic(telegram.topic, kind, delivery, (TASK,), readers, content, rate, _BASE, (telegram,))
    return replace(row, recorded=recorded, answer=answer, axis=axis)


# fmt: off
# the bus, and the machine

PHASE = Topic(
    'sercos/phase', Header, LATCHED, (TASK,), (DRIVE, PLANT),
    'communication phase and session; in CP4 the stamp is the bus time at which cyclic operation begins',
    CHANGE, 'CPn hhhh', one_writer=True, recorded=True,
)
PARTICIPANTS = Topic(
    'sercos/participants', DiagnosticStatus, LATCHED_FROM_MANY, (DRIVE, PLANT, PLANNER), (TASK,),
    'identity, session and parameters of each participant', CHANGE, recorded=True,
)
MDT = Topic(
    'sercos/mdt', JointState, CYCLIC, (TASK,), (DRIVE, PLANT),
    'motor shaft commands [rad], on the increment grid; with the parameter control.feed_forward: model as effort the '
    'additive torque command S-0-0081 of each motor [N m]; in the frame the phase, the control word S-0-0134 of each '
    'drive, its word of the service channel, the gripped payload [kg], the outputs (bit n: output n), the session',
    CYCLE, MDT_FRAME, (telegrams.MDT,), one_writer=True, recorded=True,
)
AT = Topic(
    'sercos/at/axisN', JointState, CYCLIC, (DRIVE,), (TASK,),
    'encoder position [rad], on the increment grid, and speed [rad/s] at the start of the cycle; as effort the torque '
    'K_m I_eff [N m] of one sample, the last of the current loop before it; in the frame the status word S-0-0135, the '
    'word of the service channel, the session',
    CYCLE, AT_FRAME, telegrams.AT, one_writer=True, recorded=True,
)
MOTOR_CURRENT = Topic(
    'axisN/motor_current', JointState, CYCLIC, (DRIVE,), (PLANT,),
    'I_eff [A] at the end of each 62.5 us of the exchange period, as efforts (16 for each millisecond); in the frame '
    'the brake output (free, held), the gripped payload [kg], the session',
    EXCHANGE, CURRENT_FRAME, tuple(telegrams.motor_current(axis, 16) for axis in DRIVES),
    one_writer=True, recorded=True,
)
MOTOR_SHAFTS = Topic(
    'plant/motor_shafts', JointState, CYCLIC, (PLANT,), (DRIVE,),
    'true shaft positions [rad], speeds [rad/s], and as efforts the coupling torques d [N m] (4.31)',
    EXCHANGE, 'hhhh', (telegrams.SHAFTS,), one_writer=True, recorded=True,
)
DC_LINK = Topic(
    telegrams.DC_LINK.topic, JointState, CYCLIC, (PLANT,), (DRIVE,),
    'the DC link of all drives at the start of a bus cycle: voltage [V], whether it is precharged, and heat of the '
    'brake resistor relative to its continuous power, as positions; as efforts the mean powers from the mains and in '
    'the resistor in the cycle before [W]',
    'every cycle, if the parameter `supply.enabled` is true', 'hhhh', (telegrams.DC_LINK,), one_writer=True,
    recorded=True,
)
TEMPERATURES = Topic(
    'plant/temperatures', JointState, CYCLIC, (PLANT,), (DRIVE,),
    'temperatures [degC] at the start of a bus cycle: of the windings as positions, of the housings of the motors as '
    'velocities, of the heat sinks of the drives as the first half of the efforts; in the second half the viscous '
    'frictions relative to those of cold gears',
    'every cycle, if the parameter `thermal.in_drives` is true', 'hhhh', (telegrams.temperatures(),), one_writer=True,
    recorded=True,
)
INPUTS = Topic(
    telegrams.INPUTS_TOPIC, JointState, CYCLIC, (PLANT,), (TASK, VISUALIZATION),
    'I/O image: the inputs of a cell by name, sampled at the start of the cycle, 1 is on; outputs in the MDT of a '
    'cycle take effect in the next one',
    'every cycle, if there is a cell with inputs', 'hhhh', one_writer=True, recorded=True,
)
BELTS = Topic(
    telegrams.BELTS_TOPIC, JointState, CYCLIC, (PLANT,), (TASK, VISUALIZATION),
    'belts of a cell by name: as position the encoder count at the start of the cycle, as velocity the number of '
    'pictures taken by the camera; six efforts for each reported part: number of the belt, of the type in the cell '
    'file (-1: latched by the light barrier), count at that instant, position along and across [m], angle [rad]',
    'every cycle, if there is a cell with belts', 'hhhh', one_writer=True, recorded=True,
)
PARTS = Topic(
    'cell/parts', String, FACTS, (PLANT,), (VISUALIZATION,),
    'JSON: cycle, part events of a cell in it with the numbers of the picks and places, misses',
    CHANGE, recorded=True,
)
SCENE = Topic(
    'cell/scene', String, LATCHED, (PLANT,), (VISUALIZATION,),
    'JSON: the cell as level areas: belts with their windows, barriers and cameras, boxes, '
    'supplies, sensors',
    'at the start, if there is a cell', recorded=True,
)
SEEN = Topic(
    'cell/camera', PoseArray, REPORT, (PLANT,), (),
    'parts in a picture of a belt camera, as poses of the centres of their undersides, stamped with the time of the '
    'picture', 'a picture with parts, with subscribers only', _BASE,
)
SET_INPUT = Topic(
    'cell/set_input', KeyValue, REQUEST, (), (PLANT,),
    'force an input of a cell: its name as key, `on`, `off` or `auto` as value; rejected while a bag is played back',
    ASKED, bytes_max=10_000,
)
PHASE_CURRENT = Topic(
    'axisN/phase_current', JointState, REPORT, (DRIVE,), (),
    "phase currents I1s, I2s, I3s [A] at the cycle's start, as efforts", 'every cycle, with subscribers only',
)
SERVICE_REQUEST = Topic(
    'sercos/service/request', String, REQUEST, (OPERATOR, SCRIPT), (TASK,),
    '`axis1 read S-0-0104`, `axis1 write S-0-0104 70`; an optional leading mark (`#3fa9 axis1 read ...`) is repeated '
    'in the reply',
    ASKED,
)
SERVICE_ANSWER = Topic(
    'sercos/service/answer', String, REQUEST, (TASK,), (), 'value with unit, or the message 8503', ASKED
)
FAULT_SCHEDULE = Topic(
    'faults/schedule', String, FAULTS, (TASK,), (TASK, PLANNER, DRIVE, PLANT),
    'JSON: injected faults with session, number, first cycle and end cycle', CHANGE, recorded=True,
    bytes_max=10_000,
)

SCOPE_REQUEST = Topic(
    'scope/request', String, REQUEST, (), (DRIVE,),
    'JSON: identity and name of an oscilloscope, its channels by axis, decimation of the current-loop periods; '
    'must be repeated every second. No control is required',
    ASKED, bytes_max=8192,
)
SCOPE_ANSWER = Topic(
    'scope/answer', String, REQUEST, (DRIVE,), (),
    'JSON: identity of the oscilloscope, axis, whether it is armed, current-loop period, reason of a rejection', ASKED,
)
SCOPE_SAMPLES = Topic(
    'axisN/scope', Float64MultiArray, SAMPLES, (DRIVE,), (),
    'samples of an armed oscilloscope: bus time [s] and number of the first one, then rows of channels. Labels: '
    'identity of the oscilloscope, names of the channels', 'every 8 cycles, while an oscilloscope is armed',
)

# motion
FOLLOWING_ERROR = _telegram(
    telegrams.FOLLOWING_ERROR, 'following error of each arm [rad], dead time removed by linear extrapolation (7.3)',
    recorded=True, answer='following_error',
)
TCP_COMMAND = _telegram(
    telegrams.TCP_COMMAND, 'commanded TCP [m]', (VISUALIZATION,), recorded=True, answer='tcp_command',
)
TCP_ACTUAL = _telegram(
    telegrams.TCP_ACTUAL, 'TCP by forward kinematics of the actual angles [m]', recorded=True, answer='tcp_actual',
)
TCP_ERROR = _telegram(
    telegrams.TCP_ERROR,
    'Cartesian error [m] without the delay of a set point (1.75 cycles, with sercos2 2.75); raw: command - actual',
    (VISUALIZATION,), recorded=True, answer='tcp_error',
)
TURNS = TURN, TURN_2 = tuple(
    _telegram(
        telegram,
        f'angle of the tool on `{axis}` [rad]: commanded, measured by its motor encoder, and the error without the '
        'set-point delay',
        (VISUALIZATION,), rate=f'every cycle, if there is an `{axis}`', recorded=True, axis=axis,
    )
    for telegram, axis in zip(telegrams.TURNS, ROTARY_DRIVES, strict=True)
)
MASTER = _telegram(
    telegrams.MASTER, 'virtual master: distance [m], speed [m/s], number of the move', recorded=True,
)
JOINT_MOTION = _telegram(
    telegrams.JOINT_MOTION,
    'speeds [rad/s] of the arms and, as efforts, their accelerations [rad/s2] through the Jacobian at the commanded '
    'TCP (4.12, 4.16); stamped with the cycle they belong to, published one cycle later',
    rate=JOINT_MOTION_RATE, recorded=True,
)
JACOBIAN = _telegram(
    telegrams.JACOBIAN,
    'condition number of J, speed [m/s] and acceleration [m/s2] of the commanded TCP, with the same stamp',
    rate=JOINT_MOTION_RATE, recorded=True,
)
JOINT_STATES = _telegram(
    telegrams.JOINT_STATES,
    'arm angles [rad], arm speeds [rad/s], arm torques (gear ratio times motor torque) [N m]; then, without '
    'torques, the passive joints of the tree in `robot_description`, and last, with torque, the '
    'tool of each rotary axis (`axis4`, `axis5`)',
    (PLANNER, VISUALIZATION), '100 Hz', recorded=True,
)
OUTPUTS = Topic(
    'outputs', JointState, LATCHED, (TASK,), (VISUALIZATION,),
    'eight digital outputs (`gripper`, `output1` ...) and the payload, as positions, stamped with the cycle of '
    'the change',
    CHANGE, recorded=True,
)
MOTION_STATE = Topic(
    'motion/state', String, LATCHED, (TASK,), (), 'idle, moving, steered, stopping, stopped, error', CHANGE,
    recorded=True,
)
LOCATED = Topic(
    'motion/located', PointStamped, LATCHED, (TASK,), (),
    'TCP position [m], when the robot can take a program', CHANGE, _BASE, recorded=True,
)
PROGRESS = Topic(
    'motion/progress', String, REPORT, (TASK,), (),
    'JSON: state, move, master, remaining time, override, overruns, lateness, fault and its value',
    '5 Hz', recorded=True,
)
PROGRESS_VALUES = Topic(
    'motion/progress/values', JointState, REPORT, (TASK,), (),
    'the numbers of `motion/progress` by name, as positions, stamped with the newest evaluated cycle',
    '5 Hz, from the start of cyclic operation on', _BASE, (telegrams.progress_values(list(NO_REPORT.numbers())),),
    recorded=True,
)
DIAGNOSTICS = Topic(
    '/diagnostics', DiagnosticArray, REPORT, (TASK, DRIVE), (),
    'state of the bus and of every drive, counters, telegram times', '1 Hz',
)

# task and planner
MOTION_PLAN = Topic(
    'motion/plan', Float64MultiArray, PLAN, (PLANNER, SCRIPT), (TASK, VISUALIZATION),
    'one message for each distinct move: header, phases of the master (t, s, v, a, jerk), path segments '
    '(s, coefficients of x, y, z up to the 5th power), events; then one with the order of the moves. Labels of plans '
    'and motion profiles: kind, identity of the planner, session, number of the order',
    ASKED, recorded=True, bytes_max=ROW_BYTES_MAX,
)
MOTION_CHANGE = Topic(
    'motion/change', Float64MultiArray, CHANGE_OF_PLAN, (PLANNER, SCRIPT), (TASK,),
    'motion profile requested by the planner: override, resume', ASKED,
    bytes_max=ROW_BYTES_MAX,
)
PROFILE = Topic(
    'motion/course', Float64MultiArray, LATCHED, (TASK,), (PLANNER,),
    'motion profile of the master with its first cycle: start, stop, resume, override', CHANGE, recorded=True,
    bytes_max=ROW_BYTES_MAX,
)
STATUS = Topic(
    'motion/status', String, LATCHED, (TASK,), (PLANNER, PLANT, VISUALIZATION),
    'JSON: session, state, position, reason why no program can start, operator in control', CHANGE, recorded=True,
)
VERDICT = Topic(
    'motion/verdict', String, REQUEST, (TASK,), (PLANNER,), 'JSON: result of an order or a change', ASKED,
    recorded=True,
)
REFUSAL = Topic(
    'motion/refusal', String, REQUEST, (TASK,), (), 'why a plan or a change is rejected', ASKED
)
PLANNER_ALIVE = Topic(
    'unit_robot/alive', Header, REPORT, (PLANNER,), (TASK,),
    'heartbeat: identity of the planner, the session it knows and the identifier (GID) of its publisher in the '
    'frame, a number in `stamp.sec`', '5 Hz',
)

# operators
PLANNER_STATE = Topic(
    'unit_robot/state', String, LATCHED, (PLANNER,), (), 'idle, moving, steered, stopping, stopped, error', CHANGE
)
ANSWER = Topic(
    'unit_robot/answer', String, LATCHED, (PLANNER,), (),
    'one sentence for each request: `accepted: ...`, `refused: ...`', ASKED, recorded=True,
)
QUEUE = Topic(
    'unit_robot/queue', String, LATCHED, (PLANNER,), (),
    'JSON: moves in the queue, their duration, the override, planning progress, reason of the newest rejection '
    'as a sentence and a code', CHANGE, recorded=True,
)
QUEUE_VALUES = Topic(
    'unit_robot/queue/values', DiagnosticArray, LATCHED, (PLANNER,), (),
    'keys and values of `unit_robot/queue`, stamped with bus time; level WARN after a rejection',
    'on a change, from the start of cyclic operation on', recorded=True,
)
REQUESTS = Topic(
    'unit_robot/requests', String, REQUEST, (PLANNER,), (),
    'JSON: id of a move request, its state (planning, queued, running, done, refused, aborted), its statements, '
    'the number of remaining ones; code and sentence of a rejection', CHANGE, recorded=True,
)
REQUESTS_VALUES = Topic(
    'unit_robot/requests/values', DiagnosticArray, REQUEST, (PLANNER,), (),
    'keys and values of `unit_robot/requests`, stamped with bus time; the message is the state, the level WARN if the '
    'request is refused or aborted', CHANGE, recorded=True,
)
MOVE_L = Topic(
    'unit_robot/move_l', PointStamped, REQUEST, (), (PLANNER,), 'straight move to a point [m]', ASKED, _BASE,
    bytes_max=PROGRAM_BYTES_MAX,
)
MOVE_C = Topic(
    'unit_robot/move_c', Path, REQUEST, (), (PLANNER,), 'circular move: circle point and end [m]', ASKED, _BASE,
    bytes_max=PROGRAM_BYTES_MAX,
)
MOVE_SB = Topic(
    'unit_robot/move_sb', Path, REQUEST, (), (PLANNER,), 'spline through at most 100 points [m]', ASKED, _BASE,
    bytes_max=PROGRAM_BYTES_MAX,
)
PROGRAM = Topic(
    'unit_robot/program', String, REQUEST, (), (PLANNER,), 'YAML, or the name of a packaged program', ASKED,
    bytes_max=PROGRAM_BYTES_MAX,
)
JOINT_TRAJECTORY = Topic(
    'joint_trajectory', JointTrajectory, REQUEST, (), (PLANNER,),
    'arm angles [rad] over time, executed immediately; as for joint_trajectory_controller', ASKED,
    bytes_max=TRAJECTORY_BYTES_MAX,
)
OVERRIDE = Topic(
    'unit_robot/override', Float64, REQUEST, (), (PLANNER,), 'percent of the speed', ASKED,
    bytes_max=PROGRAM_BYTES_MAX,
)
SERVO_TWIST = Topic(
    'servo/twist', TwistStamped, SET_POINT, (), (TASK,),
    'velocity of the TCP [m/s] of a steered robot, in the frame `base` or of a belt', '20 to 500 Hz',
    recorded=True,
)
SERVO_POSE = Topic(
    'servo/pose', PoseStamped, SET_POINT, (), (TASK,), 'position of the TCP [m] of a steered robot', '20 to 500 Hz',
    _BASE, recorded=True,
)
SERVO_STATE = Topic(
    'servo/state', DiagnosticStatus, LATCHED, (TASK,), (),
    'whether set points move the robot, whether a limit slows it down, accepted and rejected set points, newest '
    'rejection', CHANGE, recorded=True,
)
PLANNER_REQUEST = Topic(
    'unit_robot/request', String, REQUEST, (OPERATOR, SCRIPT), (PLANNER,),
    'JSON: request of an identified operator: program, move, trajectory, start, resume, clear, override, '
    'withdraw', ASKED, bytes_max=REQUEST_BYTES_MAX,
)
PLANNER_REPLY = Topic('unit_robot/reply', String, REQUEST, (PLANNER,), (), 'JSON: the reply', ASKED)
SCRIPT_REQUEST = Topic(
    'script/request', String, REQUEST, (SCRIPT,), (TASK,),
    'JSON: request of a script in control: attach, look, wait for a condition, hold, leave', ASKED,
    bytes_max=TASK_REQUEST_BYTES_MAX,
)
SCRIPT_REPLY = Topic(
    'script/reply', String, REQUEST, (TASK,), (), 'JSON: the reply: state in a bus cycle', ASKED
)
CONTROL_REQUEST = Topic(
    'control/request', String, REQUEST, (OPERATOR, SCRIPT), (TASK,),
    'JSON: take control, take control over, release control, enable, disable, reset, hold, abort, emergency stop',
    ASKED, bytes_max=TASK_REQUEST_BYTES_MAX,
)
CONTROL_REPLY = Topic('control/reply', String, REQUEST, (TASK,), (), 'JSON: the reply', ASKED)
CONTROL_ALIVE = Topic(
    'control/alive', Header, REPORT, (OPERATOR, SCRIPT), (TASK,),
    'heartbeat of the operator in control: its identity in the frame, a number in `stamp.sec`', '5 Hz',
)
CONTROL_OPERATOR = Topic(
    'control/operator', String, LATCHED, (TASK,), (), 'name of the operator in control, empty without one', CHANGE,
    recorded=True
)

# tools
ROBOT_DESCRIPTION = Topic(
    'robot_description', String, LATCHED, (PLANNER,), (), 'the robot as URDF, from its parameters', 'at the start',
    recorded=True,
)
MARKERS = Topic(
    'markers', MarkerArray, REPORT, (VISUALIZATION,), (),
    'the robot, its workspace, planned and travelled path, commanded TCP, magnified error',
    '20 Hz, with subscribers only', _BASE,
)
CLOCK = Topic(
    '/clock', Clock, REPORT, (VISUALIZATION,), (), 'bus time, for tools with `use_sim_time`',
    '100 Hz, with subscribers and without another publisher',
)
RECORDER_STATE = Topic(
    'recorder/state', String, LATCHED, (RECORDER,), (),
    '`recording`, or `stopped: ` and the reason', CHANGE,
)
# fmt: on

TOPICS = tuple(item for item in list(vars().values()) if isinstance(item, Topic))
RECORDED = tuple(topic for topic in TOPICS if topic.recorded)
ANSWER_TOPICS = tuple(topic for topic in TOPICS if topic.answer)
ONE_WRITER = tuple(name for topic in TOPICS if topic.one_writer for name in topic.names_of(ALL_DRIVES))


@dataclass(frozen=True)
class Service:
    """A row of the table: one service; with ``needs_control`` it is rejected while another client has control."""

    name: str
    type: type
    node: str
    content: str
    needs_control: bool = False

    @property
    def type_name(self) -> str:
        """ROS name of the service type."""
        return f'{self.type.__module__.split(".")[0]}/srv/{self.type.__name__}'

    @property
    def former_name(self) -> str:
        """Deprecated name below the name of the node, empty if the service has none."""
        return '' if '/' in self.name else f'{self.node}/{self.name}'

    def servers(self, node: Node, serve: Callable[[Any, Any], Any]) -> list[Server]:
        """Create the servers, one for each name."""
        return [node.create_service(self.type, *named) for named in self._callbacks(node, serve)]

    def deferred_servers(self, node: Node, ask: Callable[[Any, Respond], None]) -> list[Server]:
        """Create servers that reply when the requested action has finished."""
        return [create_deferred_service(node, self.type, *named) for named in self._callbacks(node, ask)]

    def _callbacks(
        self, node: Node, serve: Callable[[Any, Any], Any]
    ) -> list[tuple[str, Callable[[Any, Any], Any]]]:
        """Return names and callbacks at a node that may have been renamed; the deprecated name warns once."""
        name, former = (
            text.replace(f'{self.node}/', f'{node.get_name()}/') for text in (self.name, self.former_name)
        )
        warned = False

        def serve_former(request: Any, response: Any) -> Any:
            nonlocal warned
            if not warned:
                warned = True
                node.get_logger().warning(
                    f'service {former} is deprecated and will be removed in the next release; use {name}'
                )
            return serve(request, response)

        return [(name, serve), *([(former, serve_former)] if former else [])]

    def client(self, node: Node) -> Client:
        """Create a client."""
        return node.create_client(self.type, self.name)


START = Service('start', Trigger, PLANNER, 'start the queue', needs_control=True)
MOVE = Service(
    'unit_robot/move',
    AddDiagnostics,
    PLANNER,
    'execute a move, a list of moves or a program, written as YAML in `load_namespace`; the reply is JSON: id, code, '
    'sentence',
    needs_control=True,
)
RESUME = Service('resume', Trigger, PLANNER, 'continue after a hold', needs_control=True)
CLEAR = Service('clear', Trigger, PLANNER, 'empty the queue', needs_control=True)
ENABLE = Service('enable', SetBool, TASK, 'torque on (needs control) or off (does not)', needs_control=True)
RESET = Service('reset', Trigger, TASK, 'clear faults whose cause has been removed', needs_control=True)
SERVO = Service(
    'servo/enable',
    SetBool,
    TASK,
    'let set points move the robot (needs control), or stop it (does not)',
    needs_control=True,
)
HOLD = Service('hold', Trigger, TASK, 'stop on the path; can be resumed')
ABORT = Service('abort', Trigger, TASK, 'stop on the path; cannot be resumed')
EMERGENCY_STOP = Service('emergency_stop', Trigger, TASK, 'stop on the path, then torque off')
INPUT = Service(
    'input', AddDiagnostics, PLANT,
    'force an input of a cell, written as YAML in `load_namespace`: `{name: part, value: true}`; `value: auto` removes '
    'the override; an empty request returns the inputs and outputs of the newest cycle as JSON',
)  # fmt: skip
INJECT_FAULT = Service(
    'inject_fault', AddDiagnostics, TASK,
    'inject a fault, written as YAML in `load_namespace`; the reply is a sentence',
)  # fmt: skip
SERVICES = tuple(item for item in list(vars().values()) if isinstance(item, Service))


def read_heartbeat(message: Header) -> tuple[str, str, str]:
    """Return identity, session and publisher in a planner's heartbeat; missing ones are empty."""
    words = [*message.frame_id.split(' '), '', '']
    return words[0], words[1], words[2]


PLAYER = 'rosbag2_player'  # name of the node of ``ros2 bag play``


def publishers_of(node: Node, topic: Topic) -> set[str]:
    """Return the identifiers of all publishers of a topic, as hexadecimal digits."""
    found = node.get_publishers_info_by_topic(node.resolve_topic_name(topic.name))
    return {bytes(info.endpoint_gid).hex() for info in found}


def player_of(node: Node, topic: Topic) -> Reason | None:
    """Return why messages of a topic are those of a bag being played back, None if no player publishes it."""
    for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic.name)):
        if info.node_name.startswith(PLAYER):
            return Reason(
                Code.FOREIGN, f'the node {info.node_name} publishes {topic.name}: a bag is being played back'
            )
    return None


def second_writer(node: Node) -> Reason | None:
    """Return which bus topic has two writers, and their names; None if there is none."""
    for name in ONE_WRITER:
        if node.count_publishers(name) > 1:
            writers = sorted(
                f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                for info in node.get_publishers_info_by_topic(node.resolve_topic_name(name))
            )
            return Reason(Code.BUS, f'{name} has {len(writers)} writers: {", ".join(writers)}')
    return None

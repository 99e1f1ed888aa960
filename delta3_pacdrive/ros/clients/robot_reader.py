"""State of a robot from its topics, for the page.

Joint states arrive at 100 Hz, reports and states less often. Of the cyclic topics (following error, TCP error, rotation
of the tool) only the newest message is read when a picture is due, so nothing wakes the process in every cycle.
"""

import json
import math
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray, String

from delta3_pacdrive import kinematics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.cell.cell_scene import brings_parts
from delta3_pacdrive.control.cycle.planned_path import PlannedPath
from delta3_pacdrive.control.messages import Status
from delta3_pacdrive.errors import Delta3Error, TelegramError, sources_of
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegram_codec import TelegramCodec
from delta3_pacdrive.ros.clients.cell_reader import CellReader
from delta3_pacdrive.ros.clients.remote_parameters import RemoteParameters
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.wire import cdr, interfaces
from delta3_pacdrive.ros.wire.joint_states import JointStatesReader
from delta3_pacdrive.ros.wire.numbers import row_of
from delta3_pacdrive.ros.wire.polling import newest
from delta3_pacdrive.ros.wire.qos import NEWEST
from delta3_pacdrive.view.values import DriveFacts, Facts, Instant, TurnInstant, tool_angle_rad

SILENT_S = 2.0  # without a report before the robot counts as gone
OVERLOAD = 'overload_s'


class RobotReader:
    """The state of a robot, read from its topics."""

    def __init__(self, operator: OperatorNode, parameters: Parameters) -> None:
        self.operator = operator
        self.parameters = parameters  # newest known ones
        self.planned = PlannedPath(parameters.kinematics)
        self._joints = interfaces.JOINT_STATES.polled_subscription(operator, profile=NEWEST)
        self._lags = interfaces.FOLLOWING_ERROR.polled_subscription(operator, profile=NEWEST)
        self._errors = interfaces.TCP_ERROR.polled_subscription(operator, profile=NEWEST)
        self._turns = [topic.polled_subscription(operator, profile=NEWEST) for topic in interfaces.TURNS]
        self._joint_reader = JointStatesReader()
        self._lag_codec = cdr.codec(telegrams.FOLLOWING_ERROR)
        self._error_codec = cdr.codec(telegrams.TCP_ERROR)
        self._turn_codec = cdr.codec(telegrams.TURNS[0])
        self._lag, self._error = np.zeros(3), np.zeros(3)
        self._tool = [np.zeros(3) for _ in self._turns]  # newest message of each rotary axis
        self.cell = CellReader(operator)
        self._overload = np.zeros(3)
        self._drives = [DriveFacts()] * len(DRIVES)
        self._prefix = operator.get_namespace().rstrip('/') + '/mc4_drive_'
        interfaces.DIAGNOSTICS.subscription(operator, self._on_diagnostics)
        plan = interfaces.MOTION_PLAN
        plan.subscription(operator, self._on_plan, raw=True, profile=plan.delivery.view)
        interfaces.STATUS.subscription(operator, self._on_status)
        self._remote = RemoteParameters(operator)
        self._controller = ''  # unknown until the robot has published its parameters
        self._requested_in = ''  # session

    @property
    def available(self) -> bool:
        """Whether a report of the robot was received recently."""
        return self.operator.progress.received and time.monotonic() - self.operator.progress_s < SILENT_S

    def instant(self) -> Instant | None:
        """Return the state of the newest joint states, None without new ones."""
        self._lag = newest(self._lags, _numbers(self._lag_codec), self._lag)
        self._error = newest(self._errors, _numbers(self._error_codec), self._error)
        self._tool = [
            newest(take, _numbers(self._turn_codec), known)
            for take, known in zip(self._turns, self._tool, strict=True)
        ]
        self.cell.read()
        # joints of another robot may be on the same topic
        found = newest(self._joints, self._joint_reader.read, None)
        if found is None:
            return None
        theta, speed, effort = map(np.array, (found.angles, found.speeds, found.torques))
        torque = effort / self.parameters.dynamics.gear_ratio
        time_s = found.sec + found.nanosec / NANOSECONDS
        tcp = kinematics.forward(theta, self.parameters, unreachable='nan')
        solved = bool(np.isfinite(tcp).all())
        x, y, z = tcp.tolist()
        turns = tuple(
            TurnInstant(actual, error) for _, actual, error in self._tool[: len(self.parameters.rotary_axes)]
        )
        return Instant(
            time_s=time_s,
            theta_rad=theta,
            lag_rad=self._lag,
            torque_n_m=torque,
            current_a=torque / self.parameters.motor.torque_constant_n_m_a,
            overload=self._overload,
            speed_m_s=float(np.linalg.norm(kinematics.jacobian(theta, tcp, self.parameters) @ speed))
            if solved
            else 0.0,
            error_m=self._error,
            cell=self.cell.at(time_s, (x, y, z), tool_angle_rad(turns)) if solved else None,
            turns=turns,
        )

    def facts(self) -> Facts:
        """Return the facts for the readout."""
        self.cell.update_inputs()
        p, queue = self.operator.progress, self.operator.queue
        if not self.available:
            where = self.operator.get_namespace()
            return Facts(waiting=f'no report from a robot in namespace {where}')
        return Facts(
            state=p.state,
            enabled=p.enabled,
            in_torque=p.in_torque,
            phase=p.phase,
            cycle=p.cycles,
            bus_time_s=p.bus_time_s,
            override=queue.override if queue else p.rate,
            overruns=p.overruns,
            lost_telegrams=p.lost_telegrams,
            waiting=p.waiting,
            fault=p.fault,
            sources=sources_of(p.fault_source),
            drives=tuple(self._drives),
            move=p.move,
            moves=p.moves,
            remaining_s=p.remaining_s,
            queue=queue.moves if queue else 0,
            working=queue.working if queue else '',
            operator=p.operator,
            payload_kg=None if brings_parts(self.cell.now.things) else _payload(p.payload_kg),
            outputs=p.outputs,
            inputs=self.cell.inputs,
            controller=self._controller,
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            number = status.name.removeprefix(self._prefix)
            if number == status.name or number not in ('1', '2', '3'):
                continue
            facts = {item.key: item.value for item in status.values}
            # values may come from any publisher
            with suppress(ValueError, TypeError, RecursionError):
                warnings = tuple(str(text) for text in json.loads(facts.get('warnings', '[]')))
                overload_s = float(facts.get(OVERLOAD, 0.0))
                index = int(number) - 1
                self._drives[index] = DriveFacts(facts.get('state', ''), facts.get('brake', ''), warnings)
                if math.isfinite(overload_s):
                    self._overload[index] = overload_s / self.parameters.drive.overload_time_s

    def _on_plan(self, data: bytes) -> None:
        with suppress(Delta3Error, RuntimeError, ValueError, UnicodeDecodeError):  # from a third-party writer
            self.planned.take(*row_of(deserialize_message(data, Float64MultiArray)))

    def _on_status(self, message: String) -> None:
        with suppress(TelegramError):
            status = Status.from_json(message.data)
            if status.session == self.operator.present.session:
                self.planned.update(status)

    def update_parameters(self) -> bool:
        """Request the parameters of the robot once per session; return whether they have changed."""
        session = self.operator.progress.session if self.available else ''
        if session and session != self._requested_in and self._remote.ready:
            self._requested_in = session
            self._remote.ask()
        if (found := self._remote.take()) is None:
            return False
        before, self.parameters = self.parameters, found
        self._controller = found.controller
        self.planned.use(found.kinematics)
        return found.checksum != before.checksum


def _numbers(codec: TelegramCodec) -> Callable[[bytes], Floats]:
    """Return a function that reads the three numbers of a telegram."""
    return lambda data: np.array(codec.decode(data)[3])


def _payload(reported_kg: float) -> float:
    """Limit a reported payload to the permitted range [kg]."""
    return min(max(reported_kg, 0.0), core.PAYLOAD_MAX_KG)

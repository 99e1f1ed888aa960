"""Operator services of the transformation task: control, enabling, stops, reset.

Services without an identity: ``hold``, ``abort``, ``emergency_stop``, ``reset`` (Trigger), ``enable`` (SetBool). The
same requests with an identity: ``control/request`` and ``control/reply`` (String, JSON), which also take and release
control. ``control/alive`` is the heartbeat of the operator in control, ``control/operator`` (String, latched) its name.
Reading and stopping need no control; enabling and resetting do if an operator has control.
"""

import time
from collections.abc import Callable
from functools import partial

from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.control import messages
from delta3_pacdrive.control.cycle.servo import default_limits, limits_of
from delta3_pacdrive.control.messages import ENABLE, RELEASE, RESET, TAKE_OVER, Request
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.control import Operator
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.errors import Code, Delta3Error, Reason, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros.deferred_service import Respond
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.request_server import RequestServer

NEEDS_CONTROL = frozenset({ENABLE, RESET, messages.STEER})


class OperatorServices:
    """Operator services of one transformation task.

    ``changed`` is called after a request to execute the resulting actions, ``control_changed`` when control has changed
    hands.
    """

    def __init__(
        self,
        node: RobotNode,
        parameters: Parameters,
        controller: RobotController,
        changed: Callable[[], None],
        control_changed: Callable[[], None],
    ) -> None:
        self._log, self._changed, self._control_changed = node.get_logger(), changed, control_changed
        self._state, self._control = state, control = controller.state, controller.control
        self._enabling = controller.enabling
        self._acts: dict[str, Callable[[], Reason | str]] = {
            messages.HOLD: controller.scripts.hold,
            messages.ABORT: controller.scripts.abort,
            messages.EMERGENCY_STOP: state.emergency_stop,
            messages.DISABLE: self._enabling.disable,
            messages.END_STEERING: state.end_steering,
        }
        self._limits = default_limits(parameters)
        self._steered_by = ''  # operator that has started the steering, empty without one
        self._operator = interfaces.CONTROL_OPERATOR.publisher(node)

        def session() -> str:
            return controller.bus.session.decode()

        self._server = RequestServer(
            node,
            (interfaces.CONTROL_REQUEST, interfaces.CONTROL_REPLY),
            session,
            self._on_request,
            changes=lambda: control.changes,
            always=frozenset(messages.STOPS.values()),
        )
        interfaces.CONTROL_ALIVE.bounded_subscription(node, self._on_alive)
        for service, action in (
            (interfaces.HOLD, messages.HOLD),
            (interfaces.ABORT, messages.ABORT),
            (interfaces.EMERGENCY_STOP, messages.EMERGENCY_STOP),
            (interfaces.RESET, messages.RESET),
        ):
            service.deferred_servers(node, partial(self._serve, action))
        interfaces.ENABLE.deferred_servers(node, self._on_enable)
        interfaces.SERVO.deferred_servers(node, self._on_servo)

    def _serve(self, action: str, _: Trigger.Request, respond: Respond) -> None:
        self._do('', action, '', respond)

    def _on_enable(self, request: SetBool.Request, respond: Respond) -> None:
        self._do('', ENABLE if request.data else messages.DISABLE, '', respond)

    def _on_servo(self, request: SetBool.Request, respond: Respond) -> None:
        self._do('', messages.STEER if request.data else messages.END_STEERING, '', respond)

    # control --------------------------------------------------------------------------------------------------------

    def _on_alive(self, message: Header) -> None:
        self._control.receive_heartbeat(message.frame_id, message.stamp.sec, time.monotonic())

    def check_heartbeat(self) -> None:
        """Hold the robot if the heartbeat of the operator in control has stopped."""
        lost = self._control.poll(time.monotonic())
        if lost is None:
            return
        self._log.error(f'{lost.name} has lost control: heartbeat timeout')
        if self._state.motion in (MotionState.MOVING, MotionState.STEERED):
            self._state.hold()
            self._changed()
        self._publish_control()

    def _publish_control(self) -> None:
        operator = self._control.operator
        self._operator.publish(String(data=operator.name if operator else ''))
        self._control_changed()

    # requests -------------------------------------------------------------------------------------------------------

    def _on_request(self, request: Request) -> None:
        def reply(reason: Reason | None, sentence: str) -> None:
            self._server.reply(request, reason, sentence)

        self._do(request.operator, request.action, request.text, reply)

    def _do(self, operator: str, action: str, text: str, respond: Respond) -> None:
        """Execute the request of an operator (empty: without an identity) and reply to it, now or later."""
        outcome: Reason | str | None = None
        if action in NEEDS_CONTROL:
            outcome = self._control.refusal(operator)
        if outcome is None:
            if action in (messages.TAKE, TAKE_OVER, RELEASE):
                outcome = self._change_control(operator, action, text)
            elif action in (RESET, ENABLE):
                outcome = (self._enabling.reset if action == RESET else self._enabling.enable)(respond)
            elif action == messages.STEER:
                outcome = self._steer(operator, text)
            elif action in self._acts:
                outcome = self._acts[action]()
            else:
                outcome = Reason(Code.CONTENT, f'there is no action {shown(action)}')
        self._changed()
        self._control_changed()  # before the reply, so that all clients see the new state first
        if isinstance(outcome, Reason):
            self._log.info(f'{action} refused: {outcome}')
            respond(outcome, '')
        elif outcome is not None:
            respond(None, outcome)

    def _steer(self, operator: str, text: str) -> Reason | str:
        try:
            limits = limits_of(text, self._limits)
        except Delta3Error as error:
            return Reason.of(error)
        self._steered_by = operator
        return self._state.steer(limits)

    def _change_control(self, identity: str, action: str, name: str) -> Reason | str:
        if action == RELEASE:
            reason = self._control.release(identity)
        else:
            operator = Operator(identity, name)
            reason = self._control.take(operator, action == TAKE_OVER, time.monotonic())
        if reason is not None:
            return reason
        if self._state.motion is MotionState.STEERED and self._steered_by != identity:
            self._state.end_steering()
        self._publish_control()
        return 'control released' if action == RELEASE else f'{name} has control'

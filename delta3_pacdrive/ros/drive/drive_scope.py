"""Server of a drive's oscilloscope: a request arms it, and it publishes samples until requests stop.

Clients repeat their request once a second. A drive serves one oscilloscope at a time and does not require control; it
rejects a second client with the name of the first. An idle oscilloscope costs no time in the cycle.
"""

import array
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String

from delta3_pacdrive.errors import Delta3Error, ParameterError, TelegramError, shown
from delta3_pacdrive.robot.drive.bus_drive import BusDrive
from delta3_pacdrive.robot.drive.channels import SCOPE_CHANNELS_MAX, channel_named
from delta3_pacdrive.robot.drive.scope import Block
from delta3_pacdrive.robot.sercos.configuration_check import require_axis
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire.interfaces import SCOPE_ANSWER, SCOPE_REQUEST, SCOPE_SAMPLES

GIVEN_UP_S = 5.0  # without a request before an oscilloscope is disarmed
IDENTITY_MAX, NAME_MAX = 32, 100
DECIMATION_MAX = 16_000
TRIGGERS_MAX = 1  # channels in addition to those shown


@dataclass(frozen=True)
class ScopeRequest:
    """A request for samples of a drive; an empty list of channels ends it."""

    identity: str
    name: str
    channels: tuple[str, ...]
    decimation: int
    axes: tuple[str, ...]  # of the requested drives

    @staticmethod
    def read(text: str, axis: str) -> 'ScopeRequest':
        """Parse the part of a request that concerns an axis; raises TelegramError."""
        try:
            document = json.loads(text)
            identity, name = document['scope'], document['name']
            axes, decimation = document['channels'], document['decimation']
            channels = axes.get(axis, [])
            texts = [identity, name, *channels]
        except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
            raise TelegramError(f'{shown(text[:80])} is not a valid oscilloscope request') from None
        if not all(isinstance(one, str) for one in texts) or not 0 < len(identity) <= IDENTITY_MAX:
            raise TelegramError('an oscilloscope request needs identity, name and channels as text')
        if type(decimation) is not int or not 1 <= decimation <= DECIMATION_MAX:
            raise TelegramError(
                f'the decimation of an oscilloscope must be an integer up to {DECIMATION_MAX}'
            )
        if len(channels) > SCOPE_CHANNELS_MAX + TRIGGERS_MAX:
            raise TelegramError(f'an oscilloscope shows at most {SCOPE_CHANNELS_MAX} channels')
        return ScopeRequest(identity, name[:NAME_MAX], tuple(channels), decimation, tuple(axes))


class DriveScopeServer:
    """Serves the oscilloscope of one drive; ``drives`` names all drives of the robot."""

    def __init__(self, node: RobotNode, axis: str, bus_drive: BusDrive, drives: Sequence[str]) -> None:
        self._node, self._axis, self._bus_drive, self._drives = node, axis, bus_drive, drives
        self._served: ScopeRequest | None = None
        self._requested_s = 0.0
        self._period_s = float(bus_drive.drive.constants['current_period'][0])
        self._answers = SCOPE_ANSWER.publisher(node)
        self._samples = SCOPE_SAMPLES.publisher(node, axis)
        self._layout = MultiArrayLayout()
        SCOPE_REQUEST.bounded_subscription(node, self._on_request)

    def _on_request(self, message: String) -> None:
        request, served = ScopeRequest.read(message.data, self._axis), self._served
        try:
            for axis in request.axes:
                require_axis(axis, self._drives, ParameterError)
        except ParameterError as error:
            self._answer(request, str(error))
            return
        if not request.channels:
            if served is not None and served.identity == request.identity:
                self._disarm()
            return
        if served is not None and served.identity != request.identity:
            self._answer(request, f'the oscilloscope of {self._axis} is in use by {served.name}')
            return
        self._requested_s = time.monotonic()
        if request == served:
            return
        try:
            self._arm(request)
        except Delta3Error as error:
            self._answer(request, str(error))
        else:
            self._answer(request)

    def _arm(self, request: ScopeRequest) -> None:
        channels = [channel_named(name) for name in request.channels]
        columns = MultiArrayDimension(
            label=','.join(request.channels), size=len(channels), stride=len(channels)
        )
        self._layout = MultiArrayLayout(
            dim=[MultiArrayDimension(label=request.identity), columns], data_offset=2
        )
        self._bus_drive.arm(channels, request.decimation, self._send)
        self._served = request
        self._node.get_logger().info(f'{self._axis}: oscilloscope armed by {request.name}')

    def _disarm(self) -> None:
        self._bus_drive.disarm()
        self._served = None
        self._node.get_logger().info(f'{self._axis}: oscilloscope disarmed')

    def _answer(self, request: ScopeRequest, refusal: str = '') -> None:
        answer: dict[str, Any] = {
            'scope': request.identity, 'axis': self._axis, 'armed': not refusal, 'period_s': self._period_s,
            'refusal': refusal,
        }  # fmt: skip
        self._answers.publish(String(data=json.dumps(answer)))

    def _send(self, block: Block) -> None:
        served = self._served
        if served is None:
            return
        rows = len(block.values)
        first_s = block.first * served.decimation * self._period_s
        data = array.array('d', (first_s, float(block.first)))
        data.frombytes(block.values.tobytes())
        self._layout.dim[0].size, self._layout.dim[0].stride = rows, block.values.size
        self._samples.publish(Float64MultiArray(layout=self._layout, data=data))

    def update(self) -> None:
        """Disarm the oscilloscope if its client has stopped sending requests."""
        if self._served is not None and time.monotonic() - self._requested_s > GIVEN_UP_S:
            self._disarm()

"""Client of oscilloscopes: arms the drives of a running robot and receives their samples."""

from __future__ import annotations

import json
import os
import secrets
import socket
import time
from collections import deque
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from std_msgs.msg import Float64MultiArray, String

from delta3_pacdrive.errors import ProgramError, RunError, RunInterruptedError
from delta3_pacdrive.recording.acquisition import Acquisition, Mode, Record, Setting
from delta3_pacdrive.robot.drive.scope import Block
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.ros.wire.interfaces import SCOPE_ANSWER, SCOPE_REQUEST, SCOPE_SAMPLES

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.publisher import Publisher

    from delta3_pacdrive.ros.clients.robot_client import OperatorNode

AGAIN_S = 1.0  # period of the request
SILENT_S = 10.0  # without samples before a drive counts as gone
LOOK_S = 0.02
PARTING_S = 0.1
NO_DRIVES, NO_ANSWER = (
    'drives with an oscilloscope',
    'answer of the oscilloscope',
)  # for messages "no ... within"


class ScopeClient:
    """A client of the drives of a robot.

    ``take`` is called with each record; consecutive clients must share the publisher ``requests``.
    """

    def __init__(
        self,
        operator: OperatorNode,
        setting: Setting,
        take: Callable[[Record], None],
        requests: Publisher | None = None,
    ) -> None:
        self._operator, self._setting, self._take = operator, setting, take
        self._identity = secrets.token_hex(8)
        self._name = f'process {os.getpid()} on {socket.gethostname()}'
        self._answers: dict[str, dict[str, object]] = {}
        self._blocks: deque[tuple[int, Block]] = deque()
        self._received_s = dict.fromkeys(setting.axes, time.monotonic())
        self._requests = requests or SCOPE_REQUEST.publisher(operator)
        self._requested_s = -AGAIN_S
        self._subscriptions = [
            SCOPE_ANSWER.subscription(operator, self._on_answer),
            *(
                SCOPE_SAMPLES.subscription(operator, self._receiver(axis), ALL_DRIVES[axis])
                for axis in setting.axes
            ),
        ]

    def _on_answer(self, message: String) -> None:
        with suppress(ValueError, RecursionError, TypeError, KeyError):
            answer = json.loads(message.data)
            if answer['scope'] == self._identity:
                self._answers[answer['axis']] = answer

    def _receiver(self, axis: int) -> Callable[[Float64MultiArray], None]:
        columns = len(self._setting.of_axis(axis))

        def receive(message: Float64MultiArray) -> None:
            dims = message.layout.dim
            if len(dims) != 2 or dims[0].label != self._identity or len(message.data) < 2:
                return
            data = np.array(message.data)
            if (len(data) - 2) % columns == 0:
                self._received_s[axis] = time.monotonic()
                self._blocks.append((axis, Block(int(data[1]), data[2:].reshape(-1, columns))))

        return receive

    def _ask(self, arm: bool = True) -> None:
        axes = self._setting.axes if arm else ()
        channels = {
            ALL_DRIVES[axis]: [channel.name for channel in self._setting.of_axis(axis)] for axis in axes
        }
        request = {
            'scope': self._identity, 'name': self._name, 'channels': channels,
            'decimation': self._setting.decimation,
        }  # fmt: skip
        self._requests.publish(String(data=json.dumps(request)))
        self._requested_s = time.monotonic()

    def record(self, timeout_s: float, show: Callable[[str], None] = lambda _: None) -> Acquisition:
        """Record as specified by the setting; return the acquisition.

        Raises
        ------
        ProgramError
            A drive rejects the request.
        RunError
            The robot is not running, the trigger did not fire, or samples were lost.
        RunInterruptedError
            A signal arrived before the first record.

        """
        try:
            acquisition = self.arm(timeout_s)
            self.follow(acquisition, timeout_s, show)
        finally:
            self.disarm()
        return acquisition

    def disarm(self) -> None:
        """Disarm the drives."""
        self._operator.interruptible = False
        self._ask(arm=False)
        self._operator.spin_for(PARTING_S)

    def detach(self) -> None:
        """Disarm the drives without waiting, and unsubscribe, in a process that continues."""
        self._ask(arm=False)
        for subscription in self._subscriptions:
            self._operator.destroy_subscription(subscription)

    # to be called repeatedly by a process with other tasks ------------------------------------------------------------

    @property
    def reaches_drives(self) -> bool:
        """Whether all arm drives are discovered, and the requested ones have an oscilloscope.

        Only the drives know whether there is a rotary axis; its drive is asked until it replies.
        """
        axes = (axis for number, axis in enumerate(DRIVES) if number in self._setting.axes)
        return self._requests.get_subscription_count() >= len(DRIVES) and all(
            self._operator.count_publishers(SCOPE_SAMPLES.of(axis)) for axis in axes
        )

    def armed(self) -> Acquisition | None:
        """Request samples; return the acquisition as soon as all drives have replied, else None.

        Raises
        ------
        ProgramError
            A drive rejects the request.

        """
        if time.monotonic() - self._requested_s > AGAIN_S:
            self._ask()
        axes = [ALL_DRIVES[axis] for axis in self._setting.axes]
        for answer in self._answers.values():
            if not answer['armed']:
                raise ProgramError(str(answer['refusal']))
        if not all(axis in self._answers for axis in axes):
            return None
        period_s = float(self._answers[axes[0]]['period_s'])  # type: ignore[arg-type]
        setting = replace(self._setting, sample_time_s=self._setting.decimation * period_s)
        self._received_s = dict.fromkeys(self._setting.axes, time.monotonic())
        return Acquisition(setting, self._take)

    def receive_samples(self, acquisition: Acquisition) -> None:
        """Add received samples to an acquisition; raises RunError if samples are lost or missing."""
        while self._blocks and not acquisition.done:
            acquisition.add(*self._blocks.popleft())
        now = time.monotonic()
        if now - self._requested_s > AGAIN_S:
            self._ask()
        for axis, received_s in self._received_s.items():
            if now - received_s > SILENT_S:
                raise RunError(
                    f'{ALL_DRIVES[axis]} has sent no samples for {SILENT_S:g} s while {awaited(acquisition)}: is its '
                    'robot still up, and in cyclic operation?'
                )

    # blocking calls ---------------------------------------------------------------------------------------------------

    def arm(self, timeout_s: float) -> Acquisition:
        """Arm the drives; return the acquisition. Raises ProgramError or RunError."""
        self._operator.wait_until(lambda: self.reaches_drives, NO_DRIVES, timeout_s)
        found: list[Acquisition] = []

        def answered() -> bool:
            found.extend(filter(None, [self.armed()]))
            return bool(found)

        self._operator.wait_until(answered, NO_ANSWER)
        return found[0]

    def follow(
        self, acquisition: Acquisition, timeout_s: float, show: Callable[[str], None] = lambda _: None
    ) -> None:
        """Receive samples until the acquisition is complete; raises RunError."""
        trigger, begun_s = acquisition.setting.trigger, time.monotonic()
        self._received_s = dict.fromkeys(self._setting.axes, begun_s)
        show(f'waiting for {trigger.sentence}' if trigger else 'recording')
        records = 0
        while not acquisition.done:
            try:
                self._operator.spin_for(LOOK_S)
            except RunInterruptedError as error:
                if acquisition.setting.mode is Mode.SINGLE or (trigger and not acquisition.records):
                    raise RunInterruptedError(f'{error} while {awaited(acquisition)}') from None
                acquisition.finish()
                return
            self.receive_samples(acquisition)
            now = time.monotonic()
            if acquisition.records != records:
                records, begun_s = acquisition.records, now
            if not acquisition.triggered and now - begun_s > timeout_s:
                raise RunError(f'the trigger did not fire: {awaited(acquisition)} for {timeout_s:g} s')


def awaited(acquisition: Acquisition) -> str:
    """Return the current activity, for a message."""
    trigger = acquisition.setting.trigger
    return f'{trigger.sentence} was awaited' if trigger else 'it was recorded'

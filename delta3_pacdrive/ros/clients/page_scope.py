"""Oscilloscope of the page: requests samples from the drives like ``delta3 scope``, without blocking the view.

It does not require control of the robot. All browsers share one oscilloscope.
"""

import time
from contextlib import suppress

from rclpy.publisher import Publisher

from delta3_pacdrive.errors import Delta3Error, RunError
from delta3_pacdrive.recording.acquisition import Acquisition, Mode, Record, Setting
from delta3_pacdrive.ros.clients.robot_reader import RobotReader
from delta3_pacdrive.ros.clients.scope_client import NO_ANSWER, NO_DRIVES, ScopeClient, awaited
from delta3_pacdrive.ros.wire.interfaces import SCOPE_REQUEST
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.scope_panel import caption, setting_of

PATIENCE_S = 10.0  # timeout for the drives' replies
ROLLED_S = 0.5  # refresh period of a rolling oscilloscope
LEFT_S = 2.0  # without a browser before a rolling recording is ended


class PageScope:
    """The oscilloscope of a page, started and ended by UI commands and updated between pictures."""

    def __init__(self, page: Page, robot: RobotReader) -> None:
        self._page, self._robot = page, robot
        # shared by all clients: the end of one recording must be received before the start of the next
        self._requests: Publisher | None = None
        self._client: ScopeClient | None = None
        self._acquisition: Acquisition | None = None
        self._setting: Setting | None = None
        self._began_s = self._drawn_s = self._watched_s = 0.0

    def begin(self, text: str) -> None:
        """Start the requested recording, replacing the current one."""
        self._detach()
        try:
            self._setting = setting_of(text, self._robot.parameters)
        except Delta3Error as error:
            self._report(str(error), refused=True)
            return
        operator = self._robot.operator
        if self._requests is None:
            self._requests = SCOPE_REQUEST.publisher(operator)
        self._client = ScopeClient(operator, self._setting, self._take, self._requests)
        self._began_s = self._watched_s = time.monotonic()
        self._report('asking the drives')

    def end(self) -> None:
        """End the current recording; a rolling oscilloscope keeps its last picture."""
        client, acquisition = self._client, self._acquisition
        if client is None:
            self._report('nothing is recorded')
            return
        if acquisition is None:
            self._report('ended before the drives answered')
        elif acquisition.setting.mode is Mode.ROLLING or acquisition.records:
            acquisition.finish()
        else:
            self._report(f'ended while {awaited(acquisition)}')
        self._detach()

    def close(self) -> None:
        """Disarm the drives before the view ends."""
        client, self._client = self._client, None
        if client is not None:
            with suppress(Delta3Error):  # interrupted by a signal
                client.disarm()

    def update(self) -> None:
        """Continue the current recording."""
        if self._client is None:
            return
        try:
            self._continue(self._client)
        except Delta3Error as error:
            self._detach()
            self._report(str(error), refused=True)

    def _continue(self, client: ScopeClient) -> None:
        now = time.monotonic()
        if self._page.watched:
            self._watched_s = now
        if self._acquisition is None:
            self._arm(client, now)
            return
        client.receive_samples(self._acquisition)
        if self._acquisition.done:
            self._detach()
        elif self._acquisition.setting.mode is Mode.ROLLING:
            if now - self._watched_s > LEFT_S:
                self.end()
            elif now - self._drawn_s > ROLLED_S and (record := self._acquisition.newest()) is not None:
                self._drawn_s = now
                self._draw(record)

    def _arm(self, client: ScopeClient, now: float) -> None:
        reached = client.reaches_drives
        if reached and (acquisition := client.armed()) is not None:
            self._acquisition, trigger = acquisition, acquisition.setting.trigger
            self._report(f'waiting for {trigger.sentence}' if trigger else 'recording')
        elif now - self._began_s > PATIENCE_S:
            where = self._robot.operator.get_namespace()
            raise RunError(
                f'no {NO_ANSWER if reached else NO_DRIVES} within {PATIENCE_S:g} s: is a robot up in namespace {where}?'
            )

    def _take(self, record: Record) -> None:
        self._draw(record)
        self._report(caption(record))

    def _draw(self, record: Record) -> None:
        if self._page.scope is not None:
            self._page.scope.show(record)

    def _report(self, sentence: str, refused: bool = False) -> None:
        self._page.report_scope(sentence, refused)

    def _detach(self) -> None:
        if self._client is not None:
            self._client.detach()
        self._client = self._acquisition = None

"""The oscilloscope of the page: the drives are asked as ``delta3 scope`` asks them, while the view goes on.

It needs no control of the robot. A page has one oscilloscope, whoever looks at it.
"""

import time
from contextlib import suppress

from rclpy.publisher import Publisher

from delta3_pacdrive.errors import Delta3Error, RunError
from delta3_pacdrive.recording.acquisition import Acquisition, Mode, Record, Setting
from delta3_pacdrive.ros.interfaces import SCOPE_REQUEST
from delta3_pacdrive.ros.robot_reader import RobotReader
from delta3_pacdrive.ros.scope_client import NO_ANSWER, NO_DRIVES, ScopeClient, awaited
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.scope_panel import caption, setting_of

PATIENCE_S = 10.0  # for drives to answer
ROLLED_S = 0.5  # between two pictures of a rolling oscilloscope
LEFT_S = 2.0  # without a browser, after which a rolling one is ended


class PageScope:
    """The oscilloscope of a page is begun and ended by wishes, and looked after between pictures.

    Parameters
    ----------
    page
        Where what is recorded is drawn.
    robot
        Whose drives are asked.

    """

    def __init__(self, page: Page, robot: RobotReader) -> None:
        self._page, self._robot = page, robot
        self._requests: Publisher | None = (
            None  # for all clients: what one ends comes before what the next begins
        )
        self._client: ScopeClient | None = None
        self._acquisition: Acquisition | None = None
        self._setting: Setting | None = None
        self._began_s = self._drawn_s = self._watched_s = 0.0

    def begin(self, text: str) -> None:
        """Begin what a wish asks for, in the place of what is under way."""
        self._leave()
        try:
            self._setting = setting_of(text, self._robot.parameters)
        except Delta3Error as error:
            self._tell(str(error), refused=True)
            return
        operator = self._robot.operator
        if self._requests is None:
            self._requests = SCOPE_REQUEST.publisher(operator)
        self._client = ScopeClient(operator, self._setting, self._take, self._requests)
        self._began_s = self._watched_s = time.monotonic()
        self._tell('asking the drives')

    def end(self) -> None:
        """End what is under way; what a rolling oscilloscope shows stays."""
        client, acquisition = self._client, self._acquisition
        if client is None:
            self._tell('nothing is recorded')
            return
        if acquisition is None:
            self._tell('ended before the drives answered')
        elif acquisition.setting.mode is Mode.ROLLING or acquisition.records:
            acquisition.finish()
        else:
            self._tell(f'ended while {awaited(acquisition)}')
        self._leave()

    def close(self) -> None:
        """Let the drives run without oscilloscope again, as nobody goes on here."""
        client, self._client = self._client, None
        if client is not None:
            with suppress(Delta3Error):  # whoever is in a hurry
                client.part()

    def look(self) -> None:
        """Go on with what is under way."""
        if self._client is None:
            return
        try:
            self._go_on(self._client)
        except Delta3Error as error:
            self._leave()
            self._tell(str(error), refused=True)

    def _go_on(self, client: ScopeClient) -> None:
        now = time.monotonic()
        if self._page.watched:
            self._watched_s = now
        if self._acquisition is None:
            self._arm(client, now)
            return
        client.take_in(self._acquisition)
        if self._acquisition.done:
            self._leave()
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
            self._tell(f'waiting for {trigger.sentence}' if trigger else 'recording')
        elif now - self._began_s > PATIENCE_S:
            where = self._robot.operator.get_namespace()
            raise RunError(
                f'no {NO_ANSWER if reached else NO_DRIVES} within {PATIENCE_S:g} s: is a robot up in namespace {where}?'
            )

    def _take(self, record: Record) -> None:
        self._draw(record)
        self._tell(caption(record))

    def _draw(self, record: Record) -> None:
        if self._page.scope is not None:
            self._page.scope.show(record)

    def _tell(self, sentence: str, refused: bool = False) -> None:
        self._page.tell_of_scope(sentence, refused)

    def _leave(self) -> None:
        if self._client is not None:
            self._client.leave()
        self._client = self._acquisition = None

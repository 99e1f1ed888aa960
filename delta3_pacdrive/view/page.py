"""The page: a viser server with the robot in three dimensions, what there is to read, plots and controls.

It is fed with plain values and gives wishes back; it neither knows of ROS nor of recordings.
"""

import contextlib
import io
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.peripherals.cell_scene import Thing
from delta3_pacdrive.sercos.configuration_check import drives_of
from delta3_pacdrive.view import readout, thread_safe_events
from delta3_pacdrive.view.cell_figure import CellFigure
from delta3_pacdrive.view.controls import PROGRAM_BYTES_MAX, Controls
from delta3_pacdrive.view.figure import BLUE, Figure, segments
from delta3_pacdrive.view.ghost import KINDS, ghost_of
from delta3_pacdrive.view.history import History
from delta3_pacdrive.view.plots import COLUMNS, ERROR, TCP, Plots, rows_of
from delta3_pacdrive.view.scope_panel import ScopePanel
from delta3_pacdrive.view.serving import Place
from delta3_pacdrive.view.values import Facts, Instant, Wish

PICTURES_HZ = 30.2
READ_S, PLOT_S = 0.2, 0.4  # between two updates of what is read, and of plots and the path travelled
FLASH_S = 0.5
HISTORY_S = 30.0  # of the path travelled; plots show as much at most
MAGNIFIED = ('1', '2', '5', '10', '20', '50', '100', '200', '500', '1000')
NOTIFICATIONS_HZ, NOTIFICATIONS_BURST = 1.0, 5.0  # to all browsers
WINDOWS_S = ('2', '5', '10', '30')  # that plots show


class Page:
    """One page, for any number of browsers.

    Parameters
    ----------
    parameters
        Of the robot.
    place
        Where it is served.
    title
        Above everything that is read.
    more
        Whether there is more to be added before browsers are let in by ``open``.

    Attributes
    ----------
    url
        Where the page is.
    wishes
        What was asked for and not yet carried out, the oldest first.
    rows
        Returns what is plotted of the last seconds, the path travelled among it, as ``plots.rows_of`` has it; by
        default what was shown.

    """

    def __init__(self, parameters: Parameters, place: Place, title: str, more: bool = False) -> None:
        from delta3_pacdrive.view import page_guard

        thread_safe_events.use_in_viser()
        self._guard = page_guard.Guard(
            place.host, PROGRAM_BYTES_MAX, lambda why: self.tell(why, refused=True)
        )
        self._notifications = page_guard.Bucket(NOTIFICATIONS_HZ, NOTIFICATIONS_BURST)
        with contextlib.redirect_stdout(io.StringIO()):  # it greets
            self.server: Any = self._guard.serve(title, place.listener)
        self.url, self._place = place.url, place
        self.wishes: deque[Wish] = deque()
        self.controls: Controls | None = None
        self.scope: ScopePanel | None = None
        self._things: tuple[Thing, ...] = ()
        self._cell: CellFigure | None = None
        self._tcp_m: Floats | None = None
        self._instant: Instant | None = None
        self._history = History(round(HISTORY_S * PICTURES_HZ), COLUMNS)
        self.rows: Callable[[float], Floats] = self._history.last
        self._read_s = self._plot_s = 0.0
        self._facts = Facts()
        self._seconds = self._magnification = 10.0
        gui = self.server.gui
        gui.configure_theme(control_width='large', show_logo=False, show_share_button=False, brand_color=BLUE)
        gui.main_panel.dock_right()
        # buttons stand above everything that grows and shrinks: nothing moves them away from under a finger
        self.top = gui.add_folder(None)
        self._status = gui.add_html('')
        self._bars = gui.add_html('')
        self.middle = gui.add_folder(None)
        self._add_looks(gui)
        self._plots = Plots(gui)
        self.use(parameters)
        self.server.on_client_connect(self._aim)
        if not more:
            self.open()

    def open(self) -> None:
        """Let browsers in, as what is added before their eyes takes them longer than all of it at once."""
        self._place.hand_over()
        self._guard.begin()

    def _aim(self, client: Any) -> None:
        """Let the robot stand in the upper half of a phone, whose lower half is covered by what is read."""
        if client.camera.image_width < client.camera.image_height:
            client.camera.position = self._size_m * np.array([1.7, -2.65, 0.1])
            client.camera.look_at = self._size_m * np.array([0.0, 0.0, -1.08])

    def use(self, parameters: Parameters) -> None:
        """Show a robot with these parameters."""
        self._parameters = parameters
        for panel in (self.controls, self.scope):
            if panel is not None:
                panel.use(drives_of(parameters))
        self._scales = readout.Scales.of(parameters)
        k = parameters.kinematics
        scene = self.server.scene
        self._size_m = k.base_radius_m + k.upper_arm_length_m + k.forearm_length_m
        camera = self.server.initial_camera
        camera.position = self._size_m * np.array([1.0, -1.52, 0.1])
        camera.look_at = self._size_m * np.array([-0.08, -0.05, -0.47])
        camera.fov = np.radians(45.0)
        scene.reset()
        scene.set_up_direction('+z')
        # shadows cost as much as all the rest where there is no graphics processor
        scene.configure_default_lights(cast_shadow=False)
        self._figure = Figure(scene, parameters)
        home = np.array(parameters.motion.home_m)  # until it is known where the robot is
        self._figure.place(kinematics.inverse(home, parameters), home, None)
        self._cell = None  # it has gone with the rest
        self.forget()
        self.stand(self._things)

    def stand(self, things: Sequence[Thing]) -> None:
        """Show what stands around the robot; nothing: it has no cell."""
        self._things = tuple(things)
        if self._cell is not None:
            self._cell.remove()
        self._cell = CellFigure(self.server.scene, things) if things else None
        self._boxes['cell'].visible = bool(things)
        self._apply_looks()

    def _add_looks(self, gui: Any) -> None:
        """Add what everybody may choose, however the robot moves."""
        with gui.add_folder('Look', expand_by_default=False):
            self._ghost = gui.add_dropdown('ghost', KINDS, hint='what stands beside the actual pose')
            self._magnified = gui.add_dropdown('error x', MAGNIFIED, initial_value='100')
            self._window = gui.add_dropdown('plots, s', WINDOWS_S, initial_value='10')
            self._boxes = {
                name: gui.add_checkbox(name, True)
                for name in ('workspace', 'planned path', 'travelled path', 'labels', 'cell')
            }
            self._dark = gui.add_checkbox('dark', False)
        for handle in (self._ghost, self._magnified, self._window, self._dark, *self._boxes.values()):
            handle.on_update(lambda _: self._apply_looks())

    def _apply_looks(self) -> None:
        figure, boxes = self._figure, self._boxes
        for handle in figure.workspace:
            handle.visible = boxes['workspace'].value
        figure.planned.visible = boxes['planned path'].value
        figure.travelled.visible = boxes['travelled path'].value
        for handle in (*figure.labels, *figure.axes):
            handle.visible = boxes['labels'].value
        if self._cell is not None:
            self._cell.show(boxes['cell'].value, boxes['labels'].value)
        if self._window.value in WINDOWS_S:  # a page may say anything
            self._seconds = float(self._window.value)
        if self._magnified.value in MAGNIFIED:
            self._magnification = float(self._magnified.value)
        self.server.gui.configure_theme(
            control_width='large', show_logo=False, show_share_button=False, brand_color=BLUE,
            dark_mode=self._dark.value,
        )  # fmt: skip

    def darken(self, dark: bool) -> None:
        """Let the page be dark, or light."""
        self._dark.value = dark

    def add_controls(self) -> None:
        """Let people ask for something: ``wishes`` fills."""
        with self.top:
            self.controls = Controls(self.server.gui, self.wishes.append, drives_of(self._parameters))

    def add_scope(self) -> None:
        """Let people look into the drives: ``wishes`` fills."""
        with self.middle:
            self.scope = ScopePanel(self.server.gui, self.wishes.append, drives_of(self._parameters))

    def stand_still(self) -> None:
        """Show nothing that only a robot that moves has: no plots, no bars, no ghost, no paths."""
        self._plots.hide()
        paths = (self._boxes[name] for name in ('planned path', 'travelled path'))
        for handle in (self._bars, self._ghost, self._magnified, self._window, *paths):
            handle.visible = False

    def wait(self, sentence: str) -> None:
        """Say for what the page waits, until there is something to read."""
        self._facts = Facts(waiting=sentence)
        self._write()

    def note(self, sentence: str) -> None:
        """Show a sentence for good."""
        with self.middle:
            self.server.gui.add_markdown(sentence)

    @property
    def watched(self) -> bool:
        """Whether a browser has the page open."""
        return bool(self.server.get_clients())

    # what is shown ----------------------------------------------------------------------------------------------------

    def forget(self) -> None:
        """Begin the plots and the path travelled anew."""
        self._history.clear()

    def plan(self, points_m: Floats) -> None:
        """Show the path that is planned, shape (n, 3)."""
        self._figure.planned.points = segments(points_m).astype(np.float32)

    def show(self, instant: Instant) -> None:
        """Show the robot at an instant."""
        (row,) = rows_of(
            np.array([instant.time_s]),
            instant.theta_rad[None],
            instant.lag_rad[None],
            instant.torque_n_m[None],
            instant.current_a[None],
            np.array([instant.speed_m_s]),
            instant.error_m[None],
            self._parameters,
        )
        if not np.isfinite(row).all():
            return
        self._history.add(row[0], row[1:])
        tcp, error = 1e-3 * row[TCP], 1e-3 * row[ERROR]
        self._tcp_m, self._instant = tcp, instant
        if not self.watched:
            return
        now = time.monotonic()
        with self.server.atomic():
            angle = 0.0 if instant.turn is None else instant.turn.angle_rad
            ghost = ghost_of(instant, tcp, error, self._ghost.value, self._magnification)
            there, beside = (None, angle) if ghost is None else ghost
            self._figure.place(instant.theta_rad, tcp, there, (angle, beside))
            if self._cell is not None and instant.cell is not None:
                self._cell.place(instant.cell)
            if now - self._read_s >= READ_S:
                self._read_s = now
                self._write()
                self._flash(now)
            if now - self._plot_s >= PLOT_S:
                self._plot_s = now
                rows = self.rows(HISTORY_S)
                self._figure.travelled.points = segments(1e-3 * rows[:, TCP]).astype(np.float32)
                if len(rows):
                    self._plots.draw(rows[np.searchsorted(rows[:, 0], rows[-1, 0] - self._seconds) :])
        self.server.flush()  # else a picture waits for viser's window, twice 1/60 s: 28 of 30 would be sent

    def read(self, facts: Facts) -> None:
        """Show what there is to read, and flash where a fault is."""
        self._facts = facts
        if not self.watched:
            return
        self._read_s = now = time.monotonic()  # the next picture has nothing to add
        self._write()
        self._figure.carry(facts.payload_kg or 0.0)
        self._flash(now)
        if self.controls is not None:
            self.controls.show(facts)

    def _write(self) -> None:
        turn = None if self._instant is None else self._instant.turn
        self._status.content = readout.status(self._facts, self._tcp_m, turn)
        if self._instant is not None:
            self._bars.content = readout.bars(self._instant, self._facts.drives, self._scales)

    def _flash(self, now: float) -> None:
        self._figure.alarm(self._facts.sources, self._facts.fault, int(now / FLASH_S) % 2 == 0)

    def tell(self, sentence: str, refused: bool = False) -> None:
        """Answer a wish; what is refused is also shown where nobody overlooks it."""
        if self.controls is not None:
            self.controls.tell(sentence, refused)
        self._notify(sentence, refused)

    def tell_of_scope(self, sentence: str, refused: bool = False) -> None:
        """Say how it goes with the oscilloscope, in the same way."""
        if self.scope is not None:
            self.scope.tell(sentence, refused)
        self._notify(sentence, refused)

    def _notify(self, sentence: str, refused: bool) -> None:
        if refused and self._notifications.take():  # the answers below the buttons show all of them
            for client in self.server.get_clients().values():
                client.add_notification('Refused', sentence, color='red', auto_close_seconds=8.0)

    def close(self) -> None:
        """Serve nobody any more."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

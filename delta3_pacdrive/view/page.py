"""The page: a viser server with the robot in 3D, a readout, plots and controls.

It displays plain values and returns UI commands; it depends neither on ROS nor on recordings.
"""

import contextlib
import io
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.cell.cell_scene import Thing
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.view import readout, thread_safe_events
from delta3_pacdrive.view.cell_figure import CellFigure
from delta3_pacdrive.view.controls import PROGRAM_BYTES_MAX, Controls
from delta3_pacdrive.view.figure import BLUE, KINDS, Figure, ghost_of, segments
from delta3_pacdrive.view.plots import COLUMNS, ERROR, TCP, History, Plots, rows_of
from delta3_pacdrive.view.scope_panel import ScopePanel
from delta3_pacdrive.view.serving import Place
from delta3_pacdrive.view.values import Facts, Instant, UiCommand, tool_angle_rad

PICTURES_HZ = 30.2
READ_S, PLOT_S = 0.2, 0.4  # refresh periods of the readout, and of plots and travelled path
FLASH_S = 0.5
HISTORY_S = 30.0  # of the travelled path; maximum window of the plots
MAGNIFIED = ('1', '2', '5', '10', '20', '50', '100', '200', '500', '1000')
NOTIFICATIONS_HZ, NOTIFICATIONS_BURST = 1.0, 5.0  # for all browsers together
WINDOWS_S = ('2', '5', '10', '30')  # of the plots


class Page:
    """One page for any number of browsers.

    With ``more`` further elements are added before ``open`` admits browsers.
    """

    def __init__(self, parameters: Parameters, place: Place, title: str, more: bool = False) -> None:
        from delta3_pacdrive.view import page_guard

        thread_safe_events.use_in_viser()
        self._guard = page_guard.Guard(
            place.host, PROGRAM_BYTES_MAX, lambda why: self.report(why, refused=True)
        )
        self._notifications = page_guard.Bucket(NOTIFICATIONS_HZ, NOTIFICATIONS_BURST)
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner
            self.server: Any = self._guard.serve(title, place.listener)
        self.url, self._place = place.url, place
        self.commands: deque[UiCommand] = deque()  # pending, oldest first
        self.controls: Controls | None = None
        self.scope: ScopePanel | None = None
        self._things: tuple[Thing, ...] = ()
        self._cell: CellFigure | None = None
        self._tcp_m: Floats | None = None
        self._instant: Instant | None = None
        self._history = History(round(HISTORY_S * PICTURES_HZ), COLUMNS)
        # returns the plotted rows of the last seconds, including the travelled path, as ``plots.rows_of`` does
        self.rows: Callable[[float], Floats] = self._history.last
        self._read_s = self._plot_s = 0.0
        self._facts = Facts()
        self._seconds = self._magnification = 10.0
        gui = self.server.gui
        gui.configure_theme(control_width='large', show_logo=False, show_share_button=False, brand_color=BLUE)
        gui.main_panel.dock_right()
        # buttons are above all elements of variable size, so that they never move under a finger
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
        """Admit browsers; elements added before this are sent in one batch, which is faster."""
        self._place.hand_over()
        self._guard.begin()

    def _aim(self, client: Any) -> None:
        """On a phone, whose lower half shows the readout, move the robot into the upper half."""
        if client.camera.image_width < client.camera.image_height:
            client.camera.position = self._size_m * np.array([1.7, -2.65, 0.1])
            client.camera.look_at = self._size_m * np.array([0.0, 0.0, -1.08])

    def use(self, parameters: Parameters) -> None:
        """Display a robot with these parameters."""
        self._parameters = parameters
        for panel in (self.controls, self.scope):
            if panel is not None:
                panel.use(parameters.axes)
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
        # without a GPU, shadows cost as much as everything else
        scene.configure_default_lights(cast_shadow=False)
        self._figure = Figure(scene, parameters)
        home = np.array(parameters.motion.home_m)  # until the pose is known
        self._figure.place(kinematics.inverse(home, parameters), home, None)
        self._cell = None  # removed by the reset
        self.clear_history()
        self.show_cell(self._things)

    def show_cell(self, things: Sequence[Thing]) -> None:
        """Display the cell; an empty sequence removes it."""
        self._things = tuple(things)
        if self._cell is not None:
            self._cell.remove()
        self._cell = CellFigure(self.server.scene, things) if things else None
        self._boxes['cell'].visible = bool(things)
        self._apply_looks()

    def _add_looks(self, gui: Any) -> None:
        """Add the display options."""
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
        if self._window.value in WINDOWS_S:  # a browser may send any value
            self._seconds = float(self._window.value)
        if self._magnified.value in MAGNIFIED:
            self._magnification = float(self._magnified.value)
        self.server.gui.configure_theme(
            control_width='large', show_logo=False, show_share_button=False, brand_color=BLUE,
            dark_mode=self._dark.value,
        )  # fmt: skip

    def darken(self, dark: bool) -> None:
        """Select the dark or the light theme."""
        self._dark.value = dark

    def add_controls(self) -> None:
        """Add the controls; they append to ``commands``."""
        with self.top:
            self.controls = Controls(self.server.gui, self.commands.append, self._parameters.axes)

    def add_scope(self) -> None:
        """Add the oscilloscope; it appends to ``commands``."""
        with self.middle:
            self.scope = ScopePanel(self.server.gui, self.commands.append, self._parameters.axes)

    def hide_motion(self) -> None:
        """Hide everything that concerns motion: plots, bars, ghost and paths."""
        self._plots.hide()
        paths = (self._boxes[name] for name in ('planned path', 'travelled path'))
        for handle in (self._bars, self._ghost, self._magnified, self._window, *paths):
            handle.visible = False

    def wait(self, sentence: str) -> None:
        """Show a waiting message until the first facts arrive."""
        self._facts = Facts(waiting=sentence)
        self._write()

    def note(self, sentence: str) -> None:
        """Add a permanent note."""
        with self.middle:
            self.server.gui.add_markdown(sentence)

    @property
    def watched(self) -> bool:
        """Whether a browser is connected."""
        return bool(self.server.get_clients())

    # display ----------------------------------------------------------------------------------------------------------

    def clear_history(self) -> None:
        """Clear the plots and the travelled path."""
        self._history.clear()

    def show_path(self, points_m: Floats) -> None:
        """Display the planned path, shape (n, 3)."""
        self._figure.planned.points = segments(points_m).astype(np.float32)

    def show(self, instant: Instant) -> None:
        """Display the robot at an instant."""
        (row,) = rows_of(
            time_s=np.array([instant.time_s]),
            theta_rad=instant.theta_rad[None],
            lag_rad=instant.lag_rad[None],
            torque_n_m=instant.torque_n_m[None],
            current_a=instant.current_a[None],
            speed_m_s=np.array([instant.speed_m_s]),
            error_m=instant.error_m[None],
            parameters=self._parameters,
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
            angle = tool_angle_rad(instant.turns)
            ghost = ghost_of(instant, tcp, error, self._ghost.value, self._magnification)
            ghost_m, ghost_rad = (None, angle) if ghost is None else ghost
            self._figure.place(instant.theta_rad, tcp, ghost_m, (angle, ghost_rad))
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
        self.server.flush()  # otherwise a picture waits for viser's window of 2/60 s, and 28 of 30 are sent

    def read(self, facts: Facts) -> None:
        """Update the readout, and flash at the source of a fault."""
        self._facts = facts
        if not self.watched:
            return
        self._read_s = now = time.monotonic()  # the next picture need not update it
        self._write()
        self._figure.carry(facts.payload_kg or 0.0)
        self._flash(now)
        if self.controls is not None:
            self.controls.show(facts)

    def _write(self) -> None:
        turns = () if self._instant is None else self._instant.turns
        self._status.content = readout.status(self._facts, self._tcp_m, turns)
        if self._instant is not None:
            self._bars.content = readout.bars(self._instant, self._facts.drives, self._scales)

    def _flash(self, now: float) -> None:
        self._figure.alarm(self._facts.sources, self._facts.fault, int(now / FLASH_S) % 2 == 0)

    def report(self, sentence: str, refused: bool = False) -> None:
        """Show the reply to a command; rejections also as a notification."""
        if self.controls is not None:
            self.controls.report(sentence, refused)
        self._notify(sentence, refused)

    def report_procedure(self, axis: str, sentence: str, failed: bool = False) -> None:
        """Show step or result of a procedure of an axis."""
        if self.controls is not None:
            self.controls.report_procedure(axis, sentence, failed)

    def report_scope(self, sentence: str, refused: bool = False) -> None:
        """Show the state of the oscilloscope; rejections also as a notification."""
        if self.scope is not None:
            self.scope.report(sentence, refused)
        self._notify(sentence, refused)

    def _notify(self, sentence: str, refused: bool) -> None:
        if refused and self._notifications.take():  # the panel lists all replies
            for client in self.server.get_clients().values():
                client.add_notification('Refused', sentence, color='red', auto_close_seconds=8.0)

    def close(self) -> None:
        """Stop the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

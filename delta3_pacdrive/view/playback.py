"""A recording on the page: a slider over its time, at speeds from 0.01 to 4."""

import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from delta3_pacdrive import interrupts, kinematics
from delta3_pacdrive.analysis.runs import FAULT, Mark, Run
from delta3_pacdrive.drive.state_machine import overload_after
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.motion.move import OUTPUTS
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.peripherals.cell_scene import Thing, brings_parts
from delta3_pacdrive.sercos.telegrams import BRAKE_FREE, BRAKE_HELD
from delta3_pacdrive.view.page import PICTURES_HZ, Page
from delta3_pacdrive.view.plots import rows_of
from delta3_pacdrive.view.values import (
    CellInstant,
    DriveFacts,
    Facts,
    InputFacts,
    Instant,
    PartPlace,
    TurnInstant,
)

PICTURE_S = 1.0 / PICTURES_HZ
UNDER_WAY_S = 3.0  # to a page that draws slowly, at most
SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
WORDS = tuple(f'{value:g}' for value in SPEEDS)
STEPS = ('-1', '+1')  # cycles
SLIDER_S = 0.1  # between two updates of the slider while it plays
PLAN_POINTS = 2000
ROWS_MAX = 1500  # of plots: more than there are pixels
NEEDED = ('motor_position',)


class Clock:
    """The time that is shown [s]: it runs at a speed, stands, is set, and begins again where the recording ends."""

    def __init__(self, first_s: float, last_s: float) -> None:
        self.first_s, self.last_s = first_s, last_s
        self.time_s, self.speed = first_s, 1.0
        self.playing = self.again = True

    def advance(self, seconds: float) -> None:
        """Let it run for a time of the wall clock [s]."""
        if not self.playing:
            return
        self.time_s += self.speed * seconds
        if self.time_s < self.last_s:
            return
        self.time_s = self.first_s if self.again else self.last_s
        self.playing = self.again

    def play(self) -> None:
        """Go on, from the begin if it stands at the end."""
        if self.time_s >= self.last_s:
            self.time_s = self.first_s
        self.playing = True

    def seek(self, time_s: float) -> None:
        """Show another time."""
        self.time_s = max(self.first_s, min(self.last_s, time_s))  # nan is the end


class Film:
    """A run gives instants by their time, and what there is to read.

    Parameters
    ----------
    run
        A recording, or a program that was simulated.

    Raises
    ------
    TraceError
        It has no positions of the motors.

    """

    def __init__(self, run: Run) -> None:
        trace, robot = run.part, run.robot
        if absent := [name for name in NEEDED if name not in trace.signals]:
            raise TraceError(
                f'{run.name} cannot be shown without {", ".join(absent)} (topics sercos/at/axis1 to axis3): it has '
                f'only {", ".join(trace.signals) or "no signals"}'
            )
        self.run, self.robot, self.time_s = run, robot, trace.time_s
        self._signals = trace.signals
        self._theta = trace['motor_position'] / robot.dynamics.gear_ratio
        nothing = np.zeros_like(self._theta)
        self._lag = trace.signals.get('following_error', nothing)
        self._current = trace.signals.get('current', nothing)
        self._true = trace.signals.get('tcp_true')
        self._tcp = kinematics.forward(self._theta, robot, unreachable='nan')
        self._speed = np.zeros(len(self.time_s))
        if len(self.time_s) > 1:
            self._speed = np.linalg.norm(np.gradient(self._tcp, self.time_s, axis=0), axis=1)
        nominal, limit = robot.motor.nominal_current_a, robot.drive.overload_time_s
        # the drives' monitoring takes all samples of a cycle
        load = trace.signals.get('current_rms', self._current)
        self._error = error_of(trace.signals, self._tcp, self._theta + self._lag, robot)
        self._overload = overload_of(load / nominal, run.period_s) / limit
        torque = robot.motor.torque_constant_n_m_a * self._current
        self._rows = rows_of(
            self.time_s, self._theta, self._lag, torque, self._current, self._speed, self._error, robot
        )
        self._rows = self._rows[np.isfinite(self._rows).all(axis=1)]

    def row(self, time_s: float) -> int:
        """Return the number of the cycle that is shown at a time."""
        return int(np.clip(np.searchsorted(self.time_s, time_s, side='right') - 1, 0, len(self.time_s) - 1))

    def before(self, time_s: float, seconds: float) -> Floats:
        """Return what is plotted of the seconds before a time, no more rows than anybody sees."""
        first, end = np.searchsorted(self._rows[:, 0], [time_s - seconds, time_s + 0.5 * self.run.period_s])
        # the same rows are left out whatever the time is: curves would tremble else
        step = max(1, int(min(seconds, np.ptp(self.time_s)) / self.run.period_s) // ROWS_MAX)
        return np.asarray(self._rows[first - first % step : end : step])

    def at(self, row: int) -> Instant:
        """Return the instant of a cycle."""
        current = self._current[row]
        return Instant(
            float(self.time_s[row]),
            self._theta[row],
            self._lag[row],
            self.robot.motor.torque_constant_n_m_a * current,
            current,
            self._overload[row],
            float(self._speed[row]),
            None if self._true is None else self._true[row],
            self._error[row],
            self._cell_at(row),
            self._turn_at(row),
        )

    def _turn_at(self, row: int) -> TurnInstant | None:
        """Return the tool in a cycle, of a recording that tells of its rotary axis."""
        angle, error, true = (
            float(self._signals[name][row, 0]) if name in self._signals else None
            for name in ('turn_position', 'turn_error', 'turn_true')
        )
        return None if angle is None else TurnInstant(angle, error or 0.0, true)

    @property
    def things(self) -> tuple[Thing, ...]:
        """What stands around the robot."""
        return () if self.run.cell is None else self.run.cell.things

    def _cell_at(self, row: int) -> CellInstant | None:
        """Return what moves around the robot in a cycle."""
        story = self.run.cell
        if story is None:
            return None
        start = int(self.run.part.meta.get('start_cycle') or 0)  # of the program, from which times count
        cycle = round(float(self.time_s[row]) / self.run.period_s) + start
        x, y, z = self._tcp[row].tolist()
        parts = []
        turn = self._turn_at(row)
        for part, place, angle in story.at(cycle, (x, y, z), turn.angle_rad if turn else 0.0):
            length, width, height = part['size_m']
            parts.append(PartPlace(part['number'], part['type'], (length, width, height), place, angle))
        return CellInstant(tuple(parts), {name: story.way_m(name, cycle) for name in story.belts})

    def _inputs(self, row: int) -> tuple[InputFacts, ...]:
        """Return the inputs of a cycle, if they are recorded."""
        cell = self.run.part.meta.get('cell')
        if cell is None or 'cell_inputs' not in self._signals:
            return ()
        values = self._signals['cell_inputs'][row]
        return tuple(InputFacts(name, bool(on)) for name, on in zip(cell['inputs'], values, strict=False))

    def facts(self, row: int, state: str, speed: float) -> Facts:
        """Return what there is to read in a cycle, while it is played at a speed or stands."""
        run, time_s = self.run, float(self.time_s[row])
        begun = [move for move in run.moves if move.start_s <= time_s]
        faults = [mark for mark in run.marks if mark.kind == FAULT and mark.time_s <= time_s]
        fault = faults[-1] if faults else Mark(time_s, FAULT, '')
        payload_kg = self.robot.dynamics.payload_mass_kg
        on: dict[str, bool] = {}
        for change in run.outputs:
            if change['time_s'] <= time_s:
                on[change['name']] = bool(change['value'])
                payload_kg = payload_kg if change['payload_kg'] is None else float(change['payload_kg'])
        return Facts(
            state=state,
            recording=run.title,
            cycle=round(time_s / run.period_s),
            bus_time_s=time_s,
            override=speed,
            fault=fault.text,
            sources=fault.sources,
            move=max(len(begun) - 1, 0),
            moves=len(run.moves),
            drives=self._drives(time_s),
            remaining_s=max(float(self.time_s[-1]) - time_s, 0.0),
            payload_kg=None if brings_parts(self.things) else payload_kg,
            outputs=sum(1 << number for number, name in enumerate(OUTPUTS) if on.get(name)),
            inputs=self._inputs(row),
            controller='' if run.robot_note else run.robot.controller,
        )

    def _drives(self, time_s: float) -> tuple[DriveFacts, ...]:
        """Return what the status word of each drive told at a time."""
        if not self.run.drives:
            return Facts().drives
        told = []
        for changes in self.run.drives:
            n = bisect_right(changes, time_s + 0.5 * self.run.period_s, key=lambda change: change.time_s)
            now = changes[n - 1] if n else None
            brake = '' if now is None or now.released is None else BRAKE_FREE if now.released else BRAKE_HELD
            told.append(DriveFacts(now.state if now else '', brake))
        return tuple(told)

    def path(self) -> Floats:
        """Return points of the path that was commanded, else of that which was travelled [m], shape (n, 3)."""
        points = self._signals.get('tcp_command', self._tcp)
        points = points[np.isfinite(points).all(axis=1)]
        return np.asarray(points[:: max(1, len(points) // PLAN_POINTS)])


def error_of(
    signals: Mapping[str, Floats], tcp_m: Floats, command_rad: Floats, parameters: Parameters
) -> Floats:
    """Return the TCP error [m], shape (n, 3): as the robot has told it, else from where the arms should be.

    Parameters
    ----------
    signals
        Of a recording.
    tcp_m
        Places of the TCP [m], shape (n, 3).
    command_rad
        Arm angles with the following errors that were told, shape (n, 3).
    parameters
        Of the robot.

    """
    if 'tcp_error' in signals:
        return signals['tcp_error']
    return kinematics.forward(command_rad, parameters, unreachable='nan') - tcp_m


def overload_of(ratio: Floats, period_s: float) -> Floats:
    """Return the integral [s] that the I2t monitoring of each drive has at the end of each cycle.

    Parameters
    ----------
    ratio
        Current over nominal current, shape (n, 3); nan where it is not known: the integral stays as it was.
    period_s
        Time between two of them [s].

    Returns
    -------
    Floats
        Shape (n, 3).

    """
    found = np.zeros_like(ratio)
    for axis in range(ratio.shape[1]):
        load = 0.0
        for n in range(len(ratio)):
            if np.isfinite(ratio[n, axis]):
                load = overload_after(load, ratio[n, axis], period_s)
            found[n, axis] = load
    return found


class Player:
    """Buttons and slider of a recording on the page, and the loop that shows it.

    Parameters
    ----------
    page
        Shows it.
    film
        The recording.

    """

    def __init__(self, page: Page, film: Film) -> None:
        self._page, self._film = page, film
        first, last = float(film.time_s[0]), float(film.time_s[-1])
        self.clock = Clock(first, last)
        self._stopping = False
        self._slid_s = self._moved_s = 0.0
        self._asked: deque[Callable[[], None]] = deque()  # by the threads of the page; the loop does it
        gui: Any = page.server.gui
        with page.top:
            self._slider = gui.add_slider('time s', first, max(last, first + 1e-3), 1e-3, first)
            buttons = gui.add_button_group('play', ('Play', 'Pause', *STEPS, 'Begin'))
            speed = gui.add_dropdown('speed', WORDS, initial_value='1')
            again = gui.add_checkbox('again and again', True)
        self._slider.on_update(self._slide)
        buttons.on_click(lambda event: self._asked.append(partial(self._press, event.target.value)))
        speed.on_update(lambda _: self._asked.append(partial(self._run_at, speed.value)))
        again.on_update(lambda _: self._asked.append(partial(setattr, self.clock, 'again', again.value)))
        page.rows = lambda seconds: film.before(self.clock.time_s, seconds)
        page.plan(film.path())
        page.stand(film.things)

    def _slide(self, event: Any) -> None:
        if event.client is not None:  # the clock moves it as well
            self._asked.append(partial(self._show, float(self._slider.value)))

    def _show(self, time_s: float) -> None:
        if time.monotonic() - self._moved_s < UNDER_WAY_S:
            # What is under way to the page moves its slider once more. Here it is where it was asked to be already, so
            # that nothing would be sent that puts it right: it has to move.
            self._slider.value = self.clock.first_s
        self.clock.playing = False
        self.clock.seek(time_s)
        self._slider.value = round(self.clock.time_s, 3)

    def _run_at(self, text: str) -> None:
        if text in WORDS:  # a page may say anything
            self.clock.speed = float(text)

    def _press(self, word: str) -> None:
        clock, film = self.clock, self._film
        if word == 'Play':
            clock.play()
            return
        clock.playing = False
        if word == 'Begin':
            clock.seek(clock.first_s)
        elif word in STEPS:
            row = min(max(film.row(clock.time_s) + int(word), 0), len(film.time_s) - 1)
            clock.seek(float(film.time_s[row]))

    def stop(self) -> None:
        """Let ``run`` end."""
        self._stopping = True

    def run(self) -> None:
        """Show it until it is stopped."""
        due = then = time.monotonic()
        while not self._stopping:
            due = max(due + PICTURE_S, then)  # on a grid; not to catch up
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            self.clock.advance(now - then)
            then = now
            while self._asked:
                self._asked.popleft()()
            self._draw(now)

    def _draw(self, now: float) -> None:
        row = self._film.row(self.clock.time_s)
        self._page.show(self._film.at(row))
        if now - self._slid_s >= SLIDER_S:
            self._slid_s = now
            self._slider.value = round(self.clock.time_s, 3)
            if self.clock.playing:
                self._moved_s = now
            state = 'playing' if self.clock.playing else 'paused'
            self._page.read(self._film.facts(row, state, self.clock.speed))


def run(page: Page, film: Film) -> None:
    """Show a recording until a signal asks for the end."""
    player = Player(page, film)
    page.open()
    with interrupts.answered_by(player.stop, interrupts.PATIENCE_S):
        player.run()

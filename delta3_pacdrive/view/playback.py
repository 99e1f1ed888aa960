"""Playback of a recording on the page, with a time slider and speeds from 0.01 to 4."""

import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from delta3_pacdrive import interrupts, kinematics
from delta3_pacdrive.cell.cell_scene import Thing, brings_parts
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ROTARY_AXES_MAX, Parameters, numbered
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.robot.drive.state_machine import overload_after
from delta3_pacdrive.robot.sercos.telegrams import BRAKE_FREE, BRAKE_HELD
from delta3_pacdrive.studies.runs.runs import FAULT, Mark, Run
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
    tool_angle_rad,
)

PICTURE_S = 1.0 / PICTURES_HZ
UNDER_WAY_S = 3.0  # maximum latency of a page that draws slowly
SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
WORDS = tuple(f'{value:g}' for value in SPEEDS)
STEPS = ('-1', '+1')  # cycles
SLIDER_S = 0.1  # update period of the slider during playback
PLAN_POINTS = 2000
ROWS_MAX = 1500  # of plots: more than pixels
NEEDED = ('motor_position',)


class Clock:
    """The displayed time [s]: it runs at a speed, pauses, can be set, and optionally repeats at the end."""

    def __init__(self, first_s: float, last_s: float) -> None:
        self.first_s, self.last_s = first_s, last_s
        self.time_s, self.speed = first_s, 1.0
        self.playing = self.again = True

    def advance(self, seconds: float) -> None:
        """Advance by an elapsed wall-clock time [s]."""
        if not self.playing:
            return
        self.time_s += self.speed * seconds
        if self.time_s < self.last_s:
            return
        self.time_s = self.first_s if self.again else self.last_s
        self.playing = self.again

    def play(self) -> None:
        """Continue, or restart at the end."""
        if self.time_s >= self.last_s:
            self.time_s = self.first_s
        self.playing = True

    def seek(self, time_s: float) -> None:
        """Set the time."""
        self.time_s = max(self.first_s, min(self.last_s, time_s))  # nan becomes the end


class Film:
    """Instants and facts of a recorded or simulated run, by time.

    Raises
    ------
    TraceError
        The run has no motor positions.

    """

    def __init__(self, run: Run) -> None:
        trace, robot = run.window, run.robot
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
        # the drives monitor all samples of a cycle
        load = trace.signals.get('current_rms', self._current)
        self._error = error_of(trace.signals, self._tcp, self._theta + self._lag, robot)
        self._overload = overload_of(load / nominal, run.period_s) / limit
        torque = robot.motor.torque_constant_n_m_a * self._current
        self._rows = rows_of(
            time_s=self.time_s,
            theta_rad=self._theta,
            lag_rad=self._lag,
            torque_n_m=torque,
            current_a=self._current,
            speed_m_s=self._speed,
            error_m=self._error,
            parameters=robot,
        )
        self._rows = self._rows[np.isfinite(self._rows).all(axis=1)]

    def row(self, time_s: float) -> int:
        """Return the index of the cycle displayed at a time."""
        return int(np.clip(np.searchsorted(self.time_s, time_s, side='right') - 1, 0, len(self.time_s) - 1))

    def before(self, time_s: float, seconds: float) -> Floats:
        """Return plot rows of the seconds before a time, decimated to the resolution of a plot."""
        first, end = np.searchsorted(self._rows[:, 0], [time_s - seconds, time_s + 0.5 * self.run.period_s])
        # decimate on a fixed grid: otherwise curves would jitter
        step = max(1, int(min(seconds, np.ptp(self.time_s)) / self.run.period_s) // ROWS_MAX)
        return np.asarray(self._rows[first - first % step : end : step])

    def at(self, row: int) -> Instant:
        """Return the state in a cycle."""
        current = self._current[row]
        return Instant(
            time_s=float(self.time_s[row]),
            theta_rad=self._theta[row],
            lag_rad=self._lag[row],
            torque_n_m=self.robot.motor.torque_constant_n_m_a * current,
            current_a=current,
            overload=self._overload[row],
            speed_m_s=float(self._speed[row]),
            true_m=None if self._true is None else self._true[row],
            error_m=self._error[row],
            cell=self._cell_at(row),
            turns=self._turns_at(row),
        )

    def _turns_at(self, row: int) -> tuple[TurnInstant, ...]:
        """Return the recorded rotary axes in a cycle."""
        found = []
        for number in range(ROTARY_AXES_MAX):
            angle, error, true = (
                float(self._signals[name][row, 0]) if name in self._signals else None
                for name in (numbered(name, number) for name in ('turn_position', 'turn_error', 'turn_true'))
            )
            if angle is not None:
                found.append(TurnInstant(angle, error or 0.0, true))
        return tuple(found)

    @property
    def things(self) -> tuple[Thing, ...]:
        """Fixtures of the cell."""
        return () if self.run.cell is None else self.run.cell.things

    def _cell_at(self, row: int) -> CellInstant | None:
        """Return the moving objects of the cell in a cycle."""
        story = self.run.cell
        if story is None:
            return None
        start = int(
            self.run.window.meta.get('start_cycle') or 0
        )  # of the program: origin of the cell's times
        cycle = round(float(self.time_s[row]) / self.run.period_s) + start
        x, y, z = self._tcp[row].tolist()
        parts = []
        tool_rad = tool_angle_rad(self._turns_at(row))
        for part, place, angle in story.at(cycle, (x, y, z), tool_rad):
            length, width, height = part['size_m']
            parts.append(PartPlace(part['number'], part['type'], (length, width, height), place, angle))
        return CellInstant(tuple(parts), {name: story.way_m(name, cycle) for name in story.belts})

    def _inputs(self, row: int) -> tuple[InputFacts, ...]:
        """Return the recorded inputs of a cycle."""
        cell = self.run.window.meta.get('cell')
        if cell is None or 'cell_inputs' not in self._signals:
            return ()
        values = self._signals['cell_inputs'][row]
        return tuple(InputFacts(name, bool(on)) for name, on in zip(cell['inputs'], values, strict=False))

    def facts(self, row: int, state: str, speed: float) -> Facts:
        """Return the facts of a cycle, for a playback state and speed."""
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
        """Return the states of the drives at a time, from their status words."""
        if not self.run.drives:
            return Facts().drives
        found = []
        for changes in self.run.drives:
            n = bisect_right(changes, time_s + 0.5 * self.run.period_s, key=lambda change: change.time_s)
            now = changes[n - 1] if n else None
            brake = '' if now is None or now.released is None else BRAKE_FREE if now.released else BRAKE_HELD
            found.append(DriveFacts(now.state if now else '', brake))
        return tuple(found)

    def path(self) -> Floats:
        """Return points of the commanded path, else of the travelled path [m], shape (n, 3)."""
        points = self._signals.get('tcp_command', self._tcp)
        points = points[np.isfinite(points).all(axis=1)]
        return np.asarray(points[:: max(1, len(points) // PLAN_POINTS)])


def error_of(
    signals: Mapping[str, Floats], tcp_m: Floats, command_rad: Floats, parameters: Parameters
) -> Floats:
    """Return the TCP error [m], shape (n, 3): the recorded one, else from commanded arm angles.

    Parameters
    ----------
    signals
        Recorded signals by name.
    tcp_m
        TCP positions [m], shape (n, 3).
    command_rad
        Arm angles plus recorded following errors, shape (n, 3).
    parameters
        Parameters of the robot.

    """
    if 'tcp_error' in signals:
        return signals['tcp_error']
    return kinematics.forward(command_rad, parameters, unreachable='nan') - tcp_m


def overload_of(ratio: Floats, period_s: float) -> Floats:
    """Return the integral [s] of the I2t monitoring of each drive at the end of each cycle, shape (n, 3).

    Parameters
    ----------
    ratio
        Current over nominal current, shape (n, 3); the integral is unchanged where it is nan.
    period_s
        Sample time [s].

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
    """The controls of a recording on the page, and the playback loop."""

    def __init__(self, page: Page, film: Film) -> None:
        self._page, self._film = page, film
        first, last = float(film.time_s[0]), float(film.time_s[-1])
        self.clock = Clock(first, last)
        self._stopping = False
        self._slid_s = self._moved_s = 0.0
        self._requests: deque[Callable[[], None]] = (
            deque()
        )  # requests of the page's threads, executed by the loop
        gui: Any = page.server.gui
        with page.top:
            self._slider = gui.add_slider('time s', first, max(last, first + 1e-3), 1e-3, first)
            buttons = gui.add_button_group('play', ('Play', 'Pause', *STEPS, 'Begin'))
            speed = gui.add_dropdown('speed', WORDS, initial_value='1')
            again = gui.add_checkbox('repeat', True)
        self._slider.on_update(self._slide)
        buttons.on_click(lambda event: self._requests.append(partial(self._press, event.target.value)))
        speed.on_update(lambda _: self._requests.append(partial(self._run_at, speed.value)))
        again.on_update(lambda _: self._requests.append(partial(setattr, self.clock, 'again', again.value)))
        page.rows = lambda seconds: film.before(self.clock.time_s, seconds)
        page.show_path(film.path())
        page.show_cell(film.things)

    def _slide(self, event: Any) -> None:
        if event.client is not None:  # not an update by the clock
            self._requests.append(partial(self._show, float(self._slider.value)))

    def _show(self, time_s: float) -> None:
        if time.monotonic() - self._moved_s < UNDER_WAY_S:
            # An update that is still being sent to the page will move its slider once more. The value here is already
            # the requested one, so no correction would be sent; therefore change it first.
            self._slider.value = self.clock.first_s
        self.clock.playing = False
        self.clock.seek(time_s)
        self._slider.value = round(self.clock.time_s, 3)

    def _run_at(self, text: str) -> None:
        if text in WORDS:  # a browser may send any value
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
        """Make ``run`` return."""
        self._stopping = True

    def run(self) -> None:
        """Play until stopped."""
        due = then = time.monotonic()
        while not self._stopping:
            due = max(due + PICTURE_S, then)  # on a grid; late pictures are skipped
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            self.clock.advance(now - then)
            then = now
            while self._requests:
                self._requests.popleft()()
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
    """Play a recording until a signal ends it."""
    player = Player(page, film)
    page.open()
    with interrupts.answered_by(player.stop, interrupts.PATIENCE_S):
        player.run()

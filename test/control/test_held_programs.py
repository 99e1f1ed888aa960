"""Held, overridden, resumed and extended in any order, a program runs to its end without a missing corner."""

import json
import random
from typing import Any

import numpy as np
import pytest

from thoroughness import examples

SEEDS = examples(24)
REACHED_M = 1e-3
OVERRIDES = ('40', '70', '100')
SIDE_M = 0.04  # least length of a line, at least twice its blend


class Course:
    """Lines and rounded corners that the robot has to drive, and how far it is."""

    def __init__(self, rig: Any, seed: int) -> None:
        self.rig, self.chance = rig, random.Random(seed)
        self.corners: list[tuple[np.ndarray, float]] = []  # place and blend of each line's end
        self.reached = 0
        self.told: list[str] = []
        self.here, self.way = np.array(rig.robot.motion.home_m), np.zeros(3)
        command = rig.task.command

        def commanded(cycle: int) -> Any:
            result = command(cycle)
            self._look(rig.task.state['tcp'][0])
            return result

        rig.task.command = commanded
        rig.enable()

    def _look(self, tcp: np.ndarray) -> None:
        while self.reached < len(self.corners):
            place, blend_m = self.corners[self.reached]
            if np.linalg.norm(tcp - place) > blend_m + REACHED_M:
                return
            self.reached += 1

    def _place(self) -> np.ndarray:
        """Return a random place to which the path neither is short nor turns back."""
        while True:
            to = np.array([self.chance.uniform(-0.08, 0.08), self.chance.uniform(-0.08, 0.08), -0.8])
            way = to - self.here
            if np.linalg.norm(way) > SIDE_M and way @ self.way > -0.5 * np.linalg.norm(way):
                return np.round(to, 6)

    def _line(self, to: np.ndarray, blend_m: float) -> dict[str, Any]:
        self.way = (to - self.here) / np.linalg.norm(to - self.here)
        self.here = to
        self.corners.append((to, blend_m))
        return {'move_l': {'to_m': to.tolist(), 'blend_m': blend_m, 'speed_m_s': 0.8}}

    def lines(self, count: int) -> list[dict[str, Any]]:
        """Return lines to random places, most of them with a blend, and outputs; expect the robot at their ends."""
        written = []
        for _ in range(count):
            written.append(self._line(self._place(), self.chance.choice((0.0, 0.005, 0.01, 0.02))))
            if self.chance.random() < 0.2:
                written.append({'output': {'name': 'output1', 'value': self.chance.random() < 0.5}})
        return written

    def program(self) -> str:
        """Return a first program: rounds without a stop, more statements than may be planned anew, or a few."""
        kind = self.chance.choice(('rounds', 'rounds', 'long', 'short'))
        if kind != 'rounds':
            return json.dumps({'moves': self.lines(102 if kind == 'long' else 4)})
        rounds, angle = self.chance.choice((2, 3, 26)), self.chance.uniform(0.0, 6.0)
        angles = angle + np.arange(4) * 0.5 * np.pi
        places = np.round(
            np.stack([0.035 * np.cos(angles), 0.035 * np.sin(angles), 0.0 * angles - 0.8], axis=1), 6
        )
        self.here = places[-1]
        lines = [self._line(place, 0.01) for place in places]
        self.corners *= rounds
        return json.dumps({'moves': lines, 'repeat': rounds, 'start_m': self.here.tolist()})

    def ask(self, action: str, text: str = '') -> str:
        accepted, sentence = self.rig.ask(action, text)
        self.told.append(f'{action} {text[:60]}: {sentence}')
        assert accepted, self.told
        return str(sentence)

    def step(self) -> None:
        """Hold, resume, override, append, or let time pass."""
        rig, chance = self.rig, self.chance
        what = chance.choice(('hold', 'resume', 'override', 'append', 'append', 'run', 'run'))
        if what == 'hold' and rig.state.motion == 'moving':
            rig.do('hold')
        elif what == 'resume' and rig.state.motion == 'stopped':
            self.ask('resume')
        elif what == 'override':
            self.ask('override', chance.choice(OVERRIDES))
        elif what == 'append':
            self.ask('move', json.dumps(self.lines(chance.randint(1, 3))))
        else:
            rig.run(chance.choice((1, 7, 60, 400)))

    def finish(self) -> None:
        """Drive the rest at full speed."""
        rig = self.rig
        self.ask('override', '100')
        for _ in range(300):
            if rig.state.motion == 'idle':
                return
            if rig.state.motion == 'stopped':
                self.ask('resume')
            rig.run(100)
        raise AssertionError(f'still {rig.state.motion}')


@pytest.mark.parametrize('seed', range(SEEDS))
def test_moves_are_appended_at_any_time_and_every_corner_is_driven(seed: int, rig: Any) -> None:
    course = Course(rig, seed)
    text = course.program()
    first = json.loads(text).get('start_m')
    if first is not None:
        assert rig.ask('move', json.dumps({'move_l': {'to_m': first}}))[0]
        rig.finish()
        course.reached = 0
    course.ask('move', text)
    for _ in range(12):
        course.step()
    course.finish()
    assert course.reached == len(course.corners), course.told
    assert np.abs(rig.task.state['tcp'][0] - course.here).max() < 1e-6

"""After any sequence of requests, the documented requests make the robot ready, and every reply is true."""

import json
import os
import random
from collections.abc import Callable
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import FaultCode, RobotFault
from thoroughness import examples

SEQUENCES = int(os.environ.get('DELTA3_SEQUENCES', examples(300)))
LENGTH = 50
HOME = kinematics.inverse((0.0, 0.0, -0.75), parameters.load().kinematics)
# the first and the last lead anywhere but beyond the workspace; short, so that they end within a sequence


def arms(time_s: float, by: float, speed_rad_s: float = 0.0) -> dict[str, Any]:
    """Return a point of arm angles, so far from the start."""
    angles = [angle + by * share for angle, share in zip(HOME.tolist(), (1.0, 0.5, 0.8), strict=True)]
    return {'time_s': time_s, 'angles_rad': angles, 'speeds_rad_s': [speed_rad_s] * 3}


def joints(*points: dict[str, Any]) -> str:
    return json.dumps({'joints': {'points': points}})


PROGRAMS = (
    f'moves: [{joints(arms(0.4, 0.05))}, {{move_l: {{to_m: [0.0, 0.0, -0.75]}}}}]',
    'moves: [{move_l: {to_m: [0.03, 0.0, -0.75]}}]',
    'moves: [{move_l: {to_m: [0.0, 0.02, -0.76], blend_m: 0.005}}, {move_l: {to_m: [0.0, 0.0, -0.75]}}]',
    'moves: [{move_l: {to_m: [0.0, 0.0, -0.2]}}]',
    'moves: [{move_l: {to_m: up}}]',
    'moves: [{dwell: {time_s: 0.05}}]',
    '][',
)
MOVES = (
    'move_l: {to_m: [0.02, 0.0, -0.76], blend_m: 0.004}',
    '[{move_l: {to_m: [0.0, 0.0, -0.74], blend_m: 0.003}}, {move_l: {to_m: [0.0, 0.02, -0.76]}}]',
    '{move_l: {to_m: [0.0, -0.02, -0.75]}, start: false}',
    '[{dwell: {time_s: 0.02}}, {output: {name: gripper, value: true}}]',
    'move_l: {to_m: [0.0, 0.0, -0.2]}',
    joints(arms(0.3, 0.06)),
    f'[{joints(arms(0.2, 0.03, 0.2), arms(0.4, 0.06))}, {{move_l: {{to_m: [0.0, 0.0, -0.75]}}}}]',
    joints(arms(0.01, 0.06)),  # too fast for the motors
)
TRAJECTORIES = (
    TrajectoryRequest(0.0, [arms(0.3, 0.04)]),
    TrajectoryRequest(0.0, [arms(0.2, 0.03, 0.2), arms(0.5, 0.0)]),
    TrajectoryRequest(0.0, [arms(0.5, 2.0)]),  # beyond the limit of the arms
    TrajectoryRequest(0.001, [arms(0.02, 0.01)]),  # over
    TrajectoryRequest(0.0, []),  # a stop
)
REQUESTS = ('move', 'move', 'start', 'resume', 'clear', 'program', 'override', 'withdraw', 'trajectory')
SERVICES = ('enable', 'disable', 'hold', 'abort', 'emergency_stop', 'reset')


FOUND = (
    5980,
    6663,
)  # seeds that found something: a queue that a refused start filled; a start right behind an end


class Sequence:
    """One random sequence of requests of two operators and of clients without an identity."""

    def __init__(self, rig: Any, seed: int) -> None:
        self.rig, self.chance = rig, random.Random(seed)
        self.told: list[str] = []

    def step(self) -> None:
        chance, rig = self.chance, self.rig
        kind = chance.random()
        holder = rig.control.operator
        identity = holder.identity if holder else ''
        if rig.state.motion in ('moving', 'stopping', 'stopped') and chance.random() < 0.4:
            self._ask('move', identity)
        elif rig.state.enabled and not rig.planner.queue[0] and chance.random() < 0.3:
            self._ask('trajectory', identity)
        elif kind < 0.45:
            self._ask(chance.choice(REQUESTS), chance.choice(['', '', 'A', 'B']))
        elif kind < 0.75:
            self._do(chance.choice(SERVICES))
        elif kind < 0.8:
            identity = chance.choice('AB')
            rig.take_control(identity, chance.random() < 0.5)
            self.told.append(f'{identity} takes control')
        elif kind < 0.83:
            rig.control.release(chance.choice('AB'))
            rig.tell()
        elif kind < 0.86:
            rig.state.stop(RobotFault(FaultCode.DISABLED, 'a fault that somebody has injected'))
            rig.settle()
            rig.tell()
        else:
            rig.run(chance.randrange(300))
            self.told.append(f'time passes: {rig.state.motion}')
        self.check()

    def _ask(self, action: str, operator: str) -> None:
        chance, rig = self.chance, self.rig
        text = {
            'program': chance.choice(PROGRAMS),
            'move': chance.choice(MOVES),
            'override': chance.choice(['50', '150', '100', '1', '999', 'fast']),
            'withdraw': str(rig.asked),
            'trajectory': chance.choice(TRAJECTORIES).to_json(),
        }.get(action, '')
        before = rig.planner.queue
        motion, losses = rig.state.motion, rig.control.losses
        holder, order = rig.control.operator, rig.planner.status.order
        accepted, sentence = rig.ask(action, text, operator)
        self.told.append(f'{operator or "anybody"}: {action} {text}: {accepted} {sentence}')
        assert sentence
        assert '\n' not in sentence
        if holder is not None and rig.control.operator == holder and holder.identity != operator:
            assert not accepted or action == 'withdraw'
        if action == 'start' or (action == 'trajectory' and '"points": []' not in text):
            # who is told that it has started finds it moving, and who is refused finds everything as before; what is
            # asked for in the last cycles of a program may start when that has ended
            started = rig.state.motion == 'moving' and (
                motion != 'moving' or rig.planner.status.order != order
            )
            assert accepted == started, self.told[-5:]
            assert accepted or rig.planner.queue[0] == before[0] or rig.control.losses > losses
        if action == 'resume' and accepted:
            assert rig.state.motion == 'moving'
        if action == 'move' and not accepted:
            assert rig.planner.queue[0] == before[0] or rig.control.losses > losses

    def _do(self, action: str) -> None:
        rig = self.rig
        accepted, sentence = rig.do(action)
        self.told.append(f'{action}: {accepted} {sentence}')
        assert sentence
        if action == 'reset':
            assert accepted == (not rig.state.fault and sentence.startswith('faults cleared'))
        if action == 'enable':
            assert accepted == rig.state.enabled

    def check(self) -> None:
        rig = self.rig
        tcp = rig.task.state['tcp'][0]
        assert np.isfinite(tcp).all()
        assert abs(tcp[0]) < 0.2
        assert -1.0 < tcp[2] < -0.6

    def lead_out(self) -> None:
        """Follow the documentation: reset, enable, clear; then a move works."""
        rig = self.rig
        rig.take_control('A', by_force=True)
        rig.beating = 'A'
        if rig.state.motion in ('moving', 'stopping', 'stopped'):
            accepted, sentence = rig.do('abort')
            assert accepted, sentence
            rig.finish()
        rig.run(60)
        if rig.state.fault:
            accepted, sentence = rig.do('reset')
            assert accepted, sentence
        accepted, sentence = rig.do('enable')
        assert accepted, sentence
        rig.run(50)
        accepted, sentence = rig.ask('clear', operator='A')
        assert accepted, sentence
        assert rig.planner.queue == (0, 0.0)
        before = rig.task.state['tcp'][0].copy()
        accepted, sentence = rig.ask(
            'program', 'moves: [{move_l: {to_m: {by_m: [0.0, 0.0, -0.01]}}}]', operator='A'
        )
        assert accepted, sentence
        accepted, sentence = rig.ask('start', operator='A')
        assert accepted, sentence
        rig.finish()
        assert np.abs(rig.task.state['tcp'][0] - before - [0.0, 0.0, -0.01]).max() < 1e-9


def test_after_any_sequence_of_requests_the_documented_ones_lead_out(new_rig: Callable[[], Any]) -> None:
    followed = driven = 0
    for seed in (*range(SEQUENCES), *FOUND):
        sequence = Sequence(new_rig(), seed)
        try:
            for _ in range(LENGTH):
                sequence.step()
            sequence.lead_out()
        except BaseException:
            print(f'seed {seed}:\n' + '\n'.join(sequence.told[-20:]))
            raise
        followed += sum(' statements follow' in told for told in sequence.told)
        driven += sum('True started "joint_trajectory"' in told for told in sequence.told)
    assert driven > SEQUENCES / 10
    assert followed > SEQUENCES / 10  # moves are taken while the robot moves, too

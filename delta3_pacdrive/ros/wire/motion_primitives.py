"""Conversion of ``control_msgs/MotionPrimitive`` to a program, as in motion_primitives_controllers of ros2_controllers.

A primitive becomes one statement: LINEAR_CARTESIAN a MoveL, CIRCULAR_CARTESIAN a MoveC, and LINEAR_JOINT arm angles
over time, in which all arms start and end together.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.errors import ProgramError, UnreachableError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.planning import rest_to_rest
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import BASE_FRAME
from delta3_pacdrive.ros.wire.move_messages import Statement, point_of_pose

NAME = 'motion sequence'
BASE = BASE_FRAME.decode()
MOTIONS_MAX = 1024  # of a goal, the capacity of the queue of the controller
LINEAR_JOINT, LINEAR_CARTESIAN, CIRCULAR_CARTESIAN = 0, 50, 51  # constants of the message
TYPES = {
    LINEAR_JOINT: 'LINEAR_JOINT',
    LINEAR_CARTESIAN: 'LINEAR_CARTESIAN',
    CIRCULAR_CARTESIAN: 'CIRCULAR_CARTESIAN',
}
LIMITS = {'velocity': 'speed_m_s', 'acceleration': 'acceleration_m_s2'}  # and their names in programs
MOVE_TIME = 'move_time'
ARGUMENTS = (*LIMITS, MOVE_TIME)


def sequence_program(motions: Sequence[Any], start_m: Floats, lengths: Kinematics, base: str = BASE) -> str:
    """Return the program of a sequence in JSON.

    Parameters
    ----------
    motions
        Messages.
    start_m
        TCP position at the start [m], shape (3,).
    lengths
        Kinematics of the robot.
    base
        Frame that poses may name.

    Raises
    ------
    ProgramError
        A primitive is not valid for this robot; names it by its index in ``motions``.

    """
    if not motions:
        raise ProgramError('the sequence has no motions; to stop, cancel the goal')
    if len(motions) > MOTIONS_MAX:
        raise ProgramError(f'the sequence has {len(motions)} motions, the limit is {MOTIONS_MAX}')
    reader = _Sequence(start_m, lengths, base)
    statements = []
    for number, motion in enumerate(motions):
        try:
            statements.append(reader.statement(motion, number == len(motions) - 1))
        except ProgramError as error:
            raise ProgramError(f'motions[{number}]: {error}') from None
    return json.dumps({'name': NAME, 'start_m': start_m.tolist(), 'moves': statements})


@dataclass
class _Sequence:
    """The position [m] that the sequence has reached, and whether its last primitive has a blend.

    ``base`` is the frame of its poses.
    """

    position_m: Floats
    lengths: Kinematics
    base: str
    blended: bool = False

    def statement(self, motion: Any, last: bool) -> Statement:
        """Return the statement of the next primitive; raises ProgramError."""
        convert: dict[int, Callable[[Any, dict[str, float], float], Statement]] = {
            LINEAR_JOINT: self._joint,
            LINEAR_CARTESIAN: self._line,
            CIRCULAR_CARTESIAN: self._circle,
        }
        if motion.type not in convert:
            names = ', '.join(f'{name} ({number})' for number, name in TYPES.items())
            raise ProgramError(f'type {motion.type} is not supported, expected one of {names}')
        radius = float(motion.blend_radius)
        if not 0.0 <= radius < math.inf:
            raise ProgramError(f'blend_radius is {radius:g} m, but must be finite and at least 0')
        # no motion follows the last one, so that its radius has no effect
        radius = 0.0 if last else radius
        found = convert[motion.type](motion, _arguments(motion), radius)
        self.blended = radius > 0.0
        return found

    def _joint(self, motion: Any, arguments: dict[str, float], radius: float) -> Statement:
        if radius > 0.0 or self.blended:
            raise ProgramError('LINEAR_JOINT begins and ends at rest, but a blend_radius is given there')
        values = [float(value) for value in motion.joint_positions]
        if len(values) != len(DRIVES):
            found = counted(len(values), 'value')
            raise ProgramError(
                f'LINEAR_JOINT needs {len(DRIVES)} joint_positions, one per arm, but has {found}'
            )
        if not np.isfinite(values).all():
            raise ProgramError(f'joint_positions are {shown(values)}, but must be finite')
        start, end = kinematics.inverse(self.position_m, self.lengths), np.array(values)
        distance, time = float(np.abs(end - start).max()), arguments.get(MOVE_TIME, 0.0)
        if time > 0.0:
            peak, ramp = rest_to_rest.PEAK * distance / time, time / 3.0
            if distance == 0.0:
                ramp = time
        else:
            for name in LIMITS:
                if name not in arguments:
                    raise ProgramError('LINEAR_JOINT needs velocity and acceleration, or move_time')
            speed, acceleration = (_positive(arguments, name) for name in LIMITS)
            peak, ramp = rest_to_rest.joint_ramps(distance, speed, acceleration)
        try:
            self.position_m = kinematics.forward(end, self.lengths)
        except UnreachableError as error:
            raise ProgramError(str(error)) from None
        return {'joints': {'points': rest_to_rest.joint_points(start, end, peak, ramp)}}

    def _line(self, motion: Any, arguments: dict[str, float], radius: float) -> Statement:
        (end,) = _points(motion, self.base, 1)
        length = float(np.linalg.norm(np.array(end) - self.position_m))
        time = arguments.get(MOVE_TIME, 0.0)
        if time == 0.0:
            return self._path('move_l', {'to_m': end}, arguments, radius)
        if radius > 0.0 or self.blended:
            raise ProgramError(
                'a motion with move_time begins and ends at rest, but a blend_radius is given there'
            )
        self.position_m = np.array(end)
        limits = rest_to_rest.line_limits(length, time) if length > 0.0 else {}
        return {'move_l': {'to_m': end, **limits, 'strict': True}}

    def _circle(self, motion: Any, arguments: dict[str, float], radius: float) -> Statement:
        if arguments.get(MOVE_TIME, 0.0) > 0.0:
            raise ProgramError(
                'CIRCULAR_CARTESIAN does not support move_time: give velocity and acceleration'
            )
        end, via = _points(motion, self.base, 2)
        return self._path('move_c', {'via_m': via, 'to_m': end}, arguments, radius)

    def _path(
        self, kind: str, points: dict[str, list[float]], arguments: dict[str, float], radius: float
    ) -> Statement:
        self.position_m = np.array(points['to_m'])
        limits = {key: _positive(arguments, name) for name, key in LIMITS.items() if name in arguments}
        return {kind: {**points, **limits, 'blend_m': radius}}


def _arguments(motion: Any) -> dict[str, float]:
    """Return the additional arguments by name."""
    found: dict[str, float] = {}
    for argument in motion.additional_arguments:
        name, value = argument.name, float(argument.value)
        if name not in ARGUMENTS:
            raise ProgramError(f'unknown argument {shown(name)}, expected one of {", ".join(ARGUMENTS)}')
        if name in found:
            raise ProgramError(f'{name} is given twice')
        if not 0.0 <= value < math.inf:
            raise ProgramError(f'{name} is {value:g}, but must be finite and at least 0')
        found[name] = value
    return found


def _positive(arguments: dict[str, float], name: str) -> float:
    if arguments[name] == 0.0:
        raise ProgramError(f'{name} is 0, but must be above 0')
    return arguments[name]


def _points(motion: Any, base: str, count: int) -> list[list[float]]:
    """Return the positions of the poses [m]: the end, then the circle point."""
    if len(motion.poses) != count:
        wanted = 'one pose' if count == 1 else 'two poses, end and circle point'
        raise ProgramError(f'{TYPES[motion.type]} needs {wanted}, but has {len(motion.poses)}')
    points = [point_of_pose(pose, base, f'poses[{number}]') for number, pose in enumerate(motion.poses)]
    for number, point in enumerate(points):
        if not np.isfinite(point).all():
            raise ProgramError(f'poses[{number}] is at {shown(point)}, but must be finite')
    return points

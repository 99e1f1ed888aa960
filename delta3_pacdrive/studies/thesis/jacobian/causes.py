"""Causes, other than wrong lengths, of differences between computed and recorded joint motion."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.thesis.jacobian.deviation import Deviation
from delta3_pacdrive.studies.thesis.jacobian.mapping import (
    joint_motion,
    with_printed_jacobian_dot,
    without_jacobian_dot,
)
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion

CONSECUTIVE = 1.5  # largest distance of consecutive samples, in sample times
LATE = 'one bus cycle between TCP and joints'
WITHOUT_JACOBIAN_DOT = 'Jdot left out of (4.16)'
PRINTED_JACOBIAN_DOT = '(4.15) as printed, + Sdot J'


@dataclass(frozen=True)
class Cause:
    """Largest deviations [%] that a cause makes on its own."""

    name: str
    quantity: str
    of_peak: float
    momentary: float


@dataclass(frozen=True)
class Course:
    """Deviation [% of the peak] over time by a single cause, shape (n, 3); nan without a previous sample."""

    name: str
    quantity: str
    of_peak: Floats


def causes(motion: Motion, kinematics: Kinematics) -> list[Cause]:
    """Return the deviations by a bus cycle between TCP and joints, by omitting Jdot, and by (4.15) as printed."""
    rows = []
    for name, quantity, _, calculated, recorded in _compared(motion, kinematics):
        found = Deviation.of(calculated, recorded).summary()
        rows.append(Cause(name, quantity, found['of_peak']['max'], found['momentary']['max']))
    return rows


def courses(motion: Motion, kinematics: Kinematics) -> list[Course]:
    """Return the deviations of ``causes`` over time."""
    found = []
    for name, quantity, rows, calculated, recorded in _compared(motion, kinematics):
        values = np.full((len(motion.time_s), 3), np.nan)
        values[rows] = Deviation.of(calculated, recorded).of_peak
        found.append(Course(name, quantity, values))
    return found


def _compared(motion: Motion, kinematics: Kinematics) -> list[tuple[str, str, Any, Floats, Floats]]:
    """Return for each cause name, quantity, rows in which it is defined, calculated and recorded values there."""
    exact = joint_motion(motion, kinematics)
    pairs = np.flatnonzero(np.diff(motion.time_s) < CONSECUTIVE * motion.period_s)
    now, before = pairs + 1, pairs
    without, printed = (
        make(motion, kinematics) for make in (without_jacobian_dot, with_printed_jacobian_dot)
    )
    every = slice(None)
    return [
        (LATE, 'velocity', now, exact.velocity[now], motion.thetadot[before]),
        (LATE, 'acceleration', now, exact.acceleration[now], motion.thetaddot[before]),
        (WITHOUT_JACOBIAN_DOT, 'acceleration', every, without, motion.thetaddot),
        (PRINTED_JACOBIAN_DOT, 'acceleration', every, printed, motion.thetaddot),
    ]

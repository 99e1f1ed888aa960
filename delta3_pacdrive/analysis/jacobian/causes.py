"""What else than a wrong length makes computed and recorded joint motion differ, with exact lengths."""

from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.analysis.jacobian.deviation import Deviation
from delta3_pacdrive.analysis.jacobian.mapping import (
    joint_motion,
    with_printed_jacobian_dot,
    without_jacobian_dot,
)
from delta3_pacdrive.analysis.jacobian.motion import Motion
from delta3_pacdrive.parameters import Kinematics

CONSECUTIVE = 1.5  # sample times
LATE = 'one bus cycle between TCP and joints'
WITHOUT_JACOBIAN_DOT = 'Jdot left out of (4.16)'
PRINTED_JACOBIAN_DOT = '(4.15) as printed, + Sdot J'


@dataclass(frozen=True)
class Cause:
    """A cause makes, by itself, these largest deviations [%]."""

    name: str
    quantity: str
    of_peak: float
    momentary: float


def causes(motion: Motion, kinematics: Kinematics) -> list[Cause]:
    """Return the deviations by a bus cycle between TCP and joints, by leaving Jdot out, by (4.15) as printed."""
    exact = joint_motion(motion, kinematics)
    pairs = np.flatnonzero(np.diff(motion.time_s) < CONSECUTIVE * motion.period_s)
    now, before = pairs + 1, pairs
    without, printed = (
        make(motion, kinematics) for make in (without_jacobian_dot, with_printed_jacobian_dot)
    )
    compared = [
        (LATE, 'velocity', exact.velocity[now], motion.thetadot[before]),
        (LATE, 'acceleration', exact.acceleration[now], motion.thetaddot[before]),
        (WITHOUT_JACOBIAN_DOT, 'acceleration', without, motion.thetaddot),
        (PRINTED_JACOBIAN_DOT, 'acceleration', printed, motion.thetaddot),
    ]
    rows = []
    for name, quantity, calculated, recorded in compared:
        found = Deviation.of(calculated, recorded).summary()
        rows.append(Cause(name, quantity, found['of_peak']['max'], found['momentary']['max']))
    return rows

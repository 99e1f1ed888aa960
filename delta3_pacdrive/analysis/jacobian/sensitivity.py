"""How much deviation an error of each length of P1 makes: slopes, and the error that a given deviation needs.

The slopes are central differences over errors of +-``STEP_M`` of the joint motion that the Jacobian gives.
"""

from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.analysis.jacobian.deviation import THRESHOLD, peaks, share_of
from delta3_pacdrive.analysis.jacobian.mapping import LENGTHS, JointMotion, Pose, inexact, joint_motion
from delta3_pacdrive.analysis.jacobian.motion import Motion
from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics

STEP_M = 1e-5  # its square leaves 1e-9 of the slope, rounding 1e-10
MILLIMETRE = 1e-3
CLOSE = 1e-3  # relative, to the deviation that was asked for
STEPS_MAX = 30
ERROR_MAX = 1.0  # of a length, that is looked for


@dataclass(frozen=True)
class Share:
    """A share is what 1 mm makes [%/mm]: largest and rms deviation of the joint's peak, largest momentary one."""

    of_peak: float
    of_peak_rms: float
    momentary: float


@dataclass(frozen=True)
class Sensitivity:
    """A sensitivity says what an error of one length makes of one trajectory.

    Attributes
    ----------
    trajectory, pose, symbol
        Which.
    value_m
        The length as it should be.
    velocity, acceleration
        Deviations per millimetre.
    needed_of_peak_m, needed_momentary_m
        Error with which the joint velocity deviates by ``target_percent``; None where none does.
    target_percent
        Largest deviation of joint velocities that the thesis found, 10 % where it says nothing.

    """

    trajectory: str
    pose: Pose
    symbol: str
    value_m: float
    velocity: Share
    acceleration: Share
    target_percent: float
    needed_of_peak_m: float | None
    needed_momentary_m: float | None

    @property
    def mm_per_percent(self) -> float:
        """One percent of the length [mm]: slopes per percent are those per millimetre, times this."""
        return 10.0 * self.value_m


def slope(motion: Motion, kinematics: Kinematics, symbol: str, pose: Pose) -> JointMotion:
    """Change of the computed joint motion with a length: [1/(s m)] and [1/(s^2 m)], shapes (n, 3)."""
    longer, shorter = (
        joint_motion(motion, inexact(kinematics, {symbol: step}), pose) for step in (STEP_M, -STEP_M)
    )
    return JointMotion(
        (longer.velocity - shorter.velocity) / (2.0 * STEP_M),
        (longer.acceleration - shorter.acceleration) / (2.0 * STEP_M),
    )


def sensitivities(motion: Motion, kinematics: Kinematics) -> list[Sensitivity]:
    """Return one row for every pose and length."""
    rows = []
    target = motion.thesis.deviation_percent if motion.thesis else 10.0
    for pose in Pose:
        for symbol, key in LENGTHS.items():
            change = slope(motion, kinematics, symbol, pose)
            velocity = _share(change.velocity, motion.thetadot)
            acceleration = _share(change.acceleration, motion.thetaddot)
            needed = (
                _needed(motion, kinematics, symbol, pose, target, first, momentary)
                for momentary, first in ((False, velocity.of_peak), (True, velocity.momentary))
            )
            which = motion.name, pose, symbol, float(getattr(kinematics, key))
            rows.append(Sensitivity(*which, velocity, acceleration, target, *needed))
    return rows


def tolerance(motion: Motion, kinematics: Kinematics, pose: Pose) -> dict[str, dict[str, float]]:
    """Largest deviation [%] if every length is 1 mm off, each in the direction that is worst for the sample."""
    total = JointMotion(np.zeros_like(motion.theta), np.zeros_like(motion.theta))
    for symbol in LENGTHS:
        part = slope(motion, kinematics, symbol, pose)
        total = JointMotion(
            total.velocity + np.abs(part.velocity), total.acceleration + np.abs(part.acceleration)
        )
    velocity = _share(total.velocity, motion.thetadot)
    acceleration = _share(total.acceleration, motion.thetaddot)
    return {
        'velocity': {'of_peak': velocity.of_peak, 'momentary': velocity.momentary},
        'acceleration': {'of_peak': acceleration.of_peak, 'momentary': acceleration.momentary},
    }


def _share(change: Floats, recorded: Floats) -> Share:
    percent = 100.0 * MILLIMETRE * change
    of_peak = percent / peaks(recorded)
    momentary = share_of(percent, recorded, THRESHOLD)
    return Share(
        float(np.abs(of_peak).max()),
        float(np.sqrt(np.mean(of_peak**2))),
        float(np.nanmax(np.abs(momentary))),
    )


def _needed(
    motion: Motion,
    kinematics: Kinematics,
    symbol: str,
    pose: Pose,
    target: float,
    per_millimetre: float,
    momentary: bool,
) -> float | None:
    """Return the positive error [m] with which the largest deviation is ``target``; None if there is none.

    Starts with the first order and corrects it by the ratio of what is wanted to what is found: the deviation is
    nearly proportional to the error.
    """
    longest = ERROR_MAX * float(getattr(kinematics, LENGTHS[symbol]))
    exact = joint_motion(motion, kinematics, pose).velocity
    if per_millimetre * longest / MILLIMETRE < 0.5 * target:
        return None
    error = min(target / per_millimetre * MILLIMETRE, longest)
    for _ in range(STEPS_MAX):
        try:
            difference = joint_motion(motion, inexact(kinematics, {symbol: error}), pose).velocity - exact
        except UnreachableError:
            return None
        percent = 100.0 * difference
        shares = share_of(percent, motion.thetadot) if momentary else percent / peaks(motion.thetadot)
        found = float(np.nanmax(np.abs(shares)))
        if abs(found - target) <= CLOSE * target:
            return error
        error *= target / found
        if error > longest:
            return None
    return None

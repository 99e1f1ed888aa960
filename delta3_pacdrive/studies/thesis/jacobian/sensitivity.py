"""Sensitivity of the joint motion to each length of P1, and the error that causes a given deviation.

Slopes are central differences of the joint motion through the Jacobian over errors of +-``STEP_M``.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.thesis.jacobian.deviation import THRESHOLD, peaks, share_of
from delta3_pacdrive.studies.thesis.jacobian.mapping import LENGTHS, JointMotion, Pose, inexact, joint_motion
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion

STEP_M = 1e-5  # relative error of the slope: 1e-9 by its square, 1e-10 by rounding
MILLIMETRE = 1e-3
CLOSE = 1e-3  # relative tolerance of the deviation that is searched for
STEPS_MAX = 30
ERROR_MAX = 1.0  # largest error searched for, relative to the length


@dataclass(frozen=True)
class Share:
    """Deviation caused by an error of 1 mm [%/mm]."""

    of_peak: float  # largest deviation relative to the peak of the joint
    of_peak_rms: float
    momentary: float  # largest deviation relative to the momentary value


@dataclass(frozen=True)
class Sensitivity:
    """Effect of an error of one length on one trajectory."""

    trajectory: str
    pose: Pose
    symbol: str
    value_m: float  # exact length
    velocity: Share
    acceleration: Share
    target_percent: float  # largest deviation of joint velocities in the thesis, 10 % if it gives none
    needed_of_peak_m: (
        float | None
    )  # error with which the joint velocity deviates by target_percent; None if none does
    needed_momentary_m: float | None

    @property
    def mm_per_percent(self) -> float:
        """One percent of the length [mm]: factor from slopes per millimetre to slopes per percent."""
        return 10.0 * self.value_m


def slope(motion: Motion, kinematics: Kinematics, symbol: str, pose: Pose) -> JointMotion:
    """Return the derivative of the joint motion by a length: [1/(s m)] and [1/(s^2 m)], shapes (n, 3)."""
    longer, shorter = (
        joint_motion(motion, inexact(kinematics, {symbol: step}), pose) for step in (STEP_M, -STEP_M)
    )
    return JointMotion(
        (longer.velocity - shorter.velocity) / (2.0 * STEP_M),
        (longer.acceleration - shorter.acceleration) / (2.0 * STEP_M),
    )


def sensitivities(motion: Motion, kinematics: Kinematics) -> list[Sensitivity]:
    """Return the sensitivities for every pose and length."""
    rows = []
    target = motion.thesis.deviation_percent if motion.thesis else 10.0
    for pose in Pose:
        for symbol, key in LENGTHS.items():
            change = slope(motion, kinematics, symbol, pose)
            needed = partial(_needed, motion, kinematics, symbol, pose=pose, target=target)
            velocity = _share(change.velocity, motion.thetadot)
            acceleration = _share(change.acceleration, motion.thetaddot)
            rows.append(
                Sensitivity(
                    trajectory=motion.name,
                    pose=pose,
                    symbol=symbol,
                    value_m=float(getattr(kinematics, key)),
                    velocity=velocity,
                    acceleration=acceleration,
                    target_percent=target,
                    needed_of_peak_m=needed(velocity.of_peak),
                    needed_momentary_m=needed(velocity.momentary, momentary=True),
                )
            )
    return rows


def tolerance(motion: Motion, kinematics: Kinematics, pose: Pose) -> dict[str, dict[str, float]]:
    """Return the largest deviation [%] with every length 1 mm off, each in the worst direction for the sample."""
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
    per_millimetre: float,
    *,
    pose: Pose,
    target: float,
    momentary: bool = False,
) -> float | None:
    """Return the positive error [m] with which the largest deviation is ``target``; None if there is none.

    The first-order error is corrected by the ratio of target to deviation, which is nearly proportional to the error.
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

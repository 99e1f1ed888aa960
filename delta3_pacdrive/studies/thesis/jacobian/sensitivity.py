"""Sensitivity of the joint motion to each length of P1, and the error that causes a given deviation.

Slopes are central differences of the joint motion through the Jacobian over errors of +-``STEP_M``.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np

from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.framework.columns import Column
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
    """Deviation caused by an error of a length [%/mm, or % per % of the length]."""

    # largest deviation relative to the peak of the joint
    of_peak: Annotated[float, Column('max of peak', form='.5g')]
    of_peak_rms: Annotated[float, Column('rms of peak', form='.5g')]
    # largest deviation relative to the momentary value
    momentary: Annotated[float, Column('max momentary', form='.5g')]

    def times(self, factor: float) -> 'Share':
        """Return the deviation by an error of another size."""
        return Share(factor * self.of_peak, factor * self.of_peak_rms, factor * self.momentary)


@dataclass(frozen=True)
class Sensitivity:
    """Effect of an error of one length on one trajectory."""

    trajectory: Annotated[str, Column('trajectory')]
    pose: Annotated[Pose, Column('pose')]
    symbol: Annotated[str, Column('length')]
    value_m: Annotated[float, Column('value [mm]', form='g in mm')]  # exact length
    velocity: Annotated[Share, Column('velocity {} [%/mm]')]
    velocity_relative: Annotated[Share, Column('velocity {} [%/%]', in_json=False)]
    acceleration: Annotated[Share, Column('acceleration {} [%/mm]')]
    acceleration_relative: Annotated[Share, Column('acceleration {} [%/%]', in_json=False)]
    # largest deviation of joint velocities in the thesis, 10 % if it gives none
    target_percent: Annotated[float, Column('wanted deviation of velocity [%]')]
    # error with which the joint velocity deviates by target_percent; None if none does
    needed_of_peak_m: Annotated[float | None, Column('error for it of peak [mm]', form='.4g in mm')]
    needed_momentary_m: Annotated[float | None, Column('error for it momentary [mm]', form='.4g in mm')]


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
            value_m = float(getattr(kinematics, key))
            per_percent = 10.0 * value_m  # one percent of the length [mm]
            rows.append(
                Sensitivity(
                    trajectory=motion.name,
                    pose=pose,
                    symbol=symbol,
                    value_m=value_m,
                    velocity=velocity,
                    velocity_relative=velocity.times(per_percent),
                    acceleration=acceleration,
                    acceleration_relative=acceleration.times(per_percent),
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

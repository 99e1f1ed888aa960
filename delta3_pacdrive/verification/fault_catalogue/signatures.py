"""Evidence of a fault in the recorded telegrams, in addition to the robot's own report."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.robot.sercos.telegrams import at
from delta3_pacdrive.verification.telegram_log import SHAFTS, Telegrams

ENCODER_RAD = 1e-4  # ten times the resolution of the encoder
SAG_RAD_S = 0.5
# torque beyond load, friction and motor inertia; arms alone need 0.3 N m at rest, a rotary axis nothing
EXTRA_N_M, EXTRA_OF_TOOL_N_M = 1.0, 0.4
POSITION, TORQUE = 0, 2  # columns of an AT
ARMS = len(DRIVES)


def coupling_of_arms(shafts: Floats) -> Floats:
    """Return the coupling torques [N m] of the arms from rows of motor shafts, shape (n, 3)."""
    first = 2 * shafts.shape[1] // 3
    return shafts[:, first : first + ARMS]


@dataclass(frozen=True)
class AxisRecord:
    """Bus cycles since the fault for which both shaft and AT of the axis are known."""

    read: Floats  # position in the AT [rad]
    torque: Floats  # in the AT [N m]
    position: Floats  # of the shaft [rad]
    speed: Floats  # of the shaft [rad/s]
    coupling: Floats  # torque d of the load [N m]
    extra: float = EXTRA_N_M  # tolerance [N m]

    @staticmethod
    def of(recorded: dict[str, Telegrams], axis: int, first: int) -> 'AxisRecord':
        """Extract the record from telegrams."""
        answers, shafts = recorded[at(ALL_DRIVES[axis]).topic], recorded[SHAFTS]
        common, own, true = np.intersect1d(answers.cycles, shafts.cycles, return_indices=True)
        own, true = own[common >= first], true[common >= first]
        values = shafts.values[true]
        drives = values.shape[1] // 3
        return AxisRecord(
            read=answers.values[own, POSITION],
            torque=answers.values[own, TORQUE],
            position=values[:, axis],
            speed=values[:, drives + axis],
            coupling=values[:, 2 * drives + axis],
            extra=EXTRA_N_M if axis < ARMS else EXTRA_OF_TOOL_N_M,
        )


def misread(record: AxisRecord) -> str:
    """Return the encoder error as text, empty if there is none."""
    error = float(np.abs(record.read - record.position).max(initial=0.0))
    return f'reads up to {error:.4f} rad wrong' if error > ENCODER_RAD else ''


def sagged(record: AxisRecord) -> str:
    """Return the speed of the shaft without torque under its brake as text."""
    speed = float(np.abs(record.speed[record.torque == 0.0]).max(initial=0.0))
    return f'turns at {speed:.1f} rad/s under its brake' if speed > SAG_RAD_S else ''


def burdened(record: AxisRecord) -> str:
    """Return the motor torque beyond that of the load as text."""
    held = record.torque != 0.0
    extra = np.abs(record.torque - record.coupling)[held]
    torque = float(np.percentile(extra, 90)) if len(extra) else 0.0
    return f'needs {torque:.2f} N m more than its load' if torque > record.extra else ''


def loaded(record: AxisRecord) -> str:
    """Return the median load torque of the shaft as text."""
    torque = float(np.median(np.abs(record.coupling))) if len(record.coupling) else 0.0
    return f'carries {torque:.2f} N m' if torque > record.extra else ''


OF_AXIS: dict[str, Callable[[AxisRecord], str]] = {
    'encoder_jump': misread,
    'encoder_drift': misread,
    'encoder_noise': misread,
    'brake_worn': sagged,
    'brake_stuck': burdened,
    'overload': loaded,
}

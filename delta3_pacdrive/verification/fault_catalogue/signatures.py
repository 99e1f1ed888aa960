"""What the recorded telegrams of a case show of its fault, beside the sentence that the robot says about it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.sercos.telegrams import at
from delta3_pacdrive.verification.telegram_log import SHAFTS, Telegrams

ENCODER_RAD = 1e-4  # ten times what the grid of the encoder makes
SAG_RAD_S = 0.5
# beyond what load, friction and the motor's own inertia ask for; arms alone need 0.3 at rest, a rotary axis nothing
EXTRA_N_M, EXTRA_OF_TOOL_N_M = 1.0, 0.4
POSITION, TORQUE = 0, 2  # columns of an AT
ARMS = len(DRIVES)


def coupling_of_arms(shafts: Floats) -> Floats:
    """Return the coupling torques [N m] of the arms in rows of motor shafts, shape (n, 3)."""
    first = 2 * shafts.shape[1] // 3
    return shafts[:, first : first + ARMS]


@dataclass(frozen=True)
class AxisRecord:
    """The record holds the bus cycles since the fault in which both shaft and answer of the axis are known."""

    read: Floats  # position that the drive told [rad]
    torque: Floats  # that the drive told [N m]
    position: Floats  # of the shaft [rad]
    speed: Floats  # of the shaft [rad/s]
    coupling: Floats  # torque d of what hangs at it [N m]
    extra: float = EXTRA_N_M  # of which nothing is said [N m]

    @staticmethod
    def of(recorded: dict[str, Telegrams], axis: int, first: int) -> 'AxisRecord':
        """Cut it out of what was recorded."""
        answers, shafts = recorded[at(ALL_DRIVES[axis]).topic], recorded[SHAFTS]
        common, own, true = np.intersect1d(answers.cycles, shafts.cycles, return_indices=True)
        own, true = own[common >= first], true[common >= first]
        values = shafts.values[true]
        drives = values.shape[1] // 3
        return AxisRecord(
            answers.values[own, POSITION],
            answers.values[own, TORQUE],
            values[:, axis],
            values[:, drives + axis],
            values[:, 2 * drives + axis],
            EXTRA_N_M if axis < ARMS else EXTRA_OF_TOOL_N_M,
        )


def misread(record: AxisRecord) -> str:
    """Say how far the encoder is off."""
    error = float(np.abs(record.read - record.position).max(initial=0.0))
    return f'reads up to {error:.4f} rad wrong' if error > ENCODER_RAD else ''


def sagged(record: AxisRecord) -> str:
    """Say how fast the shaft turned without torque under its brake."""
    speed = float(np.abs(record.speed[record.torque == 0.0]).max(initial=0.0))
    return f'turns at {speed:.1f} rad/s under its brake' if speed > SAG_RAD_S else ''


def burdened(record: AxisRecord) -> str:
    """Say how much torque the motor gives beyond that of the load."""
    held = record.torque != 0.0
    extra = np.abs(record.torque - record.coupling)[held]
    torque = float(np.percentile(extra, 90)) if len(extra) else 0.0
    return f'needs {torque:.2f} N m more than its load' if torque > record.extra else ''


def loaded(record: AxisRecord) -> str:
    """Say how much torque the load of the shaft asks for, mostly."""
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

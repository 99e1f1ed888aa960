"""How motors, encoders and switches of the arms are wired and mounted, and the data of the procedures that find it out.

The neutral ``Mounting`` is that of a robot whose drives know everything. Angles are those of motor shafts.
"""

import math
from dataclasses import dataclass

from delta3_pacdrive.configuration.fields import choice, positive, quantity

MULTI_TURN, SINGLE_TURN, INCREMENTAL = ENCODERS = 'multi_turn', 'single_turn', 'incremental'
AXES = 'none', 'axis1', 'axis2', 'axis3', 'all'  # that something applies to
PAIRS = 'none', 'axis1-axis2', 'axis1-axis3', 'axis2-axis3'
ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Mounting:
    """Wiring and mounting of the arms' motors, encoders and switches; the drives do not know these values."""

    commissioned: bool = quantity(
        'whether the drives have stored the offsets of encoders and commutation', False, True, default=True
    )
    encoder: str = choice(
        'range in which an encoder knows its position after the drive is switched on', ENCODERS
    )
    encoder_offset_rad: tuple[float, float, float] = quantity(
        'reading of the encoder at the zero point of the machine', -1e4, 1e4, default=ZERO
    )
    rotor_offset_rad: tuple[float, float, float] = quantity(
        'electrical angle of the rotor at the zero point of the machine', -math.pi, math.pi, default=ZERO
    )
    encoder_reversed: str = choice('axes whose encoders count in the wrong direction', AXES)
    phases_exchanged: str = choice('axes with two motor phases exchanged', AXES)
    encoder_cables_exchanged: str = choice('axes whose encoder cables are exchanged', PAIRS)
    motor_cables_exchanged: str = choice('axes whose cables of motor and brake are exchanged', PAIRS)
    switch_deg: tuple[float, float, float] = quantity(
        'arm angle below which the home switch is actuated', -180.0, 180.0, default=(-50.0, -50.0, -50.0)
    )

    @property
    def neutral(self) -> bool:
        """Whether each drive is wired to its own axis and knows all offsets."""
        return self == Mounting()

    @property
    def homed_at_start(self) -> bool:
        """Whether all axes are homed when the drives are switched on."""
        return self.commissioned and self.encoder == MULTI_TURN

    @property
    def crossed(self) -> bool:
        """Whether cables are exchanged between two axes."""
        return self.encoder_cables_exchanged != PAIRS[0] or self.motor_cables_exchanged != PAIRS[0]

    def reverses_encoder(self, axis: int) -> bool:
        """Whether the encoder of an axis, from 0, counts in the wrong direction."""
        return self.encoder_reversed in ('all', AXES[axis + 1])

    def exchanges_phases(self, axis: int) -> bool:
        """Whether two motor phases of an axis, from 0, are exchanged."""
        return self.phases_exchanged in ('all', AXES[axis + 1])

    def motor_of(self, drive: int) -> int:
        """Index of the axis whose motor and brake a drive feeds; both from 0."""
        return _partner(self.motor_cables_exchanged, drive)

    def encoder_of(self, drive: int) -> int:
        """Index of the axis whose encoder is connected to a drive; both from 0."""
        return _partner(self.encoder_cables_exchanged, drive)


def _partner(pair: str, drive: int) -> int:
    """Return the other axis of a ``pair`` that contains the axis of a drive, else that axis."""
    axes = [AXES.index(name) - 1 for name in pair.split('-')]
    return sum(axes) - drive if drive in axes else drive


@dataclass(frozen=True)
class Commissioning:
    """Data of the procedure commands of the drives, motor side."""

    homing_speed_rad_s: float = positive('speed of homing, S-0-0041', 100.0, default=10.0)
    homing_acceleration_rad_s2: float = positive('acceleration of homing, S-0-0042', 1e4, default=200.0)
    stop_torque_n_m: float = positive(
        'torque at which an arm is blocked by its end stop or an obstacle', 10.0, default=1.5
    )
    alignment_current_a: float = positive('current of the commutation alignment', 100.0, default=4.0)
    brake_test_torque_n_m: float = positive('torque of the brake test', 100.0, default=2.4)

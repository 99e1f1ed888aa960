"""Wiring and mounting of motor, encoder and home switch of an axis, and the data by which its drive compensates them.

A shaft at x [rad] from the zero point of the machine has the electrical angle p x + r of its rotor. The encoder reads

    e = m x + o,   phi = n e

with m = -1 if it counts in the wrong direction, and n = -1 if the drive inverts it (S-0-0055). The position in the AT
is phi plus the absolute distance (S-0-0177). The drive turns the field to p phi plus the commutation offset (P-0-0508);
exchanged phases or an inverted field (P-0-0509) reverse that angle, both together do not. With the error d between
field and rotor, the motor has the torque K_m i cos d and the back-EMF (K_m / 3) w cos d: twice the electrical angle for
a field that turns against the rotor. The plant receives the current that produces torque, i cos d.

A field at rest, with a current independent of the encoder, pulls the rotor a quarter of an electrical turn ahead of it.
Records without ``mounted`` are those of a drive with its own, aligned encoder.
"""

import math
from typing import Any

from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.parameters.commissioning import ENCODERS, INCREMENTAL, SINGLE_TURN
from delta3_pacdrive.robot.sercos.increments import to_increments

OF_ONE_TURN, OF_NO_TURN = ENCODERS.index(SINGLE_TURN), ENCODERS.index(INCREMENTAL)
INVERTED = 4.0  # S-0-0055: position feedback value 1 inverted


@kernel
def switch_on_encoder(position, s):
    """Set the reading of an encoder that is switched on; it may have lost its turns or its angle.

    The motor is at ``position`` [rad].
    """
    s.encoder_on = 1
    reading = s.encoder_sign * (s.feedback_position if s.apart != 0 else position) + s.encoder_mount
    s.encoder_origin = s.encoder_mount
    if s.encoder_kind == OF_ONE_TURN:
        s.encoder_origin -= math.tau * math.floor(reading / math.tau)
    elif s.encoder_kind == OF_NO_TURN:
        s.encoder_origin -= reading
        s.commutated = 0
    if s.encoder_kind != 0:
        s.homed = 0


@kernel
def direction(s):
    """Sign by which the drive multiplies the reading of the encoder."""
    return 1.0 if s.polarity == 0.0 else -1.0


@kernel
def mounted_reading(position, s, c):
    """Position in increments from the machine's zero point, with the shaft of the encoder at ``position`` [rad]."""
    reading = s.encoder_sign * (position + s.encoder_offset) + s.encoder_origin
    return direction(s) * to_increments(reading, c.increments_per_rad) + s.absolute_distance


@kernel
def measured_speed(speed, s):
    """Speed [rad/s] that the encoder measures, for a motor with ``speed``."""
    return direction(s) * s.encoder_sign * (s.feedback_speed if s.apart != 0 else speed)


@kernel
def encoder_angle(s, m):
    """Electrical angle [rad] of the encoder: p phi."""
    position = s.feedback_position if s.apart != 0 else s.position
    reading = s.encoder_sign * position + s.encoder_origin
    return m.pole_pairs * direction(s) * reading


@kernel
def torque_share(in_field, s, m):
    """Share cos d of the current that produces torque; ``in_field``: the field does not follow the encoder."""
    rotor = m.pole_pairs * s.position + s.rotor_offset
    field = s.field_angle if in_field else encoder_angle(s, m) + s.commutation_offset
    if s.field_sign * (1.0 if s.field_inverted == 0.0 else -1.0) < 0.0:
        return -math.cos(field + rotor)
    return math.cos(field - rotor)


@kernel
def switch_actuated(s):
    """Whether the home switch is actuated: the shaft of the motor is below it."""
    return s.position < s.switch_position


def mount(axis: int, parameters: Parameters, state: NDArray[Any]) -> None:
    """Set wiring, mounting and stored data of an axis, 0 to 2, in the record of a drive, before it is switched on."""
    mounting, pole_pairs = parameters.mounting, parameters.motor.pole_pairs
    per_rad = parameters.bus.increments_per_rev / math.tau
    dynamics = parameters.dynamics
    state['mounted'] = not mounting.neutral
    state['encoder_kind'] = ENCODERS.index(mounting.encoder)
    encoder = mounting.encoder_of(axis)
    state['apart'] = encoder != mounting.motor_of(axis)
    state['encoder_sign'] = -1.0 if mounting.reverses_encoder(encoder) else 1.0
    state['encoder_mount'] = mounting.encoder_offset_rad[encoder]
    state['rotor_offset'] = mounting.rotor_offset_rad[mounting.motor_of(axis)]
    state['field_sign'] = -1.0 if mounting.exchanges_phases(mounting.motor_of(axis)) else 1.0
    switch = math.radians(mounting.switch_deg[axis]) * dynamics.gear_ratio
    state['switch_position'] = state['reference_distance'] = switch
    state['travel_min'] = math.radians(dynamics.end_stop_min_deg) * dynamics.gear_ratio
    state['travel_max'] = math.radians(dynamics.end_stop_max_deg) * dynamics.gear_ratio
    if mounting.commissioned:
        # measured before anything was exchanged
        offset = mounting.encoder_offset_rad[axis]
        state['commutation_offset'] = mounting.rotor_offset_rad[axis] - pole_pairs * offset
        state['absolute_distance'] -= to_increments(offset, per_rad)
        state['commutated'] = state['homed'] = 1
    else:
        state['absolute_distance'] = 0.0

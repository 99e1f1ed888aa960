"""Observer of the drive for its shaft between two exchanges with the plant."""

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.robot.motor import friction_torque


@kernel
def reset_observer(shaft, s):
    """Reset the shaft to that of the plant: position [rad], speed [rad/s], coupling torque d [N m]."""
    s.position, s.speed, s.coupling = shaft


@kernel
def advance_observer(mean_current, s, c, m):
    """Advance the shaft by one current-loop period under its current, friction and the last coupling torque."""
    torque = c.torque_constant * s.torque_share * mean_current - friction_torque(s.speed, m) - s.coupling
    acceleration = torque / c.observer_inertia
    s.position += c.current_period * (s.speed + 0.5 * c.current_period * acceleration)
    s.speed += c.current_period * acceleration

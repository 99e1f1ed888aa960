"""External contacts of the arms: end stops, and the payload at the plate."""

from delta3_pacdrive.numerics.kernel import kernel


@kernel
def contact_torque(depth, rate, stiffness, damping):
    """Torque of a compressed, damped spring, which pushes but never pulls."""
    torque = stiffness * depth + damping * rate
    return torque if torque * depth > 0.0 else 0.0


@kernel
def end_stop_torque(theta, thetadot, c):
    """Torque [N m] of an arm against its end stop, 0 between the stops."""
    if theta < c.stop_min:
        return contact_torque(theta - c.stop_min, thetadot, c.stop_stiffness, c.stop_damping)
    if theta > c.stop_max:
        return contact_torque(theta - c.stop_max, thetadot, c.stop_stiffness, c.stop_damping)
    return 0.0


@kernel
def hang_payload(payload_kg, s, n):
    """Attach the gripped payload to the plate unless it has fallen off; a new payload has the plate's speed."""
    if payload_kg != s.gripped:
        s.gripped = payload_kg
        s.payload_lost = 0
    carried = 0.0 if s.payload_lost != 0 else s.gripped
    if carried != s.carried:
        n.plate += carried - s.carried
        s.carried = carried

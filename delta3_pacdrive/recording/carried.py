"""Which telegram carries which signals of a run."""

from delta3_pacdrive.sercos import telegrams

# signals that a telegram carries, one for each of its arrays; a topic may have more than one layout
CARRIED = {
    telegrams.TORQUE_MDT: ('motor_command', 'torque_command'),
    telegrams.MDT: ('motor_command',),
    **dict.fromkeys(telegrams.AT, ('motor_position', 'motor_speed', 'current')),
    telegrams.FOLLOWING_ERROR: ('following_error',),
    telegrams.TCP_COMMAND: ('tcp_command',),
    telegrams.TCP_ACTUAL: ('tcp_actual',),
    telegrams.TCP_ERROR: ('tcp_error',),
    telegrams.SHAFTS: ('shaft_position', 'shaft_speed', 'coupling_torque'),
}

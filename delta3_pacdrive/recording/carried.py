"""Which telegram carries which signals of a run."""

from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES

# signals that a telegram carries, one for each of its arrays, or numbers; a topic may have more than one layout
CARRIED = {
    # of a robot with a rotary axis
    telegrams.mdt(torques=True, drives=ALL_DRIVES): ('motor_command', 'torque_command'),
    telegrams.mdt(torques=False, drives=ALL_DRIVES): ('motor_command',),
    telegrams.TOOL_AT: ('turn_position', 'turn_speed', 'turn_current'),
    telegrams.TURN: ('turn_command', '', 'turn_error'),  # the angle between is told by the AT
    telegrams.shafts(ALL_DRIVES): ('shaft_position', 'shaft_speed', 'coupling_torque'),
    # of one without
    telegrams.TORQUE_MDT: ('motor_command', 'torque_command'),
    telegrams.MDT: ('motor_command',),
    **dict.fromkeys(telegrams.AT, ('motor_position', 'motor_speed', 'current')),
    telegrams.FOLLOWING_ERROR: ('following_error',),
    telegrams.TCP_COMMAND: ('tcp_command',),
    telegrams.TCP_ACTUAL: ('tcp_actual',),
    telegrams.TCP_ERROR: ('tcp_error',),
    telegrams.SHAFTS: ('shaft_position', 'shaft_speed', 'coupling_torque'),
}

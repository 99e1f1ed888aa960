"""Signals in the telegrams of a run."""

from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES

# one signal per array of a telegram, or per number; a topic may have several layouts
TELEGRAM_SIGNALS = {
    # with rotary axis
    telegrams.mdt(torques=True, drives=ALL_DRIVES): ('motor_command', 'torque_command'),
    telegrams.mdt(torques=False, drives=ALL_DRIVES): ('motor_command',),
    telegrams.TOOL_AT: ('turn_position', 'turn_speed', 'turn_current'),
    telegrams.TURN: ('turn_command', '', 'turn_error'),  # the second value is redundant: it is in the AT
    telegrams.shafts(ALL_DRIVES): ('shaft_position', 'shaft_speed', 'coupling_torque'),
    # without rotary axis
    telegrams.TORQUE_MDT: ('motor_command', 'torque_command'),
    telegrams.MDT: ('motor_command',),
    **dict.fromkeys(telegrams.AT, ('motor_position', 'motor_speed', 'current')),
    telegrams.FOLLOWING_ERROR: ('following_error',),
    telegrams.TCP_COMMAND: ('tcp_command',),
    telegrams.TCP_ACTUAL: ('tcp_actual',),
    telegrams.TCP_ERROR: ('tcp_error',),
    telegrams.SHAFTS: ('shaft_position', 'shaft_speed', 'coupling_torque'),
}

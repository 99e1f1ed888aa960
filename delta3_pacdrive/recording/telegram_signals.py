"""Signals in the telegrams of a run."""

from delta3_pacdrive.parameters import numbered
from delta3_pacdrive.recording.signals import THERMAL_SIGNALS
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES

_DRIVES = [ALL_DRIVES[:count] for count in range(len(ALL_DRIVES), len(DRIVES) - 1, -1)]

# one signal per array of a telegram, or per number; a topic may have several layouts
TELEGRAM_SIGNALS = {
    # with each number of rotary axes
    **dict.fromkeys((telegrams.mdt(True, drives) for drives in _DRIVES), ('motor_command', 'torque_command')),
    **dict.fromkeys((telegrams.mdt(False, drives) for drives in _DRIVES), ('motor_command',)),
    **dict.fromkeys(map(telegrams.shafts, _DRIVES), ('shaft_position', 'shaft_speed', 'coupling_torque')),
    **{
        telegram: tuple(numbered(name, n) for name in ('turn_position', 'turn_speed', 'turn_current'))
        for n, telegram in enumerate(telegrams.ROTARY_AT)
    },
    # the second value is redundant: it is in the AT
    **{
        telegram: (numbered('turn_command', n), '', numbered('turn_error', n))
        for n, telegram in enumerate(telegrams.TURNS)
    },
    telegrams.DC_LINK: ('dc_link_voltage', '', '', 'mains_power', 'resistor_power'),
    **dict.fromkeys(map(telegrams.temperatures, _DRIVES), (*THERMAL_SIGNALS, '')),
    **dict.fromkeys(telegrams.AT, ('motor_position', 'motor_speed', 'current')),
    telegrams.FOLLOWING_ERROR: ('following_error',),
    telegrams.TCP_COMMAND: ('tcp_command',),
    telegrams.TCP_ACTUAL: ('tcp_actual',),
    telegrams.TCP_ERROR: ('tcp_error',),
}

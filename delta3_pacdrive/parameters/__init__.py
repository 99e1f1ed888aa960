"""Parameters P1 to P4 (Table 9-1), bus and motion: frozen groups, the rules that their values keep, their files."""

from delta3_pacdrive.parameters.file import DEFAULT_FILE, config_directory, find, load, write
from delta3_pacdrive.parameters.geometry import ArmDeviations, Kinematics
from delta3_pacdrive.parameters.records import (
    CUBIC,
    DECOUPLED,
    EXACT,
    INTERPOLATIONS,
    LINEAR,
    PAYLOAD_MAX_KG,
    Bus,
    Drive,
    Dynamics,
    Motion,
    Motor,
    Rich,
)
from delta3_pacdrive.parameters.robot import (
    PLANTS,
    Parameters,
    flat_document,
    flatten,
    from_flat,
    groups,
    is_rich,
)
from delta3_pacdrive.parameters.rules import CYCLE_TIMES_S, ELASTIC_EXCHANGE_S, EXCHANGE_PERIODS_S

__all__ = [
    'CUBIC',
    'CYCLE_TIMES_S',
    'DECOUPLED',
    'DEFAULT_FILE',
    'ELASTIC_EXCHANGE_S',
    'EXACT',
    'EXCHANGE_PERIODS_S',
    'INTERPOLATIONS',
    'LINEAR',
    'PAYLOAD_MAX_KG',
    'PLANTS',
    'ArmDeviations',
    'Bus',
    'Drive',
    'Dynamics',
    'Kinematics',
    'Motion',
    'Motor',
    'Parameters',
    'Rich',
    'config_directory',
    'find',
    'flat_document',
    'flatten',
    'from_flat',
    'groups',
    'is_rich',
    'load',
    'write',
]

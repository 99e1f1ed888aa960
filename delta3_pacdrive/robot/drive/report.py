"""Human-readable report of a drive."""

from typing import Any

from delta3_pacdrive.robot.drive.diagnostics import (
    WARNINGS,
    class_1_diagnostic,
    class_2_diagnostic,
    fault_text,
)
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.telegrams import BRAKE_FREE, BRAKE_HELD


def report(drive: MC4) -> dict[str, Any]:
    """Return state, diagnostics and counters of a drive, by SERCOS names."""
    state = drive.state[0]
    return {
        'state': drive.drive_state.name,
        'brake': BRAKE_FREE if state['brake_release'] else BRAKE_HELD,
        'diagnostic': fault_text(drive.fault),
        'warnings': [WARNINGS[warning].text for warning in WARNINGS if drive.warning & warning],
        'S-0-0011 class 1 diagnostic': f'{class_1_diagnostic(drive.fault):04x}',
        'S-0-0012 class 2 diagnostic': f'{class_2_diagnostic(drive.warning):04x}',
        'S-0-0028 MST losses': int(state['mdt_losses']),
        'S-0-0029 MDT losses': int(state['mdt_losses']),
        'S-0-0134 control word': f'{int(state["control"]):04x}',
        'S-0-0135 status word': f'{int(state["status"]):04x}',
        'overload_s': round(float(state['overload']), 3),
    }

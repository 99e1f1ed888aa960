"""Effects of injected faults on the states of drives and plant."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from delta3_pacdrive.robot.faults.fault import Fault
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES


def apply_to_drive(
    state: Any, axis: str, changes: Sequence[tuple[Fault, bool]], active: Sequence[Fault]
) -> None:
    """Update the state of a drive after faults have begun (True) or ended (False).

    ``active`` are the current faults. If several of one kind are active, jumps, drifts and noises add up, and the
    latest voltage applies instead of that of the supply.
    """
    for fault, begins in changes:
        if fault.kind == 'clear':
            state['encoder_offset'] = 0.0
        elif fault.kind == 'encoder_jump' and fault.target == axis:
            state['encoder_offset'] += fault.value if begins else -fault.value
    values = _values(axis, active)
    state['encoder_broken'] = len(values('encoder_failure')) > 0
    state['encoder_drift'] = sum(values('encoder_drift'))
    state['encoder_noise'] = sum(values('encoder_noise'))
    state['winding_short'] = len(values('winding_short')) > 0
    forced = values('dc_link')
    state['link_forced'] = len(forced) > 0
    state['dc_link'] = forced[-1] if forced else state['link_voltage']


def apply_to_plant(state: Any, changes: Sequence[tuple[Fault, bool]], active: Sequence[Fault]) -> None:
    """Update the state of the plant likewise; torques add up, and remaining brake fractions multiply."""
    if any(fault.kind == 'payload_lost' for fault, _ in changes):
        state['payload_lost'] = 1
    apply_to_motors(state, active, DRIVES)


def apply_to_link(state: Any, active: Sequence[Fault]) -> None:
    """Update the DC link likewise; the lowest share of the mains voltage applies."""
    shares = [fault.value for fault in active if fault.kind == 'supply_dip']
    state['mains_share'] = min(shares, default=1.0)
    state['resistor_broken'] = any(fault.kind == 'resistor_open' for fault in active)


def apply_to_temperatures(bodies: Any, active: Sequence[Fault], axes: Sequence[str]) -> None:
    """Update the temperatures of motors and drives, whose axes are given in order; excesses add up."""
    for state, axis in zip(bodies['state'], axes, strict=True):
        values = _values(axis, active)
        state['excess'] = sum(values('motor_hot'))
        state['fan_blocked'] = len(values('fan_blocked')) > 0


def apply_to_motors(state: Any, active: Sequence[Fault], axes: Sequence[str]) -> None:
    """Update brakes and loads of motors, whose axes are given in order."""
    for index, axis in enumerate(axes):
        values = _values(axis, active)
        state['brake_share'][..., index] = math.prod(1.0 - lost for lost in values('brake_worn'))
        state['brake_stuck'][..., index] = len(values('brake_stuck')) > 0
        state['load_torque'][..., index] = sum(values('overload'))


def _values(axis: str, active: Sequence[Fault]) -> Callable[[str], list[float]]:
    """Return a function that lists the values of all active faults of a kind at an axis."""
    return lambda kind: [fault.value for fault in active if fault.kind == kind and fault.target == axis]

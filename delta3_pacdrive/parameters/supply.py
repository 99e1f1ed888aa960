"""The power supply: rectifier, DC link of all drives, and brake resistor; a constant voltage without ``enabled``."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from delta3_pacdrive.configuration.fields import positive, quantity
from delta3_pacdrive.parameters.rotary import violation

UNDER_VOLTAGE, OVER_VOLTAGE = 0.75, 1.35  # relative to the nominal DC link voltage: 420 V and 756 V


@dataclass(frozen=True)
class Supply:
    """Rectifier that only draws from the mains, capacitors in the drives, and brake resistor on one DC link."""

    enabled: bool = quantity(
        'whether the voltage of the DC link follows from its energy; otherwise it is drive.dc_link_voltage_v',
        False,
        True,
        default=False,
    )
    mains_voltage_v: float = positive(
        'line-to-line voltage of the three-phase mains, rms', 700.0, default=400.0
    )
    mains_resistance_ohm: float = quantity(
        'fall of the rectified voltage per current of the rectifier', 0.01, 100.0, default=1.0
    )
    capacitance_f: float = quantity('capacitance of the DC link in each drive', 1e-5, 1.0, default=0.39e-3)
    consumption_w: float = quantity(
        'constant power drawn by the electronics of each drive', 0.0, 1e3, default=10.0
    )
    resistor_ohm: float = quantity('resistance of the brake resistor', 1.0, 1e4, default=60.0)
    resistor_on_v: float = positive('voltage at which the brake resistor is switched on', 1e3, default=700.0)
    resistor_off_v: float = positive('voltage at which it is switched off', 1e3, default=680.0)
    resistor_power_w: float = positive('continuous power of the brake resistor', 1e5, default=150.0)
    resistor_time_constant_s: float = quantity(
        'thermal time constant of the brake resistor', 0.1, 1e4, default=60.0
    )
    starts_empty: bool = quantity(
        'whether the capacitors are empty at the begin of bus time; otherwise they are charged',
        False,
        True,
        default=False,
    )
    precharge_resistance_ohm: float = quantity(
        'resistance in the supply until the DC link is ready', 0.1, 1e4, default=47.0
    )
    ready_share: float = quantity(
        'share of the rectified voltage at which the DC link is ready', 0.5, 0.99, default=0.9
    )

    @property
    def rectified_v(self) -> float:
        """Voltage of the DC link without load: the peak of the line-to-line voltage."""
        return math.sqrt(2.0) * self.mains_voltage_v


def broken_supply(supply: Supply, nominal_v: float) -> Iterator[tuple[str, str]]:
    """Yield violated rules between values of a supply that is enabled, for drives with a ``nominal_v`` [V]."""
    if not supply.enabled:
        return
    if not supply.resistor_off_v < supply.resistor_on_v:
        yield violation(
            'supply.resistor_off_v',
            f'{supply.resistor_off_v:g}',
            f'must be less than supply.resistor_on_v ({supply.resistor_on_v:g})',
        )
    if supply.resistor_off_v <= supply.rectified_v:
        yield violation(
            'supply.resistor_off_v',
            f'{supply.resistor_off_v:g}',
            f'must exceed the rectified voltage of the mains ({supply.rectified_v:.4g} V)',
        )
    if supply.resistor_on_v >= OVER_VOLTAGE * nominal_v:
        yield violation(
            'supply.resistor_on_v',
            f'{supply.resistor_on_v:g}',
            f'must be less than the limit of the drives ({OVER_VOLTAGE * nominal_v:g} V, message 8910)',
        )
    if not UNDER_VOLTAGE * nominal_v < supply.ready_share * supply.rectified_v:
        yield violation(
            'supply.mains_voltage_v',
            f'{supply.mains_voltage_v:g}',
            f'charges the DC link only to {supply.rectified_v:.4g} V: the drives need '
            f'{UNDER_VOLTAGE * nominal_v:g} V (message 8909) at the ready voltage',
        )

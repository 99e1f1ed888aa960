"""Thermal data of the motors of the arms: winding and housing as two bodies, losses, and surroundings of a shift."""

from collections.abc import Iterator
from dataclasses import dataclass

from delta3_pacdrive.configuration.fields import positive, quantity
from delta3_pacdrive.parameters.rotary import violation


@dataclass(frozen=True)
class Thermal:
    """Data for the temperature of the motors in a shift; no program depends on them."""

    ambient_degc: float = quantity('temperature of the surroundings', -40.0, 80.0, default=25.0)
    shift_h: float = quantity('duration of a shift without a pause', 0.1, 1000.0, default=8.0)
    winding_limit_degc: float = quantity(
        'largest temperature of the winding, by its insulation', 60.0, 250.0, default=140.0
    )
    reference_degc: float = quantity(
        'temperature of R, K_m and F_v in the group motor', 0.0, 50.0, default=20.0
    )
    winding_to_housing_k_w: float = quantity(
        'thermal resistance between winding and housing', 0.01, 100.0, default=0.35
    )
    housing_to_ambient_k_w: float = quantity(
        'thermal resistance between housing and surroundings', 0.01, 100.0, default=0.648
    )
    winding_time_constant_s: float = quantity(
        'heat capacity of the winding times its resistance to the housing', 1.0, 1e4, default=90.0
    )
    housing_time_constant_s: float = quantity(
        'heat capacity of the housing times its resistance to the surroundings', 1.0, 1e5, default=2400.0
    )
    copper_coefficient_1_k: float = quantity(
        'relative change of R per kelvin above the reference', 0.0, 0.01, default=0.00393
    )
    magnet_coefficient_1_k: float = quantity(
        'relative change of K_m per kelvin above the reference', -0.002, 0.0, default=-0.0011
    )
    iron_loss_w: float = quantity('iron loss at the largest speed of the motor', 0.0, 1e4, default=40.0)
    iron_loss_exponent: float = quantity('of the speed in the iron loss', 1.0, 2.0, default=1.5)
    motor_friction_share: float = quantity(
        'share of the friction loss that heats the motor; the rest heats the gear', 0.0, 1.0, default=0.3
    )
    warm_friction_share: float = positive(
        'F_v of a gear at operating temperature over that at the reference', 1.0, default=0.6
    )
    warm_up_time_constant_s: float = quantity(
        'time constant with which the oil of the gears warms up', 1.0, 1e5, default=3600.0
    )


def broken_thermal(thermal: Thermal) -> Iterator[tuple[str, str]]:
    """Yield violated rules between values."""
    if thermal.ambient_degc >= thermal.winding_limit_degc:
        yield violation(
            'thermal.ambient_degc',
            f'{thermal.ambient_degc:g}',
            f'must be less than thermal.winding_limit_degc ({thermal.winding_limit_degc:g})',
        )

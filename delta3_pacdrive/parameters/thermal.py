"""Thermal data of motors, gears and drives: bodies and losses, surroundings of a shift, and running drives.

The values of a motor are those of the arms; those of a rotary axis follow from its nominal current.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from delta3_pacdrive.configuration.fields import positive, quantity
from delta3_pacdrive.parameters.rotary import violation

LOSS_MIN = 1e-6  # of 1 A in 1 ohm


@dataclass(frozen=True)
class Thermal:
    """Data for the temperatures of a shift, and with ``in_drives`` for those of the running drives."""

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
    in_drives: bool = quantity(
        'whether motors, gears and drives of a running robot warm up; otherwise they have the reference temperature',
        False,
        True,
        default=False,
    )
    start_degc: float = quantity(
        'temperature of the motors at the begin of bus time; heat sinks have that of the surroundings',
        -40.0,
        200.0,
        default=25.0,
    )
    time_factor: float = quantity('seconds of warming per second of bus time', 1.0, 1e4, default=1.0)
    motor_warning_degc: float = quantity(
        'temperature of the winding of warning 8914 (S-0-0201)', 0.0, 250.0, default=130.0
    )
    sink_to_ambient_k_w: float = quantity(
        'thermal resistance between the heat sink of a drive and its surroundings', 0.01, 100.0, default=0.9
    )
    sink_time_constant_s: float = quantity(
        'heat capacity of the heat sink times this resistance', 1.0, 1e5, default=600.0
    )
    fan_factor: float = quantity(
        'thermal resistance of the heat sink with a blocked fan over that with the fan',
        1.0,
        100.0,
        default=4.0,
    )
    stage_loss_w: float = quantity('loss of a drive without current', 0.0, 1e3, default=12.0)
    stage_loss_w_a: float = quantity('further loss of its power stage per I_eff', 0.0, 100.0, default=5.0)
    sink_warning_degc: float = quantity(
        'temperature of the heat sink of warning 8916 (S-0-0200)', 0.0, 250.0, default=75.0
    )
    sink_limit_degc: float = quantity(
        'temperature of the heat sink that stops the drive (8917, S-0-0203)', 0.0, 250.0, default=85.0
    )

    def of_motor(self, loss: float, loss_of_arms: float) -> 'Thermal':
        """Return the values of another motor by its loss at its nominal current, relative to that of the arms' motors.

        Both are as hot at their nominal currents, and have the same time constants.
        """
        loss_ratio = max(loss, LOSS_MIN) / max(loss_of_arms, LOSS_MIN)
        return replace(
            self,
            winding_to_housing_k_w=self.winding_to_housing_k_w / loss_ratio,
            housing_to_ambient_k_w=self.housing_to_ambient_k_w / loss_ratio,
            iron_loss_w=self.iron_loss_w * loss_ratio,
        )


def broken_thermal(thermal: Thermal) -> Iterator[tuple[str, str]]:
    """Yield violated rules between values; those of warnings only for drives that compute temperatures."""
    ambient, limit = thermal.ambient_degc, thermal.winding_limit_degc
    if ambient >= limit:
        rule = f'must be less than thermal.winding_limit_degc ({limit:g})'
        yield violation('thermal.ambient_degc', f'{ambient:g}', rule)
    if not thermal.in_drives:
        return
    for name, other in (
        ('motor_warning_degc', 'winding_limit_degc'),
        ('sink_warning_degc', 'sink_limit_degc'),
    ):
        value, most = getattr(thermal, name), getattr(thermal, other)
        if value > most:
            yield violation(f'thermal.{name}', f'{value:g}', f'must not exceed thermal.{other} ({most:g})')

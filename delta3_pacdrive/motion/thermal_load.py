"""How moves heat the motors: the rms current at any rate, and the largest override within the limits of the motors."""

from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.motion.execution import OVERRIDE_MAX
from delta3_pacdrive.motion.limits import ROUNDING
from delta3_pacdrive.motion.path_dynamics import PathDynamics
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

SLOWEST = 1e-3  # rate that stands for standstill
AMOUNTS = ('moving', 'mixed', 'standing', 'duration_s', 'dwelling', 'dwell_s')  # what adds up


@dataclass(frozen=True)
class ThermalLoad:
    """What the rms current of the motors at any rate needs: integrals per motor, (3,) each [A^2 s], and times [s].

    Dwells are apart, because a program whose moves are slowed down dwells no longer.
    """

    moving: Floats
    mixed: Floats
    standing: Floats
    duration_s: float
    dwelling: Floats
    dwell_s: float
    override_max: float  # at which every motor and the TCP speed still keep their limits

    def times(self, count: float) -> 'ThermalLoad':
        """Return the effort of doing it ``count`` times."""
        return replace(self, **{name: count * getattr(self, name) for name in AMOUNTS})

    def __add__(self, other: 'ThermalLoad') -> 'ThermalLoad':
        """Return the effort of doing one after the other."""
        amounts = {name: getattr(self, name) + getattr(other, name) for name in AMOUNTS}
        return ThermalLoad(**amounts, override_max=min(self.override_max, other.override_max))

    def slowed(self, factor: float) -> 'ThermalLoad':
        """Return the effort of the same moves, ``factor`` times as slow."""
        return replace(
            self,
            moving=self.moving / factor**3,
            mixed=self.mixed / factor,
            standing=self.standing * factor,
            duration_s=self.duration_s * factor,
            override_max=1.0,
        )

    def rms(self, rate: float, override: float = 1.0) -> Floats:
        """Rms current [A] of each motor, (3,), with moves planned at a rate and everything driven at an override."""
        r = rate * override
        square = r**4 * self.moving + 2.0 * r**2 * self.mixed + self.standing
        # a rate of 0 is the limit of slowness: then no dwell counts beside the moves
        dwells = rate if self.duration_s > 0.0 else 1.0
        square = np.maximum(square, 0.0) + dwells * self.dwelling
        return np.asarray(np.sqrt(square / (self.duration_s + dwells * self.dwell_s)))


@dataclass(frozen=True)
class LoadBehind:
    """The effort of moves behind others, which are driven already and stay as they are."""

    load: ThermalLoad
    before: ThermalLoad

    @property
    def override_max(self) -> float:
        """Override at which every motor and the TCP speed still keep their limits."""
        return min(self.load.override_max, self.before.override_max)

    def rms(self, rate: float, override: float = 1.0) -> Floats:
        """Rms current [A] of each motor, (3,), with the moves behind the others planned at a rate."""
        return (self.before + self.load.slowed(1.0 / max(rate, SLOWEST))).rms(1.0, override)


def thermal_load(d: PathDynamics, weights: Floats, duration_s: float, parameters: Parameters) -> ThermalLoad:
    """Sum up a timed motion; ``weights`` (n,) are the times for which its samples stand [s]."""
    standing = d.standing_current_a
    moving = d.motor_current_a - standing
    motor = parameters.motor
    w = weights[:, None]
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        room = np.maximum(motor.peak_current_a - np.abs(standing), 1e-12) / np.abs(moving)
        speed = motor.max_speed_rad_s / np.abs(d.motor_speed_rad_s)
        tcp = parameters.motion.tcp_speed_limit_m_s * (1.0 + ROUNDING) / d.tcp_speed_m_s
        volts = parameters.drive.dc_link_voltage_v / np.sqrt(6.0) / np.abs(d.phase_voltage_v)
    override_max = min(
        float(np.sqrt(room).min()),
        float(speed.min()),
        float(np.sqrt(volts).min()),
        float(tcp.min()),
        OVERRIDE_MAX,
    )
    return ThermalLoad(
        (w * moving**2).sum(axis=0),
        (w * moving * standing).sum(axis=0),
        (w * standing**2).sum(axis=0),
        duration_s,
        np.zeros(3),
        0.0,
        max(override_max, 1.0),
    )


def dwell_load(d: PathDynamics, time_s: float) -> ThermalLoad:
    """Return what it takes to stand for a time [s] at the first sample."""
    none, square = np.zeros(3), d.standing_current_a[0] ** 2 * time_s
    return ThermalLoad(none, none, none, 0.0, square, time_s, OVERRIDE_MAX)

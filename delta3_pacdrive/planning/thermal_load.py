"""Thermal load of the motors: rms current at any rate, and largest override within the motor limits."""

import math
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import OVERRIDE_MAX
from delta3_pacdrive.planning.limits.joint_forces import force_demands
from delta3_pacdrive.planning.limits.limits import ROUNDING, phase_voltage_max
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics

SLOWEST = 1e-3  # smallest rate, in place of standstill
AMOUNTS = ('moving', 'mixed', 'standing', 'duration_s', 'dwelling', 'dwell_s')  # additive fields


@dataclass(frozen=True)
class ThermalLoad:
    """Integrals for the rms current of the motors at any rate: per motor, (3,) each [A^2 s], and times [s].

    Dwells are separate, because slowing a program down does not lengthen them.
    """

    moving: Floats
    mixed: Floats
    standing: Floats
    duration_s: float
    dwelling: Floats
    dwell_s: float
    override_max: float  # within all motor limits and the TCP speed limit

    def times(self, count: float) -> 'ThermalLoad':
        """Return the load of ``count`` repetitions."""
        return replace(self, **{name: count * getattr(self, name) for name in AMOUNTS})

    def __add__(self, other: 'ThermalLoad') -> 'ThermalLoad':
        """Return the load of both in sequence."""
        amounts = {name: getattr(self, name) + getattr(other, name) for name in AMOUNTS}
        return ThermalLoad(**amounts, override_max=min(self.override_max, other.override_max))

    def slowed(self, factor: float) -> 'ThermalLoad':
        """Return the load of the same moves slowed down by a factor."""
        return replace(
            self,
            moving=self.moving / factor**3,
            mixed=self.mixed / factor,
            standing=self.standing * factor,
            duration_s=self.duration_s * factor,
            override_max=1.0,
        )

    def rms(self, rate: float, override: float = 1.0) -> Floats:
        """Return the rms current [A] of each motor, (3,), for moves slowed to a rate and a program at an override."""
        r = rate * override
        square = r**4 * self.moving + 2.0 * r**2 * self.mixed + self.standing
        # rate 0 is the limit of infinite slowness, where dwells are negligible
        dwells = rate if self.duration_s > 0.0 else 1.0
        square = np.maximum(square, 0.0) + dwells * self.dwelling
        return np.asarray(np.sqrt(square / (self.duration_s + dwells * self.dwell_s)))


@dataclass(frozen=True)
class AppendedLoad:
    """Load of moves appended to others that cannot be slowed down any more."""

    load: ThermalLoad
    before: ThermalLoad

    @property
    def override_max(self) -> float:
        """Largest override within all motor limits and the TCP speed limit."""
        return min(self.load.override_max, self.before.override_max)

    def rms(self, rate: float, override: float = 1.0) -> Floats:
        """Return the rms current [A] of each motor, (3,), for appended moves slowed to a rate."""
        return (self.before + self.load.slowed(1.0 / max(rate, SLOWEST))).rms(1.0, override)


def thermal_load(d: PathDynamics, weights: Floats, duration_s: float, parameters: Parameters) -> ThermalLoad:
    """Integrate the load of a timed motion; ``weights`` (n,) are the time steps of its samples [s]."""
    standing = d.standing_current_a
    moving = d.motor_current_a - standing
    motor = parameters.motor
    w = weights[:, None]
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        room = np.maximum(motor.peak_current_a - np.abs(standing), 1e-12) / np.abs(moving)
        speed = parameters.shaft_speed_max_rad_s / np.abs(d.motor_speed_rad_s)
        moved = np.abs(d.gear_torque_n_m - d.standing_gear_torque_n_m)
        gear = (parameters.gear_torque_max_n_m - np.abs(d.standing_gear_torque_n_m)) / moved
        tcp = parameters.motion.tcp_speed_limit_m_s * (1.0 + ROUNDING) / d.tcp_speed_m_s
        volts = phase_voltage_max(parameters) / np.abs(d.phase_voltage_v)
    forces = math.inf
    if parameters.joints.limit_moves:
        for one in force_demands(d.tcp_motion_m, d.payload_kg, parameters):
            with np.errstate(divide='ignore', invalid='ignore'):
                left = np.maximum(one.limit - np.abs(one.standing), 0.0) / np.abs(one.moving)
            forces = min(forces, float(np.sqrt(left).min()))
    override_max = min(
        forces,
        float(np.sqrt(room).min()),
        float(speed.min()),
        float(np.sqrt(volts).min()),
        float(tcp.min()),
        float(np.sqrt(np.maximum(gear, 0.0)).min()),
        OVERRIDE_MAX,
    )
    return ThermalLoad(
        moving=(w * moving**2).sum(axis=0),
        mixed=(w * moving * standing).sum(axis=0),
        standing=(w * standing**2).sum(axis=0),
        duration_s=duration_s,
        dwelling=np.zeros(3),
        dwell_s=0.0,
        override_max=max(override_max, 1.0),
    )


def dwell_load(d: PathDynamics, time_s: float) -> ThermalLoad:
    """Return the load of a dwell [s] at the first sample."""
    none, square = np.zeros(3), d.standing_current_a[0] ** 2 * time_s
    return ThermalLoad(
        none, none, none, duration_s=0.0, dwelling=square, dwell_s=time_s, override_max=OVERRIDE_MAX
    )

"""Power from the mains, voltage of the DC link, brake resistor and energy balance of a run.

The balance covers the time from the start of the program to the end of the recording:

    drawn = copper + friction + resistor + electronics + motion + stored + rest

``motion`` is the kinetic and potential energy of robot and payload and the magnetic energy of the windings, ``stored``
the energy of the capacitors. The rest is what this evaluation of the signals does not explain: holding brakes, end
stops, and losses beyond the friction of the parameters, as in the gears of a built robot.

Robots on one DC link: the powers of their drives add up, and the capacitors of all drives are connected in parallel.
The motions are those of the separate runs, so this is exact while the voltage limits no drive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.dynamics import gravity, mass_matrix
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Motor, Parameters, numbered, rotary_axis_parameters
from delta3_pacdrive.planning.limits.supply import SupplyLoad, supply_load
from delta3_pacdrive.recording.signals import SUPPLY_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.motor import friction_torques
from delta3_pacdrive.robot.motor_heat import PHASES, heat_constants, resistance_share, warmer_gear
from delta3_pacdrive.robot.plant.dc_link import DcLink, integrate_link
from delta3_pacdrive.studies.runs.run_signals import cycles_of, payloads_kg

NEEDED = (*SUPPLY_SIGNALS, 'shaft_speed', 'shaft_position', 'current', 'current_rms')


@dataclass(frozen=True)
class EnergyBalance:
    """Energies [J] as in the balance above."""

    drawn_j: float
    copper_j: float
    friction_j: float
    resistor_j: float
    electronics_j: float
    motion_j: float
    stored_j: float
    rest_j: float

    @property
    def text(self) -> str:
        """The balance as a sentence."""
        return (
            f'{self.drawn_j:.4g} J drawn: {self.copper_j:.4g} in windings, {self.friction_j:.4g} in friction, '
            f'{self.resistor_j:.4g} in the brake resistor, {self.electronics_j:.4g} in electronics, '
            f'{self.motion_j + self.stored_j:.3g} stored; {100.0 * self.rest_j / max(self.drawn_j, 1e-9):.2g} % '
            'unexplained'
        )


@dataclass(frozen=True)
class SupplyFigures:
    """Load of the supply and energy balance of a run."""

    load: SupplyLoad
    balance: EnergyBalance

    def rows(self) -> list[tuple[str, str]]:
        """Return the figures as rows of text."""
        return [*self.load.rows(), ('balance', self.balance.text)]


@dataclass(frozen=True)
class DrivesPower:
    """Powers of the drives of a robot in consecutive bus cycles, from its run with its own supply."""

    first_cycle: int
    drives_w: Floats  # mean of each cycle, shape (n,)
    mains_w: Floats  # from its own mains, shape (n,)
    resistor_w: Floats  # in its own brake resistor, shape (n,)
    voltage_v: Floats  # at the begin of each cycle, shape (n,)


def drives_power(trace: Trace, parameters: Parameters, first: int | None = None) -> DrivesPower:
    """Return the powers of a run; raises TraceError without signals of the supply or with missing cycles.

    ``first`` is the number of the first cycle, if it should differ from that of the trace: another begin of time.
    """
    cycles = cycles_of(trace)
    voltage, mains, resistor = (trace[name][:, 0] for name in SUPPLY_SIGNALS)
    if len(cycles) < 2 or cycles[-1] - cycles[0] != len(cycles) - 1:
        raise TraceError('the powers of a DC link need a recording of consecutive bus cycles')
    # powers are means of the cycle before
    mains, resistor = mains[1:], resistor[1:]
    drives_w = mains - resistor - _electronics_w(parameters) - _charging_w(voltage, parameters)
    return DrivesPower(int(cycles[0]) if first is None else first, drives_w, mains, resistor, voltage[:-1])


@dataclass(frozen=True)
class CommonSupply:
    """Robots on one DC link against the same robots with a supply each, over the same time."""

    robots: int
    time_s: float
    separate_drawn_j: float  # from the mains, all robots
    separate_resistor_j: float
    separate_peak_w: float  # sum of the powers from the mains
    drawn_j: float
    resistor_j: float
    load: SupplyLoad  # of the common link

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> 'CommonSupply':
        """Return the figures in a document for JSON."""
        return cls(**{**document, 'load': SupplyLoad(**document['load'])})

    def lines(self) -> list[str]:
        """Return the figures as lines of text."""
        saved_j = self.separate_drawn_j - self.drawn_j
        share = 100.0 * saved_j / self.separate_drawn_j if self.separate_drawn_j else 0.0
        return [
            f'{self.robots} robots, {self.time_s:.4g} s',
            f'separate DC links: {self.separate_drawn_j:.4g} J from the mains, {self.separate_peak_w:.0f} W peak, '
            f'{self.separate_resistor_j:.4g} J in brake resistors',
            f'common DC link: {self.drawn_j:.4g} J from the mains ({share:.1f} % less), {self.load.power_peak_w:.0f} W '
            f'peak, {self.resistor_j:.4g} J in the brake resistor',
            *(f'{name}: {text}' for name, text in self.load.rows()),
        ]


def common_supply(powers: Sequence[DrivesPower], parameters: Parameters) -> CommonSupply | None:
    """Return the load of one DC link for several equal robots; None if they have no bus cycle in common.

    Mains, rectifier and brake resistor are those of one robot. The common link starts with the energy that the
    separate ones have at that time.
    """
    begin = max(one.first_cycle for one in powers)
    end = min(one.first_cycle + len(one.drives_w) for one in powers)
    if end <= begin:
        return None
    drives_w, mains_w, resistor_w, voltage_v = (
        np.array([getattr(one, name)[begin - one.first_cycle : end - one.first_cycle] for one in powers])
        for name in ('drives_w', 'mains_w', 'resistor_w', 'voltage_v')
    )
    supply, period_s = parameters.supply, parameters.bus.cycle_time_s
    link = DcLink(
        parameters.replace(
            supply__capacitance_f=supply.capacitance_f * len(powers),
            supply__consumption_w=supply.consumption_w * len(powers),
        )
    )
    link.state['voltage'] = np.sqrt(np.mean(voltage_v[:, 0] ** 2))
    link.state['ready'] = 1
    total_w = drives_w.sum(axis=0)
    mains_j, voltage, resistor_j = found = np.empty((3, end - begin))
    exchanges = round(period_s / parameters.bus.exchange_period_s)
    integrate_link(total_w * period_s, exchanges, link.record, found)
    return CommonSupply(
        robots=len(powers),
        time_s=float((end - begin) * period_s),
        separate_drawn_j=float(mains_w.sum() * period_s),
        separate_resistor_j=float(resistor_w.sum() * period_s),
        separate_peak_w=float(mains_w.sum(axis=0).max()),
        drawn_j=float(mains_j.sum()),
        resistor_j=float(resistor_j.sum()),
        load=supply_load(mains_j / period_s, voltage, resistor_j / period_s, total_w, parameters),
    )


def supply_of_run(trace: Trace, parameters: Parameters) -> SupplyFigures | None:
    """Return the figures of a simulated or recorded run; None without a model of the supply, or with gaps."""
    start = trace.meta.get('start_cycle')
    if any(name not in trace.signals for name in NEEDED) or start is None:
        return None
    cycles = cycles_of(trace)
    first = int(np.searchsorted(cycles, start))
    if first >= len(cycles) - 1 or cycles[-1] - cycles[first] != len(cycles) - 1 - first:
        return None
    part = Trace(trace.time_s[first:], {name: one[first:] for name, one in trace.signals.items()}, trace.meta)
    return _figures(part, parameters)


def _figures(part: Trace, parameters: Parameters) -> SupplyFigures:
    """Return the figures of consecutive bus cycles: sums from the begin of the first to that of the last."""
    drives, period_s = len(parameters.axes), parameters.bus.cycle_time_s
    powers, voltage = drives_power(part, parameters), part['dc_link_voltage'][:, 0]
    copper_j, friction_j, motion_j = np.sum(
        [_of_arms(part, parameters), *(_of_rotary(part, parameters, n) for n in range(drives - ARMS))], axis=0
    ).tolist()
    drawn_j, resistor_j = (float(power.sum() * period_s) for power in (powers.mains_w, powers.resistor_w))
    electronics_j = _electronics_w(parameters) * period_s * len(powers.drives_w)
    charged_j = float(_charging_w(voltage, parameters).sum() * period_s)
    balance = EnergyBalance(
        drawn_j=drawn_j,
        copper_j=copper_j,
        friction_j=friction_j,
        resistor_j=resistor_j,
        electronics_j=electronics_j,
        motion_j=motion_j,
        stored_j=charged_j,
        rest_j=drawn_j - copper_j - friction_j - resistor_j - electronics_j - motion_j - charged_j,
    )
    return SupplyFigures(
        supply_load(powers.mains_w, voltage, powers.resistor_w, powers.drives_w, parameters), balance
    )


def _electronics_w(parameters: Parameters) -> float:
    """Return the consumption [W] of the electronics of all drives."""
    return parameters.supply.consumption_w * len(parameters.axes)


def _charging_w(voltage: Floats, parameters: Parameters) -> Floats:
    """Return the mean power [W] into all capacitors in each cycle, from the voltages [V] at its ends."""
    stored_j = 0.5 * parameters.supply.capacitance_f * len(parameters.axes) * voltage**2
    charging_w: Floats = np.diff(stored_j) / parameters.bus.cycle_time_s
    return charging_w


def _of_arms(part: Trace, parameters: Parameters) -> tuple[float, float, float]:
    """Return copper loss, friction and energy of the motion [J] of the arms."""
    motor, ratio, period_s = parameters.motor, parameters.dynamics.gear_ratio, parameters.bus.cycle_time_s
    speed, current = part['shaft_speed'], part['current']
    resistance, friction = _warm_shares(part, parameters)
    copper_w = PHASES * motor.winding_resistance_ohm / 2.0 * (resistance * part['current_rms'] ** 2)[:-1]
    ends, rates = part['shaft_position'][[0, -1]] / ratio, speed[[0, -1]] / ratio
    masses = mass_matrix(ends, parameters)
    kinetic = 0.5 * np.einsum('ki,kij,kj->k', rates, masses, rates)
    stored = kinetic[1] - kinetic[0] + _winding_j(current[-1], motor) - _winding_j(current[0], motor)
    return (
        float(copper_w.sum() * period_s),
        _friction_j(speed, part.time_s, motor, friction),
        float(stored + _lifting_j(part, parameters)),
    )


def _warm_shares(part: Trace, parameters: Parameters) -> tuple[Floats, Floats]:
    """Return resistance (cycles, arms) and viscous friction (cycles, 1) of a warm robot relative to a cold one."""
    if 'winding_temperature' not in part.signals:
        return np.ones((1, 1)), np.ones((1, 1))
    heat, factor = heat_constants(parameters)[0], parameters.thermal.time_factor
    gears = [warmer_gear(1.0, factor * time_s, heat) for time_s in part.time_s.tolist()]
    windings = part['winding_temperature'].tolist()
    resistances = [[resistance_share(degc, heat) for degc in row] for row in windings]
    return np.array(resistances), np.array(gears)[:, None]


def _winding_j(current: Floats, motor: Motor) -> float:
    """Return the magnetic energy [J] of windings with currents [A rms]."""
    return float(PHASES * motor.winding_inductance_h / 4.0 * np.sum(current**2))


def _friction_j(speed: Floats, time_s: Floats, motor: Motor, viscous: Floats | float = 1.0) -> float:
    """Return the friction loss [J] of shafts with speeds [rad/s] at the begins of bus cycles, shape (cycles, n).

    ``viscous`` is the viscous friction relative to F_v.
    """
    torque = friction_torques(speed, motor) + (viscous - 1.0) * motor.viscous_friction_n_m_s_rad * speed
    return float(np.trapezoid((torque * speed).sum(axis=1), time_s))


def _lifting_j(part: Trace, parameters: Parameters) -> float:
    """Return the work [J] against gravity: the integral of G over the arm angles, with the payloads of the program."""
    angles = part['shaft_position'] / parameters.dynamics.gear_ratio
    payloads = payloads_kg(part, parameters, float(part.time_s[0]))
    work = 0.0
    for payload in np.unique(payloads):
        torque = gravity(angles, parameters.replace(dynamics__payload_mass_kg=float(payload)))
        steps = (0.5 * (torque[1:] + torque[:-1]) * np.diff(angles, axis=0)).sum(axis=1)
        work += float(steps[payloads[:-1] == payload].sum())
    return work


def _of_rotary(part: Trace, parameters: Parameters, number: int) -> tuple[float, float, float]:
    """Return copper loss, friction and energy of the motion [J] of a rotary axis; 0 if it is not recorded."""
    names = [numbered(name, number) for name in ('turn_speed', 'turn_current')]
    if any(name not in part.signals for name in names):
        return 0.0, 0.0, 0.0
    own = rotary_axis_parameters(parameters, number)
    speed, current = part[names[0]] * own.dynamics.gear_ratio, part[names[1]]
    copper_w = PHASES * own.motor.winding_resistance_ohm / 2.0 * current[:, 0] ** 2
    inertia = own.drive.feedforward_inertia_kg_m2
    kinetic = 0.5 * inertia * (speed[-1, 0] ** 2 - speed[0, 0] ** 2)
    magnetic = _winding_j(current[-1], own.motor) - _winding_j(current[0], own.motor)
    return (
        float(np.trapezoid(copper_w, part.time_s)),
        _friction_j(speed, part.time_s, own.motor),
        float(kinetic + magnetic),
    )

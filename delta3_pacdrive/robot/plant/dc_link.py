"""The common DC link of all drives: mains with rectifier, capacitors, precharge, and brake resistor.

The voltage V follows from

    C V' = i - V / R_b - (P_c + P) / V,   i = (V_m - V) / R_m, not below 0

with the rectified voltage V_m, the resistance R_m of mains and rectifier, the brake resistor R_b while it is switched
on, the consumption P_c of the electronics, and the power P of the drives, which is negative while they brake. A step is
an implicit one with the mean x of the voltages at its ends, for which the energy balance is exact:

    2 C x (x - V) = x (i - x / R_b) h - (P_c + P) h

with the currents of a first approximation of x.
The plant knows the energy that the motors draw in an exchange period (``motor.drawn_energy``), which is constant power
here. The drives use the voltage at the start of a bus cycle for the whole cycle.

The power from the mains is V i: R_m stands for the inductances of mains and rectifier, which lower the voltage without
losses. The heat in the resistor of the precharge is not counted.

Arguments of the functions and kernels here:

``link``
    Array of one record ``LINK``.
``s``, ``c``
    Records ``STATE`` and ``CONSTANTS`` of the link.
``voltage``
    Voltage of the link [V].
``current``, ``power``, ``h``
    Current that charges the capacitors [A], power that is drawn from them [W], and time step [s].
``drawn``
    Energy drawn by all motors in an exchange period [J].
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import Parameters

STEP_SHARE = 0.25  # longest step relative to the smallest time constant of the link
ELECTRONICS_MIN_V = 100.0  # below, the power supplies of the electronics do not work
OPENED_SHARE = 0.5  # of the ready voltage: below, the link is precharged again

STATE = np.dtype(
    [
        ('voltage', 'f8'),  # [V]
        ('ready', 'i8'),  # the precharge is over
        ('braking', 'i8'),  # the brake resistor is switched on
        ('heat', 'f8'),  # [J], in the brake resistor
        # since the begin of the bus cycle [J]
        ('cycle_mains', 'f8'),  # from the mains
        ('cycle_resistor', 'f8'),  # in the brake resistor
        # injected
        ('mains_share', 'f8'),  # remaining share of the mains voltage
        ('resistor_broken', 'i8'),
    ],
    align=True,
)

CONSTANTS = np.dtype(
    [
        ('enabled', 'i8'),
        ('steps', 'i8'),  # per exchange period
        ('period', 'f8'),  # exchange period [s]
        ('capacitance', 'f8'),  # of all drives [F]
        ('rectified', 'f8'),  # V_m [V]
        ('resistance', 'f8'),  # R_m [ohm]
        ('precharge', 'f8'),  # R_m until the link is ready [ohm]
        ('ready_voltage', 'f8'),
        ('consumption', 'f8'),  # of all drives [W]
        ('resistor', 'f8'),  # R_b [ohm]
        ('on_voltage', 'f8'),
        ('off_voltage', 'f8'),
        ('heat_max', 'f8'),  # at the continuous power [J]
        ('time_constant', 'f8'),  # of the heat [s]
    ],
    align=True,
)

LINK = np.dtype([('state', STATE), ('constants', CONSTANTS)], align=True)


def link_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``CONSTANTS``."""
    supply, drives = parameters.supply, len(parameters.axes)
    record = np.zeros(1, CONSTANTS)
    record['enabled'] = supply.enabled
    record['period'] = period_s = parameters.bus.exchange_period_s
    record['capacitance'] = capacitance_f = supply.capacitance_f * drives
    least_ohm = min(supply.mains_resistance_ohm, supply.precharge_resistance_ohm, supply.resistor_ohm)
    most_s = min(parameters.drive.current_period_s, STEP_SHARE * least_ohm * capacitance_f)
    record['steps'] = math.ceil(period_s / most_s * (1.0 - 1e-9))
    record['rectified'] = supply.rectified_v
    record['resistance'] = supply.mains_resistance_ohm
    record['precharge'] = supply.precharge_resistance_ohm
    record['ready_voltage'] = supply.ready_share * supply.rectified_v
    record['consumption'] = supply.consumption_w * drives
    record['resistor'] = supply.resistor_ohm
    record['on_voltage'], record['off_voltage'] = supply.resistor_on_v, supply.resistor_off_v
    record['heat_max'] = supply.resistor_power_w * supply.resistor_time_constant_s
    record['time_constant'] = supply.resistor_time_constant_s
    return record


@kernel
def _currents(voltage, s, c):
    """Currents [A] from the mains and in the brake resistor."""
    above = s.mains_share * c.rectified - voltage
    mains = max(above, 0.0) / (c.resistance if s.ready != 0 else c.precharge)
    return mains, voltage / c.resistor if s.braking != 0 else 0.0


@kernel
def _mean_voltage(current, power, h, s, c):
    """Mean of the voltages [V] at the ends of a step."""
    half = 2.0 * c.capacitance * s.voltage + current * h
    root = half * half - 8.0 * c.capacitance * power * h
    # capacitors without charge supply nothing
    return max(0.25 * (half + math.sqrt(max(root, 0.0))) / c.capacitance, 0.5 * s.voltage)


@kernel
def _switch(s, c):
    """Switch brake resistor and precharge by the voltage."""
    if s.resistor_broken != 0:
        s.braking = 0
    elif s.voltage > c.on_voltage:
        s.braking = 1
    elif s.voltage < c.off_voltage:
        s.braking = 0
    if s.voltage >= c.ready_voltage:
        s.ready = 1
    elif s.voltage < OPENED_SHARE * c.ready_voltage:
        s.ready = 0


@kernel
def begin_link_cycle(link):
    """Begin the sums of a bus cycle."""
    s = link[0].state
    s.cycle_mains = s.cycle_resistor = 0.0


@kernel
def advance_link(drawn, link):
    """Integrate the link through an exchange period."""
    s, c = link[0].state, link[0].constants
    h = c.period / c.steps
    for _ in range(c.steps):
        _switch(s, c)
        power = drawn / c.period + (c.consumption if s.voltage > ELECTRONICS_MIN_V else 0.0)
        mains, burnt = _currents(s.voltage, s, c)
        middle = _mean_voltage(mains - burnt, power, h, s, c)
        mains, burnt = _currents(middle, s, c)
        middle = _mean_voltage(mains - burnt, power, h, s, c)
        s.voltage = 2.0 * middle - s.voltage
        s.heat += h * (middle * burnt - s.heat / c.time_constant)
        s.cycle_mains += h * middle * mains
        s.cycle_resistor += h * middle * burnt


@kernel
def integrate_link(drawn, exchanges, link, found):
    """Integrate the link through consecutive periods.

    Parameters
    ----------
    drawn
        Energies drawn by all motors in the periods [J], shape (n,).
    exchanges
        Exchange periods per period.
    link
        Array of one record ``LINK``.
    found
        Receives energy from the mains [J], voltage at the begin [V] and energy in the resistor [J] of each period,
        shape (3, n).

    """
    s = link[0].state
    for n in range(drawn.shape[0]):
        found[1, n] = s.voltage
        begin_link_cycle(link)
        for _ in range(exchanges):
            advance_link(drawn[n] / exchanges, link)
        found[0, n], found[2, n] = s.cycle_mains, s.cycle_resistor


class DcLink:
    """The DC link of all drives of a robot, initially charged without load, or empty.

    Parameters
    ----------
    parameters
        Parameters of the robot; without ``supply.enabled`` the voltage is constant, and ``advance`` has no effect.
    record
        Array of one record ``LINK`` to use, shape (1,); created if None.

    Attributes
    ----------
    record, state
        Record of the compiled loops, and its state, shape (1,).
    enabled
        Whether the link has a model.

    """

    def __init__(self, parameters: Parameters, record: NDArray[Any] | None = None) -> None:
        self.record = record = np.zeros(1, LINK) if record is None else record
        self.state: NDArray[Any] = record['state']
        record['constants'] = link_constants(parameters)
        self.enabled, self._cycle_s = parameters.supply.enabled, parameters.bus.cycle_time_s
        state, supply = self.state, parameters.supply
        state['mains_share'] = 1.0
        voltage = parameters.drive.dc_link_voltage_v
        if supply.enabled:
            voltage = 0.0 if supply.starts_empty else supply.rectified_v
        state['voltage'], state['ready'] = voltage, voltage > 0.0

    def begin_cycle(self) -> None:
        """Begin the sums of a bus cycle."""
        begin_link_cycle(self.record)

    def advance(self, drawn_j: float) -> None:
        """Integrate one exchange period, in which the motors draw an energy [J]."""
        if self.enabled:
            advance_link(drawn_j, self.record)

    def powers_w(self) -> tuple[float, float]:
        """Return the mean powers [W] from the mains and in the brake resistor since the begin of the bus cycle."""
        state, period_s = self.state[0], self._cycle_s
        return float(state['cycle_mains'] / period_s), float(state['cycle_resistor'] / period_s)

    def values(self) -> tuple[float, float, float]:
        """Return voltage [V], readiness (1 or 0), and heat of the brake resistor relative to its continuous power."""
        state, constants = self.state[0], self.record['constants'][0]
        return float(state['voltage']), float(state['ready']), float(state['heat'] / constants['heat_max'])

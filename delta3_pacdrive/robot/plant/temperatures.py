"""Temperatures of motors, gears and drives of a running robot.

The plant collects the losses of a bus cycle from the currents of the drives and the speeds of the shafts, and advances
the temperatures at its end, by ``thermal.time_factor`` times its duration. Those at the start of a bus cycle are valid
throughout the cycle, in the plant (K_m, friction) and in the drives (R, back-EMF, monitoring).

Winding and housing are those of ``robot.motor_heat``. The heat sink of a drive is one body with the loss
P_0 + P_1 |I_eff|; a blocked fan multiplies its thermal resistance.

Arguments of the kernels here:

``bodies``
    Array of records ``BODIES``, one for each axis.
``currents``
    Currents [A rms] of an exchange period, shape (steps, axes).
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters, rotary_axis_parameters
from delta3_pacdrive.robot.motor import MOTOR, motor
from delta3_pacdrive.robot.motor_heat import (
    BURNT_DEGC,
    HEAT,
    heat_constants,
    iron_share,
    resistance_share,
    torque_share,
    warmed,
    warmer_gear,
)

STATE = np.dtype(
    [
        ('winding', 'f8'),  # [degC]
        ('felt', 'f8'),  # [degC], the same with an injected excess, in this bus cycle
        ('housing', 'f8'),  # [degC]
        ('sink', 'f8'),  # [degC], heat sink of the drive
        ('friction', 'f8'),  # viscous friction relative to F_v
        # sums over the samples of a bus cycle
        ('square', 'f8'),  # [A^2]
        ('current', 'f8'),  # [A], magnitudes
        ('samples', 'i8'),
        # over its exchange periods
        ('iron', 'f8'),  # relative to the loss at the largest speed
        ('dry', 'f8'),  # [W]
        ('rubbing', 'f8'),  # [W], of cold gears
        ('periods', 'i8'),
        # injected
        ('excess', 'f8'),  # [K], of the winding
        ('fan_blocked', 'i8'),
    ],
    align=True,
)

CONSTANTS = np.dtype(
    [
        ('step', 'f8'),  # [s], per bus cycle
        ('sink_resistance', 'f8'),  # [K/W]
        ('sink_time', 'f8'),  # [s]
        ('fan_factor', 'f8'),
        ('stage_loss', 'f8'),  # [W]
        ('stage_loss_a', 'f8'),  # [W/A]
    ],
    align=True,
)

BODIES = np.dtype([('state', STATE), ('constants', CONSTANTS), ('heat', HEAT), ('motor', MOTOR)], align=True)


def _bodies(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``BODIES`` for an axis with these parameters, as a view of a new array."""
    record, thermal = np.zeros(1, BODIES), parameters.thermal
    state, constants = record['state'], record['constants']
    state['winding'] = state['felt'] = state['housing'] = thermal.start_degc
    state['sink'] = thermal.ambient_degc
    state['friction'] = 1.0
    constants['step'] = thermal.time_factor * parameters.bus.cycle_time_s
    constants['sink_resistance'] = thermal.sink_to_ambient_k_w
    constants['sink_time'] = thermal.sink_time_constant_s
    constants['fan_factor'] = thermal.fan_factor
    constants['stage_loss'], constants['stage_loss_a'] = thermal.stage_loss_w, thermal.stage_loss_w_a
    record['heat'], record['motor'] = heat_constants(parameters), motor(parameters)
    return record


@kernel
def collect_losses(currents, i, speed, bodies):
    """Add the losses of axis ``i`` in an exchange period, with the ``speed`` [rad/s] of its shaft at the end."""
    s, m = bodies[i].state, bodies[i].motor
    for k in range(currents.shape[0]):
        s.square += currents[k, i] * currents[k, i]
        s.current += abs(currents[k, i])
    s.samples += currents.shape[0]
    s.iron += iron_share(speed, bodies[i].heat)
    s.dry += m.static_friction * math.tanh(speed / m.friction_smoothing) * speed
    s.rubbing += m.viscous_friction * speed * speed
    s.periods += 1


@kernel
def end_heat_cycle(axes, bodies):
    """Advance the temperatures of the first ``axes`` axes by a bus cycle."""
    for i in range(axes):
        s, c, h = bodies[i].state, bodies[i].constants, bodies[i].heat
        share = torque_share(s.winding, h)  # the current is the real one
        square = s.square / s.samples * share * share
        rubbed = s.dry / s.periods + s.friction * s.rubbing / s.periods
        direct = h.iron_loss * s.iron / s.periods + h.motor_share * rubbed
        winding, s.housing = warmed(s.winding, s.housing, square, direct, c.step, h)
        s.winding = min(winding, BURNT_DEGC)
        s.felt = s.winding + s.excess
        s.friction = warmer_gear(s.friction, c.step, h)
        factor = c.fan_factor if s.fan_blocked != 0 else 1.0
        loss = c.stage_loss + c.stage_loss_a * s.current / s.samples
        final = h.ambient + factor * c.sink_resistance * loss
        s.sink = final + (s.sink - final) * math.exp(-c.step / (factor * c.sink_time))
        s.square = s.current = s.iron = s.dry = s.rubbing = 0.0
        s.samples = s.periods = 0


@kernel
def temperatures(i, bodies):
    """Winding, housing, heat sink [degC] and relative viscous friction of axis ``i``."""
    s = bodies[i].state
    return s.felt, s.housing, s.sink, s.friction


@kernel
def warm_plant(i, bodies, state, place):
    """Set K_m, R and friction of axis ``i`` in the ``state`` of arms or rotary axis, at the index ``place``."""
    s, h = bodies[i].state, bodies[i].heat
    state.torque_share[place] = torque_share(s.felt, h)
    state.resistance_share[place] = resistance_share(s.felt, h)
    state.friction_share[place] = s.friction


class Temperatures:
    """Temperatures of all axes of a robot, initially motors at ``thermal.start_degc``, cold gears and heat sinks.

    Parameters
    ----------
    parameters
        Parameters of the robot; without ``thermal.in_drives`` nothing warms up.
    bodies
        Array of records ``BODIES`` to use, shape (axes,) or longer; created if None.

    Attributes
    ----------
    bodies
        Records of the compiled loops, shape (axes,).
    enabled
        Whether motors, gears and drives warm up.

    """

    def __init__(self, parameters: Parameters, bodies: NDArray[Any] | None = None) -> None:
        axes = len(parameters.axes)
        self.bodies: NDArray[Any] = np.zeros(axes, BODIES) if bodies is None else bodies[:axes]
        self.enabled = parameters.thermal.in_drives
        self.bodies[:ARMS] = _bodies(parameters)
        for number in range(axes - ARMS):
            self.bodies[ARMS + number] = _bodies(rotary_axis_parameters(parameters, number))[0]

    def warm(self, arms: Any, rotary: Sequence[Any]) -> None:
        """Set K_m, R and friction in the states of the arms and of the rotary axes, at the start of a bus cycle."""
        for i in range(ARMS):
            warm_plant(i, self.bodies, arms, i)
        for number, state in enumerate(rotary):
            warm_plant(ARMS + number, self.bodies, state, 0)

    def collect(self, currents: Floats, speeds_rad_s: Sequence[float]) -> None:
        """Add the losses of an exchange period, with the ``currents`` [A rms] and the speeds of all axes."""
        for i, speed in enumerate(speeds_rad_s):
            collect_losses(currents, i, speed, self.bodies)

    def end_cycle(self) -> None:
        """Advance the temperatures by a bus cycle."""
        end_heat_cycle(len(self.bodies), self.bodies)

    def values(self) -> list[float]:
        """Return the numbers of ``telegrams.temperatures``: each quantity of ``of_axis``, by axis."""
        rows = [self.of_axis(index) for index in range(len(self.bodies))]
        return [value for quantity in zip(*rows, strict=True) for value in quantity]

    def of_axis(self, index: int) -> tuple[float, float, float, float]:
        """Return winding, housing, heat sink [degC] and relative viscous friction of an axis."""
        winding, housing, sink, friction = temperatures(index, self.bodies)
        return float(winding), float(housing), float(sink), float(friction)

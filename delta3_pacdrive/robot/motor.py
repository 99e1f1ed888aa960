"""The brushless AC servo motor (thesis 7.2, 8.2): winding, back-EMF, torque and friction; currents rms per phase.

With R and L phase to phase and K_m per ampere rms, one phase obeys

    v = (R/2) I + (L/2) dI/dt + (K_m/3) w,   |v| <= V_dc / sqrt(6),   torque = K_m I - F_s tanh(w/w_s) - F_v w

with the current vector on the q axis (i_d = 0): I_eff = i_q / sqrt(2), signed (8.2). A winding short-circuited at its
terminals brakes with v = 0; the neglected d axis would reduce that braking above the electrical speed R/L.

Arguments of the functions and kernels here:

``current``
    I_eff [A].
``voltage``, ``dc_link``
    Voltage of a phase [V rms], and that of the DC link [V].
``speed``, ``shaft_position``
    Speed [rad/s] and position [rad] of the motor shaft.
``m``
    Record ``MOTOR``.
``speed_rad_s``
    Speeds [rad/s] of motor shafts, any shape.
``parameters``
    The parameters of a robot: a ``Parameters``.
``motor``
    Their group ``motor``.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Motor, Parameters

TERMINAL_SHORT = 0.02  # remaining share of R and L, of cable and arc, when the terminals are short-circuited

MOTOR = np.dtype(
    [
        ('torque_constant', 'f8'),
        ('phase_resistance', 'f8'),
        ('current_decay', 'f8'),
        ('phase_inductance', 'f8'),
        ('back_emf_constant', 'f8'),
        ('viscous_friction', 'f8'),
        ('static_friction', 'f8'),
        ('friction_smoothing', 'f8'),
        ('pole_pairs', 'f8'),
    ]
)


def motor(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``MOTOR``; ``current_decay`` is for one period of the current loop."""
    p, drive = parameters.motor, parameters.drive
    record = np.zeros(1, MOTOR)
    # a commutation error rotates the current vector out of the q axis
    record['torque_constant'] = p.torque_constant_n_m_a * math.cos(drive.commutation_offset_rad)
    record['phase_resistance'] = p.winding_resistance_ohm / 2.0
    time_constant = p.winding_inductance_h / p.winding_resistance_ohm
    record['phase_inductance'] = p.winding_inductance_h / 2.0
    record['current_decay'] = math.exp(-drive.current_period_s / time_constant)
    record['back_emf_constant'] = p.torque_constant_n_m_a / 3.0
    record['viscous_friction'] = p.viscous_friction_n_m_s_rad
    record['static_friction'] = p.static_friction_n_m
    record['friction_smoothing'] = p.friction_smoothing_rad_s
    record['pole_pairs'] = p.pole_pairs
    return record


@kernel
def phase_voltage_max(dc_link):
    """Largest phase voltage [V rms] for a DC link voltage [V]."""
    return dc_link / math.sqrt(6.0)


@kernel
def winding_current(current, voltage, speed, m):
    """Current after one period at constant voltage and speed: exact solution of the winding equation."""
    final = (voltage - m.back_emf_constant * speed) / m.phase_resistance
    return final + (current - final) * m.current_decay


@kernel
def short_circuit_current(current, voltage, m):
    """Current [A] of the end stage after one period into shorted terminals: without back-EMF, with unchanged L/R."""
    final = voltage / (TERMINAL_SHORT * m.phase_resistance)
    return final + (current - final) * m.current_decay


@kernel
def friction_torque(speed, m):
    """Friction torque at the shaft, opposing the speed."""
    return warm_friction_torque(speed, 1.0, m)


@kernel
def warm_friction_torque(speed, share, m):
    """Friction torque at the shaft if the viscous friction has fallen to a ``share`` of F_v."""
    return m.static_friction * math.tanh(speed / m.friction_smoothing) + share * m.viscous_friction * speed


@kernel
def drawn_energy(before, now, speed, step, m):
    """Energy [J] that a motor draws from the DC link in a ``step`` [s], negative while it brakes.

    It is the heat and the change of the magnetic energy of the winding, and the work at the shaft, for a current that
    changes linearly from ``before`` to ``now`` [A] at a mean ``speed`` [rad/s].
    """
    return warm_drawn_energy(before, now, speed, step, 1.0, 1.0, m)


@kernel
def warm_drawn_energy(before, now, speed, step, torque_share, resistance_share, m):
    """Energy as ``drawn_energy``, with K_m and R at shares of their values.

    ``before`` and ``now`` are the currents [A] with which a motor with the whole K_m has the same torque during the
    ``step`` [s]; ``torque_share`` and ``resistance_share`` are the values of K_m and R relative to those of ``m``.
    """
    of_square = 1.0 / (torque_share * torque_share)
    heat = m.phase_resistance * (before * before + before * now + now * now) * step
    magnetic = 1.5 * m.phase_inductance * (now * now - before * before)
    winding = (heat * resistance_share + magnetic) * of_square
    return winding + 0.5 * m.torque_constant * (before + now) * speed * step


def friction_torques(speed_rad_s: Floats, motor: Motor) -> Floats:
    """Return the friction torques [N m] that oppose the speeds, same shape."""
    dry = motor.static_friction_n_m * np.tanh(speed_rad_s / motor.friction_smoothing_rad_s)
    return np.asarray(dry + motor.viscous_friction_n_m_s_rad * speed_rad_s)


@kernel
def phase_currents(current, shaft_position, m):
    """Instantaneous I1s, I2s, I3s [A] of the effective current at a shaft position (Fig. 8.3)."""
    peak = math.sqrt(2.0) * current
    angle = m.pole_pairs * shaft_position
    third = 2.0 * math.pi / 3.0
    return (-peak * math.sin(angle), -peak * math.sin(angle - third), -peak * math.sin(angle + third))


@kernel
def phase_columns(effective, shaft_position, m, phases):
    """Fill rows of instantaneous phase currents (or voltages) for columns of effective values.

    Parameters
    ----------
    effective
        I_eff [A], shape (n,).
    shaft_position
        Position of the motor shaft [rad], shape (n,).
    m
        Record ``MOTOR``.
    phases
        Receives I1s, I2s, I3s [A], shape (n, 3).

    """
    for n in range(effective.shape[0]):
        phases[n, 0], phases[n, 1], phases[n, 2] = phase_currents(effective[n], shaft_position[n], m)


def share_text(currents: Sequence[float | None], limit: float, name: str) -> str:
    """Format ``currents`` [A] as shares of a ``limit`` [A] with a ``name``: ``103 % of the nominal current (4 A)``.

    Shares near the limit have one more digit, so that a slight excess is visible.
    """
    shares = [
        '-' if one is None else f'{(share := 100.0 * one / limit):.{1 if 99.0 < share < 101.0 else 0}f}'
        for one in currents
    ]
    return f'{" / ".join(shares)} % of the {name} current ({limit:g} A)'


def thermal_warnings(rms_a: Sequence[float | None], nominal: float, motors: Sequence[str] = ()) -> list[str]:
    """Return a warning for each of the ``motors`` whose rms current ``rms_a`` [A] exceeds the ``nominal`` one [A]."""
    names = motors or [f'motor {number}' for number in range(1, len(rms_a) + 1)]
    return [
        f'{name} draws {rms:.2f} A rms, {share_text([rms], nominal, "nominal")}: it overheats if this repeats '
        'without a pause'
        for name, rms in zip(names, rms_a, strict=True)
        if rms is not None and rms > nominal
    ]

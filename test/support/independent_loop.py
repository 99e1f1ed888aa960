"""A second simulation of drives, motors and arms, which shares no code with the product.

It differs where drives differ: the arms are integrated by Runge-Kutta from the constraint equations of the rods, sensor
noise acts inside the loops, the logged current is sampled ``lead`` periods before the AT, and gains and filters may
deviate from the parameter file.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

PERIOD_S = 62.5e-6  # of the current loop
PER_CYCLE, PER_POSITION, PER_VELOCITY = 16, 4, 2  # periods per bus cycle, and per step of the outer loops
STANDING_CYCLES = 200
SUBSTEPS = 2
VOLTAGE_MAX = 560.0 / math.sqrt(6.0)
INCREMENT_RAD = math.tau / 2**19
GRAVITY = 9.81


@dataclass(frozen=True)
class Delta:
    """Robot of the thesis, as an independent list of its constants (PARAMETERS P1 to P4)."""

    arm: float = 0.4  # m
    forearm: float = 0.95
    radius: float = 0.15  # of the motors less that of the plate
    m_b: float = 1.3  # kg
    m_c: float = 0.25
    m_fb: float = 0.45
    m_n: float = 1.35  # with the payload
    share: float = 2.0 / 3.0  # of a forearm at the elbow
    ratio: float = 32.0
    k_m: float = 0.78  # N m/A
    resistance: float = 2.7  # Ohm, phase to phase
    inductance: float = 13.0e-3  # H
    f_v: float = 3.0e-4
    f_s: float = 0.1
    w_s: float = 1.0
    rotor: float = 8.07e-5  # kg m^2, with its brake
    feedforward: float = 6.41e-4  # kg m^2, motor side
    nominal_k_m: float = 0.78  # assumed by the drive

    @property
    def i_b(self) -> float:
        """Inertia of an arm about its axis, with the rotor [kg m^2]."""
        return self.ratio**2 * self.rotor + self.arm**2 * (self.m_b / 3.0 + self.m_c + self.share * self.m_fb)

    @property
    def m_nt(self) -> float:
        """Mass at the plate [kg]."""
        return self.m_n + 3.0 * (1.0 - self.share) * self.m_fb

    @property
    def m_br(self) -> float:
        """First moment of an arm about its axis [kg m]."""
        return self.arm * (self.m_b / 2.0 + self.m_c + self.share * self.m_fb)


@dataclass(frozen=True)
class Loops:
    """Settings of the drives, and their sensors."""

    position_gain: float = 60.0
    velocity_gain: float = 0.35
    velocity_integral: float = 20.0
    current_gain: float = 30.0
    current_integral: float = 15000.0
    reference_filter_s: float = 2.0e-4
    lead: int = 1  # periods by which the logged current is older than the cycle, 1 to 16
    encoder_noise_rad: float = 3.0e-6
    current_noise_a: float = 0.02
    cubic: bool = False  # set points between bus cycles


@njit
def _solve3(a, b):
    """Solve a 3 x 3 system by Cramer's rule."""
    c0 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c1 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c2 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    det = a[0, 0] * c0 + a[0, 1] * c1 + a[0, 2] * c2
    out = np.empty(3)
    out[0] = (
        b[0] * c0 + a[0, 1] * (a[1, 2] * b[2] - b[1] * a[2, 2]) + a[0, 2] * (b[1] * a[2, 1] - a[1, 1] * b[2])
    )
    out[1] = (
        a[0, 0] * (b[1] * a[2, 2] - a[1, 2] * b[2]) + b[0] * c1 + a[0, 2] * (a[1, 0] * b[2] - b[1] * a[2, 0])
    )
    out[2] = (
        a[0, 0] * (a[1, 1] * b[2] - b[1] * a[2, 1]) + a[0, 1] * (b[1] * a[2, 0] - a[1, 0] * b[2]) + b[0] * c2
    )
    return out / det


@njit
def _elbows(theta, geometry):
    """Elbows and their first and second derivatives with respect to the arm angles, rows by arm."""
    arm, _, radius = geometry
    place, first, second = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        azimuth = 2.0 * math.pi / 3.0 * i
        ca, sa, c, s = math.cos(azimuth), math.sin(azimuth), math.cos(theta[i]), math.sin(theta[i])
        place[i] = (radius + arm * c) * ca, (radius + arm * c) * sa, -arm * s
        first[i] = -arm * s * ca, -arm * s * sa, -arm * c
        second[i] = -arm * c * ca, -arm * c * sa, arm * s
    return place, first, second


@njit
def _plate(place, guess, length):
    """Point at the length of the rods from all elbows, by Newton's method."""
    point = guess.copy()
    for _ in range(20):
        rods = point - place
        gap = np.array([0.5 * ((rods[i] ** 2).sum() - length**2) for i in range(3)])
        step = _solve3(rods, gap)
        point -= step
        if np.abs(step).max() < 1e-13:
            break
    return point


@njit
def _acceleration(theta, speed, torque, point, geometry, masses):
    """Arm accelerations for torques at the arms; also updates ``point``."""
    i_b, m_nt, m_br = masses
    place, first, second = _elbows(theta, geometry)
    point[:] = _plate(place, point, geometry[1])
    rods = point - place
    jacobian = np.empty((3, 3))
    for i in range(3):
        own = np.zeros(3)
        own[i] = (rods[i] * first[i]).sum()
        jacobian[:, i] = _solve3(rods, own)
    velocity = jacobian @ speed
    drift = np.empty(3)
    for i in range(3):
        relative = velocity - first[i] * speed[i]
        drift[i] = (rods[i] * second[i]).sum() * speed[i] ** 2 - (relative**2).sum()
    bend = _solve3(rods, drift)
    mass = m_nt * (jacobian.T @ jacobian)
    force = np.empty(3)
    for i in range(3):
        mass[i, i] += i_b
        force[i] = torque[i] + m_br * GRAVITY * math.cos(theta[i]) - m_nt * GRAVITY * jacobian[2, i]
        force[i] -= m_nt * (jacobian[:, i] * bend).sum()
    return _solve3(mass, force)


@njit
def _net(current, speed, motor):
    """Torques of the motors at the arms, less friction."""
    ratio, k_m, f_v, f_s, w_s = motor
    out = np.empty(3)
    for i in range(3):
        shaft = ratio * speed[i]
        out[i] = ratio * (k_m * current[i] - f_s * math.tanh(shaft / w_s) - f_v * shaft)
    return out


@njit
def _move(theta, speed, before, after, point, plant):
    """Advance the arms by one period in which the currents change linearly."""
    geometry, masses, motor = plant
    h = PERIOD_S / SUBSTEPS
    for n in range(SUBSTEPS):
        i0 = before + (after - before) * (n / SUBSTEPS)
        i1 = before + (after - before) * ((n + 0.5) / SUBSTEPS)
        i2 = before + (after - before) * ((n + 1.0) / SUBSTEPS)
        a1 = _acceleration(theta, speed, _net(i0, speed, motor), point, geometry, masses)
        s2 = speed + 0.5 * h * a1
        a2 = _acceleration(theta + 0.5 * h * speed, s2, _net(i1, s2, motor), point, geometry, masses)
        s3 = speed + 0.5 * h * a2
        a3 = _acceleration(theta + 0.5 * h * s2, s3, _net(i1, s3, motor), point, geometry, masses)
        s4 = speed + h * a3
        a4 = _acceleration(theta + h * s3, s4, _net(i2, s4, motor), point, geometry, masses)
        theta += h * (speed + 2.0 * s2 + 2.0 * s3 + s4) / 6.0
        speed += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0


@njit
def _clamped(value, limit):
    return min(max(value, -limit), limit)


@njit
def _run(commands, plant, winding, loops, start, generator):
    """Return position, speed and current of each bus cycle."""
    half_resistance, half_inductance, emf, forward = winding
    k_pos, k_vel, k_int, k_cur, k_curint, smoothing, lead, noise, current_noise, cubic = loops
    ratio = plant[2][0]
    decay = math.exp(-PERIOD_S * half_resistance / half_inductance)
    count = commands.shape[0]
    out = np.empty((3, count, 3))
    theta, speed = commands[0] / ratio, np.zeros(3)
    point = start.copy()
    # at rest in equilibrium
    load = np.zeros(3)
    for _ in range(100):
        load -= 0.5 * plant[1][0] * _acceleration(theta, speed, load, point, plant[0], plant[1])
    hold = load / (ratio * plant[2][1])
    current, integral = hold.copy(), hold.copy()
    reference, smooth = np.zeros(3), hold.copy()
    voltage, voltage_integral = half_resistance * hold, half_resistance * hold
    sampled = np.zeros((PER_CYCLE, 3))
    measured = theta * ratio
    wanted_speed = np.zeros(3)
    for k in range(-STANDING_CYCLES, count):
        # a set point takes effect in the cycle after its telegram
        c0, c1 = commands[max(k - 3, 0)], commands[max(k - 2, 0)]
        c2, c3 = commands[max(k - 1, 0)], commands[max(k, 0)]
        if k >= 0:
            out[0, k] = (
                np.floor(
                    theta * ratio / INCREMENT_RAD + generator.standard_normal(3) * noise / INCREMENT_RAD + 0.5
                )
                * INCREMENT_RAD
            )
            out[1, k] = ratio * speed + 0.05 * generator.standard_normal(3)
            out[2, k] = sampled[PER_CYCLE - lead]
        for step in range(PER_CYCLE):
            for i in range(3):
                if step % PER_VELOCITY == 0:
                    before = measured[i]
                    own = ratio * theta[i] + noise * generator.standard_normal()
                    measured[i] = math.floor(own / INCREMENT_RAD + 0.5) * INCREMENT_RAD
                    actual = (measured[i] - before) / (PER_VELOCITY * PERIOD_S)
                    now, last, coming = c2[i] - c1[i], c1[i] - c0[i], c3[i] - c2[i]
                    second = now - last
                    if cubic:
                        share = (step + PER_VELOCITY) / PER_CYCLE
                        second = (1.0 - share) * (now - last) + share * (coming - now)
                    if step % PER_POSITION == 0:
                        share = (step // PER_POSITION + 1) * PER_POSITION / PER_CYCLE
                        way, slope = share * now, now
                        if cubic:
                            a, b = 0.5 * (last + now), 0.5 * (now + coming)
                            way = share * (
                                a + share * (3.0 * now - 2.0 * a - b + share * (a + b - 2.0 * now))
                            )
                            slope = a + share * (
                                2.0 * (3.0 * now - 2.0 * a - b) + 3.0 * share * (a + b - 2.0 * now)
                            )
                        wanted_speed[i] = slope * 1e3 + k_pos * (c1[i] + way - measured[i])
                    error = wanted_speed[i] - actual
                    integral[i] += k_int * PER_VELOCITY * PERIOD_S * error
                    reference[i] = k_vel * error + integral[i] + forward * second * 1e6
            before_all = current.copy()
            for i in range(3):
                seen = current[i] + current_noise * generator.standard_normal()
                sampled[step, i] = seen
                smooth[i] += smoothing * (reference[i] - smooth[i])
                applied = voltage[i]
                miss = smooth[i] - seen
                voltage_integral[i] += k_curint * PERIOD_S * miss
                voltage[i] = _clamped(k_cur * miss + voltage_integral[i], VOLTAGE_MAX)
                final = (applied - emf * ratio * speed[i]) / half_resistance
                current[i] = final + (current[i] - final) * decay
            _move(theta, speed, before_all, current, point, plant)
    return out


def log(commands, delta=Delta(), loops=Loops(), seed=0):
    """Return motor_position [rad], motor_speed [rad/s] and current [A] of a log, each of shape (n, 3).

    ``commands`` are the motor commands of each bus cycle of 1 ms [rad], shape (n, 3).
    """
    plant = (
        (delta.arm, delta.forearm, delta.radius),
        (delta.i_b, delta.m_nt, delta.m_br),
        (delta.ratio, delta.k_m, delta.f_v, delta.f_s, delta.w_s),
    )
    winding = (
        delta.resistance / 2.0, delta.inductance / 2.0, delta.k_m / 3.0, delta.feedforward / delta.nominal_k_m
    )  # fmt: skip
    smoothing = 1.0 - math.exp(-PERIOD_S / loops.reference_filter_s)
    settings = (
        loops.position_gain, loops.velocity_gain, loops.velocity_integral, loops.current_gain, loops.current_integral,
        smoothing, loops.lead, loops.encoder_noise_rad, loops.current_noise_a, loops.cubic,
    )  # fmt: skip
    start = np.array([0.0, 0.0, -0.75])
    found = _run(np.ascontiguousarray(commands), plant, winding, settings, start, np.random.default_rng(seed))
    return dict(zip(('motor_position', 'motor_speed', 'current'), found, strict=True))

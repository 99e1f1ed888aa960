"""Test bench: the emulated drive turns a load of constant inertia and gravity, one current period at a time.

Between two exchanges with the plant, a drive integrates its own shaft and motor model, ``robot.drive.shaft_observer``.
The bench sets the inertia of this shaft to that of the load and never exchanges, so that no equation is duplicated.
An elastic gear of a built robot is part of the bench: the drive turns the rotor, the gear turns the load.
The bench turns at a constant speed because the friction slope F_s/w_s at standstill hides the load.

Set points are added in the state of the drive between two periods:

- current: to the integrator of the velocity loop before a period, removed after it;
- speed: to the slope of the command, with an open position loop (gain 0) and a velocity feed-forward of 1;
- position: to the last three commands, which keeps their differences and thus the feed-forwards unchanged.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import INERTIA, Parameters
from delta3_pacdrive.parameters.notch import NUMBERS
from delta3_pacdrive.robot.drive.arrays import STATE, DriveState
from delta3_pacdrive.robot.drive.diagnostics import fault_text
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from delta3_pacdrive.studies.drives.loops.load import Load, gear_of
from delta3_pacdrive.studies.runs.oscilloscope import finest

SETTLING_S = 0.25  # after the drive is enabled: 15 time constants of the position loop
ENABLING_CYCLES_MAX = 2000
MARGIN_RAD = 1.0  # between the end of travel and the initial position


class Place(StrEnum):
    """Point at which a set point is added; determines which loops are closed."""

    CURRENT = 'current'  # current loop alone, shaft locked
    SPEED = 'speed'  # velocity loop and the loops inside it
    POSITION = 'position'  # all loops, without feed-forwards
    PLANT = 'plant'  # all loops; added to the current set point, the input of winding and load


@dataclass(frozen=True)
class Run:
    """Recording of every current period of a run on the bench."""

    period_s: float  # of the current loop
    added: Floats  # set point that was added, shape (samples,)
    states: NDArray[Any]  # state of the drive at the end of each period, shape (samples,)

    def __getitem__(self, name: str) -> Floats:
        """Return a field of the state over time."""
        return np.asarray(self.states[name], dtype=np.float64)

    def at_start(self, name: str) -> Floats:
        """Return a field at the start of each period."""
        values = self[name]
        return np.concatenate([values[:1], values[:-1]])


def test_bench_parameters(parameters: Parameters, load: Load, place: Place) -> Parameters:
    """Return parameters of the drive on the bench: load inertia in its shaft, loops outside ``place`` open."""
    drive = parameters.drive
    values: dict[str, Any] = {'control__feed_forward': INERTIA}  # without a task no torque is commanded
    if math.isfinite(load.inertia_kg_m2):
        gear = gear_of(parameters)
        own = load.inertia_kg_m2 if gear is None else gear.rotor_kg_m2
        inertia = own * parameters.dynamics.gear_ratio**2
        values['drive__observer_arm_inertia_kg_m2'] = inertia
    if place == Place.CURRENT:
        values |= {'drive__velocity_gain_a_s_rad': 0.0, 'drive__velocity_integral_gain_a_rad': 0.0}
        values |= {'drive__current_feedforward': 0.0, 'drive__disturbance_bandwidth_hz': 0.0}
        values |= {f'drive__notch_{number}_frequency_hz': 0.0 for number in NUMBERS}  # of the velocity loop
    elif place == Place.SPEED:
        values |= {'drive__position_gain_rad_s_rad': 0.0, 'drive__velocity_feedforward': 1.0}
        # set points of the speed in every period of its loop
        values |= {'drive__current_feedforward': 0.0, 'drive__position_period_s': drive.velocity_period_s}
    return finest(parameters).replace(**values)


class Bench:
    """Test bench with one enabled drive and its load at constant speed; each ``run`` continues the previous one.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    load
        Load of the drive; an infinite inertia locks the shaft.
    place
        Point at which ``run`` adds its set point.
    speed_rad_s
        Speed of the bench, motor side; 0 for a locked shaft.

    Raises
    ------
    RunError
        The drive cannot be enabled, or trips before the speed has settled.

    """

    def __init__(self, parameters: Parameters, load: Load, place: Place, speed_rad_s: float) -> None:
        own = test_bench_parameters(parameters, load, place)
        self._drive = MC4(own)
        self._fields = set_point_fields(place, own.bus.cycle_time_s)
        self._held = not math.isfinite(load.inertia_kg_m2)
        self.speed_rad_s = 0.0 if self._held else speed_rad_s
        self._cycle_time = own.bus.cycle_time_s
        self._period = own.drive.current_period_s
        self._load_n_m = load.gravity_n_m
        self._gear = None if self._held else gear_of(parameters)
        self._arm_kg_m2 = load.inertia_kg_m2 - (self._gear.rotor_kg_m2 if self._gear else 0.0)
        self._steps = round(self._cycle_time / self._period)
        # start near the end of travel; the speed leads away from it
        self._position = self._command = float(self._drive.state['travel_min'][0]) + MARGIN_RAD
        self._shaft_speed = self._arm_speed = self.speed_rad_s
        twist = self._load_n_m / self._gear.stiffness_n_m_rad if self._gear else 0.0
        self._arm = self._position - twist
        self._step = 0
        self._enable()

    def _enable(self) -> None:
        try:
            for _ in range(ENABLING_CYCLES_MAX):
                self.run(np.zeros(self._steps))
                if self._drive.drive_state == DriveState.ENABLED:
                    break
            self.run(np.zeros(self._steps * round(SETTLING_S / self._cycle_time)))
        except RunError as error:
            raise RunError(f'on the bench: {error}') from error
        if self._drive.drive_state != DriveState.ENABLED:
            raise RunError(f'on the bench: {self._cause()}')

    def _cause(self) -> str:
        fault = self._drive.fault
        return fault_text(fault) if fault else f'the drive is {self._drive.drive_state.name}'

    def run(self, added: Floats) -> Run:
        """Add a set point, one value per current period, and return the recording; raises RunError."""
        states = np.empty(len(added), dtype=STATE)
        drive, row = self._drive, self._drive.state[0]
        for k, value in enumerate(added.tolist()):
            shaft = self._position, self._shaft_speed, self._load_torque()
            if self._step % self._steps == 0:
                drive.begin_cycle(self._command, CONTROL_ENABLE, *shaft)
                self._command += self.speed_rad_s * self._cycle_time
                if drive.fault:
                    raise RunError(self._cause())
            for name, factor in self._fields:
                row[name] += factor * value
            drive.run_sample(*shaft)
            for name, factor in self._fields:
                row[name] -= factor * value
            states[k] = row
            self._step += 1
            self._move_arm(shaft[2])
            if not self._held:
                self._position, self._shaft_speed = float(row['position']), float(row['speed'])
        return Run(self._period, added, states)

    def add_load(self, torque_n_m: float) -> None:
        """Add a constant torque at the arm from now on, motor side."""
        self._load_n_m -= torque_n_m

    def _load_torque(self) -> float:
        """Return the torque on the motor; with an elastic gear that in the middle of the next period."""
        if self._gear is None:
            return self._load_n_m
        rate = self._shaft_speed - self._arm_speed
        return float(self._gear.torque(self._position - self._arm + 0.5 * self._period * rate, rate))

    def _move_arm(self, passed: float) -> None:
        if self._gear is not None:
            acceleration = (passed - self._load_n_m) / self._arm_kg_m2
            self._arm += self._period * (self._arm_speed + 0.5 * self._period * acceleration)
            self._arm_speed += self._period * acceleration


def set_point_fields(place: Place, cycle_time_s: float) -> tuple[tuple[str, float], ...]:
    """Return the state fields of a drive to which a set point is added before a period, each with its factor."""
    if place in (Place.CURRENT, Place.PLANT):
        return (('velocity_integral', 1.0),)
    if place == Place.POSITION:
        return tuple((name, 1.0) for name in ('command', 'command_before', 'command_before_that'))
    return (('command_before', -cycle_time_s),)

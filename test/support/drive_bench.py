"""Three MC-4 drives on the plant, or a single one, for the tests of drives."""

import math

import numpy as np

from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.diagnostics import DriveFault
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, Status, in_torque
from delta3_pacdrive.simulation.robot import Robot

INCREMENT_RAD = math.tau / 2**19
I_PEAK, I_NOMINAL, K_M, GEAR = 17.0, 4.1, 0.78, 32.0
SAG_RAD = 1e-5  # arm; 4 um at the elbow, where gravity alone would take it 1 mm in 10 ms
CURRENT_OVERSHOOT = 1.05  # the current loop has 62 deg phase margin, the limit is on its reference


class Bench:
    """Three drives on the plant, with a record of every bus cycle."""

    def __init__(self, parameters):
        self.robot = Robot(parameters)
        self.start = np.array(self.robot.encoder_positions())
        self.answers = self.robot.answers
        self.shafts, self.currents, self.states, self.status, self.released = [], [], [], [], []

    def run(self, cycles, offset=0.0, control=CONTROL_ENABLE):
        """Run cycles with commands ``offset`` [rad, motor] from the start; it may be a function of the cycle."""
        for n in range(cycles):
            now = offset(n) if callable(offset) else offset
            self.robot.cycle(self.start + now, control)
            self.status.append(self.robot.status.tolist())
            self.shafts.append(self.robot.plant.shafts())
            self.currents.append([drive.currents.copy() for drive in self.robot.drives])
            self.states.append([drive.drive_state for drive in self.robot.drives])
            self.released.append(self.robot.plant.state['brake_released'][0].copy())
        return self

    @property
    def moved(self):
        """Shaft positions [rad] from the start, shape (cycles, 3)."""
        return np.array(self.shafts)[:, :3] - self.start

    @property
    def faults(self):
        return [drive.fault for drive in self.robot.drives]


def stand(drive, command, cycles=1, position=0.0, speed=0.0, control=CONTROL_ENABLE):
    """Run a drive with a locked shaft; return its currents."""
    currents = []
    for _ in range(cycles):
        drive.begin_cycle(command, control, position, speed, 0.0)
        for _ in range(16 // len(drive.currents)):
            drive.run_period(position, speed, 0.0)
            currents.append(drive.currents.copy())
    return np.concatenate(currents)


def enabled_drive(parameters):
    """Return a drive that follows its command on a shaft held at 0."""
    drive = MC4(parameters)
    stand(drive, 0.0, 60)
    assert drive.drive_state == DriveState.ENABLED
    return drive


def ramp(rate, end):
    return lambda n: min((n + 1) * rate, end)


def assert_stopped(bench, axis, fault):
    """Check that one axis has stopped under its brake without power, with a cause, and the others continue."""
    drive = bench.robot.drives[axis]
    assert drive.fault == fault
    assert drive.drive_state == DriveState.FAULT
    assert bench.status[-1][axis] & Status.ERROR
    assert not in_torque(bench.status[-1][axis])
    assert not drive.state['brake_release'][0]
    assert not drive.currents.any()
    assert not bench.released[-1][axis]
    assert bench.shafts[-1][3 + axis] == 0.0
    others = [other for n, other in enumerate(bench.robot.drives) if n != axis]
    assert [other.fault for other in others] == [DriveFault.NONE] * 2
    assert np.ptp(bench.moved[-20:, axis]) == 0.0

"""A robot with oscilloscopes in its drives, run exchange by exchange as in the nodes, with identical results."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters
from delta3_pacdrive.recording.acquisition import Acquisition
from delta3_pacdrive.robot.drive.bus_drive import own_parameters
from delta3_pacdrive.robot.drive.mc4 import mc4_run_period
from delta3_pacdrive.robot.drive.scope import Block, DriveScope
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, require_axis
from delta3_pacdrive.simulation.robot import Robot


class ScopedRobot(Robot):
    """A robot with oscilloscopes in its drives.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    acquisition
        Receives the records of the oscilloscopes, and selects their channels.

    Raises
    ------
    ParameterError
        A channel belongs to a rotary axis that the robot does not have.

    """

    observed = True

    def __init__(self, parameters: Parameters, acquisition: Acquisition) -> None:
        super().__init__(parameters)
        self._cycle = 0
        self._acquisition, self._setting = acquisition, acquisition.setting
        self._parameters = parameters
        for axis in self._setting.axes:
            require_axis(ALL_DRIVES[axis], parameters.axes, ParameterError)
        self._scopes = {axis: self._scope(axis) for axis in self._setting.axes}

    def _scope(self, axis: int) -> DriveScope:
        def hand_over(block: Block) -> None:
            self._acquisition.add(axis, block)

        parameters, _ = own_parameters(self._parameters, axis)
        drive, setting = self.drives[axis], self._setting
        return DriveScope(drive, setting.of_axis(axis), setting.decimation, lambda: parameters, hand_over)

    def cycle(
        self,
        commands: Floats,
        control: int,
        payload_kg: float | None = None,
        received: bool | Sequence[bool] = True,
        torques: ArrayLike = 0.0,
    ) -> None:
        """Run one bus cycle as ``Robot.cycle``, with the oscilloscopes."""
        r = self.record[0]
        self.take_payload(float(r['next_payload']) if payload_kg is None else payload_kg)
        exchanges, axes = int(r['exchanges']), len(commands)
        if self.link.enabled:
            for drive in self.drives[:axes]:
                drive.take_link(self.link.values())
            self.link.begin_cycle()
        warms = self.temperatures.enabled
        if warms:
            for index, drive in enumerate(self.drives[:axes]):
                drive.take_temperatures(self.temperatures.of_axis(index))
            self.temperatures.warm(self.plant.state[0], [axis.state[0] for axis in self.rotary])
        additive, arrives = np.broadcast_to(torques, axes).tolist(), np.broadcast_to(received, axes)
        for i, (drive, shaft) in enumerate(zip(self.drives[:axes], self.shafts(), strict=False)):
            if arrives[i]:
                self.status[i] = drive.begin_cycle(
                    commands[i], control, shaft[0], shaft[1], shaft[2], torque=additive[i]
                )
            else:
                self.status[i] = drive.extrapolate_cycle(*shaft)
            self.answers[:, i] = drive.answer
        for exchange in range(self._cycle * exchanges, (self._cycle + 1) * exchanges):
            shafts = self.shafts()[:axes]
            released = [self._run(exchange, i, shaft) for i, shaft in enumerate(shafts)]
            self.plant.advance(self.currents, released[:ARMS], self.payload)
            carried = float(self.plant.state['carried'][0])
            for axis, brake_released in zip(self.rotary, released[ARMS:], strict=False):
                axis.advance(self.currents, brake_released, carried)
            if self.link.enabled:
                self.link.advance(sum((axis.drawn_j for axis in self.rotary), self.plant.drawn_j))
            if warms:
                self.temperatures.collect(self.currents, [speed for _, speed, _ in self.shafts()[:axes]])
        if warms:
            self.temperatures.end_cycle()
        self._cycle += 1

    def _run(self, exchange: int, i: int, shaft: Sequence[float]) -> bool:
        if i in self._scopes and not self._acquisition.done:
            return self._scopes[i].run_period(exchange, *shaft)
        return self.drives[i].run_period(*shaft)

    def finish(self) -> None:
        """Hand over the remaining samples of the oscilloscopes."""
        for scope in self._scopes.values():
            scope.flush()
        self._acquisition.finish()


FOUND = ('position', 'speed', 'command', 'motor_current', 'voltage')  # fields of a drive's state
POSITION, SPEED = FOUND.index('position'), FOUND.index('speed')


@kernel
def run_recorded_exchange(row, shafts, words, added, robot, currents, found, left):
    """Run the drives from one exchange to the next, one period of the current loop at a time.

    Parameters
    ----------
    row
        Row of the first period in the recorded arrays.
    shafts
        True shafts at the start: three positions [rad], three speeds [rad/s], three coupling torques d [N m].
    words
        States of the drives as numbers, one word each, shape (axes, words).
    added
        Indices of the words to add to, factors, number of the drive, and a value for each period.
    robot
        Array of one record ``ROBOT``; ``brakes`` is set.
    currents
        Receives the motor currents of an exchange period [A], shape (steps, axes).
    found, left
        Indices of the words recorded at the start (``FOUND``) and at the end of each period, and the arrays that
        receive them, shape (fields, samples, 3).

    """
    places, factors, axis, values = added
    found_places, found_values = found
    left_places, left_values = left
    r = robot[0]
    for i in range(3):
        state, s = words[i], r.drives[i].state
        shaft = shafts[i], shafts[3 + i], shafts[6 + i]
        for n in range(currents.shape[0]):
            for k in range(found_places.shape[0]):
                found_values[k, row + n, i] = state[found_places[k]]
            found_values[POSITION, row + n, i], found_values[SPEED, row + n, i] = shaft[0], shaft[1]
            if i == axis:
                for k in range(places.shape[0]):
                    state[places[k]] += factors[k] * values[row + n]
            # continue with the drive's own shaft: to the drive this is one exchange
            r.brakes[i] = mc4_run_period(shaft, r.drives, i, currents[n : n + 1])
            if i == axis:
                for k in range(places.shape[0]):
                    state[places[k]] -= factors[k] * values[row + n]
            for k in range(left_places.shape[0]):
                left_values[k, row + n, i] = state[left_places[k]]
            shaft = s.position, s.speed, s.coupling

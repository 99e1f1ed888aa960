"""A robot whose drives have oscilloscopes: exchange by exchange, as the nodes run it, with the same bits."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.drive.scope import Block, DriveScope
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.acquisition import Acquisition
from delta3_pacdrive.simulation.robot import Robot


class ScopedRobot(Robot):
    """A robot that is observed.

    Parameters
    ----------
    parameters
        Of the robot.
    acquisition
        Takes what the oscilloscopes hand over; its setting says what they show.

    """

    observed = True

    def __init__(self, parameters: Parameters, acquisition: Acquisition) -> None:
        super().__init__(parameters)
        self._cycle = 0
        self._acquisition, self._setting = acquisition, acquisition.setting
        self._parameters = parameters
        self._scopes = {axis: self._scope(axis) for axis in self._setting.axes}

    def _scope(self, axis: int) -> DriveScope:
        def hand_over(block: Block) -> None:
            self._acquisition.add(axis, block)

        channels = self._setting.of_axis(axis)
        every = self._setting.decimation
        return DriveScope(self.drives[axis], channels, every, lambda: self._parameters, hand_over)

    def cycle(
        self,
        commands: Floats,
        control: int,
        payload_kg: float | None = None,
        received: Sequence[bool] = (True, True, True),
        torques: ArrayLike = 0.0,
    ) -> None:
        """Run one bus cycle as ``Robot.cycle`` does, with the oscilloscopes."""
        r = self.record[0]
        self.take_payload(float(r['next_payload']) if payload_kg is None else payload_kg)
        exchanges, beside = int(r['exchanges']), np.broadcast_to(torques, 3).tolist()
        for i, (drive, shaft) in enumerate(zip(self.drives, self._shafts(), strict=True)):
            if received[i]:
                self.status[i] = drive.begin_cycle(
                    commands[i], control, shaft[0], shaft[1], shaft[2], torque=beside[i]
                )
            else:
                self.status[i] = drive.extrapolate_cycle(*shaft)
            self.answers[:, i] = drive.answer
        for exchange in range(self._cycle * exchanges, (self._cycle + 1) * exchanges):
            shafts = self._shafts()
            released = [self._run(exchange, i, shaft) for i, shaft in enumerate(shafts)]
            self.plant.advance(self.currents, released, self.payload)
        self._cycle += 1

    def _shafts(self) -> list[list[float]]:
        values = self.plant.shafts()
        return [values[i::3] for i in range(3)]

    def _run(self, exchange: int, i: int, shaft: Sequence[float]) -> bool:
        if i in self._scopes and not self._acquisition.done:
            return self._scopes[i].run_period(exchange, *shaft)
        return self.drives[i].run_period(*shaft)

    def finish(self) -> None:
        """Hand over what the oscilloscopes still hold."""
        for scope in self._scopes.values():
            scope.flush()
        self._acquisition.finish()

"""The robot behind the bus: three drives and the plant, one bus cycle after the other, without ROS."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.drive.mc4 import MC4, mc4_begin_cycle, mc4_run_period
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.plant import Plant, advance
from delta3_pacdrive.sercos.words import payload_on_grid

AXES = ('axis1', 'axis2', 'axis3')


@kernel
def robot_cycle(
    heard, motors, control, payload_kg, status, answers, payload, exchanges, drives, drive_constants, plant
):
    """One bus cycle of drives and plant, exchange by exchange; ``heard`` (3,) says which drives get their MDT.

    ``payload`` holds what is gripped now, and what the last MDT said [kg].
    """
    (
        motor_record,
        plant_state,
        plant_constants,
        geometry_record,
        inertia_record,
        rich,
        shafts,
        matrix,
        brakes,
    ) = plant
    payload[0] = payload[1]
    payload[1] = payload_kg
    for i in range(3):
        state, answer, _ = drives[i]
        status[i] = mc4_begin_cycle(
            heard[i] != 0,
            motors[i],
            control,
            shafts[i],
            shafts[3 + i],
            shafts[6 + i],
            answer,
            state,
            drive_constants,
        )
        for row in range(3):
            answers[row, i] = answer[row]
    for _ in range(exchanges):
        for i in range(3):
            state, _, currents = drives[i]
            brakes[i] = mc4_run_period(
                shafts[i], shafts[3 + i], shafts[6 + i], currents, state, drive_constants, motor_record
            )
            for n in range(currents.shape[0]):
                matrix[n, i] = currents[n]
        advance(
            matrix,
            brakes,
            payload[0],
            shafts,
            plant_state,
            plant_constants,
            geometry_record,
            inertia_record,
            motor_record,
            rich,
        )


class Robot:
    """Plant and drives, one exchange after the other."""

    def __init__(self, parameters: Parameters) -> None:
        bus = parameters.bus
        self.plant = Plant(parameters)
        self.drives = [MC4(parameters, index) for index in range(len(AXES))]
        gripped = payload_on_grid(parameters.dynamics.payload_mass_kg)
        self.payload: Floats = np.array([gripped, gripped])
        self.exchanges = round(bus.cycle_time_s / bus.exchange_period_s)
        steps = len(self.drives[0].currents)
        self.drive_arrays = tuple((drive.state, drive.answer, drive.currents) for drive in self.drives)
        self.drive_constants = self.drives[0].constants
        self.plant_arrays = (*self.plant.arrays(), np.zeros((steps, 3)), np.zeros(3, dtype=np.int64))
        self._status = np.zeros(3, dtype=np.int64)
        self._heard = np.ones(3, dtype=np.int64)

    def encoder_positions(self) -> list[float]:
        """Motor shaft positions [rad] as the encoders read them."""
        positions = self.plant.shafts()[:3]
        return [drive.encoder_position(p) for drive, p in zip(self.drives, positions, strict=True)]

    def arrays(self) -> tuple[Any, ...]:
        """Arrays for a loop that is compiled as a whole, as ``robot_cycle`` takes them."""
        return (self.payload, self.exchanges, self.drive_arrays, self.drive_constants, self.plant_arrays)

    def cycle(
        self,
        commands: Floats,
        control: int,
        answers: Floats,
        payload_kg: float | None = None,
        heard: Sequence[bool] = (True, True, True),
    ) -> list[int]:
        """Run one bus cycle; fill ``answers`` (3 rows: position, speed, torque) and return the status words."""
        self._heard[:] = heard
        robot_cycle(
            self._heard,
            np.ascontiguousarray(commands, dtype=np.float64),
            control,
            float(self.payload[1]) if payload_kg is None else payload_kg,
            self._status,
            answers,
            self.payload,
            self.exchanges,
            self.drive_arrays,
            self.drive_constants,
            self.plant_arrays,
        )
        return list(self._status.tolist())

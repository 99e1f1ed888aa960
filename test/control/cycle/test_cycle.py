"""Tests of the controller's part of a bus cycle: faults that stop the robot, first cycle and kind of stop."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.cycle import ControllerCycle, Stop, emergency_stop
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_ON, Status

FOLLOWS = int(Status.IN_TORQUE | Status.FOLLOWS_COMMAND)
FAULT, FAULT_ON_PATH = int(Status.ERROR), int(Status.ERROR) | FOLLOWS


class Controller:
    """A controller at rest at home, with the replies of a test."""

    def __init__(self, robot):
        self.task, self.axes = Transformation(robot), AxisMonitor(robot)
        self.cycle = ControllerCycle(self.task, self.axes, robot)
        theta = kinematics.inverse(np.array(robot.motion.home_m), robot.kinematics)
        self.motors = (theta * robot.dynamics.gear_ratio).tolist()
        self.task.locate(self.motors)
        self.axes.begin()

    def evaluate(self, cycle, status=(FOLLOWS,) * 3, lost=(), starts=NEVER, stopped=False):
        answers = [
            None if axis in lost else ((position, 0.0, 0.0), word, 'more')
            for axis, (position, word) in enumerate(zip(self.motors, status, strict=True))
        ]
        return self.cycle.evaluate(cycle, answers, starts, stopped)


@pytest.fixture
def controller(robot):
    return Controller(robot)


def test_a_command_holds_shafts_control_word_and_payload(controller, robot):
    controller.task.enable(1)
    assert controller.task.command(0).control == CONTROL_ON
    motors, torques, control, payload, *_ = controller.task.command(1)
    assert control == CONTROL_ENABLE
    assert payload == robot.dynamics.payload_mass_kg
    assert not torques.any()
    assert motors == pytest.approx(controller.motors, abs=2e-5)


def test_ats_without_faults_stop_no_axis_and_are_evaluated(controller, robot):
    controller.task.command(0)
    assert controller.evaluate(0, starts=0) is None
    assert controller.task.answer['tcp_actual'] == pytest.approx(robot.motion.home_m)


def test_a_fault_stops_the_robot_when_all_commands_that_are_out_are_over(controller, robot):
    stop = controller.evaluate(7, (FOLLOWS, FAULT_ON_PATH, FOLLOWS))
    first = 7 + robot.bus.outstanding_cycles_max
    fault = RobotFault(FaultCode.DRIVE, 'axis2 reports a fault in bus cycle 7', 'axis2', cycle=7)
    assert stop == Stop(fault, first, hard=False, drive=1)


def test_lost_axis_makes_the_stop_hard_even_during_another_stop(controller):
    status = (FOLLOWS, FOLLOWS, FAULT)
    assert controller.evaluate(7, status).hard
    controller.axes.begin()
    assert controller.evaluate(8, status, stopped=True).hard


def test_a_robot_that_is_stopped_is_not_stopped_again_by_an_axis_that_follows(controller):
    assert controller.evaluate(7, (FAULT_ON_PATH, FOLLOWS, FOLLOWS), stopped=True) is None


def test_one_lost_at_stops_no_axis_and_the_second_in_a_row_does(controller):
    assert controller.evaluate(0, lost=[0]) is None
    assert 'two AT lost in a row' in controller.evaluate(1, lost=[0]).fault.sentence


def test_an_emergency_stop_begins_with_the_command_of_its_cycle():
    fault = RobotFault(FaultCode.EMERGENCY_STOP, 'emergency stop in bus cycle 40', cycle=40)
    assert emergency_stop(40) == Stop(fault, 40, hard=False)

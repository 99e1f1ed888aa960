"""Scripting API: Python programs that move a robot, wait for inputs and make decisions.

    from delta3_pacdrive import scripting

    with scripting.simulate(inputs={'part': [(0.4, True)]}) as robot:
        robot.move_l(to_mm=[100, 0, -800])
        robot.wait_input('part')
        robot.move_l(to_mm=[100, 0, -850])
        robot.output('gripper', True)

Use ``scripting.connect()`` instead of ``scripting.simulate(...)`` for a running robot. ``delta3 simulate FILE.py`` and
``delta3 run FILE.py`` execute the same calls in a function ``main(robot)`` of a file.
"""

from delta3_pacdrive.errors import ScriptError, WaitTimeoutError
from delta3_pacdrive.scripting.connected_link import connect
from delta3_pacdrive.scripting.robot import Robot, State
from delta3_pacdrive.scripting.simulation import Simulation, simulate

__all__ = ['Robot', 'ScriptError', 'Simulation', 'State', 'WaitTimeoutError', 'connect', 'simulate']

"""Programs with decisions: Python scripts that move a robot, wait for inputs, and go on as these say.

    from delta3_pacdrive import cell

    with cell.simulate(inputs={'part': [(0.4, True)]}) as robot:
        robot.move_l(to_mm=[100, 0, -800])
        robot.wait_input('part')
        robot.move_l(to_mm=[100, 0, -850])
        robot.output('gripper', True)

``cell.connect()`` in place of ``cell.simulate(...)`` moves a robot that is up. The same calls, in a function
``main(robot)`` of a file, are run by ``delta3 simulate FILE.py`` and by ``delta3 run FILE.py``.
"""

from delta3_pacdrive.cell.connected import connect
from delta3_pacdrive.cell.robot import Robot
from delta3_pacdrive.cell.simulation import Simulation, simulate
from delta3_pacdrive.cell.state import State
from delta3_pacdrive.errors import ScriptError, WaitTimeoutError

__all__ = ['Robot', 'ScriptError', 'Simulation', 'State', 'WaitTimeoutError', 'connect', 'simulate']

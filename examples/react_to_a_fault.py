"""Recover a robot from a fault and continue its path; in another terminal: delta3 up."""

from delta3_pacdrive.ros.clients.robot_client import operating

PROGRAM = 'moves: [move_l: {to_m: [0.2, 0.0, -0.8], speed_m_s: 0.2}, move_l: {to_m: [0.0, 0.0, -0.75]}]'
# a drive stops after two consecutive lost telegrams
FAULT = '{fault: drop_mdt, axis: axis2, cycles: 2, after_s: 0.3}'


def reason(robot):
    """Return why the robot has stopped, and where."""
    robot.wait_until(lambda: robot.progress.fault, 'reason')
    return f'at x = {robot.progress.tcp_m[0]:.3f} m: {robot.progress.fault}'


with operating('') as robot:  # waits have timeouts; a rejection raises an exception with the message
    robot.take_control('watchman')
    print(robot.send_program(PROGRAM))
    print(robot.call('start'))
    print(robot.inject(FAULT))
    robot.wait_until(lambda: robot.state == 'error', 'stop')
    print(reason(robot))

    print(robot.call('reset'))  # clears the drive faults after their causes have ended
    print(robot.enable(True))
    robot.wait_until(lambda: robot.progress.in_torque, 'torque')
    print(robot.call('resume'))  # straight back to the stop position, then along the path
    robot.wait_until(lambda: robot.state == 'moving', 'motion')
    robot.wait_until(lambda: robot.state == 'idle' and robot.progress.finished, 'end of the program')
    print(f'{robot.state} at x = {robot.progress.tcp_m[0]:.3f} m')
    robot.release_control()

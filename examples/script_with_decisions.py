"""Wait for parts, pick each one, and place the good ones on a grid: a script with decisions by inputs."""

from delta3_pacdrive import scripting

PICK_MM, REJECT_MM = [150, 0, -850], [0, -150, -850]
PLACES_MM = [[-150 + 60 * column, 60 * row, -850] for row in range(2) for column in range(2)]


def carry(robot, to_mm):
    """Pick the part and lay it down somewhere."""
    robot.arch(to_mm=PICK_MM, up_mm=20, down_mm=20)
    robot.output('gripper', True, payload_kg=0.3)
    robot.dwell(0.05)
    robot.arch(to_mm=to_mm, up_mm=20, down_mm=20)
    robot.output('gripper', False, payload_kg=0.0)


def main(robot):
    """Fill the grid."""
    free = list(PLACES_MM)
    while free:
        robot.wait_input('part', timeout_s=5.0)
        good = robot.input('good')
        carry(robot, free.pop(0) if good else REJECT_MM)
        robot.wait()
        print(
            f'{robot.state().time_s:.3f} s: a {"good" if good else "bad"} part, {len(free)} places are free'
        )


if __name__ == '__main__':
    parts = {'part': [(0.2, True)], 'good': [(0.0, True), (2.5, False), (4.5, True)]}
    with scripting.simulate(inputs=parts) as robot:
        main(robot)
    outputs = [one['time_s'] for one in robot.trace.meta['outputs']]
    print(f'{len(outputs) // 2} parts, the gripper closed first after {outputs[0]:.3f} s')

"""A cell with one belt for tests, a picking script, and the distance between true TCP and true part."""

import numpy as np

from delta3_pacdrive.cell import cell_file

QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
ON_IT_M = 2e-5  # above the top of a part: the robot stands on it
TOP_M = -0.85
ORIGIN_M = (-0.7, 0.1)


def speed_of(speed_m_s, after_s=0.0):
    return {'after_s': after_s, 'speed_m_s': speed_m_s}


def around(speed, parts, inputs=None, faults=(), **of_belt):
    """Return a cell with a belt along x; without a speed, without the belt."""
    line = {
        'origin_mm': [-700, 100, -870], 'length_mm': 1500, 'encoder': {'bits': 14, 'circumference_mm': 200},
        'speed': speed, 'barrier': {'at_mm': 300, 'delay_s': 0.0005}, 'window_mm': [450, 1100],
        'stream': {'part': 'bar', 'count': max(parts, 1), 'spacing_mm': 450},
    }  # fmt: skip
    cup = {
        'output': 'gripper', 'diameter_mm': 60, 'vacuum_pa': 60000, 'build_up_s': 0.006, 'decay_s': 0.004,
        'valve': {'on_s': 0.005, 'off_s': 0.004},
    }  # fmt: skip
    document = {
        'cup': cup,
        'parts': {'bar': {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}},
        'boxes': {'tray': {'at_mm': [0, -200, -870], 'clears_s': 0.02}},
        'inputs': inputs or {},
        'faults': list(faults),
    }
    return cell_file.parse(document | ({} if speed is None else {'belts': {'line': line | of_belt}}))


def pick(robot, grip_s=0.06):
    """Pick the next part from the belt and put it into the tray."""
    with robot.track('line', timeout_s=5.0, **QUICK):
        robot.move_l(to_mm=[0, 0, 40], **QUICK)
        robot.move_l(to_mm=[0, 0, 20], **QUICK)
        robot.output('gripper', True, payload_kg=0.2)
        robot.dwell(grip_s)
        robot.move_l(to_mm=[0, 0, 40], **QUICK)
    robot.arch(to_mm=[0, -200, -850], up_mm=20, down_mm=20, **QUICK)
    robot.output('gripper', False, payload_kg=0.0)
    robot.dwell(0.03)


def gets_on(robot):
    """Get on the belt above a part, and be left in the middle of it; return its block."""
    block = robot.track('line', timeout_s=5.0, **QUICK)
    block.__enter__()
    robot.move_l(to_mm=[0, 0, 60], **QUICK)
    robot.wait()
    return block


def apart_m(trace, along_m=0.0):
    """Return the distance of the TCP from the top of a part during its contact [m], and the bus cycles.

    ``along_m`` is the position of the part at 0 m of belt travel, by default that of the first part.
    """
    tcp, way = trace.signals['tcp_true'], trace.signals['cell_belts'][:, 0]
    top = np.column_stack(
        [ORIGIN_M[0] + along_m + way, np.full(len(way), ORIGIN_M[1]), np.full(len(way), TOP_M)]
    )
    near = (np.abs(tcp[:, 2] - TOP_M) < ON_IT_M) & (np.linalg.norm(tcp - top, axis=1) < 0.02)
    cycles = np.flatnonzero(near)
    return np.linalg.norm(tcp - top, axis=1)[cycles], cycles[:-1]

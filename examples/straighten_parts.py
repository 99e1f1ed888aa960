"""Align skewed parts from one belt with the direction of another belt; the cell is ``skewed_parts.yaml``."""

import math
from pathlib import Path

from delta3_pacdrive import scripting

QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}


def main(robot, count=6):
    """Carry parts over, one by one; the tool turns to the part, and with it to the belt."""
    for _ in range(count):
        part = robot.part('line')
        askew = math.degrees(part.angle_rad)
        with robot.track('line', part, **QUICK):
            robot.move_l(to_mm=[0, 0, 40], turn_deg=askew, **QUICK)
            robot.move_l(to_mm=[0, 0, 20], **QUICK)
            robot.output('gripper', True, payload_kg=0.2)
            robot.dwell(0.04)
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
        with robot.track('out', robot.slot('out', pitch_m=0.15), **QUICK):
            robot.move_l(to_mm=[0, 0, 40], turn_deg=0, **QUICK)
            robot.move_l(to_mm=[0, 0, 20], **QUICK)
            robot.output('gripper', False, payload_kg=0.0)
            robot.dwell(0.02)
            robot.move_l(to_mm=[0, 0, 40], **QUICK)


if __name__ == '__main__':
    with scripting.simulate('model+rotary', cell=Path(__file__).with_name('skewed_parts.yaml')) as simulated:
        main(simulated)
    put = [one['stays'] for one in simulated.trace.meta['cell']['parts'] if one['where'] == 'out']
    for name, stay, along in (('before', 0, 0.0), ('after', -1, math.pi)):
        angles = [math.degrees(math.remainder(stays[stay]['angle_rad'] - along, math.tau)) for stays in put]
        print(f'askew {name}: ' + ', '.join(f'{angle:.2f}' for angle in angles) + ' deg')

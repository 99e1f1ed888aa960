"""Sort a mixed stream of two types from a belt into two trays; the cell is ``two_belts.yaml``."""

from collections import Counter
from pathlib import Path

from delta3_pacdrive import scripting

QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
TRAYS_MM = {'bar': [-150, -20, -850], 'disc': [150, -20, -850]}
MASSES_KG = {'bar': 0.2, 'disc': 0.1}


def main(robot, count=10):
    """Sort so many parts; one that cannot be met any more passes."""
    for _ in range(count):
        part = robot.part('line')
        try:
            with robot.track('line', part, **QUICK):
                robot.move_l(to_mm=[0, 0, 40], **QUICK)
                robot.move_l(to_mm=[0, 0, 20], **QUICK)
                robot.output('gripper', True, payload_kg=MASSES_KG[part.type])
                robot.dwell(0.04)
                robot.move_l(to_mm=[0, 0, 40], **QUICK)
        except scripting.ScriptError as error:
            print(f'left: {error}')
            continue
        robot.arch(to_mm=TRAYS_MM[part.type], up_mm=20, down_mm=20, **QUICK)
        robot.output('gripper', False, payload_kg=0.0)
        robot.dwell(0.02)


if __name__ == '__main__':
    with scripting.simulate('model', cell=Path(__file__).with_name('two_belts.yaml')) as simulated:
        main(simulated)
    parts = simulated.trace.meta['cell']['parts']
    put = Counter((one['type'], one['where']) for one in parts if one['outcome'] == 'placed')
    print(', '.join(f'{count} {kind} in {where}' for (kind, where), count in sorted(put.items())))

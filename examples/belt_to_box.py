"""Pick from a belt with a camera into a box of 3 x 4 places, in layers; the cell is ``two_belts.yaml``."""

from pathlib import Path

from delta3_pacdrive import scripting
from delta3_pacdrive.planning.program.frames import Frame
from delta3_pacdrive.planning.program.patterns import Grid, Layers

QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
BOX = Frame((-0.065, -0.07, -0.89), name='carton')  # the first place
HEIGHT_M, LAYERS = 0.02, 2


def main(robot):
    """Fill the box, layer by layer."""
    for x, y, z in Layers(Grid(rows=4, columns=3, pitch_m=(0.065, 0.045), frame=BOX), LAYERS, HEIGHT_M):
        with robot.track('line', robot.part('line', kind='bar'), **QUICK):
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
            robot.move_l(to_mm=[0, 0, 20], **QUICK)
            robot.output('gripper', True, payload_kg=0.2)
            robot.dwell(0.04)
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
        robot.arch(to_m=[x, y, z + HEIGHT_M], up_mm=20, down_mm=25, **QUICK)
        robot.output('gripper', False, payload_kg=0.0)
        robot.dwell(0.02)


if __name__ == '__main__':
    with scripting.simulate('model', cell=Path(__file__).with_name('two_belts.yaml')) as simulated:
        main(simulated)
    found = simulated.trace.meta['cell']
    far = [
        1e3 * max(map(abs, one['place_error_m'][:2])) for one in found['parts'] if one['where'] == 'carton'
    ]
    print(
        f'{len(far)} in the box in {simulated.trace.time_s[-1]:.1f} s, at most {max(far):.2f} mm off their places'
    )

"""Pick from a belt at three speeds: distance of the true TCP from the part, and parts that cannot be reached."""

import numpy as np

from delta3_pacdrive import scripting
from delta3_pacdrive.cell import cell_file

PARTS, QUICK = 3, {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
line = {'origin_mm': [-700, 100, -870], 'length_mm': 1500, 'encoder': {'bits': 14, 'circumference_mm': 200}}
line |= {'barrier': {'at_mm': 300}, 'window_mm': [400, 1100]}
line |= {'stream': {'part': 'bar', 'count': PARTS, 'spacing_mm': 450}}
valve = {'on_s': 0.005, 'off_s': 0.004}
around = {
    'cup': {'output': 'gripper', 'diameter_mm': 60, 'vacuum_pa': 60000, 'build_up_s': 0.006, 'valve': valve},
    'parts': {'bar': {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'boxes': {'tray': {'at_mm': [0, -200, -870], 'clears_s': 0.05}},
}
for speed in (0.5, 1.0, 1.5):
    belts = {'line': line | {'speed': [{'after_s': 0.0, 'speed_m_s': speed}]}}
    with scripting.simulate(
        'model', cell=cell_file.parse(around | {'belts': belts}), signals=['cell_belts']
    ) as robot:
        for n in range(PARTS):
            try:
                with robot.track('line', **QUICK):
                    robot.move_l(to_mm=[0, 0, 40], **QUICK)
                    robot.move_l(to_mm=[0, 0, 20], **QUICK)
                    robot.output('gripper', True, payload_kg=0.2)
                    robot.dwell(0.06)
                    robot.move_l(to_mm=[0, 0, 40], **QUICK)
                robot.arch(to_mm=[0, -200, -850], up_mm=20, down_mm=20, **QUICK)
                robot.output('gripper', False, payload_kg=0.0)
            except scripting.ScriptError as error:
                print(f'  part {n}: {error.code}: {error}')
    tcp, way = robot.trace.signals['tcp_true'], robot.trace.signals['cell_belts'][:, 0]
    tops = [np.stack([way - 0.7 - 0.45 * n, 0 * way + 0.1, 0 * way - 0.85], 1) for n in range(PARTS)]
    far = 1e3 * np.min([np.linalg.norm(tcp - top, axis=1) for top in tops], axis=0)
    on = far[np.abs(tcp[:, 2] + 0.85) < 2e-5][far[np.abs(tcp[:, 2] + 0.85) < 2e-5] < 20.0]
    placed, rms, most = robot.trace.meta['cell']['outcomes']['placed'], np.sqrt(np.mean(on**2)), on.max()
    print(f'{speed} m/s: {placed} of {PARTS} placed, {rms:.4f} mm rms, {most:.4f} mm max')

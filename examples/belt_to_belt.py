"""Place parts from one moving belt onto another at a pitch of 150 mm; the cell is ``two_belts.yaml``."""

from itertools import pairwise
from pathlib import Path

from delta3_pacdrive import scripting

QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
PITCH_M, COUNT = 0.15, 6


def main(robot):
    """Carry parts over, one by one."""
    for _ in range(COUNT):
        with robot.track('line', robot.part('line'), **QUICK):
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
            robot.move_l(to_mm=[0, 0, 20], **QUICK)
            robot.output('gripper', True, payload_kg=0.2)
            robot.dwell(0.04)
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
        with robot.track('out', robot.slot('out', pitch_m=PITCH_M), **QUICK):
            robot.move_l(to_mm=[0, 0, 40], **QUICK)
            robot.move_l(to_mm=[0, 0, 20], **QUICK)
            robot.output('gripper', False, payload_kg=0.0)
            robot.dwell(0.02)
            robot.move_l(to_mm=[0, 0, 40], **QUICK)


if __name__ == '__main__':
    with scripting.simulate(
        'model', cell=Path(__file__).with_name('two_belts.yaml'), signals=['cell_belts']
    ) as simulated:
        main(simulated)
    trace = simulated.trace
    put = [one for one in trace.meta['cell']['parts'] if one['where'] == 'out']
    way, tcp = trace.signals['cell_belts'][:, 1], trace.signals['tcp_true']
    cycles = [one['released_cycle'] for one in put]
    places = [0.7 - tcp[k, 0] - way[k] for k in cycles]  # along the belt at travel 0
    apart = [(a - b) / PITCH_M for a, b in pairwise(places)]
    print(f'{len(put)} parts put down, {", ".join(f"{one:.3f}" for one in apart)} pitches apart')

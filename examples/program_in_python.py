"""Write a motion program in Python instead of YAML: a flower of circles, each petal a move."""

import numpy as np

import delta3_pacdrive as d3

PETALS, RADIUS_M, HEIGHT_M = 5, 0.15, -0.80

centre = [0.0, 0.0, HEIGHT_M]
moves = [{'move_l': {'to_m': centre}}]
for angle in 2 * np.pi * np.arange(PETALS) / PETALS:
    out = np.array([np.cos(angle), np.sin(angle), 0.0])
    aside = 0.5 * np.array([-np.sin(angle), np.cos(angle), 0.0])
    # half a circle out, half a circle back
    for via, to in ((out / 2 + aside, out), (out / 2 - aside, 0 * out)):
        via_m, to_m = (centre + RADIUS_M * np.stack([via, to])).tolist()
        moves.append({'move_c': {'via_m': via_m, 'to_m': to_m}})

document = {  # same keys as a program file
    'name': 'flower',
    'start_m': [0.0, 0.0, -0.75],
    'limits': {'speed_m_s': 1.0, 'acceleration_m_s2': 15.0, 'jerk_m_s3': 800.0},
    'moves': moves,
}
robot = d3.load_parameters()
# checked like a file; errors raise ProgramError with their position
program = d3.load_program(document, robot)
trace = d3.simulate(program, robot)

speed = np.linalg.norm(np.diff(trace['tcp_command'], axis=0), axis=1) / trace.meta['cycle_time_s']
print(f'{program.name}: {len(program.statements)} moves, {trace.meta["program_s"]:.2f} s')
print(f'fastest: {speed.max():.3f} m/s')
print(f'largest TCP error: {1e3 * trace.meta["figures"]["tcp_error_max_m"]:.3f} mm')

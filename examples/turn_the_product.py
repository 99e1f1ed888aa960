"""Rotate a product by half a turn during transport: angular error, and cycle time with a slower axis."""

import math

import delta3_pacdrive as d3

PICK, LIFT_M, WAY_M = [-0.1525, 0.0, -0.85], 0.025, 0.305


def half_cycle(way_m, angle_deg):
    """Up, over and down; the tool turns while the robot goes over."""
    over = {'to_m': {'by_m': [way_m, 0, 0]}, 'blend_m': LIFT_M, 'turn_deg': angle_deg}
    return [
        {'dwell': {'time_s': 0.03}},
        {'move_l': {'to_m': {'by_m': [0, 0, LIFT_M]}, 'blend_m': LIFT_M}},
        {'move_l': over},
        {'move_l': {'to_m': {'by_m': [0, 0, -LIFT_M]}}},
    ]


document = {
    'name': 'turn the product',
    'start_m': PICK,
    'start_turn_deg': 0,
    'limits': {'speed_m_s': 4.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20000.0},
    'moves': [*half_cycle(WAY_M, 180), *half_cycle(-WAY_M, 0)],
}
for name in ('delta3+rotary', 'model+rotary', 'built+model+rotary'):
    robot = d3.load_parameters(name)
    figures = d3.simulate(d3.load_program(document, robot), robot).meta['figures']
    place, way = (math.degrees(figures[f'turn_{what}error_max_rad']) for what in ('place_', ''))
    print(f'{name}: {place:.4f} deg off at the place, {way:.3f} deg on the way')

for most in (80_000, 40_000, 20_000):
    robot = d3.load_parameters('model+rotary').replace(rotary__acceleration_max_deg_s2=most)
    seconds = d3.simulate(d3.load_program(document, robot), robot).meta['program_s']
    print(f'{most} deg/s2: {seconds:.3f} s a cycle')

"""Fill a box in two layers with a tool in a taught frame, and measure the distance to each place."""

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.planning.program.frames import Frame, Tool
from delta3_pacdrive.planning.program.patterns import Grid, Layers

TAUGHT_MM = [[100, -60, -900], [180, -40, -900], [80, 20, -900]]  # origin, on the x axis, in the xy plane
ROWS, COLUMNS, PITCH_MM, LAYERS, HEIGHT_MM = 2, 2, [40, 50], 2, 20

document = {  # same keys as a program file
    'frames': {'box': {'taught_mm': TAUGHT_MM}},
    'tools': {'cup': {'offset_mm': [0, 0, -60], 'mass_kg': 0.2}},
    'patterns': {'box': {'frame': 'box', 'rows': ROWS, 'columns': COLUMNS, 'pitch_mm': PITCH_MM,
                         'layers': LAYERS, 'height_mm': HEIGHT_MM}},
    'points_mm': {'pick': [-150, 0, -860]},
    'tool': 'cup',
    'start_mm': [-150, 0, -840],
    'moves': [{'for_each': {'place_of': 'box', 'moves': [
        {'move_l': {'to_m': 'pick'}},
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.3}},
        {'arch': {'to_m': [0, 0, 0.02], 'up_m': 0.02, 'down_m': 0.02}},
        {'output': {'name': 'gripper', 'value': False, 'payload_kg': 0.0}},
        {'dwell': {'time_s': 0.03}},
        {'arch': {'to_m': {'point': 'pick', 'by_mm': [0, 0, 20]}, 'up_m': 0.02, 'down_m': 0.02}},
    ]}}],
}  # fmt: skip
robot = d3.load_parameters('model')
trace = d3.simulate(d3.load_program(document, robot), robot)

box = Frame.taught(np.array(TAUGHT_MM) / 1e3)
places = Layers(Grid(ROWS, COLUMNS, tuple(np.array(PITCH_MM) / 1e3), frame=box), LAYERS, HEIGHT_MM / 1e3)
path = Tool((0.0, 0.0, -0.06)).working_point_m(trace['tcp_actual'])
over = places.places_m() + 0.02 * box.directions_to_base([0, 0, 1])
apart = np.linalg.norm(path[:, None] - over, axis=2).min(axis=0)
print(f'{len(places)} parts in {trace.meta["program_s"]:.1f} s')
print(f'the working point comes within {1e3 * apart.max():.3f} mm of each place')

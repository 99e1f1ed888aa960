"""Explain the difference between the gain margin of the velocity loop and of its continuous approximation."""

import delta3_pacdrive as d3
from delta3_pacdrive.studies.drives.loops.analysis import OperatingPoint
from delta3_pacdrive.studies.drives.loops.approximation import steps
from delta3_pacdrive.studies.drives.loops.load import extremes

robot = d3.load_parameters()
for load in extremes(robot):
    print(f'{load.name}: gain margin of the velocity loop')
    approximation, *pieces = steps(robot, OperatingPoint(load, speed_rad_s=10.0))
    print(f'{approximation.gain_margin_db:8.2f} dB  continuous approximation')
    for piece in pieces:
        print(f'{piece.gained_db:+8.2f} dB  {piece.name}')
    print(f'{pieces[-1].gain_margin_db:8.2f} dB  difference equations of the drive')

"""Compare the log of a robot, as written by a data logger, with the model: align both and report the deviations."""

import sys
from pathlib import Path

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.studies.runs import runs
from delta3_pacdrive.studies.thesis.experiments.run import compared
from delta3_pacdrive.studies.thesis.experiments.study import Pair

folder = Path(sys.argv[1] if len(sys.argv) > 1 else '.')

# the built robot replaces a real one; its log has another rate, clock and units
robot = d3.load_parameters('built')
run = d3.simulate('experiment1', robot)
time_s = np.arange(0.0, run.time_s[-1], 1.0 / 700.0)
angles = np.degrees(run['motor_position'] / robot.dynamics.gear_ratio)
held = [1e3 * time_s + 5000.0]
held += [np.interp(time_s, run.time_s, column) for column in (*angles.T, *run['current'].T)]
headings = ['time [ms]', *(f'arm_position_{n} [deg]' for n in '123'), *(f'current_{n} [A]' for n in '123')]
np.savetxt(folder / 'robot.csv', np.column_stack(held), '%.6f', ',', header=','.join(headings), comments='')

log, model = runs.load(str(folder / 'robot.csv')), runs.load('experiment1')
found = compared(Pair(model, log, attributed=False))
print(f'shifted by {found.alignment.shift_s:.4f} s, correlation {found.alignment.correlation:.5f}')
for row in found.comparison.statistics():
    if row.column == 'all':
        numbers = f'{row.deviation_rms:.3g} {row.unit} rms apart, at most {row.deviation_max:.3g} {row.unit}'
        print(f'{row.signal}: {numbers}')
for note in found.notes:
    print(f'note: {note}')

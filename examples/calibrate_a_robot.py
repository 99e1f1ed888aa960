"""Calibrate a built robot from measured TCP positions and compare its true error before and after."""

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.studies.calibration import estimation, model, planning, simulated
from delta3_pacdrive.studies.calibration.study import Method, Requirements

NOISE_M = 2e-5  # of each measured coordinate

robot = d3.load_parameters('built')
poses = planning.plan(Requirements(Method.BASE, number=24, checks=8, noise_m=NOISE_M), robot)
# for a real robot: measurement_file.read('measured.csv')
measured = simulated.points(poses, robot, Method.BASE, NOISE_M, seed=1)

observation = model.PointsInBase(measured, robot)
found = estimation.estimate(observation, NOISE_M)
for left in estimation.compared(found, observation):
    print(
        f'{left.what}, {left.count} poses: {1e3 * left.before_rms_m:.3f} mm before, {1e3 * left.after_rms_m:.3f} after'
    )
for one in found.estimates:
    if one.symbol == 'l_A':
        print(f'l_A of arm {one.arm}: {1e3 * one.value:+.3f} +- {1e3 * one.half_width:.3f} mm')

corrections = model.document_of(found.x)
calibrated = robot.replace(**{f'kinematics__{name}': values for name, values in corrections.items()})
for name, machine in (('drawn', robot), ('calibrated', calibrated)):
    trace = d3.simulate(d3.load_program('experiment1', machine), machine)
    unseen = np.linalg.norm(trace['tcp_true'] - trace['tcp_actual'], axis=1)
    print(f'{name}: the true TCP of experiment 1 is {1e3 * np.sqrt(np.mean(unseen**2)):.3f} mm rms off')

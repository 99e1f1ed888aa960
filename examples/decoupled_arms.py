"""Compare the decoupled linear arms of figure 4.9, with d as an input, with the exact plant for decreasing steps."""

import numpy as np

import delta3_pacdrive as d3

for period_s in (125e-6, 62.5e-6, 31.25e-6):
    robot = d3.load_parameters().replace(drive__current_period_s=period_s)
    exact = d3.simulate('experiment1', robot)
    decoupled = d3.simulate('experiment1', robot.replace(dynamics__arm_coupling='decoupled'))
    tcp = np.linalg.norm(decoupled['tcp_true'] - exact['tcp_true'], axis=1).max()
    torque = np.abs(decoupled['coupling_torque'] - exact['coupling_torque']).max()
    print(f'd is {1e6 * period_s:g} us old: TCP {1e6 * tcp:.2f} um, d {torque:.3f} N m apart at most')

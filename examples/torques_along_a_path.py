"""Compute the arm torques along experiment 3 with the equations of the thesis and compare the currents."""

import numpy as np

import delta3_pacdrive as d3

robot = d3.load_parameters()
trace = d3.simulate('experiment3', robot)
step_s = trace.meta['cycle_time_s']
gear, motor = robot.dynamics.gear_ratio, robot.motor

theta = d3.kinematics.inverse(trace['tcp_actual'], robot)  # (n, 3) [rad]
thetadot = trace['shaft_speed'] / gear  # 4.17
thetaddot = np.gradient(thetadot, step_s, axis=0)

tau = d3.dynamics.inverse(theta, thetadot, thetaddot, robot)  # 4.26 [N m], rotors included, no friction
parts = {
    'gravity': d3.dynamics.gravity(theta, robot),
    'inertia': np.einsum('nij,nj->ni', d3.dynamics.mass_matrix(theta, robot), thetaddot),
}
parts['centrifugal and Coriolis'] = tau - parts['gravity'] - parts['inertia']

shaft = trace['shaft_speed']
friction = motor.static_friction_n_m * np.tanh(shaft / motor.friction_smoothing_rad_s)
friction += motor.viscous_friction_n_m_s_rad * shaft
current = (tau / gear + friction) / motor.torque_constant_n_m_a  # 4.18

moving = np.abs(shaft).max(axis=1) > 5.0  # brakes released, outside the smoothed friction step
error_a = np.abs(current - trace['current'])[moving]
for name, part in parts.items():
    print(f'{name}: at most {np.abs(part).max():.2f} N m at an arm')
print(
    f'current: at most {np.abs(current).max():.2f} A, mean deviation from the drives {error_a.mean():.3f} A'
)

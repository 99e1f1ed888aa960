"""Estimate masses and friction from a run: the dynamics are linear in these constants, so least squares suffice."""

import numpy as np

import delta3_pacdrive as d3

robot = d3.load_parameters()
trace = d3.simulate('excitation', robot)  # or a recording: d3.load_trace(FOLDER)
gear, motor = robot.dynamics.gear_ratio, robot.motor

shaft = trace['motor_speed']
theta = d3.kinematics.inverse(trace['tcp_actual'], robot)
thetaddot = np.gradient(shaft, trace.time_s, axis=0) / gear
moving = np.abs(shaft).min(axis=1) > 5.0  # [rad/s]; at rest a brake may carry the load

# K_m I = Y [I_b, m_nt, m_br r_Gb] / k_r + F_s tanh(w / w_s) + F_v w, one row for each axis and cycle
regressor = d3.dynamics.regressor(theta, shaft / gear, thetaddot, robot) / gear
friction = np.stack([np.tanh(shaft / motor.friction_smoothing_rad_s), shaft], axis=-1)
matrix = np.concatenate([regressor, friction], axis=-1)[moving].reshape(-1, 5)
torque = (motor.torque_constant_n_m_a * trace['current'][moving]).ravel()
found, *_ = np.linalg.lstsq(matrix, torque, rcond=None)

p = robot.dynamics
truth = {
    'm_nt [kg]': p.plate_total_mass_kg,
    'F_s [N m]': motor.static_friction_n_m,
    'F_v [N m s/rad]': motor.viscous_friction_n_m_s_rad,
}
for (name, true), value in zip(truth.items(), found[[1, 3, 4]], strict=True):
    print(f'{name:16} {value:.5f}, in the robot {true:.5f} ({100 * (value / true - 1):+.2f} %)')
print(f'residual: {np.std(matrix @ found - torque):.4f} N m of {np.std(torque):.4f} N m')
print('with intervals, and what the signals do not show: delta3 estimate')

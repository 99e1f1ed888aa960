"""Find the reachable part of a plane and the condition of the Jacobian there."""

import numpy as np

import delta3_pacdrive as d3

HEIGHT_M = -0.85

robot = d3.load_parameters()
side = np.linspace(-0.9, 0.9, 181)
points = np.stack([*np.meshgrid(side, side), np.full((side.size, side.size), HEIGHT_M)], axis=-1)

# shape (181, 181, 3), nan where an arm is too short
theta = d3.kinematics.inverse(points, robot, unreachable='nan')
reached = np.isfinite(theta).all(axis=-1)
inside = reached & (np.hypot(points[..., 0], points[..., 1]) <= robot.kinematics.workspace_diameter_m / 2)
error_m = np.abs(d3.kinematics.forward(theta[inside], robot) - points[inside]).max()
condition = np.linalg.cond(d3.kinematics.jacobian(theta[inside], points[inside], robot))

print(f'{points[..., 0].size} points at z = {HEIGHT_M} m, {reached.sum()} within reach')
print(f'in the workspace: forward(inverse(p)) gives p within {error_m:.0e} m')
angles = np.degrees(theta[inside])
print(f'in the workspace: arm angles {angles.min():.1f} to {angles.max():.1f} deg')
print(f'in the workspace: condition of the Jacobian {condition.min():.2f} to {condition.max():.2f}')

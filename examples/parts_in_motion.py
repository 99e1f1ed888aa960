"""Follow the links of the robot along a program: highest elbow, steepest rod, largest swing."""

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.scene.joints import joints
from delta3_pacdrive.scene.poses import poses

robot = d3.load_parameters()
trace = d3.simulate('packaging', robot)
theta = d3.kinematics.inverse(trace['tcp_actual'], robot)

# poses of all parts at every cycle: position (n, 3), and quaternion x, y, z, w (n, 4)
there = poses(theta, robot)
rods = [f'forearm{arm}{rod}' for arm in (1, 2, 3) for rod in 'ab']
elbow_z = np.stack([there.of(rod)[0][:, 2] for rod in rods])
plate, _ = there.of('plate')

angles = dict(zip(JOINTS, joints(theta, robot).T, strict=True))
swing = np.degrees(np.abs([angles[f'{rod}_swing'] for rod in rods]).max())

print(f'{len(theta)} cycles, {len(rods)} rods')
print(f'elbows between {elbow_z.min():.3f} and {elbow_z.max():.3f} m')
print(f'plate at most {np.hypot(plate[:, 0], plate[:, 1]).max():.3f} m from the middle')
print(f'rods swing sideways by {swing:.1f} deg of {robot.kinematics.forearm_swing_max_deg:.1f} deg')

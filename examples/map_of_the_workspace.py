"""Map speed, acceleration and accuracy over the workspace, and list the limits of a program there."""

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.planning.limits.capability import capability
from delta3_pacdrive.studies.places.planning import evaluation

robot = d3.load_parameters()
side = np.linspace(-0.6, 0.6, 61)
points = np.stack(np.meshgrid(side, side, [-0.9, -0.8, -0.7], indexing='ij'), axis=-1)

can = capability(points, robot, payload_kg=2.0)  # arrays of shape (61, 61, 3)
here = can.limit == 0  # permitted poses
best = points[here][np.argmax(can.speed_m_s[here])]
print(
    f'{here.sum()} places, speed in every direction {can.speed_m_s[here].min():.2f} to '
    f'{can.speed_m_s[here].max():.2f} m/s, best at {best.round(2)} m'
)
print(f'2 kg are given at least {can.acceleration_nominal_m_s2[here].min():.1f} m/s2 at nominal current')
print(f'an increment of each motor is at most {1e6 * can.increment_m[here].max():.2f} um of the TCP')

program = d3.load_program('packaging', robot)
for row in evaluation.of_program(program, robot).rows:
    use = row.limited_by
    print(
        f'move {row.number}, {row.kind}: {row.duration_s:.3f} s, {use.quantity} at {100 * use.used:.0f} % of its limit'
    )

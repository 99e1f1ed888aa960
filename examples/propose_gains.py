"""Propose gains of velocity and position loop for margins of 50 degrees and 8 dB, and apply them to experiment 1."""

import delta3_pacdrive as d3
from delta3_pacdrive.studies.drives.tuning.proposal import Targets, propose

robot = d3.load_parameters()
found = propose(robot, Targets(phase_deg=50.0, gain_db=8.0), speed_rad_s=10.0)
for name, value in found.gains.values().items():
    print(f'drive.{name}: {value:g}')
print(f'before: {found.before.phase_deg:.1f} deg, {found.before.gain_db:.1f} dB at least')
print(f'after:  {found.kept.phase_deg:.1f} deg, {found.kept.gain_db:.1f} dB at least')
for one in (robot, found.robot):
    error_m = d3.simulate('experiment1', one).meta['figures']['tcp_error_max_m']
    print(f'TCP error {1e3 * error_m:.3f} mm')

"""Run pick-and-place arches at increasing speed, and report cycle rate, energy, current and TCP error."""

import delta3_pacdrive as d3
from delta3_pacdrive.studies.runs.run_signals import energy_of_round

ROUNDS = 3
PICK, PLACE = [-0.1525, 0.0, -0.85], [0.1525, 0.0, -0.85]
# vertical over the first and last 10 mm, and at least 25 mm high where farther than 30 mm from both ends
CLEARANCES = {'up_m': 0.01, 'down_m': 0.01, 'keep_out': {'height_m': -0.825, 'margin_m': 0.03}}

robot = d3.load_parameters('model')
for limits in ({'jerk_m_s3': 3000.0}, {'jerk_m_s3': 20000.0}, {'torque_rate_n_m_s': 1000.0}):
    document = {
        'start_m': PICK,
        'repeat': ROUNDS,
        'time_optimal': True,  # as fast as the motors allow
        'limits': limits,
        'moves': [
            {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.5}},
            {'dwell': {'time_s': 0.03}},
            {'arch': {'to_m': PLACE, **CLEARANCES}},
            {'output': {'name': 'gripper', 'value': False, 'payload_kg': 0.0}},
            {'dwell': {'time_s': 0.03}},
            {'arch': {'to_m': PICK, **CLEARANCES}},
        ],
    }
    trace = d3.simulate(d3.load_program(document, robot), robot)
    figures, energy = trace.meta['figures'], energy_of_round(trace, robot, ROUNDS)
    print(
        f'{" ".join(limits)} {next(iter(limits.values())):g}: '
        f'{60.0 * ROUNDS / trace.meta["program_s"]:.1f} rounds a minute, {energy.lost_j:.1f} J lost in each, '
        f'rms current {max(figures["current_rms_a"]):.2f} of {robot.motor.nominal_current_a:g} A, '
        f'TCP error {1e3 * figures["tcp_error_max_m"]:.3f} mm'
    )

"""Stop the built robot with each kind of input shaping, and measure the residual vibration of its true TCP."""

import math

import delta3_pacdrive as d3
from delta3_pacdrive.studies.framework.residual_vibration import after_stop, swing_m

STANDS_S = 0.4
robot = d3.load_parameters('built+model')
document = {
    'start_m': [-0.1525, 0.0, -0.85],
    'payload_kg': 0.5,
    'limits': {'speed_m_s': 3.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20000.0},
    'moves': [{'move_l': {'to_m': [0.1525, 0.0, -0.85]}}, {'dwell': {'time_s': STANDS_S}}],
}
before_m = 0.0
for shaping in ('none', 'zv', 'zvd', 'smooth'):
    shaped = robot.replace(control__shaping=shaping)
    trace = d3.simulate(d3.load_program(document, shaped), shaped)
    stop = trace.meta['end_cycle'] - round(STANDS_S / robot.bus.cycle_time_s)
    left_m = swing_m(after_stop(trace, stop))
    before_m = before_m or left_m
    less_db = 20.0 * math.log10(before_m / left_m)
    print(
        f'{shaping}: {stop - trace.meta["start_cycle"]} ms, then the TCP swings by {1e3 * left_m:.3f} mm, '
        f'{less_db:.1f} dB less'
    )

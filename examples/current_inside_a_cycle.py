"""Compare the currents in the AT with all samples of the current loops, for each bus cycle and interpolation."""

import numpy as np

import delta3_pacdrive as d3

for cycle_time_s in (1e-3, 2e-3, 4e-3):
    for interpolation in ('linear', 'cubic'):
        robot = d3.load_parameters().replace(
            bus__cycle_time_s=cycle_time_s, drive__interpolation=interpolation
        )
        trace = d3.simulate('experiment1', robot)
        figures = trace.meta['figures']
        ripple = np.sqrt(np.mean((trace['current_max'] - trace['current_min']) ** 2, axis=0))
        print(
            f'{1e3 * cycle_time_s:g} ms {interpolation:6}: AT {figures["at_current_peak_a"][0]:.2f} A, '
            f'all samples {figures["current_peak_a"][0]:.2f} A, spread in a cycle {ripple[0]:.3f} A rms'
        )

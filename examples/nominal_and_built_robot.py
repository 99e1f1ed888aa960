"""Run one program on the nominal and on a built robot with elastic gears, stiction and inexact lengths."""

import numpy as np

import delta3_pacdrive as d3

ROBOTS = {'nominal': d3.load_parameters(), 'built': d3.load_parameters('built')}


def largest_mm(vectors):
    """Largest length of the rows, in mm."""
    return 1e3 * np.linalg.norm(vectors, axis=1).max()


traces = {name: d3.simulate('experiment1', robot) for name, robot in ROBOTS.items()}
for name, trace in traces.items():
    seen = largest_mm(trace['tcp_error'])  # from the encoders, as in the controller
    true = largest_mm(trace['tcp_true'] - trace['tcp_actual'])  # visible to an external measurement only
    print(f'{name:8} error seen by the drives {seen:.3f} mm, true TCP error unseen by them {true:.3f} mm')

errors_mm = ', '.join(f'{1e3 * error:+.2f}' for error in ROBOTS['built'].rich.forearm_error_m)
print(f'its forearms differ from l_B by {errors_mm} mm')
peaks = {name: max(trace.meta['figures']['current_peak_a']) for name, trace in traces.items()}
print(f'largest current: {peaks["nominal"]:.2f} A nominal, {peaks["built"]:.2f} A built')

"""Evaluate a trace or a bag: python read_a_recording.py [FILE.npz | FILE.csv | FOLDER of a bag]."""

import sys

import numpy as np

import delta3_pacdrive as d3

if len(sys.argv) > 1:
    recording = sys.argv[1]
else:  # without a recording; delta3 run experiment3 --bag FOLDER creates one
    recording = 'experiment3.npz'
    d3.simulate('experiment3').save(recording)

trace = d3.load_trace(recording)
print(f'{recording}: {trace.meta["program"]}, {len(trace.time_s)} cycles')
print('signals:', ', '.join(trace.signals))

error = np.linalg.norm(trace['tcp_error'], axis=1)
worst = int(error.argmax())
x, y, z = trace['tcp_command'][worst]
place = f'{trace.time_s[worst]:.3f} s, ({x:.3f}, {y:.3f}, {z:.3f}) m'
print(f'largest TCP error {1e3 * error[worst]:.3f} mm at {place}')

lag = np.degrees(np.abs(trace['following_error'])).max(axis=0)
print('largest following error:', ', '.join(f'axis{n} {value:.4f} deg' for n, value in enumerate(lag, 1)))

# of all samples of the current loops, if recorded; otherwise of those in the AT
rms = np.sqrt(np.mean(trace.signals.get('current_rms', trace['current']) ** 2, axis=0))
print('current, rms:', ', '.join(f'axis{n} {value:.3f} A' for n, value in enumerate(rms, 1)))

"""Run experiment 1 of the thesis without ROS, and plot TCP error and currents."""

import sys

import matplotlib.pyplot as plt
import numpy as np

import delta3_pacdrive as d3

picture = sys.argv[1] if len(sys.argv) > 1 else 'experiment1.png'

robot = d3.load_parameters()
trace = d3.simulate('experiment1', robot)

speed = np.linalg.norm(np.gradient(trace['tcp_actual'], trace.time_s, axis=0), axis=1)
error_mm = 1e3 * np.linalg.norm(trace['tcp_error'], axis=1)

figure, (top, middle, bottom) = plt.subplots(3, sharex=True, figsize=(8, 6), layout='constrained')
top.plot(trace.time_s, speed)
top.set_ylabel('TCP speed [m/s]')
for axis in range(3):  # all samples of the current loops
    low, high = trace['current_min'][:, axis], trace['current_max'][:, axis]
    middle.fill_between(trace.time_s, low, high, label=f'axis {axis + 1}')
middle.set_ylabel('$I_{eff}$ [A]')
middle.legend()
bottom.plot(trace.time_s, error_mm)
bottom.set(ylabel='TCP error [mm]', xlabel='bus time [s]')
figure.savefig(picture, dpi=100)

print(f'{len(trace.time_s)} bus cycles of {trace.meta["cycle_time_s"] * 1e3:g} ms, {picture}')
print(f'TCP error: at most {error_mm.max():.3f} mm')
peak_a = max(trace.meta['figures']['current_peak_a'])
print(f'current: at most {peak_a:.2f} A of {robot.motor.nominal_current_a:g} A nominal')

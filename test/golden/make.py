#!/usr/bin/env python3
"""Makes the golden figures of simulated runs anew.

    python test/golden/make.py        writes figures.json into this folder

The simulator gives the same bits wherever the same machine code runs. ``maker`` is a digest of the dependencies:
versions of the interpreter, of numba and its compiler, numpy, scipy, ruckig and the C library, and the kind of
processor with its features. Figures have nine digits. Each signal of a run has a digest of its bits, and two digests
cover all signals: one those made of all samples of the current loops, the other all others. They may change only with
the equations, the parameters or the programs; a commit that changes them gives the reason.
"""

import hashlib
import json
import runpy
from pathlib import Path

import numpy as np

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS

FILE = Path(__file__).parent / 'figures.json'
COMMAND = 'python test/golden/make.py'
maker = runpy.run_path(str(Path(__file__).with_name('maker.py')))['maker']
DIGITS = 9
SHORT = 16  # hexadecimal digits of a digest that only has to differ
LINE = {
    'start_m': [0.0, 0.0, -0.78],
    'moves': [
        {'move_l': {'to_m': [0.2, 0.05, -0.8], 'speed_m_s': 1.0, 'blend_m': 0.03}},
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 1.25, 'before_m': 0.01}},
        {'move_l': {'to_m': [0.1, -0.1, -0.78], 'speed_m_s': 0.6}},
    ],
}
TUNED = {
    'drive__velocity_filter_s': 3e-4,
    'drive__current_filter_s': 5e-5,
    'drive__velocity_feedforward': 0.8,
    'drive__current_feedforward': 0.7,
    'drive__commutation_offset_rad': 0.05,
    'motor__friction_smoothing_rad_s': 3.0,
    'motor__static_friction_n_m': 0.13,
}


def _with_faults(*faults):
    return LINE | {'faults': list(faults)}


# name: (program, changes of the robot, parameter file)
CASES = {
    'experiment 1': ('experiment1', {}, None),
    'experiment 2': ('experiment2', {}, None),
    'experiment 3': ('experiment3', {}, None),
    'experiment 1, built robot': ('experiment1', {}, 'rich'),
    'experiment 2, built robot': ('experiment2', {}, 'rich'),
    'experiment 3, built robot': ('experiment3', {}, 'rich'),
    'experiment 1, exact exchange': ('experiment1', {'bus__exchange_period_s': 125e-6}, None),
    'experiment 1, cycle of 2 ms': ('experiment1', {'bus__cycle_time_s': 2e-3}, None),
    'experiment 1, cycle of 4 ms': ('experiment1', {'bus__cycle_time_s': 4e-3}, None),
    'experiment 2, cycle of 4 ms, exact exchange': (
        'experiment2',
        {'bus__cycle_time_s': 4e-3, 'bus__exchange_period_s': 125e-6},
        None,
    ),
    'experiment 1, filters and friction': ('experiment1', TUNED, None),
    'packaging with stops': ('packaging_stops', {}, None),
    'packaging': ('packaging', {}, None),
    'packaging, built robot': ('packaging', {}, 'rich'),
    'packaging, whole model': ('packaging', {}, 'model'),
    'packaging with stops, whole model': ('packaging_stops', {}, 'model'),
    'packaging, built robot, whole model': ('packaging', {}, 'model+rich'),
    'excitation': ('excitation', {}, None),
    'excitation, built robot': ('excitation', {}, 'rich'),
    'gripped on the way': (LINE, {}, None),
    'telegrams lost': (
        _with_faults(
            {'fault': 'drop_mdt', 'axis': 'axis2', 'after_s': 0.15},
            {'fault': 'drop_at', 'axis': 'axis1', 'after_s': 0.2},
            {'fault': 'drop_at', 'axis': 'axis3', 'after_s': 0.25},
        ),
        {},
        None,
    ),
    'encoder lost': (_with_faults({'fault': 'encoder_failure', 'axis': 'axis2', 'after_s': 0.2}), {}, None),
    'emergency stop': (_with_faults({'fault': 'emergency_stop', 'after_s': 0.2}), {}, None),
    'MDT lost until the drive stops': (
        _with_faults({'fault': 'drop_mdt', 'axis': 'axis1', 'cycles': 2, 'after_s': 0.2}),
        {},
        None,
    ),
    'AT late until the master stops': (
        _with_faults({'fault': 'delay_at', 'axis': 'axis3', 'cycles': 20, 'by_cycles': 3, 'after_s': 0.2}),
        {},
        None,
    ),
    'winding shorted': (_with_faults({'fault': 'winding_short', 'axis': 'axis1', 'after_s': 0.2}), {}, None),
    'brake stuck': (_with_faults({'fault': 'brake_stuck', 'axis': 'axis2', 'after_s': 0.2}), {}, None),
    'payload lost': (_with_faults({'fault': 'payload_lost', 'after_s': 0.35}), {}, None),
    'DC link sags, built robot': (
        _with_faults({'fault': 'dc_link', 'axis': 'axis2', 'voltage_v': 60.0, 'after_s': 0.2, 'for_s': 0.1}),
        {},
        'rich',
    ),
    'mains dip': (
        _with_faults({'fault': 'supply_dip', 'share': 0.8, 'after_s': 0.1, 'for_s': 0.1}),
        {'supply__enabled': True, 'supply__capacitance_f': 5e-5},
        'model',
    ),
    'fan blocked': (
        _with_faults({'fault': 'fan_blocked', 'axis': 'axis2', 'after_s': 0.1}),
        {'thermal__in_drives': True, 'thermal__time_factor': 1000.0, 'thermal__start_degc': 100.0},
        'model',
    ),
    'load and noise': (
        _with_faults(
            {'fault': 'overload', 'axis': 'axis1', 'torque_n_m': 1.5, 'after_s': 0.1, 'for_s': 0.1},
            {'fault': 'encoder_noise', 'axis': 'axis3', 'noise_rad': 2e-4, 'after_s': 0.1},
        ),
        {},
        None,
    ),
}


def _rounded(values):
    return [float(f'{value:.{DIGITS}g}') for value in np.ravel(values).tolist()]


def digest(trace, names):
    """Return the SHA-256 of signals of a run with their names."""
    found = hashlib.sha256(trace.time_s.tobytes())
    for key in sorted(names):
        found.update(f'{key} {trace[key].shape}'.encode() + np.ascontiguousarray(trace[key]).tobytes())
    return found.hexdigest()


def figures(name):
    """Return the figures of a case: rms and last value by axis of each signal, and the summary of the run."""
    program, changes, file = CASES[name]
    robot = parameters.load(file).replace(**changes)
    program = (
        programs.load(program, robot.motion)
        if isinstance(program, str)
        else programs.parse(program, robot.motion)
    )
    trace = simulation.run(program, robot)
    found = {
        'cycles': len(trace.time_s),
        'end_cycle': trace.meta['end_cycle'],
        'stopped': trace.meta['stopped'],
        'lost_telegrams': trace.meta['lost_telegrams'],
        'sha256': digest(trace, trace.signals.keys() - CURRENT_SIGNALS.keys()),
        'sha256_of_samples': digest(trace, CURRENT_SIGNALS),
        'figures': {key: _rounded(value) for key, value in trace.meta['figures'].items()},
        'digests': {key: digest(trace, [key])[:SHORT] for key in trace.signals},
    }
    signals = {key: np.sqrt((values**2).mean(axis=0)) for key, values in trace.signals.items()}
    found['rms'] = {key: _rounded(values) for key, values in signals.items()}
    found['last'] = {key: _rounded(values[-1]) for key, values in trace.signals.items()}
    return found


def main():
    """Write the file."""
    document = {'command': COMMAND, 'maker': maker(), 'cases': {name: figures(name) for name in CASES}}
    FILE.write_text(json.dumps(document, indent=1) + '\n', encoding='utf-8')


if __name__ == '__main__':
    main()

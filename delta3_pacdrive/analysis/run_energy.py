"""Energy of a run, from the currents and speeds of its motors."""

import numpy as np

from delta3_pacdrive.motion.energy import Energy, sampled_energy
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace

NEEDED = ('shaft_speed', 'current_mean', 'current_rms')


def energy_of_round(trace: Trace, parameters: Parameters, repeat: int) -> Energy | None:
    """Return the mean energy of one round of a simulated or recorded program; None if the trace is incomplete.

    Friction is that of the parameters; in a built robot the friction of the gears differs.
    """
    if any(name not in trace.signals for name in NEEDED):
        return None
    start, end = (trace.meta.get(name) for name in ('start_cycle', 'end_cycle'))
    if start is None or end is None:
        return None
    cycles = np.rint(trace.time_s / parameters.bus.cycle_time_s).astype(np.int64)
    end = min(end, cycles[-1])
    if not cycles[0] <= start < end:
        return None
    first, last = np.searchsorted(cycles, [start, end])
    if cycles[first] != start or end - start != last - first:
        return None
    speed, mean, rms = (np.asarray(trace[name][first : last + 1], dtype=np.float64) for name in NEEDED)
    # currents are averages over a cycle, speeds are values at its start
    between = 0.5 * (speed[:-1] + speed[1:])
    found = sampled_energy(trace.time_s[first:last], between, mean[:-1], rms[:-1] ** 2, parameters)
    return found.times(1.0 / repeat)

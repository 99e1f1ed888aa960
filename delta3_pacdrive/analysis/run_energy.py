"""Energy of a run, from the currents and the speeds of its motors."""

import numpy as np

from delta3_pacdrive.motion.energy import Energy, sampled_energy
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace

NEEDED = ('shaft_speed', 'current_mean', 'current_rms')


def energy_of_round(trace: Trace, parameters: Parameters) -> Energy | None:
    """Return the mean energy of a round of the program that a simulation has driven; None if the trace cannot tell.

    Friction is that of the parameters, in the gears of a built robot another one.
    """
    if any(name not in trace.signals for name in NEEDED):
        return None
    speed, mean, rms = (np.asarray(trace[name], dtype=np.float64) for name in NEEDED)
    first, last = (int(trace.meta[name]) for name in ('start_cycle', 'end_cycle'))
    # currents are those from the start of a cycle to its end, speeds those at its start
    during = slice(first, min(last, len(speed) - 1))
    between = 0.5 * (speed[first : during.stop] + speed[first + 1 : during.stop + 1])
    found = sampled_energy(trace.time_s[during], between, mean[during], rms[during] ** 2, parameters)
    return found.times(1.0 / trace.meta['repeat'])

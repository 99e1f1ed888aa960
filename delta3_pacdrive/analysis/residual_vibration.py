"""What is left of a vibration when the robot has stopped, at its true TCP."""

import numpy as np

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.trace import Trace

SETTLED_S = 0.15  # after the end of a move: by then the built robot has come to rest
ARRIVES_S = 3e-3  # from the last set point on, until the motors have got it


def after_stop(trace: Trace, cycle: int) -> Floats:
    """Return the true TCP [m] beside where it comes to rest, from when the last set point has arrived; shape (n, 3).

    Parameters
    ----------
    trace
        Of a simulation, with its true TCP.
    cycle
        Bus cycle of the last set point.

    Raises
    ------
    TraceError
        The robot does not stand long enough, or nobody knows its true TCP.

    """
    period = float(trace.time_s[1] - trace.time_s[0])
    first, last = cycle + round(ARRIVES_S / period), cycle + round(SETTLED_S / period)
    if 'tcp_true' not in trace.signals:
        raise TraceError('the true TCP is not known: only a simulation tells it')
    if not 0 < first < last < len(trace.time_s):
        raise TraceError(f'the robot must stand for {SETTLED_S:g} s after bus cycle {cycle}')
    tcp = trace['tcp_true']
    return np.asarray(tcp[first:last] - tcp[last : last + last - first].mean(axis=0))


def swing_m(beside_m: Floats) -> float:
    """Return the largest way of a coordinate from one turning point to the next [m], of shape (n, 3).

    What creeps to its place does not swing.
    """
    ways = [0.0]
    for one in beside_m.T:
        turns = np.flatnonzero(np.diff(np.sign(np.diff(one))) != 0.0) + 1
        ends = one[np.concatenate([turns, [len(one) - 1]])]
        ways.append(float(np.abs(np.diff(ends)).max(initial=0.0)))
    return max(ways)

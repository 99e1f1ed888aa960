"""Statistics of the motor current over all periods of the current loop, per bus cycle and per program.

The AT contains one sample per bus cycle; these statistics use all of them, 16 per millisecond. A program is the set of
cycles marked by the master in S-0-0134 (``Control.MEASURE``).
"""

import math

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.robot.sercos.words import Control

PROGRAM, MEASURE = int(Control.PROGRAM), int(Control.MEASURE)


@kernel
def begin_current_figures(s):
    """Reset the statistics of a bus cycle, and evaluate the real-time control bits of its MDT."""
    s.cycle_sum = s.cycle_square = s.measured_square = 0.0
    s.cycle_min = s.cycle_max = 0.0
    program = s.held_control & PROGRAM
    measuring = s.held_control & MEASURE
    if program and s.program == 0:
        s.window_cycles = 0
        s.window_square = s.window_peak = 0.0
    elif s.measuring != 0 and not measuring and s.window_cycles > 0:
        s.last_peak = s.window_peak
        s.last_rms = window_rms(s)
    s.program = 1 if program else 0
    s.measuring = 1 if measuring else 0


@kernel
def window_rms(s):
    """Root mean square [A] over the cycles marked so far."""
    return math.sqrt(s.window_square / max(s.window_cycles, 1))


@kernel
def add_current(s):
    """Add the current at the end of a period of the current loop."""
    current = s.motor_current
    if s.step == 0:
        s.cycle_min = s.cycle_max = current
    s.cycle_sum += current
    s.cycle_square += current * current
    if current < s.cycle_min:
        s.cycle_min = current
    if current > s.cycle_max:
        s.cycle_max = current
    s.measured_square += s.current * s.current


@kernel
def end_current_figures(s, c):
    """Add a bus cycle to the statistics of the program, if it is marked."""
    if s.measuring != 0:
        s.window_cycles += 1
        s.window_square += s.cycle_square / c.steps_per_cycle
        s.window_peak = max(s.window_peak, s.cycle_max, -s.cycle_min)

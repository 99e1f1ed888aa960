"""When lost telegrams are a fault: two in a row, or ten in a window (Schneider, diagnostic message 8112); both ways.

One loss of the window is forgotten with every ``FORGIVING_CYCLES`` telegrams in a row that come: ten losses in less
than a thousand cycles, evenly spread, are a fault.
"""

LOSSES_IN_A_ROW, LOSSES_IN_WINDOW = 2, 10
FORGIVING_CYCLES = 100

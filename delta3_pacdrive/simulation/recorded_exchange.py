"""One exchange of the drives, recording their state in every period of the current loop."""

from delta3_pacdrive.drive.mc4 import mc4_run_period
from delta3_pacdrive.numerics.kernel import kernel

FOUND = ('position', 'speed', 'command', 'motor_current', 'voltage')  # fields of a drive's state
POSITION, SPEED = FOUND.index('position'), FOUND.index('speed')


@kernel
def run_recorded_exchange(row, shafts, words, added, robot, currents, found, left):
    """Run the drives from one exchange to the next, one period of the current loop at a time.

    Parameters
    ----------
    row
        Row of the first period in the recorded arrays.
    shafts
        True shafts at the start: three positions [rad], three speeds [rad/s], three coupling torques d [N m].
    words
        States of the drives as numbers, one word each, shape (3, words).
    added
        Indices of the words to add to, factors, number of the drive, and a value for each period.
    robot
        Array of one record ``ROBOT``; ``brakes`` is set.
    currents
        Receives the motor currents of an exchange period [A], shape (steps, 3).
    found, left
        Indices of the words recorded at the start (``FOUND``) and at the end of each period, and the arrays that
        receive them, shape (fields, samples, 3).

    """
    places, factors, axis, values = added
    found_places, found_values = found
    left_places, left_values = left
    r = robot[0]
    for i in range(3):
        state, s = words[i], r.drives[i].state
        shaft = shafts[i], shafts[3 + i], shafts[6 + i]
        for n in range(currents.shape[0]):
            for k in range(found_places.shape[0]):
                found_values[k, row + n, i] = state[found_places[k]]
            found_values[POSITION, row + n, i], found_values[SPEED, row + n, i] = shaft[0], shaft[1]
            if i == axis:
                for k in range(places.shape[0]):
                    state[places[k]] += factors[k] * values[row + n]
            # continue with the drive's own shaft: to the drive this is one exchange
            r.brakes[i] = mc4_run_period(shaft, r.drives, i, currents[n : n + 1])
            if i == axis:
                for k in range(places.shape[0]):
                    state[places[k]] -= factors[k] * values[row + n]
            for k in range(left_places.shape[0]):
                left_values[k, row + n, i] = state[left_places[k]]
            shaft = s.position, s.speed, s.coupling

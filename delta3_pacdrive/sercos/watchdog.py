"""How long a participant waits for another before it takes it for dead, on the wall clock.

While a partner only is late, bus time stands and nothing is lost. The times are staggered, so that who can tell the
culprit decides first: a drive that receives no MDT stops by itself; the plant goes on without a drive that sends no
current, as a machine does whose end stage has lost its power; the master then sees who does not answer. Wherever a
partner dies, everything else stands without torque within ``BOUND_S`` and the stopping time of the drives.
"""

MASTER_SILENT_S = 1.0  # a drive without MDT: fault 8506, reaction BD2, without the master
DRIVE_SILENT_S = 2.0  # the plant without the currents of a drive: its motor is without power from there on
ANSWER_SILENT_S = 0.5  # the master without the AT of one axis, while the others answer later cycles
BUS_SILENT_S = 3.0  # the master without any AT
PLANNER_SILENT_S = 3.0  # the master without a heartbeat of UnitRobot, whose program runs
OPERATOR_SILENT_S = 1.5  # the master without a heartbeat of the operator who has control
OPERATOR_APPEARS_S = 5.0  # without his first one: on a busy machine or network topics find each other late
PARTING_S = 0.3  # the plant without currents, once the phase has fallen
ATTENTION_S = 0.25  # between two looks at a partner: what is more is the watcher's own absence
BOUND_S = BUS_SILENT_S + 0.5


class Watchdog:
    """Looks at a partner from time to time.

    A look that itself comes late shows that this process was held up: what came meanwhile may still lie unread. Of the
    time since the look before it, no more than ``ATTENTION_S`` or two periods count as silence.

    Parameters
    ----------
    period_s
        Time between two looks [s].

    """

    def __init__(self, period_s: float) -> None:
        self._attention_s = max(2.0 * period_s, ATTENTION_S)
        self._silence_s = 0.0  # at the last look
        self._since_s = 0.0  # the last look, or the last word of the partner after it

    def received(self, now_s: float) -> None:
        """Note that something was received from the partner, or that it need not say anything."""
        self._silence_s, self._since_s = 0.0, now_s

    def silence_s(self, now_s: float) -> float:
        """Look: how long the partner has been silent [s]."""
        self._silence_s += min(now_s - self._since_s, self._attention_s)
        self._since_s = now_s
        return self._silence_s

"""Wall-clock timeouts after which a participant considers a partner lost.

While a partner is only late, bus time waits and nothing is lost. The timeouts are staggered so that the participant
that can identify the cause acts first: a drive without MDTs stops on its own; the plant continues without the current
of a silent drive, as a machine with a dead power stage does; the master then finds the missing drive. Whichever
partner fails, all others are at rest and without torque within ``BOUND_S`` plus the stopping time of the drives.
"""

MASTER_SILENT_S = 1.0  # drive without MDT: fault 8506, reaction BD2 without the master
DRIVE_SILENT_S = 2.0  # plant without currents of a drive: its motor is unpowered from then on
ANSWER_SILENT_S = 0.5  # master without the AT of one axis, while the others answer later cycles
BUS_SILENT_S = 3.0  # master without any AT
PLANNER_SILENT_S = 3.0  # master without a heartbeat of UnitRobot during its program
OPERATOR_SILENT_S = 1.5  # master without a heartbeat of the operator in control
OPERATOR_APPEARS_S = 5.0  # until the first heartbeat: discovery is slow on a busy machine or network
PARTING_S = 0.3  # plant without currents after the phase has fallen
ATTENTION_S = 0.25  # longest counted interval between two polls; more is a delay of the watching process
BOUND_S = BUS_SILENT_S + 0.5


class Watchdog:
    """Measures the silence of a partner.

    A late poll means that this process was delayed and that messages may be unread. Therefore at most ``ATTENTION_S``
    or two periods since the previous poll count as silence.

    Parameters
    ----------
    period_s
        Time between polls [s].

    """

    def __init__(self, period_s: float) -> None:
        self._attention_s = max(2.0 * period_s, ATTENTION_S)
        self._silence_s = 0.0  # at the last poll
        self._since_s = 0.0  # last poll, or last message after it

    def received(self, now_s: float) -> None:
        """Reset the silence after a message, or while none is due."""
        self._silence_s, self._since_s = 0.0, now_s

    def silence_s(self, now_s: float) -> float:
        """Poll: return the duration of the partner's silence [s]."""
        self._silence_s += min(now_s - self._since_s, self._attention_s)
        self._since_s = now_s
        return self._silence_s

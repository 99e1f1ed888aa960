"""Start-up of the bus as the master sees it: what each phase from CP0 to CP3 waits for."""

from rclpy.node import Node

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.ros.interfaces import second_writer
from delta3_pacdrive.sercos.configuration_check import (
    DRIVES,
    PARTICIPANTS,
    PLANT,
    Identity,
    disagreements,
    missing,
)
from delta3_pacdrive.sercos.participants import Participants
from delta3_pacdrive.sercos.words import Phase

PATIENCE = 50  # looks in vain after which a guess at the reason is told


class PhaseUp:
    """One start-up after the other.

    Attributes
    ----------
    waiting
        What the present phase waits for, empty if it waits for nothing.
    resting
        Shaft positions [rad] that the drives have answered with, by number of the axis.

    """

    def __init__(self, node: Node, participants: Participants, identity: Identity) -> None:
        self._node, self._participants, self._identity = node, participants, identity
        self.waiting = ''
        self._looks_in_vain = 0  # in this phase
        self.resting: dict[int, float] = {}

    def begin(self) -> None:
        """Begin anew: whoever answered before has to do so again."""
        self.resting.clear()
        self._looks_in_vain = 0

    def next(self, phase: Phase) -> Phase:
        """Return the phase that follows now, the present one while it has to wait.

        Raises
        ------
        RunError
            Participants disagree about what the bus rests on.

        """
        if phase == Phase.CP0:
            self._wait_for(self._presence())
        elif phase == Phase.CP1:
            self._wait_for(self._answers())
        else:
            self._wait_for(self._agreement())
        if self.waiting:
            self._looks_in_vain += 1
            return phase
        self._looks_in_vain = 0
        return Phase(phase + 1)

    def _presence(self) -> str:
        twice = second_writer(self._node)
        if twice:
            return f'waiting until one of them ends: {twice}'
        absent = missing(self._participants.identities)
        return f'waiting for {", ".join(absent)}' if absent else ''

    def _answers(self) -> str:
        silent = [axis for index, axis in enumerate(DRIVES) if index not in self.resting]
        if not silent:
            return ''
        # a drive answers with the shaft position that the plant tells it
        doubt = (
            ': is the plant running?' if len(silent) == len(DRIVES) and self._looks_in_vain > PATIENCE else ''
        )
        return f'waiting for an answer of {", ".join(silent)}{doubt}'

    def _agreement(self) -> str:
        present = {name: self._participants.identities[name] for name in PARTICIPANTS}
        sentences = disagreements(self._identity, present)
        if sentences:
            raise RunError('; '.join(sentences))
        heard = self._participants.links[PLANT]
        unlinked = [axis for axis in DRIVES if axis not in heard]
        return f'waiting for the plant to hear {", ".join(unlinked)}' if unlinked else ''

    def _wait_for(self, reason: str) -> None:
        if reason != self.waiting:
            self.waiting = reason
            if reason:
                self._node.get_logger().info(reason)

"""Enabling, stops and faults of the robot, as operators and the bus ask for them.

Services of the transformation task: ``enable``, ``emergency_stop``, ``reset``. Telegrams are the task's affair; this
desk knows the first cause of a fault, stops the TCP on its path, and clears the drives (S-0-0099).
"""

from collections.abc import Callable
from typing import Protocol

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.bus.master import Master
from delta3_pacdrive.bus.phases import DRIVES
from delta3_pacdrive.bus.service import Access, Answer, Operation, parse_idn
from delta3_pacdrive.bus.words import in_torque
from delta3_pacdrive.drive.diagnostics import FAULT_OF_NUMBER, fault_text
from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.motion.timeline import NEVER
from delta3_pacdrive.nodes.motion_server import MotionServer, MotionState
from delta3_pacdrive.nodes.service_desk import ServiceDesk
from delta3_pacdrive.transformation import Transformation

RESET_CLASS_1 = parse_idn('S-0-0099')
DIAGNOSTIC_NUMBER = parse_idn('S-0-0390')
SETTLED_M = 1e-4  # by which a robot that is enabled may be away from its command
DISPLACED_M = 5e-3  # the same while a program is held, which the sag into the brakes must not end


class Bus(Protocol):
    """What the desk has to know of the bus: next cycle to start, next one to be complete, why it is not cyclic."""

    next_cycle: int
    answered: int

    def stamp(self, cycle: int) -> tuple[int, int]:
        """Bus time of a cycle."""

    def closed(self) -> str:
        """Say why nothing that needs cyclic operation can be done, empty if it can."""

    def waiting(self) -> str:
        """Say what the present phase waits for, empty if it waits for nothing."""


class SafetyDesk:
    """Of one transformation task.

    Parameters
    ----------
    node
        Has the services.
    bus, task, master, motion, drives
        Of the same transformation task.
    changed
        Called when there is something new to be told.

    Attributes
    ----------
    fault
        First cause, as a sentence; empty while there is none.
    fault_cycle
        Bus cycle in which it was found.

    """

    def __init__(
        self,
        node: Node,
        bus: Bus,
        task: Transformation,
        master: Master,
        motion: MotionServer,
        drives: ServiceDesk,
        changed: Callable[[], None],
    ) -> None:
        self._log, self._bus, self._changed = node.get_logger(), bus, changed
        self._task, self._master, self._motion, self._drives = task, master, motion, drives
        self.fault = ''
        self.fault_cycle = 0
        self._reset_wanted = False
        self._resets, self._reset_errors = 0, list[str]()
        node.create_service(SetBool, 'enable', self._on_enable)
        node.create_service(Trigger, 'emergency_stop', self._on_emergency_stop)
        node.create_service(Trigger, 'reset', self._on_reset)

    def in_torque(self) -> bool:
        """Whether any drive holds its motor."""
        return any(in_torque(status) for status in self._master.status)

    # faults -----------------------------------------------------------------------------------------------------------

    def note(self, reason: str, cycle: int | None = None) -> None:
        """Keep the first cause of a fault and say it."""
        if not self.fault:
            self.fault = reason
            self.fault_cycle = self._bus.answered if cycle is None else cycle
            self._log.error(reason)
            self._motion.fail()
            self._changed()

    def stop(self, reason: str, hard: bool = False) -> None:
        """Note a fault that leaves the bus working: the TCP stops on its path, then all drives are disabled."""
        self._task.stop_at(0, hard)
        self.note(reason)

    def stop_for_drives(self, reason: str, cycle: int) -> None:
        """Stop because of what the answers of a cycle say, and ask the drives for the cause."""
        if self.fault and not self._master.limp:
            return
        if not self.fault:
            self._explain()
        self._task.stop_at(cycle + self._master.reaction_cycles, self._master.limp)
        self.note(reason, cycle)

    def _explain(self) -> None:
        """Ask the drives that report a fault which one it is, and add it to the sentence."""

        def add(index: int, answer: Answer) -> None:
            fault = FAULT_OF_NUMBER.get(int(answer.value))
            if fault and self.fault.startswith(f'{DRIVES[index]} reports a fault'):
                self.fault += f': {fault_text(fault)}'
                self._log.error(self.fault)
                self._changed()

        for index in self._master.faulty():
            self._drives.ask(index, Access(DIAGNOSTIC_NUMBER, Operation.READ), add)

    # requests ---------------------------------------------------------------------------------------------------------

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data and self.fault:
            response.message = f'not after a fault: {self.fault}'
            return response
        cycle = self._bus.next_cycle
        if request.data and self._task.enable_cycle == NEVER and not self._bus.closed():
            reason = self._take_over_position()
            if reason:
                response.message = reason
                return response
        elif not request.data and self._motion.state in (MotionState.MOVING, MotionState.STOPPING):
            self.stop(f'disabled by the operator in motion, in bus cycle {cycle}')
            response.success, response.message = True, f'stops on its path from bus cycle {cycle} on'
            return response
        self._task.enable_cycle = cycle if request.data else NEVER
        response.success = True
        response.message = f'effective in bus cycle {cycle + 1}'
        return response

    def _take_over_position(self) -> str:
        """Command the TCP to be where the brakes hold it; say why that is not possible."""
        if self.in_torque():
            return 'a drive is in torque still'
        try:
            away = self._task.distance_m(self._master.positions)
        except UnreachableError as error:
            return str(error)
        if self._task.loaded:
            # a program that is held goes on where it was left
            where = f'{1e3 * away:.1f} mm from where its program was held'
            return f'the robot was moved {where}: abort it first' if away > DISPLACED_M else ''
        if away > SETTLED_M:
            tcp = self._task.locate(self._master.positions)
            self._motion.locate(tcp, self._bus.stamp(self._bus.answered))
        return ''

    def _on_emergency_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop on the path, then take the torque off: stop category 1."""
        self.stop(f'emergency stop in bus cycle {self._bus.next_cycle}')
        response.success, response.message = True, self.fault
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Clear the faults of all drives (S-0-0099); the robot is ready again where it stands, and not enabled."""
        if not self.fault or self._bus.closed() or self._resets or self._reset_wanted:
            waiting = f' ({self._bus.waiting()})' if self._bus.waiting() else ''
            response.message = (
                f'cannot be cleared now: {self.fault}{waiting}' if self.fault else 'there is no fault'
            )
            return response
        self._reset_wanted = True
        self.reset_when_disabled()
        response.success = True
        response.message = (
            'S-0-0099 goes out as soon as the drives are disabled'
            if self._reset_wanted
            else f'S-0-0099 goes out from bus cycle {self._bus.next_cycle} on'
        )
        return response

    def give_up_reset(self) -> None:
        """Forget a reset that waits: there are no more cycles."""
        self._reset_wanted = False

    def reset_when_disabled(self) -> None:
        """Send S-0-0099 if it waits; a drive that is reset while it is to be enabled would be so at once."""
        if not self._reset_wanted or self._bus.closed():
            return
        if self._task.enable_cycle == NEVER and not self.in_torque():
            self._reset_wanted = False
            self._resets = len(DRIVES)
            self._reset_errors = []
            for index in range(len(DRIVES)):
                self._drives.ask(index, Access(RESET_CLASS_1, Operation.COMMAND), self._on_reset_answer)

    def _on_reset_answer(self, index: int, answer: Answer) -> None:
        self._resets -= 1
        if answer.error:
            self._reset_errors.append(f'{DRIVES[index]}: {answer.sentence}')
        if self._resets:
            return
        if self._reset_errors:
            errors = '; '.join(self._reset_errors)
            self._motion.refuse('reset', ProgramError(f'{errors}; the cause may last: {self.fault}'))
            return
        if self.in_torque():
            self._motion.refuse('reset', ProgramError('a drive is in torque still'))
            return
        self.fault = ''
        self._master.forgive_losses()
        self._task.give_up()
        try:
            tcp = self._task.locate(self._master.positions)
        except UnreachableError as error:
            self.stop(str(error))
            return
        self._log.info(f'faults cleared in bus cycle {self._bus.answered}')
        self._motion.reset(tcp, self._bus.stamp(self._bus.answered))

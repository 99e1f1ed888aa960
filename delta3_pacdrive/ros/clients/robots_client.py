"""Operators of all running robots, one thread per robot, so that all are served concurrently."""

import os
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

from rclpy.node import Node

from delta3_pacdrive import interrupts
from delta3_pacdrive.errors import Delta3Error, RunError, RunInterruptedError
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.clients.robot_client import LOOK_S, OperatorNode
from delta3_pacdrive.ros.wire import discovery, domain

SETTLED_S = 1.5  # without a new robot before discovery ends
FIRST_S = 5.0  # timeout for the first robot
LEAVE_S = 1.0  # timeout for an interrupted operator to end
TASK = 'transformation_task'  # every robot has one node of this name

Answered = TypeVar('Answered')


@dataclass
class Outcome(Generic[Answered]):
    """The result of one robot: its answer, or an error message."""

    namespace: str
    answer: Answered | None = None
    error: str = ''


def ask_all(act: Callable[[OperatorNode], Answered], prefix: str = '/') -> list[Outcome[Answered]]:
    """Find all robots of the domain, or those below a namespace, and call ``act`` for each as soon as it is found.

    A robot that does not respond does not delay the others.

    Raises
    ------
    RunError
        There is none.
    RunInterruptedError
        A signal ended the search.

    """
    below = domain.namespace(prefix)
    with _finder() as (process, finder, asked):
        outcomes = _ask_found(process, finder, act, below, asked)
    _require_some(outcomes, below)
    return sorted(outcomes, key=lambda outcome: outcome.namespace)


def find_all(prefix: str = '/') -> list[str]:
    """Return the namespaces of all robots of the domain, or of those below one.

    Raises
    ------
    RunError
        There is none.
    RunInterruptedError
        A signal ended the search.

    """
    below = domain.namespace(prefix)
    found: set[str] = set()
    with _finder() as (process, finder, asked):
        patient_until = time.monotonic() + FIRST_S
        while time.monotonic() < patient_until:
            process.spin_for(LOOK_S)
            if asked:
                raise RunInterruptedError(interrupts.sentence(interrupts.asked()))
            if new := _robots(finder, below) - found:
                found |= new
                patient_until = time.monotonic() + SETTLED_S
    _require_some(found, below)
    return sorted(found)


@contextmanager
def _finder() -> Iterator[tuple[node_process.Process, Node, interrupts.Flag]]:
    """Provide the process, the node and the signal flag of a search for robots."""
    discovery.keep_to_this_machine()
    asked = interrupts.Flag()
    with interrupts.answered_by(asked.set):
        node_process.join()
        process = node_process.Process()
        try:
            finder = Node('find_robots')
            finder.create_timer(LOOK_S, lambda: None)  # the executor needs a timer to keep its waits short
            process.add(finder)
            yield process, finder, asked
        finally:
            node_process.leave(process)


def _require_some(found: Collection[object], below: str) -> None:
    if not found:
        where = '' if below == '/' else f' below namespace {below}'
        raise RunError(f'no robot is up{where} in domain {os.environ.get(domain.VARIABLE) or 0}')


def _ask_found(
    process: node_process.Process,
    finder: Node,
    act: Callable[[OperatorNode], Answered],
    below: str,
    asked: interrupts.Flag,
) -> list[Outcome[Answered]]:
    outcomes: dict[str, Outcome[Answered]] = {}
    threads: list[threading.Thread] = []
    interrupted = threading.Event()
    patient_until = time.monotonic() + FIRST_S
    while time.monotonic() < patient_until or any(thread.is_alive() for thread in threads):
        process.spin_for(LOOK_S)
        if asked:
            interrupted.set()
            for thread in threads:  # each withdraws its request
                thread.join(LEAVE_S)
            raise RunInterruptedError(interrupts.sentence(interrupts.asked()))
        for namespace in sorted(_robots(finder, below) - outcomes.keys()):
            outcome = outcomes[namespace] = Outcome(namespace)
            operator = OperatorNode(_waiting(interrupted), namespace=namespace)
            process.add(operator)
            threads.append(threading.Thread(target=_ask, args=(act, operator, outcome), daemon=True))
            threads[-1].start()
            patient_until = time.monotonic() + SETTLED_S
    return list(outcomes.values())


def _robots(finder: Node, below: str) -> set[str]:
    found = {space for name, space in finder.get_node_names_and_namespaces() if name == TASK}
    return {space for space in found if below == '/' or f'{space}/'.startswith(f'{below}/')}


def _waiting(interrupted: threading.Event) -> Callable[[float], None]:
    """Return the wait function of an operator whose node is spun by the main thread."""

    def wait(seconds: float) -> None:
        if interrupted.wait(seconds):
            raise RunInterruptedError('interrupted')

    return wait


def _ask(act: Callable[[OperatorNode], Answered], operator: OperatorNode, outcome: Outcome[Answered]) -> None:
    try:
        outcome.answer = act(operator)
    except Delta3Error as error:
        outcome.error = ' '.join(str(error).split())

"""Operators of all robots that are up: each robot has one, in a thread of its own, and all are asked at once."""

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
from delta3_pacdrive.ros import discovery, domain, node_process
from delta3_pacdrive.ros.robot_client import LOOK_S, OperatorNode

SETTLED_S = 1.5  # without a robot that was not known before, after which all are
FIRST_S = 5.0  # for the first
LEAVE_S = 1.0  # for an operator who is interrupted
TASK = 'transformation_task'  # a robot is where this node is

Answered = TypeVar('Answered')


@dataclass
class Outcome(Generic[Answered]):
    """What has come of a robot that was asked: its answer, or why there is none."""

    namespace: str
    answer: Answered | None = None
    error: str = ''


def ask_all(act: Callable[[OperatorNode], Answered], prefix: str = '/') -> list[Outcome[Answered]]:
    """Find all robots of the domain, or those below a namespace; an operator acts on each as soon as it is found.

    Nobody waits for another robot: one that does not answer keeps no other from being asked.

    Raises
    ------
    RunError
        There is none.
    RunInterruptedError
        A signal asked for the end.

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
        A signal asked for the end.

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
    """Hold a node that looks for robots, who spins it, and whether a signal has asked for the end."""
    discovery.keep_to_this_machine()
    asked = interrupts.Flag()
    with interrupts.answered_by(asked.set):
        node_process.join()
        process = node_process.Process()
        try:
            finder = Node('find_robots')
            finder.create_timer(LOOK_S, lambda: None)  # the executor needs one to keep its waits short
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
            for thread in threads:  # each takes back what it has asked for
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
    """Return how an operator waits: the main thread is who spins."""

    def wait(seconds: float) -> None:
        if interrupted.wait(seconds):
            raise RunInterruptedError('interrupted')

    return wait


def _ask(act: Callable[[OperatorNode], Answered], operator: OperatorNode, outcome: Outcome[Answered]) -> None:
    try:
        outcome.answer = act(operator)
    except Delta3Error as error:
        outcome.error = ' '.join(str(error).split())

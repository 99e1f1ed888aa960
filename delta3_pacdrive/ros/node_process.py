"""Start, spin and stop of a process of nodes."""

import faulthandler
import gc
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from delta3_pacdrive import interrupts, memory
from delta3_pacdrive.errors import Delta3Error, RunError, shown
from delta3_pacdrive.ros import domain, preload
from delta3_pacdrive.sercos.watchdog import Watchdog

REJOIN_S, REJOIN_MAX_S = 20.0, 300.0  # without a word of a partner; doubled each time until it is heard
_separate = False
_current: 'Process | None' = None  # that ``run`` spins
_rejoins = _rejoins_in_vain = 0


def is_separate() -> bool:
    """Whether this process is that of a single node."""
    return _separate


def rejoins() -> int:
    """Return how many times the node of this process has left the domain and joined it anew."""
    return _rejoins


def is_rejoining() -> bool:
    """Whether a node that is destroyed now will be made anew, as its process joins the domain again."""
    return _current is not None and _current.rejoins


class PartnerWatch:
    """Notices that a node hears nothing from a partner that it needs, and lets its process join the domain anew.

    Processes that are alive may stay deaf to each other, as after a long lack of processor time; another participant,
    with an identity that the others do not know yet, is heard again. Time in which the process itself does not run does
    not count. A process of several nodes stays as it is.

    Parameters
    ----------
    say
        Called with a sentence when the process joins anew.
    period_s
        Time between two looks [s].
    process
        That joins anew; by default the one that ``run`` spins, if it has a single node.

    """

    def __init__(
        self, say: Callable[[str], object], period_s: float, process: 'Process | None' = None
    ) -> None:
        self._say, self._period_s, self._process = say, period_s, process
        self._silent: dict[str, Watchdog] = {}  # by partner

    def heard(self, partner: str) -> None:
        """Note that a partner was heard."""
        global _rejoins_in_vain  # noqa: PLW0603 (the node that counts on is another one)
        _rejoins_in_vain = 0
        self._silent.pop(partner, None)

    def look(self, needed: Sequence[str], now_s: float) -> None:
        """Look which of the partners that are needed now are silent for too long."""
        self._silent = {name: silent for name, silent in self._silent.items() if name in needed}
        process = self._process or (_current if _separate else None)
        patience_s = min(REJOIN_S * 2**_rejoins_in_vain, REJOIN_MAX_S)
        for partner in needed:
            if partner not in self._silent:
                self._silent[partner] = Watchdog(self._period_s)
                self._silent[partner].received(now_s)
            elif self._silent[partner].silence_s(now_s) > patience_s and process and not process.rejoins:
                self._say(f'no word of {partner} for {patience_s:g} s: leaves the domain and joins it anew')
                process.rejoin()


SPIN_S = 0.1  # how long a signal may wait for the main thread
LEAVE_S = 20.0  # for the nodes of a client to leave the graph
NODES_LEAVE_S = 20.0  # for those of a robot
BAG_LEAVE_S = 60.0  # for a recorder, which has a bag to complete


class _Stop(Future):
    """The future that ends a spin; a signal may complete it while the thread that it interrupts holds its lock."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.RLock()  # type: ignore[assignment] # what is inherited is one that its holder waits for


class Process:
    """Spins nodes on one executor until SIGINT, SIGTERM or ``stop``."""

    def __init__(self, context: rclpy.Context | None = None) -> None:
        self._stop = _Stop()
        self._is_stopping = False
        self.rejoins = False
        self._executor = EventsExecutor(context=context)
        self._nodes: list[Node] = []

    def stop(self, *_: Any) -> None:
        """End ``spin``; also the signal handler."""
        if not self._is_stopping:  # not done yet where another signal interrupts this one
            self._is_stopping = True
            self._stop.set_result(None)

    def rejoin(self) -> None:
        """End ``spin`` for another process of the same nodes to begin."""
        global _rejoins, _rejoins_in_vain
        _rejoins, _rejoins_in_vain = _rejoins + 1, _rejoins_in_vain + 1
        self.rejoins = True
        self.stop()

    def add(self, node: Node) -> None:
        """Take a node in."""
        self._nodes.append(node)
        self._executor.add_node(node)

    def spin(self) -> None:
        """Run callbacks until ``stop``."""
        # one call runs many callbacks: spin_once would return after each, which costs as much again
        while not self._stop.done():
            self._executor.spin_until_future_complete(self._stop, timeout_sec=SPIN_S)

    def spin_for(self, seconds: float) -> None:
        """Run callbacks for a while."""
        self._executor.spin_until_future_complete(self._stop, timeout_sec=seconds)

    def close(self) -> None:
        """Destroy the nodes; the last words of a node still reach the graph."""
        for node in self._nodes:
            self._executor.remove_node(node)
            node.destroy_node()
        self._executor.shutdown()


def leave(process: Process | None, context: rclpy.Context | None = None, patience_s: float = LEAVE_S) -> None:
    """Leave the graph for good in a bounded time.

    Fast DDS was seen to spin in there for ever, where neither signals nor threads of Python come to their turn: then
    the process tells where it stands and ends with status 1. ``context`` is that of its nodes, if they have an own one.
    """
    faulthandler.dump_traceback_later(patience_s, exit=True)
    if process is not None:
        process.close()
    rclpy.try_shutdown(context=context)
    faulthandler.cancel_dump_traceback_later()


def join(arguments: Sequence[str] | None = None, context: rclpy.Context | None = None) -> None:
    """Join the ROS domain; signals remain with this process.

    Raises
    ------
    RunError
        ROS 2 cannot read the arguments or a parameter file, or cannot write its log.

    """
    with _rcl_errors('cannot join the ROS domain'):
        given = None if arguments is None else list(arguments)
        rclpy.init(args=given, context=context, signal_handler_options=SignalHandlerOptions.NO)


def require_ros_arguments() -> None:
    """Raise RunError if the command line of a node has other words than ROS arguments, or some that are not valid."""
    with _rcl_errors('the ROS arguments cannot be read'):
        if others := remove_ros_args(sys.argv)[1:]:
            raise RunError(
                f'{shown(others[0])} is not a ROS argument (--ros-args ...), and a node takes no others; '
                '--help lists its parameters'
            )


@contextmanager
def _rcl_errors(failed: str) -> Iterator[None]:
    try:
        yield
    except UnknownROSArgsError as error:
        raise RunError(f'{failed}: ROS 2 does not know {error}') from None
    except RCLError as error:  # the reason, then files and lines of its own sources
        reason = re.sub(r', at [^ ]*:\d+', '', ' '.join(str(error).split()))
        reason = re.sub('^(Failed to parse ROS arguments|failed to initialize rcl): ', '', reason)
        raise RunError(f'{failed}: {reason}') from None


def run(
    factories: Sequence[Callable[[], Node]],
    arguments: list[str] | None = None,
    prepare: Callable[[], None] = lambda: None,
    leave_s: float | None = None,
) -> int:
    """Be the main function of a process: prepare, build the nodes, spin, clean up; return the exit status."""
    global _separate, _current  # noqa: PLW0603 (facts about the process)
    _separate = len(factories) == 1
    _current = None
    asked_to_end = interrupts.Flag()

    def end(*_: Any) -> None:
        asked_to_end.set()
        if _current is not None:
            _current.stop()

    try:
        domain.check()
        prepare()
        preload.know_modules()
        for stopping in interrupts.NUMBERS:
            # a bring-up in the background, or under nohup, ignores signals but sends them to its children
            if stopping != signal.SIGHUP or signal.getsignal(stopping) is not signal.SIG_IGN:
                signal.signal(stopping, end)
        begins = not asked_to_end
        while begins:
            join(arguments)
            _current = process = Process()
            for factory in factories:
                process.add(factory())
            # long-lived objects need not be walked again by the collector in the middle of a cycle
            gc.collect()
            gc.freeze()
            memory.collect_often()
            if not asked_to_end:
                process.spin()
            # also if it was asked to end meanwhile: the next nodes complete the bags of these
            begins = process.rejoins
            if begins:
                leave(process, patience_s=leave_s or NODES_LEAVE_S)
                _current = None
    except Delta3Error as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        leave(_current, patience_s=leave_s or NODES_LEAVE_S)
    return 0


def run_single(factory: Callable[[], Node]) -> int:
    """Be the main function of a node that was started by itself; return the exit status.

    The kernels are compiled, or loaded from the cache, before the node shows itself: in cyclic operation the bus would
    take the silence of a drive that compiles for its end.
    """
    # an operator's process has no use for the robot's core
    from delta3_pacdrive import parameters, simulation
    from delta3_pacdrive.numerics.kernel import Lines
    from delta3_pacdrive.ros import discovery

    # an exception would be lost where the compiler calls back; whatever the node is to leave behind comes later
    interrupts.install()

    def prepare() -> None:
        require_ros_arguments()
        discovery.keep_to_this_machine()
        if exposure := discovery.exposure():
            print(f'note: {exposure}', file=sys.stderr)
        # nodes started together compile once, not each for itself
        simulation.compile_kernels(show=Lines().show)
        simulation.precompile(parameters.load())

    status = run([factory], prepare=prepare)
    interrupts.ignore()
    return status

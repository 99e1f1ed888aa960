"""Start, spinning and shutdown of a process of nodes."""

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
from delta3_pacdrive.robot.sercos.watchdog import Watchdog
from delta3_pacdrive.ros.wire import domain, preload

REJOIN_S, REJOIN_MAX_S = (
    20.0,
    300.0,
)  # silence of a partner before a rejoin; doubled after each unsuccessful one
_separate = False
_current: 'Process | None' = None  # the process that ``run`` spins
_rejoins = _rejoins_in_vain = 0


def is_separate() -> bool:
    """Whether this process runs a single node."""
    return _separate


def rejoins() -> int:
    """Return how many times this process has left and rejoined the domain."""
    return _rejoins


def is_rejoining() -> bool:
    """Whether nodes that are destroyed now are created again, because the process rejoins the domain."""
    return _current is not None and _current.rejoins


class PartnerWatch:
    """Detects that a node receives nothing from a required partner, and makes its process rejoin the domain.

    Running processes may stop receiving from each other, for example after a long lack of processor time. A new
    participant with an unknown identity is received again. Time in which the process itself does not run does not
    count. A process of several nodes never rejoins.

    Parameters
    ----------
    log
        Called with a message when the process rejoins.
    period_s
        Time between two updates [s].
    process
        The process that rejoins; by default the one that ``run`` spins, if it has a single node.

    """

    def __init__(
        self, log: Callable[[str], object], period_s: float, process: 'Process | None' = None
    ) -> None:
        self._log, self._period_s, self._process = log, period_s, process
        self._silent: dict[str, Watchdog] = {}  # by partner

    def received(self, partner: str) -> None:
        """Record that a message of a partner was received."""
        global _rejoins_in_vain  # noqa: PLW0603 (the node that counts on is another one)
        _rejoins_in_vain = 0
        self._silent.pop(partner, None)

    def update(self, needed: Sequence[str], now_s: float) -> None:
        """Rejoin the domain if a currently required partner has not been received for too long."""
        self._silent = {name: silent for name, silent in self._silent.items() if name in needed}
        process = self._process or (_current if _separate else None)
        patience_s = min(REJOIN_S * 2**_rejoins_in_vain, REJOIN_MAX_S)
        for partner in needed:
            if partner not in self._silent:
                self._silent[partner] = Watchdog(self._period_s)
                self._silent[partner].received(now_s)
            elif self._silent[partner].silence_s(now_s) > patience_s and process and not process.rejoins:
                self._log(f'no message from {partner} for {patience_s:g} s: rejoining the domain')
                process.rejoin()


SPIN_S = 0.1  # longest delay of a signal in the main thread
LEAVE_S = 20.0  # timeout for the nodes of a client to leave the graph
NODES_LEAVE_S = 20.0  # for the nodes of a robot
BAG_LEAVE_S = 60.0  # for a recorder, which completes its bag


class _Stop(Future):
    """The future that ends a spin; a signal handler may complete it while the interrupted thread holds its lock."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.RLock()  # type: ignore[assignment] # the inherited lock is not reentrant


class Process:
    """Spins nodes on one executor until SIGINT, SIGTERM or ``stop``."""

    def __init__(self, context: rclpy.Context | None = None) -> None:
        self._stop = _Stop()
        self._is_stopping = False
        self.rejoins = False
        self._executor = EventsExecutor(context=context)
        self._nodes: list[Node] = []

    def stop(self, *_: Any) -> None:
        """Make ``spin`` return; also used as signal handler."""
        if not self._is_stopping:  # a second signal may interrupt this one
            self._is_stopping = True
            self._stop.set_result(None)

    def rejoin(self) -> None:
        """Make ``spin`` return so that another process object with the same nodes can start."""
        global _rejoins, _rejoins_in_vain
        _rejoins, _rejoins_in_vain = _rejoins + 1, _rejoins_in_vain + 1
        self.rejoins = True
        self.stop()

    def add(self, node: Node) -> None:
        """Add a node to the executor."""
        self._nodes.append(node)
        self._executor.add_node(node)

    def spin(self) -> None:
        """Run callbacks until ``stop``."""
        # one call runs many callbacks; spin_once would return after each, which doubles the cost
        while not self._stop.done():
            self._executor.spin_until_future_complete(self._stop, timeout_sec=SPIN_S)

    def spin_for(self, seconds: float) -> None:
        """Run callbacks for a time [s]."""
        self._executor.spin_until_future_complete(self._stop, timeout_sec=seconds)

    def close(self) -> None:
        """Destroy the nodes; messages that they publish on destruction still reach the graph."""
        for node in self._nodes:
            self._executor.remove_node(node)
            node.destroy_node()
        self._executor.shutdown()


def leave(process: Process | None, context: rclpy.Context | None = None, patience_s: float = LEAVE_S) -> None:
    """Leave the graph in a bounded time.

    Fast DDS has been observed to spin here forever without releasing the interpreter. After ``patience_s`` the process
    therefore dumps its stack and exits with status 1. ``context`` is that of the nodes, if it is not the default.
    """
    faulthandler.dump_traceback_later(patience_s, exit=True)
    if process is not None:
        process.close()
    rclpy.try_shutdown(context=context)
    faulthandler.cancel_dump_traceback_later()


def join(arguments: Sequence[str] | None = None, context: rclpy.Context | None = None) -> None:
    """Join the ROS domain; signal handling remains with this process.

    Raises
    ------
    RunError
        The ROS arguments or a parameter file are invalid, or the log cannot be written.

    """
    with _rcl_errors('cannot join the ROS domain'):
        given = None if arguments is None else list(arguments)
        rclpy.init(args=given, context=context, signal_handler_options=SignalHandlerOptions.NO)


def require_ros_arguments() -> None:
    """Raise RunError if the command line of a node contains invalid or non-ROS arguments."""
    with _rcl_errors('the ROS arguments cannot be read'):
        if others := remove_ros_args(sys.argv)[1:]:
            raise RunError(
                f'{shown(others[0])} is not a ROS argument (--ros-args ...), and a node accepts no others; '
                '--help lists its parameters'
            )


@contextmanager
def _rcl_errors(failed: str) -> Iterator[None]:
    try:
        yield
    except UnknownROSArgsError as error:
        raise RunError(f'{failed}: ROS 2 does not know {error}') from None
    except RCLError as error:  # reason, followed by source locations of rcl
        reason = re.sub(r', at [^ ]*:\d+', '', ' '.join(str(error).split()))
        reason = re.sub('^(Failed to parse ROS arguments|failed to initialize rcl): ', '', reason)
        raise RunError(f'{failed}: {reason}') from None


def run(
    factories: Sequence[Callable[[], Node]],
    arguments: list[str] | None = None,
    prepare: Callable[[], None] = lambda: None,
    leave_s: float | None = None,
) -> int:
    """Run the main function of a process: prepare, build the nodes, spin, clean up; return the exit status."""
    global _separate, _current  # noqa: PLW0603 (state of the process)
    _separate = len(factories) == 1
    _current = None
    stop_requested = interrupts.Flag()

    def end(*_: Any) -> None:
        stop_requested.set()
        if _current is not None:
            _current.stop()

    try:
        domain.check()
        prepare()
        preload.know_modules()
        for stopping in interrupts.NUMBERS:
            # a background bring-up, or one under nohup, ignores SIGHUP but sends it to its children
            if stopping != signal.SIGHUP or signal.getsignal(stopping) is not signal.SIG_IGN:
                signal.signal(stopping, end)
        begins = not stop_requested
        while begins:
            join(arguments)
            _current = process = Process()
            for factory in factories:
                process.add(factory())
            # so that the collector does not walk long-lived objects in the middle of a cycle
            gc.collect()
            gc.freeze()
            memory.collect_often()
            if not stop_requested:
                process.spin()
            # also when stopping: the next nodes complete the bags
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
    """Run the main function of a separately started node; return the exit status.

    Kernels are compiled or loaded before the node joins the graph: in cyclic operation a drive that compiles would
    miss telegrams and stop the bus.
    """
    # imported here because an operator's process does not need the core
    from delta3_pacdrive import parameters, simulation
    from delta3_pacdrive.numerics.kernel import Lines
    from delta3_pacdrive.ros.wire import discovery

    # installed before compiling: an exception in a compiler callback would be lost
    interrupts.install()

    def prepare() -> None:
        require_ros_arguments()
        discovery.keep_to_this_machine()
        if exposure := discovery.exposure():
            print(f'note: {exposure}', file=sys.stderr)
        # nodes started together compile once
        simulation.compile_kernels(show=Lines().show)
        simulation.precompile(parameters.load())

    status = run([factory], prepare=prepare)
    interrupts.ignore()
    return status

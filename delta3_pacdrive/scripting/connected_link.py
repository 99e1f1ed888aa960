"""``scripting.connect``: run a script on a running robot."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import simulation
from delta3_pacdrive.belts.image import read_belts
from delta3_pacdrive.belts.knowledge import RemoteBelts, TrackOrder
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError, ScriptError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.extension import Extension
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.scripting.belt_robot import BeltRobot
from delta3_pacdrive.scripting.link import HeldError, Snapshot, StoppedError
from delta3_pacdrive.scripting.robot import Robot
from delta3_pacdrive.scripting.source_position import of_caller

if TYPE_CHECKING:
    from delta3_pacdrive.ros.clients.script_client import ScriptNode

MARGIN = 1.5  # expected time of the next order relative to the last one
LEAD_CYCLES = 30  # additional lead of an order, with a clock


class ConnectedLink:
    """Link to a running robot; ``node`` is a client that has control of it."""

    def __init__(self, node: 'ScriptNode', parameters: Parameters) -> None:
        self._node, self.parameters = node, parameters
        facts = node.attach()
        belts = read_belts(facts['axes'])
        self.tracking = RemoteBelts(parameters, belts) if belts else None
        self.inputs, self.outputs = tuple(facts['inputs']), node.outputs()
        self._has_clock = bool(facts['clock'])
        self._take(facts)
        self._extra_cycles = LEAD_CYCLES if self._has_clock else 0

    @property
    def extra_cycles(self) -> int:
        """Expected additional bus cycles until an order can take effect, mainly due to planning."""
        return self._extra_cycles

    def poll(self) -> Snapshot:
        """Return the state in the latest evaluated bus cycle."""
        if self._has_clock and time.monotonic() - self._seen_s > self.parameters.bus.cycle_time_s:
            self._take(self._node.look())
        return self._seen

    def _take(self, facts: dict[str, Any]) -> dict[str, Any]:
        self._seen, self._seen_s = snapshot_of(facts), time.monotonic()
        self._held = facts['held']
        if self.tracking is not None:
            self.tracking.take(facts['belts'])
        return facts

    def start(self, planned: Planned, cycle: int, override: float) -> int:
        """Start a program in a bus cycle."""
        try:
            return self._timed(
                lambda: self._node.start(planned.plan, cycle, override, exact=not self._has_clock)
            )
        except RefusedError as error:
            if error.reason.code is not Code.BELT:
                raise
            raise StoppedError(error.reason) from None

    def extend(self, extension: Extension) -> int:
        """Append moves to the running program."""
        return self._timed(lambda: self._node.extend(extension))

    def change(self, profile: MotionProfile) -> int:
        """Change the motion profile."""
        return self._timed(lambda: self._node.change(profile))

    def _timed(self, order: Callable[[], int]) -> int:
        """Send an order and measure the time since the decision."""
        try:
            return order()
        finally:
            if self._has_clock:
                spent = (time.monotonic() - self._seen_s) / self.parameters.bus.cycle_time_s
                self._extra_cycles = LEAD_CYCLES + round(MARGIN * spent)

    def hold(self, cycle: int) -> MotionProfile:
        """Run the bus to a cycle and stop the robot on its path from that cycle."""
        facts = self._after_bus_run(lambda: self._node.hold(cycle))
        return MotionProfile.from_array(facts['held'])

    def get_on(self, order: TrackOrder) -> None:
        """Set the belt for the next event of the plan that enters a belt."""
        self._node.get_on(order)

    def get_on_again(self, cycle: int) -> None:
        """Synchronize with the belt again after ``hold``, or leave it, from a bus cycle."""
        self._node.get_on_again(cycle)

    def abandon(self, cycle: int) -> None:
        """Run the bus to a cycle, stop from that cycle, and clear moves and belt once the robot is at rest."""
        self._after_bus_run(lambda: self._node.abandon(cycle))

    def _after_bus_run(self, ask: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Send a request that runs the bus, and update the state even if the request is rejected."""
        try:
            return self._take(ask())
        except RefusedError:
            self._take(self._node.look())
            raise

    def wait(self, condition: WaitCondition) -> bool:
        """Run the bus until a condition is met or its latest cycle has passed."""
        try:
            return bool(self._after_bus_run(lambda: self._node.wait(condition))['met'])
        except RefusedError as error:
            code, held = error.reason.code, self._held
            if code is Code.BELT and self.tracking is not None and self.tracking.lost is None:
                raise StoppedError(error.reason) from None
            if code is not Code.STATE or held is None:
                raise
            raise HeldError(error.reason, MotionProfile.from_array(held)) from None


def snapshot_of(facts: dict[str, Any]) -> Snapshot:
    """Return the robot state in a reply."""
    seen = facts['seen']
    x, y, z = seen['command_m']
    a, b, c = seen['position_m']
    u, v, w = seen.get('planned_m', (x, y, z))
    return Snapshot(
        seen['cycle'],
        MotionState(seen['motion']),
        (x, y, z),
        (a, b, c),
        seen['outputs'],
        seen['payload_kg'],
        seen['inputs'],
        (u, v, w),
        tuple(seen.get('turn_rad', ())),
    )


@contextmanager
def connect(namespace: str = '/', *, name: str = '', take_over: bool = False) -> Iterator[BeltRobot]:
    """Connect a script to a running robot (``delta3 up``, with its cell: ``delta3 up --cell``).

    Parameters
    ----------
    namespace
        ROS namespace of the robot.
    name
        Name of the script, published with the control; default: its file name.
    take_over
        Take control even if another operator has it.

    Yields
    ------
    robot
        Robot interface. Leaving the block waits until all moves have finished; an error or Ctrl-C holds the robot on
        its path.

    Raises
    ------
    ScriptError
        A call is rejected, or a fault has stopped the robot; with file and line of the script.

    """
    from delta3_pacdrive.ros.clients.script_client import scripting

    own = name or Path(of_caller().file).stem or 'script'
    with scripting(namespace) as node, connected(node, own, take_over) as robot:
        yield robot


@contextmanager
def connected(node: 'ScriptNode', name: str, take_over: bool = False) -> Iterator[BeltRobot]:
    """Control a robot through an existing client, like ``connect``."""
    try:
        node.wait_until(lambda: node.progress.received, 'robot')
        parameters = node.parameters()
        simulation.load_kernels(parameters)  # loading them during planning would delay orders
        node.take_control(f'script {name}', take_over)
        robot = BeltRobot(ConnectedLink(node, parameters), name)
    except Delta3Error as error:
        node.end()
        raise ScriptError(Reason.of(error)) from None
    try:
        yield robot
        robot.finish()
    except BaseException as error:
        node.stopped = False  # permit the requests below
        try:
            robot.held_at = _hold(robot)
        finally:
            node.stopped = False
            node.leave_robot()
        if robot.held_at >= 0:
            error.add_note(
                f'The robot is held on its path and is at rest from bus cycle {robot.held_at}. Cancel its program '
                'with: delta3 move abort'
            )
        raise
    node.end()


def _hold(robot: Robot) -> int:
    """Stop the robot on its path; return the bus cycle from which it is at rest, -1 if no motion was active."""
    try:
        return robot.abort()
    except Delta3Error:
        return -1  # already stopped

"""``scripting.connect``: run a script on a running robot."""

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import simulation
from delta3_pacdrive.belts.image import read_belts
from delta3_pacdrive.belts.knowledge import RemoteBelts, TrackOrder
from delta3_pacdrive.control.cycle.set_points import SetPoint
from delta3_pacdrive.control.messages import EXACT, EXTEND, ORDER
from delta3_pacdrive.control.operation.script_operations import (
    ATTACH,
    CANCEL,
    GUIDE,
    HOLD,
    POLL,
    STEER,
    TRACK,
    TRACK_AGAIN,
    WAIT,
    Guide,
    ScriptOperation,
    Snapshot,
    Steer,
)
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError, ScriptError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.extension import Extension
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.scripting.belt_robot import BeltRobot
from delta3_pacdrive.scripting.link import HeldError, StoppedError
from delta3_pacdrive.scripting.robot import Robot
from delta3_pacdrive.scripting.source_position import of_caller

if TYPE_CHECKING:
    from delta3_pacdrive.ros.clients.script_client import ScriptNode

READY_S = 30.0  # timeout for a robot to become ready
LOOK_S = 0.02  # between two attempts to attach
MARGIN = 1.5  # expected time of the next order relative to the last one
LEAD_CYCLES = 30  # additional lead of an order, with a clock


class ConnectedLink:
    """Link to a running robot; the client ``node`` has control of it."""

    def __init__(self, node: 'ScriptNode', parameters: Parameters) -> None:
        self._node, self.parameters = node, parameters
        facts = self._attach()
        self.tracking = RemoteBelts(parameters, read_belts(facts['axes']))
        self.inputs, self.outputs = tuple(facts['inputs']), node.outputs()
        self._has_clock = bool(facts['clock'])
        self._take(facts)
        self._driven = 0  # number of the newest accepted order
        self._extra_cycles = LEAD_CYCLES if self._has_clock else 0

    @property
    def extra_cycles(self) -> int:
        """Expected additional bus cycles until an order can take effect, mainly due to planning."""
        return self._extra_cycles

    def _attach(self) -> dict[str, Any]:
        """Attach the script to the robot as soon as it can be moved; return its facts."""
        deadline = time.monotonic() + READY_S
        while True:
            try:
                return self._ask(ATTACH)
            except RefusedError as error:
                waits = error.reason.code in (Code.LATE, Code.BUS) and time.monotonic() < deadline
                if not waits:
                    raise
                self._node.spin_for(LOOK_S)

    def _ask(self, operation: ScriptOperation, argument: Any = None) -> dict[str, Any]:
        return dict(json.loads(self._node.request(operation, argument)))

    def _take(self, facts: dict[str, Any]) -> dict[str, Any]:
        self._seen, self._seen_s = Snapshot.from_document(facts['seen']), time.monotonic()
        self._held = facts['held']
        if self.tracking.belts:
            self.tracking.take(facts['belts'])
        return facts

    def _run_bus(self, operation: ScriptOperation, argument: Any) -> dict[str, Any]:
        """Send a request that runs the bus, and update the state even if the request is rejected."""
        try:
            return self._take(self._ask(operation, argument))
        except RefusedError:
            self._take(self._ask(POLL))
            raise

    def poll(self) -> Snapshot:
        """Return the state in the latest evaluated bus cycle."""
        if self._has_clock and time.monotonic() - self._seen_s > self.parameters.bus.cycle_time_s:
            self._take(self._ask(POLL))
        return self._seen

    def start(self, planned: Planned, cycle: int, override: float) -> int:
        """Start a program in a bus cycle, with a clock possibly later."""
        row = (float(cycle), override, *planned.plan.tables.order.tolist())
        try:
            return self._order(ORDER if self._has_clock else EXACT, planned.plan, row)
        except RefusedError as error:
            if error.reason.code is not Code.BELT:
                raise
            raise StoppedError(error.reason) from None

    def extend(self, extension: Extension) -> int:
        """Append moves to the running program."""
        return self._order(EXTEND, extension.more, extension.row(self._driven).tolist())

    def _order(self, kind: str, plan: Plan, row: Sequence[float]) -> int:
        with self._timed():
            effect = self._node.order(kind, plan, row)
        self._driven = self._node.number
        return effect

    def change(self, profile: MotionProfile) -> int:
        """Change the motion profile."""
        with self._timed():
            return self._node.change(profile)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        """Measure the time from the decision to the reply to its order."""
        try:
            yield
        finally:
            if self._has_clock:
                spent = (time.monotonic() - self._seen_s) / self.parameters.bus.cycle_time_s
                self._extra_cycles = LEAD_CYCLES + round(MARGIN * spent)

    def hold(self, cycle: int) -> MotionProfile:
        """Run the bus to a cycle and stop the robot on its path from that cycle."""
        return MotionProfile.from_array(self._run_bus(HOLD, cycle)['held'])

    def track(self, order: TrackOrder) -> None:
        """Set the belt for the next event of the plan that enters a belt."""
        self._node.request(TRACK, order)

    def track_again(self, cycle: int) -> None:
        """Synchronize with the belt again after ``hold``, or leave it, from a bus cycle."""
        self._node.request(TRACK_AGAIN, cycle)

    def steer(self, cycle: int, limits: Limits) -> None:
        """Let set points move the robot from a bus cycle on."""
        self._node.request(STEER, Steer(cycle, limits))

    def set_point(self, cycle: int, point: SetPoint) -> None:
        """Give a steered robot a set point that counts from a bus cycle on."""
        self._node.request(GUIDE, Guide(cycle, point))

    def cancel(self, cycle: int) -> None:
        """Run the bus to a cycle, stop from that cycle, and clear moves and belt once the robot is at rest."""
        self._run_bus(CANCEL, cycle)

    def wait(self, condition: WaitCondition) -> bool:
        """Run the bus until a condition is met or its latest cycle has passed."""
        try:
            return bool(self._run_bus(WAIT, condition)['met'])
        except RefusedError as error:
            code, held = error.reason.code, self._held
            if code is Code.BELT and self.tracking.belts and self.tracking.lost is None:
                raise StoppedError(error.reason) from None
            if code is not Code.STATE or held is None:
                raise
            raise HeldError(error.reason, MotionProfile.from_array(held)) from None


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
            node.stop_robot()
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

"""``cell.connect``: a script moves a robot that is up, with the same calls as one that is simulated."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import simulation
from delta3_pacdrive.cell.belt_robot import BeltRobot
from delta3_pacdrive.cell.link import HeldError, Seen, StoppedError
from delta3_pacdrive.cell.place import of_caller
from delta3_pacdrive.cell.robot import Robot
from delta3_pacdrive.controller.belt_axes import read_belts
from delta3_pacdrive.controller.belt_knowledge import RemoteBelts, TrackOrder
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError, ScriptError
from delta3_pacdrive.motion.execution import MotionProfile
from delta3_pacdrive.motion.extension import Extension
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.parameters import Parameters

if TYPE_CHECKING:
    from delta3_pacdrive.ros.script_client import ScriptNode

MARGIN = 1.5  # of the time that the last order took, for the next one
LEAD_CYCLES = 30  # of the first order behind that, with a clock


class ConnectedLink:
    """The link of a script to a robot that is up.

    Parameters
    ----------
    node
        Client of the robot, which has control of it.
    parameters
        Of the robot.

    """

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
        """How much later than a decision should take effect it can, as far as is known: planning takes its time."""
        return self._extra_cycles

    def look(self) -> Seen:
        """Return the newest bus cycle whose answers are evaluated."""
        if self._has_clock and time.monotonic() - self._seen_s > self.parameters.bus.cycle_time_s:
            self._take(self._node.look())
        return self._seen

    def _take(self, facts: dict[str, Any]) -> dict[str, Any]:
        self._seen, self._seen_s = seen_of(facts), time.monotonic()
        self._held = facts['held']
        if self.tracking is not None:
            self.tracking.take(facts['belts'])
        return facts

    def start(self, planned: Planned, cycle: int, override: float) -> int:
        """Start a program at a bus cycle."""
        try:
            return self._timed(
                lambda: self._node.start(planned.plan, cycle, override, exact=not self._has_clock)
            )
        except RefusedError as error:
            if error.reason.code is not Code.BELT:
                raise
            raise StoppedError(error.reason) from None

    def extend(self, extension: Extension) -> int:
        """Let moves follow those that are driven."""
        return self._timed(lambda: self._node.extend(extension))

    def change(self, profile: MotionProfile) -> int:
        """Go over to another motion profile."""
        return self._timed(lambda: self._node.change(profile))

    def _timed(self, order: Callable[[], int]) -> int:
        """Give an order, and learn how long that takes from the decision on."""
        try:
            return order()
        finally:
            if self._has_clock:
                spent = (time.monotonic() - self._seen_s) / self.parameters.bus.cycle_time_s
                self._extra_cycles = LEAD_CYCLES + round(MARGIN * spent)

    def hold(self, cycle: int) -> MotionProfile:
        """Let the bus go on to a cycle, and stop the robot on its path from there on."""
        facts = self._gone_on(lambda: self._node.hold(cycle))
        return MotionProfile.from_array(facts['held'])

    def get_on(self, order: TrackOrder) -> None:
        """Say which belt is meant by the next event of the plan that gets on one."""
        self._node.get_on(order)

    def get_on_again(self, cycle: int) -> None:
        """Get on the belt again after ``hold``, or leave it, from a bus cycle on."""
        self._node.get_on_again(cycle)

    def abandon(self, cycle: int) -> None:
        """Let the bus go on to a cycle, stop from there on, and forget moves and belt once the robot stands."""
        self._gone_on(lambda: self._node.abandon(cycle))

    def _gone_on(self, ask: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Ask for what lets the bus go on, and see it as it is then, also where it is refused in the end."""
        try:
            return self._take(ask())
        except RefusedError:
            self._take(self._node.look())
            raise

    def wait(self, condition: WaitCondition) -> bool:
        """Let the bus go on until a condition is met or its latest cycle is over."""
        try:
            return bool(self._gone_on(lambda: self._node.wait(condition))['met'])
        except RefusedError as error:
            code, held = error.reason.code, self._held
            if code is Code.BELT and self.tracking is not None and self.tracking.lost is None:
                raise StoppedError(error.reason) from None
            if code is not Code.STATE or held is None:
                raise
            raise HeldError(error.reason, MotionProfile.from_array(held)) from None


def seen_of(facts: dict[str, Any]) -> Seen:
    """Return what a reply says of a bus cycle."""
    seen = facts['seen']
    x, y, z = seen['command_m']
    a, b, c = seen['position_m']
    u, v, w = seen.get('planned_m', (x, y, z))
    return Seen(
        seen['cycle'],
        MotionState(seen['motion']),
        (x, y, z),
        (a, b, c),
        seen['outputs'],
        seen['payload_kg'],
        seen['inputs'],
        (u, v, w),
        seen.get('turn_rad'),
    )


@contextmanager
def connect(namespace: str = '/', *, name: str = '', take_over: bool = False) -> Iterator[BeltRobot]:
    """Move a robot that is up (``delta3 up``) by a script; the robot has its cell (``delta3 up --cell``).

    Parameters
    ----------
    namespace
        Of the robot.
    name
        Of the script, for whoever looks who has control; without it that of its file.
    take_over
        Take control of the robot even if somebody else has it.

    Yields
    ------
    robot
        What the script calls. At its end all that is ordered is driven; an error in the script, or Ctrl-C, leaves the
        robot in a stop on its path.

    Raises
    ------
    ScriptError
        A call is refused, or the robot has stopped by a fault; tells file and line of the script.

    """
    from delta3_pacdrive.ros.script_client import scripting

    own = name or Path(of_caller().file).stem or 'script'
    with scripting(namespace) as node, connected(node, own, take_over) as robot:
        yield robot


@contextmanager
def connected(node: 'ScriptNode', name: str, take_over: bool = False) -> Iterator[BeltRobot]:
    """Have control of a robot through a client of it, as ``connect`` does."""
    try:
        node.wait_until(lambda: node.progress, 'robot')
        parameters = node.parameters()
        simulation.load_kernels(parameters)  # what planning needs; on a bus with a clock it would be late
        node.take_control(f'script {name}', take_over)
        robot = BeltRobot(ConnectedLink(node, parameters), name)
    except Delta3Error as error:
        node.end()
        raise ScriptError(Reason.of(error)) from None
    try:
        yield robot
        robot.finish()
    except BaseException as error:
        node.stopped = False  # what is asked from here on is the end
        try:
            robot.held_at = _hold(robot)
        finally:
            node.stopped = False
            node.leave_robot()
        if robot.held_at >= 0:
            error.add_note(
                f'The robot is held on its path, where it stands from bus cycle {robot.held_at} on. What gives its '
                'program up: delta3 move abort'
            )
        raise
    node.end()


def _hold(robot: Robot) -> int:
    """Stop the robot on its path; return the bus cycle from which on it stands, -1: nothing was under way."""
    try:
        return robot.give_up()
    except Delta3Error:
        return -1  # it has stopped by itself

"""A simulation that is advanced step by step; moves may be ordered between the steps."""

from collections.abc import Callable, Sequence

from delta3_pacdrive.cell.world import World
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.operation.wait_condition import Commanded, WaitCondition
from delta3_pacdrive.errors import RefusedError, RunError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.simulation.cycle import SimulatedOperation
from delta3_pacdrive.simulation.robot import Robot

Inputs = Callable[[int], int]


class SteppedOperation(SimulatedOperation):
    """Cyclic operation of a robot and its controller, step by step; programs end as on the bus.

    Parameters
    ----------
    robot, task
        The simulated robot, and the task.
    parameters
        Parameters of the robot. From ``motion.start_cycle`` on every drive must be in torque.
    inputs
        Returns the inputs of a bus cycle as bits: bit n is input n.
    ended
        Called at the end of a program, before the task clears it.
    signals
        Optional signals: see ``OptionalSignals``.
    world
        The cell around the robot.

    """

    def __init__(
        self,
        robot: Robot,
        task: Transformation,
        parameters: Parameters,
        inputs: Inputs,
        ended: Callable[[], None],
        signals: Sequence[str] = (),
        world: World | None = None,
    ) -> None:
        super().__init__(robot, task, (), parameters, signals, world=world)
        self._inputs, self._ended = inputs, ended
        self._loss_reported = False  # loss of a belt

    def commanded(self) -> Commanded:
        """Return the state after the last command."""
        return Commanded.of(self._task)

    def wait(self, condition: WaitCondition) -> bool:
        """Advance until the feedback of a cycle meets a condition, or to its latest cycle; return whether it does.

        Raises
        ------
        RunError
            A fault has stopped the robot, which is at rest.
        RefusedError
            The robot has lost its belt and is at rest; raised once per loss.

        """
        while not self._met(condition):
            if self.cycle > condition.latest:
                return False
            self._step(condition)
            self._raise_loss()
        return True

    def go_to(self, cycle: int) -> None:
        """Advance until ``cycle`` is the next bus cycle; raises RunError as ``wait`` does."""
        self.wait(WaitCondition(cycle - 1, cycle - 1))

    def _raise_loss(self) -> None:
        task, tracking = self._task, self._task.tracking
        if tracking.lost is None:
            self._loss_reported = False
        elif not self._loss_reported and 0 < tracking.rest_cycle < self.cycle:
            if task.loaded and not (task.held and task.end_cycle < self.cycle):
                return
            self._loss_reported = True
            raise RefusedError(tracking.lost)

    def _met(self, condition: WaitCondition) -> bool:
        answered = self.cycle - 1
        if answered < condition.first:
            return False
        return condition.met(
            answered, self.commanded(), self._task.loaded, self._task.within, self._inputs(answered)
        )

    def _step(self, condition: WaitCondition) -> None:
        """Run one bus cycle, or as many as can neither meet the condition nor end the program."""
        cycle, task = self.cycle, self._task
        end = min(condition.earliest(self.commanded(), task.loaded), condition.latest) + 1
        if task.loaded and not task.held:
            end = min(end, max(task.pending_last_cycle, cycle + 1))
        self.cycle = self._advance(cycle, max(end, cycle + 1))
        if self.stopped:
            self.run()
            raise RunError(self.stopped)
        answered = self.cycle - 1
        if (
            task.loaded
            and not task.held
            and answered >= task.pending_last_cycle
            and task.in_position(answered)
        ):
            self._ended()
            task.clear_program()

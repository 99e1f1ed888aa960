"""Link of a script to a simulated robot, which is advanced step by step, without ROS and without a clock."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from delta3_pacdrive.belts.knowledge import TrackOrder
from delta3_pacdrive.belts.tracking import BeltTracking
from delta3_pacdrive.cell.cell import Cell
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.control.cycle.rotary_axis import combined_turns
from delta3_pacdrive.control.cycle.set_points import SetPoint
from delta3_pacdrive.control.cycle.transformation import Figures, Transformation
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.script_gate import first_decision
from delta3_pacdrive.control.operation.script_operations import Snapshot
from delta3_pacdrive.control.operation.wait_condition import Commanded, WaitCondition
from delta3_pacdrive.errors import Code, Reason, RefusedError, RunError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.extension import Extension
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program.output_names import OWN
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.recording.acquisition import Acquisition
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.plant.decoupled import require_stable
from delta3_pacdrive.scripting.inputs import Given, inputs_of
from delta3_pacdrive.scripting.moves import MotionLog
from delta3_pacdrive.simulation.belts import axes_of
from delta3_pacdrive.simulation.cycle import SimulatedOperation
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.simulation.run import note_currents, trace_of
from delta3_pacdrive.simulation.scoped import ScopedRobot

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


class SimulatedLink:
    """Link to a simulated robot, which starts at home.

    Parameters
    ----------
    parameters
        Parameters of the robot. The first orders take effect at ``motion.start_cycle``.
    inputs
        Changes of inputs by name, or a function of the bus cycle.
    longest_s
        Maximum bus time of the simulation [s].
    acquisition
        Receives the records of oscilloscopes in the drives.
    signals
        Additional signals, as in ``simulation.run``.
    around
        Cell with its own inputs; its times count from the start of the script.

    Raises
    ------
    RunError
        Drives cannot be enabled before ``motion.start_cycle``.
    ProgramError
        The inputs are invalid.

    """

    def __init__(
        self,
        parameters: Parameters,
        inputs: Given = None,
        longest_s: float = math.inf,
        acquisition: Acquisition | None = None,
        signals: Sequence[str] = (),
        around: Cell | None = None,
    ) -> None:
        motion, bus = parameters.motion, parameters.bus
        begin = first_decision(parameters)
        self.parameters = parameters
        self._world = None if around is None else World(around, bus.cycle_time_s, begin)
        self._inputs = inputs_of(inputs, self._world, begin, bus.cycle_time_s)
        self._heaviest_kg = max([0.0, *(part.mass_kg for part in around.parts.values())] if around else [0.0])
        self.inputs = self._inputs.names
        self.outputs = OWN if around is None else around.output_names
        self._longest_s = longest_s
        self._last = math.inf if math.isinf(longest_s) else begin + round(longest_s / bus.cycle_time_s)
        self._robot = Robot(parameters) if acquisition is None else ScopedRobot(parameters, acquisition)
        self._task = Transformation(parameters)
        self._task.locate(self._robot.encoder_positions())
        self._task.enable(motion.enable_cycle)
        if around is not None and around.belts:
            self._task.follow_belts(axes_of(around))
        self._log = MotionLog(bus.cycle_time_s)
        self._figures: list[Figures] = []
        self._end_cycle = begin
        self._operation = SteppedOperation(
            self._robot,
            self._task,
            parameters=parameters,
            inputs=self._inputs.bits,
            ended=self._ended,
            signals=signals,
            world=self._world,
        )
        self._operation.go_to(begin + 1)

    def poll(self) -> Snapshot:
        """Return the state in the latest evaluated bus cycle."""
        cycle = self._operation.cycle - 1
        at_rest = MotionState.STEERED if self._task.servo.active else MotionState.IDLE
        motion = MotionState.MOVING if self._task.loaded else at_rest
        return Snapshot.of(self._task, cycle, self._operation.commanded(), motion, self._inputs.bits(cycle))

    @property
    def tracking(self) -> BeltTracking:
        """Belt tracking of the controller."""
        return self._task.tracking

    def track(self, order: TrackOrder) -> None:
        """Set the belt for the next event of the plan that enters a belt."""
        self.tracking.order(order)

    def track_again(self, cycle: int) -> None:
        """Synchronize with the belt again after ``hold``, or leave it, from a bus cycle."""
        self.tracking.again_cycle = cycle
        self.tracking.resume()  # the change of the motion profile follows

    def steer(self, cycle: int, limits: Limits) -> None:
        """Let set points move the robot from a bus cycle on."""
        self._task.servo.begin(cycle, limits, self._task.tracking)

    def set_point(self, cycle: int, point: SetPoint) -> None:
        """Give a steered robot a set point that counts from a bus cycle on."""
        self._task.servo.schedule(cycle, point)

    def cancel(self, cycle: int) -> None:
        """Run the bus to a cycle, stop from that cycle, and clear moves and belt once the robot is at rest."""
        task, tracking = self._task, self._task.tracking
        with suppress(RefusedError):  # a robot that loses its belt stops automatically
            self._run_bus(WaitCondition(cycle - 1, cycle - 1))
        if task.loaded:
            profile = task.profile if task.held else task.hold()
            if profile is not None:
                self._log.follow(task.timeline.copy(), profile.cycle, continues=True)
        tracking.halt(task.next_cycle)
        task.servo.end(task.next_cycle)
        tracking.clear_loss()
        rest_cycle = max(
            tracking.rest_cycle,
            task.servo.rest_cycle,
            task.end_cycle if task.loaded else 0,
            self._operation.cycle,
        )
        self._operation.go_to(rest_cycle + self.parameters.in_position_cycles)
        if task.loaded:
            self._ended()
        task.clear_belt()

    extra_cycles = 0  # there is no clock

    def start(self, planned: Planned, cycle: int, override: float) -> int:
        """Start a program in a bus cycle."""
        gripped = [planned.plan.move(n).payload_kg for n in range(len(planned.plan))]
        require_stable(self.parameters, max([*gripped, planned.payload_kg, self._heaviest_kg]))
        self._task.load(planned.plan)
        self._task.start(cycle, override)
        self._log.follow(self._task.timeline.copy(), cycle, continues=False)
        return cycle

    def extend(self, extension: Extension) -> int:
        """Append moves to the running program."""
        profile, more = extension.profile, extension.more
        require_stable(self.parameters, max(more.move(n).payload_kg for n in range(len(more))))
        before = self._task.timeline
        continues = before.at(profile.cycle).number == before.at(profile.cycle - 1).number
        self._task.extend(extension.first, extension.kept, more, profile)
        self._log.follow(
            extension.timeline,
            profile.cycle,
            (continues and profile.cycle < before.end_cycle) or profile.held,
        )
        return profile.cycle

    def change(self, profile: MotionProfile) -> int:
        """Change the motion profile."""
        self._task.change(profile)
        timeline = self._task.timeline.copy()
        timeline.change(profile)
        self._log.follow(timeline, profile.cycle, continues=True)
        return profile.cycle

    def hold(self, cycle: int) -> MotionProfile:
        """Run the bus to a cycle and stop the robot on its path from that cycle."""
        self._run_bus(WaitCondition(cycle - 1, cycle - 1))
        if not self._task.loaded:
            raise RefusedError(Reason(Code.STATE, 'hold: the moves had finished before it took effect'))
        profile = self._task.hold()
        self._log.follow(self._task.timeline.copy(), profile.cycle, continues=True)
        return profile

    def wait(self, condition: WaitCondition) -> bool:
        """Run the bus until a condition is met or its latest cycle has passed."""
        return self._run_bus(condition)

    def _run_bus(self, condition: WaitCondition) -> bool:
        if condition.latest < self._last:
            return self._operation.wait(condition)
        within = replace(condition, latest=int(self._last))
        if self._operation.wait(within):
            return True
        sentence = f'the script exceeds the maximum bus time of a simulation, {self._longest_s:g} s: does it terminate?'
        raise RefusedError(Reason(Code.TIMEOUT, sentence))

    def _ended(self) -> None:
        """Record the figures of a finished program."""
        note_currents(self._robot, self._task)
        self._figures.append(self._task.figures())
        self._end_cycle = self._task.end_cycle
        self._log.end(self._operation.cycle)

    def trace(self, name: str, notices: Sequence[str], stopped: str = '') -> Trace:
        """Return the trace of the run; ``stopped`` is the reason of an abort, or empty."""
        operation, start = self._operation, self._log.start_cycle
        if isinstance(self._robot, ScopedRobot):
            self._robot.finish()
        if self._task.loaded:
            self._ended()
        cycle_time_s = self.parameters.bus.cycle_time_s
        found = operation.signals()
        task_end = self._task.state['tcp'][0].tolist()
        moves, first = self._log.moves(), self.parameters.motion.start_cycle if start is None else start
        driven: dict[str, Any] = {
            'program': name,
            'notices': list(notices),
            'program_s': 0.0 if start is None else (self._end_cycle - start) * cycle_time_s,
            'repeat': 1,
            'moves': moves,
            'outputs': self._log.outputs(),
            'start_cycle': first,
            'end_cycle': self._end_cycle,
            'planned_end_m': task_end,
            'figures': combined(self._figures).to_dict() | self._robot.turn_figures(),
            'faults': [],
            'unlearned': '',
        }
        if stopped and not operation.stopped:
            driven['stopped'] = stopped
        return trace_of(found, driven, operation, self.parameters, self._world)


def combined(figures: Sequence[Figures]) -> Figures:
    """Return the combined figures of several programs; zeros without programs."""
    if not figures:
        zero = [0.0] * 3
        return Figures(
            measured_cycles=0,
            tcp_error_max_m=0.0,
            tcp_error_rms_m=0.0,
            following_error_max_rad=0.0,
            final_tcp_m=[math.nan] * 3,
            current_peak_a=[None] * 3,
            current_rms_a=[None] * 3,
            at_current_peak_a=zero,
            at_current_rms_a=zero,
        )
    if len(figures) == 1:
        return figures[0]
    cycles = [max(one.measured_cycles, 1) for one in figures]

    def rms(values: Sequence[float]) -> float:
        return math.sqrt(sum(n * v * v for n, v in zip(cycles, values, strict=True)) / sum(cycles))

    def of_axes(name: str, together: Any) -> list[Any]:
        columns = zip(*(getattr(one, name) for one in figures), strict=True)
        return [None if None in column else together(column) for column in columns]

    return Figures(
        measured_cycles=sum(one.measured_cycles for one in figures),
        tcp_error_max_m=max(one.tcp_error_max_m for one in figures),
        tcp_error_rms_m=rms([one.tcp_error_rms_m for one in figures]),
        following_error_max_rad=max(one.following_error_max_rad for one in figures),
        final_tcp_m=figures[-1].final_tcp_m,
        current_peak_a=of_axes('current_peak_a', max),
        current_rms_a=of_axes('current_rms_a', rms),
        at_current_peak_a=of_axes('at_current_peak_a', max),
        at_current_rms_a=of_axes('at_current_rms_a', rms),
        turns=tuple(map(combined_turns, zip(*(one.turns for one in figures), strict=True))),
    )

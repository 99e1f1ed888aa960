"""A running robot for the commissioning of its drives: exclusive motion, excitation and oscilloscope."""

from __future__ import annotations

import time
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.operation.service_texts import DriveValues
from delta3_pacdrive.errors import Delta3Error, ProgramError, RunError
from delta3_pacdrive.planning.program.adaptation import APPROACH_M_S, Adaptation
from delta3_pacdrive.recording.acquisition import Record, setting
from delta3_pacdrive.robot.drive.operation_data import START_EXCITATION, STOP_EXCITATION
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import format_idn
from delta3_pacdrive.ros.clients.remote_parameters import RemoteParameters
from delta3_pacdrive.ros.clients.scope_client import ScopeClient
from delta3_pacdrive.studies.drives.commissioning.robot import AxisRecord, ProgramRun, RestRecord

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.recording.acquisition import Acquisition
    from delta3_pacdrive.ros.clients.robot_client import OperatorNode
    from delta3_pacdrive.studies.drives.commissioning.strokes import Strokes

UP_S = 30.0  # timeout for a robot in cyclic operation, and for its parameters
SILENT_S = 10.0  # without a report of the moving robot
LOOK_S = 0.02
CONTROL_S = 0.5  # within which a report shows who has control
SAME_POSE_RAD = 1e-6  # of an arm
ATTEND_S = 0.2  # period of accesses to the service channel that keep the generator running
KEPT_S, AFTER_S = 10.0, 0.5  # recorded in addition to a motion; after it
PROGRAM_MAX_S = 60.0  # recorded of a test program
BRAKE_S, NOISE_S = 1.0, 0.5  # under the brakes: observed, and recorded at its end
OWN = ('current_added', 'current_asked', 'current_reference', 'current', 'speed_filtered', 'encoder_position')
TIME_IDN, ACTIVE_IDN = 'P-0-0092', 'P-0-0095'


class CommissioningRobot:
    """A robot on the graph; ``operator`` has control of its motion while ``exclusive`` is entered.

    Raises
    ------
    RunError
        The robot is not up.

    """

    def __init__(self, operator: OperatorNode) -> None:
        self._operator = operator
        self._command = ''
        self._pose_rad: Sequence[float] | None = None
        self.channel = DriveValues(operator)
        operator.wait_until(
            lambda: operator.progress.phase == 'CP4' and operator.progress.received, 'robot', UP_S
        )
        remote = RemoteParameters(operator)
        found: list[Parameters] = []

        def received() -> bool:
            remote.ask_until_received(time.monotonic())
            found.extend(filter(None, [remote.take()]))
            return bool(found)

        operator.wait_until(received, 'parameters of the robot', UP_S)
        self.parameters = found[0]

    @contextmanager
    def exclusive(self, command: str, take_over: bool = False) -> Iterator[None]:
        """Take control, so that requests of other operators are rejected, and release it at the end.

        Raises
        ------
        ProgramError
            Another operator has control, or the robot moves or is not enabled.

        """
        operator = self._operator
        self._command = command
        operator.take_control(command, take_over)
        try:
            operator.wait_until(lambda: operator.state, 'motion/state')
            self._require_rest()
            yield
        finally:
            operator.interruptible = False
            with suppress(RunError, ProgramError):  # control may be lost already
                operator.release_control()

    def _require_rest(self) -> None:
        seen = self._operator.progress
        self._operator.wait_until(lambda: self._operator.progress is not seen, 'motion/progress')
        progress = self._operator.progress
        if progress.fault:
            raise ProgramError(f'the drives cannot be excited: {progress.fault}')
        if self._operator.state != MotionState.IDLE:
            raise ProgramError(f'the drives cannot be excited: {motion_sentence(self._operator.state)}')
        if not progress.in_torque:
            raise ProgramError('the drives cannot be excited: they are not enabled (delta3 move enable)')

    def angles_rad(self) -> Sequence[float]:
        """Return the commanded arm angles at rest."""
        motors = [self.channel.read(axis, 'S-0-0047') for axis in DRIVES]
        angles: Sequence[float] = (np.array(motors) / self.parameters.dynamics.gear_ratio).tolist()
        kinematics.forward(np.array(angles), self.parameters.kinematics)
        return angles

    def _resume(self) -> Sequence[float]:
        """Return the arm angles after a computation, during which control may have been lost.

        Raises
        ------
        ProgramError
            Another operator has control, or has moved the robot.

        """
        self._operator.spin_for(CONTROL_S)
        if not self._operator.in_control:
            self._operator.take_control(self._command)
        self._require_rest()
        angles = self.angles_rad()
        self._pose_rad = self._pose_rad or angles
        if not np.allclose(angles, self._pose_rad, rtol=0.0, atol=SAME_POSE_RAD):
            raise ProgramError('another operator has moved the robot during the commissioning')
        return angles

    def record(self, strokes: Strokes, excited: bool) -> AxisRecord:
        """Execute strokes and return the record of the oscilloscopes."""
        parameters, axis = self.parameters, DRIVES[strokes.axis]
        names = [f'{axis}.{name}' for name in OWN]
        names += [f'{other}.encoder_position' for other in DRIVES if other != axis]
        text = strokes.program(self._resume(), parameters.dynamics.gear_ratio)

        def move(client: ScopeClient, acquisition: Acquisition) -> None:
            before = self.channel.read(axis, TIME_IDN)
            self.channel.write(axis, TIME_IDN, 2.0 * strokes.duration_s)
            try:
                self._move(
                    partial(self._operator.start_program, text), axis if excited else '', client, acquisition
                )
            finally:
                self._end(axis, before)

        rate_hz = 1.0 / parameters.drive.current_period_s
        record = self._recorded(names, rate_hz, strokes.duration_s + KEPT_S, move)
        columns = dict(zip(record.names, record.values.T, strict=True))
        return AxisRecord(strokes.axis, record.first, record.setting.sample_time_s, columns)

    def _recorded(
        self,
        names: Sequence[str],
        rate_hz: float,
        kept_s: float,
        act: Callable[[ScopeClient, Acquisition], None],
    ) -> Record:
        """Act while the oscilloscopes record; return the newest ``kept_s`` of the channels."""
        records: list[Record] = []
        chosen = setting(self.parameters, names, rate_hz, kept_s, mode='rolling')
        client = ScopeClient(self._operator, chosen, records.append)
        try:
            acquisition = client.arm(UP_S)
            act(client, acquisition)
            self._spin_for(AFTER_S, client, acquisition)
        finally:
            client.disarm()
            client.detach()
            self._operator.interruptible = True
        acquisition.finish()
        if acquisition.lost:
            raise RunError(f'{acquisition.lost} samples were lost during the record: repeat the command')
        (record,) = records
        return record

    # acceptance -------------------------------------------------------------------------------------------------------

    def run_program(self, program: str) -> ProgramRun:
        """Move to the start of a program, execute it, and return its figures."""
        self._resume()
        start = partial(self._operator.start_program, program, Adaptation(approach_m_s=APPROACH_M_S))

        def move(client: ScopeClient, acquisition: Acquisition) -> None:
            self._move(start, '', client, acquisition)

        names = [f'{axis}.following_error' for axis in DRIVES]
        rate_hz = 1.0 / self.parameters.bus.cycle_time_s
        record = self._recorded(names, rate_hz, PROGRAM_MAX_S, move)
        self._pose_rad = None  # the program ends at another pose
        self._operator.wait_until(
            lambda: self._operator.progress.statistics.get('figures'), 'figures of the program'
        )
        figures = self._operator.progress.statistics['figures']
        return ProgramRun(figures, record.time_s - record.time_s[0], record.values)

    def rest(self) -> RestRecord:
        """Disable the drives, record their encoders under the brakes, and enable them again."""
        operator = self._operator
        self._resume()
        before = [self.channel.read(axis, 'S-0-0051') for axis in DRIVES]
        operator.enable(False)
        operator.wait_until(lambda: not operator.progress.in_torque, 'drives without torque')

        def rest(client: ScopeClient, acquisition: Acquisition) -> None:
            self._spin_for(BRAKE_S, client, acquisition)

        try:
            names = [f'{axis}.S-0-0051' for axis in DRIVES]
            record = self._recorded(names, 1.0 / self.parameters.bus.cycle_time_s, NOISE_S, rest)
            after = [self.channel.read(axis, 'S-0-0051') for axis in DRIVES]
        finally:
            operator.enable(True)
        operator.wait_until(lambda: operator.progress.in_torque, 'enabled drives', UP_S)
        return RestRecord(record.values, [now - then for then, now in zip(before, after, strict=True)])

    def bus(self) -> dict[str, float]:
        """Return statistics of the bus."""
        statistics = self._operator.progress.statistics
        lateness = statistics.get('lateness_ms', {}).get('max', 0.0)
        return {
            'lost_telegrams': float(self._operator.progress.lost_telegrams),
            'lateness_s': 1e-3 * float(lateness or 0.0),
        }

    def _end(self, axis: str, time_s: float) -> None:
        """Stop the generator and restore its duration, also after an interrupt."""
        before, self._operator.interruptible = self._operator.interruptible, False
        try:
            with suppress(Delta3Error):  # the drive ends by itself
                self._operator.drive(f'{axis} command {format_idn(STOP_EXCITATION)}')
                self.channel.write(axis, TIME_IDN, time_s)
        finally:
            self._operator.interruptible = before

    def _move(
        self, start: Callable[[], str], excited: str, client: ScopeClient, acquisition: Acquisition
    ) -> None:
        """Execute a motion to its end, with an excited axis; an interrupt stops it on its path."""
        operator = self._operator
        changes = operator.state_changes
        try:
            start()
            operator.wait_until(lambda: operator.state_changes > changes, 'start of the motion')
            if excited:
                operator.drive(f'{excited} command {format_idn(START_EXCITATION)}')
            while operator.state == MotionState.MOVING:
                if excited:
                    self.channel.read(excited, ACTIVE_IDN)
                self._spin_for(ATTEND_S, client, acquisition)
                if time.monotonic() - operator.progress_s > SILENT_S:
                    raise RunError(f'the moving robot has not responded for {SILENT_S:g} s')
                if not operator.in_control:
                    raise RunError(
                        f'{operator.progress.operator or "no operator"} has control of the robot now'
                    )
        except (Delta3Error, KeyboardInterrupt):
            operator.interruptible = False
            with suppress(ProgramError, RunError):  # the motion may have ended
                operator.call('abort')
            operator.interruptible = True
            raise
        if operator.state == MotionState.ERROR:
            operator.wait_until(lambda: operator.progress.fault, 'fault message')
            raise RunError(operator.progress.fault)
        if operator.state != MotionState.IDLE:
            raise RunError(f'the motion did not reach its end: {motion_sentence(operator.state)}')

    def _spin_for(self, seconds: float, client: ScopeClient, acquisition: Acquisition) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self._operator.spin_for(LOOK_S)
            client.receive_samples(acquisition)

"""The fault catalogue: every fault in every state, and the expected reaction."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from delta3_pacdrive.errors import FaultCode, RobotFault, RunError
from delta3_pacdrive.robot.drive.diagnostics import FAULT_OF_NUMBER, FAULTS
from delta3_pacdrive.robot.faults.fault import KINDS, NODES, PROCESS_FAULTS, TASK, UNIT_ROBOT
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, PLANT, ROTARY_DRIVES, lack_of


class State(StrEnum):
    """State of the robot when the fault occurs."""

    DISABLED = 'disabled'  # brakes applied
    ENABLING = 'enabling'  # with torque, brakes about to open
    STANDING = 'standing'  # enabled
    MOVING = 'moving'
    STOPPING = 'stopping'  # on its path, by a hold
    HELD = 'held'  # stopped on its path
    STOPPED_BY_FAULT = 'stopped by fault'  # by an emergency stop
    STARTING = 'starting'  # in CP0, while the plant is restarted


@dataclass(frozen=True)
class Case:
    """A fault in a state."""

    fault: dict[str, Any]  # as a request, without its time
    state: State
    expected: str = ''  # number, code or source of the resulting fault of the robot; empty: none

    @property
    def kind(self) -> str:
        """Kind of the fault."""
        return str(self.fault['fault'])

    @property
    def target(self) -> str:
        """Axis or node, empty for the robot."""
        return str(self.fault.get('axis') or self.fault.get('node', ''))

    @property
    def text(self) -> str:
        """Description of the fault."""
        words = [self.kind, self.target]
        for key, value in self.fault.items():
            if key == 'cycles':
                words.append(f'x{value}')
            elif key == 'for_s':
                words.append(f'for {value:g} s')
            elif key not in ('fault', 'axis', 'node'):
                words.append(f'{value:g}')
        return ' '.join(word for word in words if word)

    @property
    def lasts(self) -> bool:
        """Whether the fault lasts until it is cleared."""
        kind = KINDS[self.kind]
        return not kind.telegram and not kind.once and 'for_s' not in self.fault

    @property
    def line(self) -> str:
        """Fault and state, to select a case."""
        return f'{self.text} {self.state}'


@dataclass
class Outcome:
    """The result of a case."""

    case: Case
    detected_s: float | None = (
        None  # bus time from fault to detection; None: not detected, or a process fault
    )
    silent_s: float | None = None  # wall time from the last telegram before a process fault to its detection
    reported: RobotFault | None = None
    exercised: bool = False  # detected only in the exercise: disable, enable, away and back
    evidence: str = ''
    deviation_m: float = 0.0  # maximum distance of the true TCP from its path
    recovered_s: float | None = None  # wall time of the operator until the robot is ready again; None: never
    reference_m: float | None = None  # path deviation in the reference move after the recovery
    problem: str = ''

    @property
    def as_expected(self) -> bool:
        """Whether the reaction was as expected, there is evidence, and the robot recovered."""
        right = self._right
        seen = bool(self.reported or self.evidence)
        return right and seen and self.recovered_s is not None and not self.problem

    @property
    def _right(self) -> bool:
        """Whether the reaction was as expected."""
        fault, expected = self.reported, self.case.expected
        if fault is None or not expected:
            return fault is None and not expected
        return expected in (str(fault.number), fault.code, *fault.sources)

    @property
    def reaction(self) -> str:
        """Message number and reaction, in a few words."""
        fault = self.reported
        if fault is None:
            return 'goes on'
        if fault.code is FaultCode.EMERGENCY_STOP:
            return 'emergency stop'
        number = FAULT_OF_NUMBER.get(fault.number) if fault.code is FaultCode.DRIVE else None
        reaction = FAULTS[number].reaction.name if number else 'stop'
        return f'{fault.number or ""} {reaction}'.strip()

    def to_row(self) -> dict[str, Any]:
        """Return the row of a table."""
        row = asdict(self)
        row['case'] = self.case.text
        return row | {
            'state': str(self.case.state),
            'reaction': self.reaction,
            'expected': self.case.expected,
            'ok': self.as_expected,
            'reported': str(self.reported or ''),
            **RobotFault.facts(self.reported),
        }


@dataclass(frozen=True)
class _Row:
    """A fault and its expected reaction in all states, with exceptions."""

    fault: dict[str, Any]
    expected: str = ''
    otherwise: dict[State, str] = field(default_factory=dict)


TWO = {'cycles': 2}
_LATE = FaultCode.NOT_IN_POSITION
# one axis each, in turn
_OF_AXES: list[tuple[dict[str, Any], str]] = [
    ({'fault': 'drop_mdt'}, ''),
    ({'fault': 'drop_mdt'} | TWO, '8112'),
    ({'fault': 'delay_mdt', 'by_cycles': 1}, ''),
    ({'fault': 'delay_mdt', 'by_cycles': 3} | TWO, '8112'),
    ({'fault': 'duplicate_mdt', 'cycles': 20}, ''),
    ({'fault': 'corrupt_mdt'}, ''),
    ({'fault': 'corrupt_mdt'} | TWO, '8112'),
    ({'fault': 'drop_at'}, ''),
    ({'fault': 'drop_at'} | TWO, '8506'),
    ({'fault': 'delay_at', 'by_cycles': 2}, ''),
    ({'fault': 'duplicate_at', 'cycles': 20}, ''),
    ({'fault': 'corrupt_at'}, ''),
    ({'fault': 'corrupt_at'} | TWO, '8506'),
    ({'fault': 'encoder_failure'}, '8171'),
    ({'fault': 'encoder_jump', 'jump_rad': 2.0}, '8171'),
    ({'fault': 'encoder_jump', 'jump_rad': 0.1}, ''),
    ({'fault': 'encoder_drift', 'drift_rad_s': 2.0}, '8911'),  # as if the shaft slipped through its brake
    ({'fault': 'encoder_noise', 'noise_rad': 0.0005}, ''),
    ({'fault': 'winding_short'}, '8905'),
    ({'fault': 'dc_link', 'voltage_v': 250.0}, '8909'),
    ({'fault': 'dc_link', 'voltage_v': 800.0}, '8910'),
    ({'fault': 'brake_worn', 'lost_share': 1.0, 'for_s': 0.1}, '8911'),
    ({'fault': 'brake_stuck'}, _LATE),  # exceeds the integrator within the time limit
    ({'fault': 'overload', 'torque_n_m': 2.0}, ''),
]
# the following error at the end of a program is detected before the brakes close
_OTHERWISE: dict[str, dict[State, str]] = {
    'encoder_drift': dict.fromkeys((State.MOVING, State.STOPPING, State.HELD), _LATE)
}
HUNG_S = 4.5  # exceeds all timeouts
_STARTS = {State.STARTING: '8506'}  # of the suspended plant: the first cause
_ROWS = [
    *(
        _Row({**fault, 'axis': DRIVES[number % len(DRIVES)]}, expected, _OTHERWISE.get(fault['fault'], {}))
        for number, (fault, expected) in enumerate(_OF_AXES)
    ),
    _Row({'fault': 'payload_lost'}),
    _Row({'fault': 'emergency_stop'}, FaultCode.EMERGENCY_STOP),
    *(_Row({'fault': 'freeze', 'node': node, 'seconds': 0.2}, '', _STARTS) for node in NODES),
    *(
        _Row({'fault': 'freeze', 'node': node, 'seconds': HUNG_S}, expected, _STARTS)
        for node, expected in (('axis2', 'axis2'), (PLANT, 'plant'), (TASK, '8506'))
    ),
    _Row(
        {'fault': 'freeze', 'node': UNIT_ROBOT, 'seconds': HUNG_S},
        '',
        _STARTS | {State.MOVING: FaultCode.PLANNER_SILENT},
    ),
    *(_Row({'fault': 'kill', 'node': node}, node, _STARTS) for node in (*DRIVES, PLANT)),
    _Row({'fault': 'kill', 'node': TASK}, '8506', {State.STOPPED_BY_FAULT: '8506', State.STARTING: ''}),
    _Row(
        {'fault': 'kill', 'node': UNIT_ROBOT},
        '',
        _STARTS | {State.MOVING: 'unit_robot'},  # silent or restarted, whichever is first
    ),
]
# rotary axis: no gravity load on the tool, so a worn brake has no effect
_OF_TOOL: list[tuple[dict[str, Any], str]] = [
    ({'fault': 'drop_mdt'}, ''),
    ({'fault': 'drop_mdt'} | TWO, '8112'),
    ({'fault': 'drop_at'}, ''),
    ({'fault': 'drop_at'} | TWO, '8506'),
    ({'fault': 'encoder_failure'}, '8171'),
    ({'fault': 'encoder_jump', 'jump_rad': 2.0}, '8171'),
    ({'fault': 'encoder_jump', 'jump_rad': 0.1}, ''),
    ({'fault': 'encoder_drift', 'drift_rad_s': 2.0}, '8911'),
    ({'fault': 'winding_short'}, '8905'),
    ({'fault': 'dc_link', 'voltage_v': 250.0}, '8909'),
    ({'fault': 'dc_link', 'voltage_v': 800.0}, '8910'),
    ({'fault': 'brake_stuck'}, _LATE),
    ({'fault': 'overload', 'torque_n_m': 0.6}, ''),
]
# mains that stay away; only with a model of the supply. Its electronics discharge the DC link within 3 s.
# The capacitors take the energy of the slow moves of the catalogue, so that an open resistor has no effect on them.
_OF_SUPPLY = [
    _Row({'fault': 'supply_dip', 'share': 0.0, 'for_s': 3.5}, '8909'),
    _Row({'fault': 'resistor_open'}),
]
# only of a robot that warms up: over the limit, and over the warning
_OF_TEMPERATURES = [
    _Row({'fault': 'motor_hot', 'axis': 'axis2', 'excess_k': 130.0}, '8915'),
    _Row({'fault': 'motor_hot', 'axis': 'axis1', 'excess_k': 110.0}),
    _Row({'fault': 'fan_blocked', 'axis': 'axis3', 'for_s': 1.0}),
]
# an overload that ends before the brake, which could not hold it, is applied
I2T = Case({'fault': 'overload', 'axis': 'axis2', 'torque_n_m': 9.0, 'for_s': 0.8}, State.STANDING, '8902')
# Running processes that stop receiving: delta3 up replaces them after a timeout of the bus. Which message a deaf plant,
# or a deaf task in motion, causes first depends on the machine.
DEAF = [
    Case({'fault': 'deaf', 'node': node}, state, '8506')
    for node, state in (
        ('axis2', State.STANDING),
        ('axis2', State.MOVING),
        (TASK, State.STANDING),
    )
]
SHORT = (
    'drop_mdt axis2 x2 enabling',
    'drop_at axis3 x2 stopping',
    'encoder_jump axis1 0.1 standing',
    'winding_short axis1 disabled',
    'dc_link axis2 250 held',
    'payload_lost moving',
    'emergency_stop stopped by fault',
    'kill transformation_task starting',
)
SHORT_OF_TOOL = tuple(
    line for axis in ROTARY_DRIVES for line in (f'drop_at {axis} x2 held', f'winding_short {axis} moving')
)


def _of_row(row: _Row) -> list[Case]:
    cases = []
    for state in State:
        if state == State.STARTING and row.fault['fault'] not in PROCESS_FAULTS:
            continue  # without cyclic operation only process faults are possible
        expected = row.expected
        if state == State.STOPPED_BY_FAULT:
            expected = FaultCode.EMERGENCY_STOP  # the first cause stays
        cases.append(Case(row.fault, state, row.otherwise.get(state, expected)))
    return cases


def _of_rotary_axis(axis: str) -> list[Case]:
    """Return the cases of a rotary axis."""
    rows = [
        *(
            _Row({**fault, 'axis': axis}, expected, _OTHERWISE.get(fault['fault'], {}))
            for fault, expected in _OF_TOOL
        ),
        _Row({'fault': 'freeze', 'node': axis, 'seconds': HUNG_S}, axis, _STARTS),
        _Row({'fault': 'kill', 'node': axis}, axis, _STARTS),
    ]
    # an overload of long duration, and one beyond the motor's torque
    long, hard = (
        {'fault': 'overload', 'axis': axis, 'torque_n_m': torque, 'for_s': time}
        for torque, time in ((3.0, 0.6), (5.0, 0.03))
    )
    return [case for row in rows for case in _of_row(row)] + [
        Case(long, State.STANDING, '8902'),
        Case(hard, State.STANDING, '8111'),
        Case(hard, State.MOVING, '8111'),
    ]


def cases(
    short: bool = False,
    only: str = '',
    rotary: Sequence[str] = (),
    supplied: bool = False,
    warms: bool = False,
) -> list[Case]:
    """Return the catalogue or its short form; ``only`` selects cases by text, ``rotary`` are the rotary axes.

    ``supplied``: the supply of the robot has a model. ``warms``: motors and drives warm up.

    Raises RunError if there are none.
    """
    everything = [case for row in _ROWS for case in _of_row(row)] + [I2T, *DEAF]
    everything += [case for axis in rotary for case in _of_rotary_axis(axis)]
    everything += [case for row in _OF_SUPPLY if supplied for case in _of_row(row)]
    everything += [case for row in _OF_TEMPERATURES if warms for case in _of_row(row)]
    lines = (*SHORT, *SHORT_OF_TOOL)
    found = [case for case in everything if only in case.line and (not short or case.line in lines)]
    if not found:
        lacking = ''.join(f': {lack_of(axis)}' for axis in ROTARY_DRIVES[len(rotary) :] if axis in only)
        raise RunError(f'no case of the catalogue contains the text {only!r}{lacking}')
    return found

"""Operation data of the drive: what the service channel reads and writes, by identification number, as one table.

S numbers and names are those of SERCOS II (IEC 61491), P numbers are ours. Units are SI and radians on the motor side,
currents A rms, voltages of one phase; nothing is scaled on the bus. Where the standard gives a loop an integral action
time, it can be read; the gain that sets it is a P number.
"""

import dataclasses
import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from delta3_pacdrive.bus.service import (
    ERROR_TEXTS,
    Access,
    Answer,
    Operation,
    ServiceError,
    message_8503,
    parse_idn,
)
from delta3_pacdrive.bus.words import Phase
from delta3_pacdrive.drive.diagnostics import FAULTS, WARNINGS, DriveFault, DriveWarning, class_1_diagnostic
from delta3_pacdrive.errors import ParameterError, shown
from delta3_pacdrive.parameters import Parameters, groups

READ_ONLY: frozenset[Phase] = frozenset()
BEFORE_CP4 = frozenset({Phase.CP2, Phase.CP3})
ALWAYS = frozenset({Phase.CP2, Phase.CP3, Phase.CP4})
ONE = '1'  # unit of what has no dimension
BITS = 'bits'  # unit of words
PHASE = 'phase'  # source: communication phase of the access


class Group(StrEnum):
    """What operation data belongs to."""

    GAINS = 'gains'
    FEEDFORWARDS = 'feed-forwards'
    FILTERS = 'filters'
    LIMITS = 'limits'
    TIMING = 'timing'
    ENCODER = 'encoder and gear'
    MOTOR = 'motor and brake'
    ACTUAL_VALUES = 'actual values'
    DIAGNOSTICS = 'diagnostics'
    COMMANDS = 'procedure commands'


@dataclass(frozen=True)
class OperationData:
    """One row of the table.

    Attributes
    ----------
    sources
        Where the value lives: with a dot a parameter (``drive.velocity_feedforward``), without one a field of the
        drive's ``STATE`` record, or ``PHASE``.
    formula
        Makes the value of the sources, in their order.
    writable_in
        Phases in which the value may be changed; data that may be has one source, a parameter, and no formula.

    """

    idn: int
    name: str
    unit: str
    group: Group
    sources: tuple[str, ...]
    formula: Callable[..., float] = float
    writable_in: frozenset[Phase] = READ_ONLY

    @property
    def limits(self) -> tuple[float, float]:
        """Minimum and maximum of the value, those of the parameter that holds it."""
        group, _, name = self.sources[0].partition('.') if self.sources else ('', '', '')
        if self.formula is float and group in groups():
            for field in dataclasses.fields(groups()[group]):
                if field.name == name:
                    return field.metadata['low'], field.metadata['high']
        return -math.inf, math.inf


def _action_time(gain: float, integral_gain: float) -> float:
    """Integral action time [s]; 0 without an integrator, as drives have it."""
    return gain / integral_gain if integral_gain else 0.0


def _class_1(fault: float) -> float:
    return class_1_diagnostic(DriveFault(int(fault)))


def _class_2(warning: float) -> float:
    """Class 2 diagnostic: overload is bit 0, what the standard has no bit for is bit 15."""
    word = 1 if int(warning) & DriveWarning.OVERLOAD else 0
    return word | (1 << 15 if int(warning) & ~DriveWarning.OVERLOAD else 0)


def _diagnostic_number(fault: float, warning: float) -> float:
    """Message number of the fault, else of the first warning, else 0."""
    if fault:
        return FAULTS[DriveFault(int(fault))].number
    return next((row.number for bit, row in WARNINGS.items() if int(warning) & bit), 0)


def _interface_status(phase: float, fault: float) -> float:
    """Communication phase in bits 2 to 0, failure of the MST in bit 3, of the MDT in bit 4, latched as the fault is."""
    failures = {DriveFault.MASTER_SILENT: 1 << 3, DriveFault.TELEGRAM: 1 << 4}
    return int(phase) | failures.get(DriveFault(int(fault)), 0)


def _nothing() -> float:
    return 0.0


def _row(
    idn: str,
    name: str,
    unit: str,
    group: Group,
    *sources: str,
    formula: Callable[..., float] = float,
    writable_in: frozenset[Phase] = READ_ONLY,
) -> OperationData:
    return OperationData(parse_idn(idn), name, unit, group, sources, formula, writable_in)


# fmt: off
_ROWS = (
    # gains
    _row('S-0-0104', 'Position loop KV-factor', '1/s', Group.GAINS,
         'drive.position_gain_rad_s_rad', writable_in=ALWAYS),
    _row('S-0-0100', 'Velocity loop proportional gain', 'A s/rad', Group.GAINS,
         'drive.velocity_gain_a_s_rad', writable_in=ALWAYS),
    _row('P-0-0011', 'Velocity loop integral gain', 'A/rad', Group.GAINS,
         'drive.velocity_integral_gain_a_rad', writable_in=ALWAYS),
    _row('S-0-0101', 'Velocity loop integral action time', 's', Group.GAINS,
         'drive.velocity_gain_a_s_rad', 'drive.velocity_integral_gain_a_rad', formula=_action_time),
    _row('S-0-0106', 'Current loop proportional gain 1', 'V/A', Group.GAINS,
         'drive.current_gain_v_a', writable_in=ALWAYS),
    _row('P-0-0012', 'Current loop integral gain 1', 'V/(A s)', Group.GAINS,
         'drive.current_integral_gain_v_a_s', writable_in=ALWAYS),
    _row('S-0-0107', 'Current loop integral action time 1', 's', Group.GAINS,
         'drive.current_gain_v_a', 'drive.current_integral_gain_v_a_s', formula=_action_time),
    # feed-forwards
    _row('S-0-0296', 'Velocity feed forward gain', ONE, Group.FEEDFORWARDS,
         'drive.velocity_feedforward', writable_in=ALWAYS),
    _row('S-0-0348', 'Acceleration feed forward gain', ONE, Group.FEEDFORWARDS,
         'drive.current_feedforward', writable_in=ALWAYS),
    _row('P-0-0021', 'Inertia of the acceleration feed forward', 'kg m2', Group.FEEDFORWARDS,
         'drive.feedforward_inertia_kg_m2', writable_in=ALWAYS),
    _row('P-0-0022', 'Arm inertia of the shaft observer, arm side', 'kg m2', Group.FEEDFORWARDS,
         'drive.observer_arm_inertia_kg_m2', writable_in=BEFORE_CP4),
    # filters
    _row('S-0-0392', 'Velocity feedback filter', 's', Group.FILTERS,
         'drive.velocity_filter_s', writable_in=ALWAYS),
    _row('P-0-0031', 'Current command filter', 's', Group.FILTERS,
         'drive.current_reference_filter_s', writable_in=ALWAYS),
    _row('P-0-0032', 'Current feedback filter', 's', Group.FILTERS,
         'drive.current_filter_s', writable_in=ALWAYS),
    # limits
    _row('S-0-0159', 'Monitoring window', 'rad', Group.LIMITS,
         'drive.following_error_limit_rad', writable_in=ALWAYS),
    _row('S-0-0429', 'Emergency stop deceleration', 'rad/s2', Group.LIMITS,
         'drive.stop_deceleration_rad_s2', writable_in=ALWAYS),
    _row('P-0-0041', 'Overspeed trip over maximum motor speed', ONE, Group.LIMITS,
         'drive.overspeed_factor', writable_in=ALWAYS),
    _row('P-0-0042', 'Overload time of the I2t monitoring', 's', Group.LIMITS,
         'drive.overload_time_s', writable_in=ALWAYS),
    _row('S-0-0273', 'Maximum drive off delay time', 's', Group.LIMITS,
         'drive.stop_time_max_s', writable_in=BEFORE_CP4),
    _row('S-0-0295', 'Drive enable delay time', 's', Group.LIMITS,
         'drive.enable_settle_s', writable_in=BEFORE_CP4),
    _row('S-0-0091', 'Bipolar velocity limit value', 'rad/s', Group.LIMITS,
         'drive.velocity_limit_rad_s', writable_in=ALWAYS),
    _row('S-0-0092', 'Bipolar torque limit value', 'N m', Group.LIMITS,
         'drive.torque_limit_n_m', writable_in=ALWAYS),
    # timing
    _row('S-0-0001', 'Control unit cycle time (tNcyc)', 's', Group.TIMING, 'bus.cycle_time_s'),
    _row('S-0-0002', 'Communication cycle time (tScyc)', 's', Group.TIMING, 'bus.cycle_time_s'),
    _row('P-0-0001', 'Position loop period', 's', Group.TIMING, 'drive.position_period_s'),
    _row('P-0-0002', 'Velocity loop period', 's', Group.TIMING, 'drive.velocity_period_s'),
    _row('P-0-0003', 'Current loop period', 's', Group.TIMING, 'drive.current_period_s'),
    _row('P-0-0004', 'Exchange period with the plant', 's', Group.TIMING, 'bus.exchange_period_s'),
    # encoder and gear
    _row('S-0-0079', 'Rotational position resolution', 'increments', Group.ENCODER, 'bus.increments_per_rev'),
    _row('S-0-0121', 'Input revolutions of load gear', ONE, Group.ENCODER, 'dynamics.gear_in'),
    _row('S-0-0122', 'Output revolutions of load gear', ONE, Group.ENCODER, 'dynamics.gear_out'),
    _row('P-0-0051', 'Commutation offset, electrical', 'rad', Group.ENCODER, 'drive.commutation_offset_rad'),
    # motor and brake
    _row('S-0-0109', 'Motor peak current', 'A', Group.MOTOR, 'motor.peak_current_a'),
    _row('S-0-0111', 'Motor continuous stall current', 'A', Group.MOTOR, 'motor.nominal_current_a'),
    _row('S-0-0113', 'Maximum motor speed', 'rad/s', Group.MOTOR, 'motor.max_speed_rad_s'),
    _row('S-0-0206', 'Drive on delay time', 's', Group.MOTOR, 'motor.brake_release_s'),
    _row('S-0-0207', 'Drive off delay time', 's', Group.MOTOR, 'motor.brake_apply_s'),
    _row('P-0-0061', 'Torque constant', 'N m/A', Group.MOTOR, 'motor.torque_constant_n_m_a'),
    _row('P-0-0062', 'Rotor inertia', 'kg m2', Group.MOTOR, 'motor.rotor_inertia_kg_m2'),
    _row('P-0-0063', 'Brake inertia', 'kg m2', Group.MOTOR, 'motor.brake_inertia_kg_m2'),
    _row('P-0-0064', 'Winding resistance, phase to phase', 'ohm', Group.MOTOR, 'motor.winding_resistance_ohm'),
    _row('P-0-0065', 'Winding inductance, phase to phase', 'H', Group.MOTOR, 'motor.winding_inductance_h'),
    _row('P-0-0066', 'Pole pairs', ONE, Group.MOTOR, 'motor.pole_pairs'),
    _row('P-0-0067', 'Viscous friction', 'N m s/rad', Group.MOTOR, 'motor.viscous_friction_n_m_s_rad'),
    _row('P-0-0068', 'Static friction', 'N m', Group.MOTOR, 'motor.static_friction_n_m'),
    _row('P-0-0069', 'Torque of the holding brake', 'N m', Group.MOTOR, 'motor.brake_torque_n_m'),
    _row('P-0-0070', 'Nominal DC bus voltage', 'V', Group.MOTOR, 'drive.dc_link_voltage_v'),
    # actual values, of the bus cycle in which the drive answers
    _row('S-0-0036', 'Velocity command value', 'rad/s', Group.ACTUAL_VALUES, 'speed_reference'),
    _row('S-0-0040', 'Velocity feedback value 1', 'rad/s', Group.ACTUAL_VALUES, 'speed'),
    _row('S-0-0047', 'Position command value', 'rad', Group.ACTUAL_VALUES, 'command'),
    _row('S-0-0051', 'Position feedback value 1 (motor feedback)', 'rad', Group.ACTUAL_VALUES,
         'sampled_position'),
    _row('S-0-0080', 'Torque command value', 'N m', Group.ACTUAL_VALUES,
         'motor.torque_constant_n_m_a', 'current_reference', formula=operator.mul),
    _row('S-0-0084', 'Torque feedback value', 'N m', Group.ACTUAL_VALUES,
         'motor.torque_constant_n_m_a', 'current', formula=operator.mul),
    _row('S-0-0189', 'Following distance', 'rad', Group.ACTUAL_VALUES, 'following_error'),
    _row('S-0-0380', 'DC bus voltage', 'V', Group.ACTUAL_VALUES, 'dc_link'),
    _row('S-0-0389', 'Effective current', 'A', Group.ACTUAL_VALUES, 'current'),
    _row('P-0-0071', 'Voltage command value of a phase', 'V', Group.ACTUAL_VALUES, 'voltage'),
    _row('P-0-0072', 'Integral of the I2t monitoring', 's', Group.ACTUAL_VALUES, 'overload'),
    # diagnostics
    _row('S-0-0011', 'Class 1 diagnostic', BITS, Group.DIAGNOSTICS, 'fault', formula=_class_1),
    _row('S-0-0012', 'Class 2 diagnostic', BITS, Group.DIAGNOSTICS, 'warning', formula=_class_2),
    _row('S-0-0014', 'Interface status', BITS, Group.DIAGNOSTICS,
         PHASE, 'fault', formula=_interface_status),
    # the MDT is the synchronisation as well: who loses one has lost the other
    _row('S-0-0028', 'MST error counter', ONE, Group.DIAGNOSTICS, 'mdt_losses'),
    _row('S-0-0029', 'MDT error counter', ONE, Group.DIAGNOSTICS, 'mdt_losses'),
    _row('S-0-0134', 'Drive control', BITS, Group.DIAGNOSTICS, 'control'),
    _row('S-0-0135', 'Drive status', BITS, Group.DIAGNOSTICS, 'status'),
    _row('S-0-0390', 'Diagnostic number', ONE, Group.DIAGNOSTICS,
         'fault', 'warning', formula=_diagnostic_number),
    _row('P-0-0081', 'State of the drive', ONE, Group.DIAGNOSTICS, 'state'),
    _row('P-0-0082', 'Reaction under way', ONE, Group.DIAGNOSTICS, 'reaction'),
    _row('P-0-0083', 'Brake output', ONE, Group.DIAGNOSTICS, 'brake_release'),
    # procedure commands: they are executed at once, so that none is ever found active
    _row('S-0-0099', 'Reset class 1 diagnostic', BITS, Group.COMMANDS, formula=_nothing),
)
# fmt: on

TABLE = {row.idn: row for row in _ROWS}
RESET_CLASS_1_DIAGNOSTIC = parse_idn('S-0-0099')


def _with_unit(value: float, unit: str) -> str:
    return shown(value) if unit == ONE else f'{shown(value)} {unit}'


def refusal(access: Access, answer: Answer) -> str:
    """Diagnostic message 8503 of a failed access, with the name, the value and its limits; empty without an error."""
    row = TABLE.get(access.idn)
    if row is None or not answer.error:
        return answer.sentence
    low, high = row.limits
    text = ERROR_TEXTS[answer.error]
    if access.operation == Operation.WRITE:
        value = _with_unit(access.value, row.unit)
        if answer.error == ServiceError.TOO_SMALL:
            # a positive quantity has the smallest number there is as its minimum
            bound = 'positive' if 0.0 < low < 1e-300 else f'at least {_with_unit(low, row.unit)}'
            text = f'{value} is too small, it must be {bound}'
        elif answer.error == ServiceError.TOO_LARGE:
            text = f'{value} is too large, it must be at most {_with_unit(high, row.unit)}'
        elif answer.error == ServiceError.INVALID:
            text = f'{value} is invalid'
    return message_8503(access.idn, answer.error, f'{row.name}: {text}')


class Register:
    """The operation data of one drive.

    Parameters
    ----------
    parameters
        With which the drive starts.
    actual
        Returns a field of the drive's ``STATE`` record by name.
    on_change
        Called with the new parameters after each accepted writing.
    reset
        Executes S-0-0099; returns whether no fault is left.

    Attributes
    ----------
    parameters
        As written.
    refusal
        Diagnostic message 8503 of the last access that failed; empty before one.

    """

    def __init__(
        self,
        parameters: Parameters,
        actual: Callable[[str], float],
        on_change: Callable[[Parameters], None],
        reset: Callable[[], bool],
    ) -> None:
        self.parameters = parameters
        self.refusal = ''
        self._actual = actual
        self._on_change = on_change
        self._phase = Phase.CP2
        self._commands = {RESET_CLASS_1_DIAGNOSTIC: reset}

    def serve(self, access: Access, phase: Phase) -> Answer:
        """Answer an access of the service channel in a communication phase."""
        self._phase = phase
        if phase < Phase.CP2:
            return self._refuse(access, ServiceError.NOT_OPEN)
        if access.operation == Operation.READ:
            return self.read(access.idn)
        if access.operation == Operation.WRITE:
            return self.write(access.idn, access.value, phase)
        return self.command(access.idn)

    def read(self, idn: int) -> Answer:
        """Return the value of an IDN, in its unit."""
        row = TABLE.get(idn)
        if row is None:
            return self._refuse(Access(idn, Operation.READ), ServiceError.NO_IDN)
        return Answer(idn, value=float(row.formula(*(self._source(source) for source in row.sources))))

    def write(self, idn: int, value: float, phase: Phase) -> Answer:
        """Change a parameter, if its limits, the phase and the rules that join it with others allow the value."""
        access = Access(idn, Operation.WRITE, value)
        error = _writing_error(access, phase)
        if error:
            return self._refuse(access, error)
        key = TABLE[idn].sources[0].replace('.', '__')
        try:
            changed = self.parameters.replace(**{key: value})
        except ParameterError as broken_rule:
            return self._refuse(access, ServiceError.INVALID, str(broken_rule))
        self.parameters = changed
        self._on_change(changed)
        return Answer(idn, value=value)

    def command(self, idn: int) -> Answer:
        """Execute a procedure command."""
        access = Access(idn, Operation.COMMAND)
        if idn not in TABLE:
            return self._refuse(access, ServiceError.NO_IDN)
        if idn not in self._commands:
            return self._refuse(access, ServiceError.NO_COMMAND)
        if not self._commands[idn]():
            return self._refuse(access, ServiceError.COMMAND_NOT_EXECUTABLE)
        return Answer(idn, value=0.0)

    def _source(self, source: str) -> float:
        if source == PHASE:
            return float(self._phase)
        group, dot, name = source.partition('.')
        return float(getattr(getattr(self.parameters, group), name) if dot else self._actual(source))

    def _refuse(self, access: Access, error: ServiceError, why: str = '') -> Answer:
        answer = Answer(access.idn, error)
        self.refusal = message_8503(access.idn, error, why) if why else refusal(access, answer)
        return answer


def _writing_error(access: Access, phase: Phase) -> ServiceError:
    """What forbids to write a value, whatever the other parameters are."""
    row = TABLE.get(access.idn)
    if phase < Phase.CP2:
        return ServiceError.NOT_OPEN
    if row is None:
        return ServiceError.NO_IDN
    if not row.writable_in:
        return ServiceError.READ_ONLY
    if phase not in row.writable_in:
        return ServiceError.WRITE_PROTECTED
    if not math.isfinite(access.value):
        return ServiceError.INVALID
    low, high = row.limits
    if access.value < low:
        return ServiceError.TOO_SMALL
    return ServiceError.TOO_LARGE if access.value > high else ServiceError.NONE

"""All parameters of one robot, by group and by dotted name."""

import dataclasses
import functools
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from delta3_pacdrive.axes import ARMS
from delta3_pacdrive.configuration import parameter_file
from delta3_pacdrive.configuration.strict_reader import Errors, refuse
from delta3_pacdrive.errors import ParameterError, shown
from delta3_pacdrive.parameters.bus_timing import BusTiming, bus_timing, cyclic_bytes
from delta3_pacdrive.parameters.commissioning import Commissioning, Mounting
from delta3_pacdrive.parameters.geometry import Kinematics
from delta3_pacdrive.parameters.notch import notches
from delta3_pacdrive.parameters.records import (
    LINEAR,
    MODEL,
    SERCOS_2,
    UNSHAPED,
    Bus,
    Control,
    Drive,
    Dynamics,
    Gear,
    Joints,
    Motion,
    Motor,
    Rich,
)
from delta3_pacdrive.parameters.rotary import GROUPS as ROTARY_GROUPS
from delta3_pacdrive.parameters.rotary import Rotary, present_axes
from delta3_pacdrive.parameters.rules import broken_rules
from delta3_pacdrive.parameters.supply import Supply
from delta3_pacdrive.parameters.thermal import Thermal

PLANTS = ('plain', 'rich')
BEYOND_DEG = 5.0  # beyond the limits of the tool angle: overtravel of the drive
RING = ('timing', 'baud_rate_mbit_s', 'fibre_length_m', 'slave_delay_s', 'jitter_s')  # of ``sercos2`` only
SEED = 4  # offset of the sensor seed of the first rotary axis


@dataclass(frozen=True)
class Parameters:
    """All parameter groups of one robot."""

    kinematics: Kinematics
    drive: Drive
    dynamics: Dynamics
    motor: Motor
    rich: Rich
    bus: Bus
    motion: Motion
    gear: Gear = field(default_factory=Gear)
    joints: Joints = field(default_factory=Joints)
    control: Control = field(default_factory=Control)
    rotary: Rotary = field(default_factory=Rotary)
    rotary_2: Rotary = field(default_factory=Rotary)
    supply: Supply = field(default_factory=Supply)
    thermal: Thermal = field(default_factory=Thermal)
    mounting: Mounting = field(default_factory=Mounting)
    commissioning: Commissioning = field(default_factory=Commissioning)

    def __post_init__(self) -> None:
        """Check the rules between values."""
        broken = [sentence for _, sentence in broken_rules(**vars(self))]
        if broken:
            raise ParameterError.of_all(broken)

    @property
    def bus_delay_cycles(self) -> int:
        """Bus cycles from the start of the cycle of an MDT until its set point takes effect in the drive.

        In the thesis, the drive has the MDT at the start of its cycle. A SERCOS II telegram arrives within the cycle
        and is valid from t3 on, so the drive has it at the start of the next one.
        """
        return 2 if self.bus.timing == SERCOS_2 else 1

    @property
    def bus_timing(self) -> BusTiming:
        """Times of the telegrams in a SERCOS II cycle."""
        at_bytes, record_bytes = cyclic_bytes(self.sends_torque)
        axes = len(self.axes)
        return bus_timing(self.bus, [at_bytes] * axes, [record_bytes] * axes)

    @property
    def set_point_delay_cycles(self) -> float:
        """Latency of a set point [cycles]: the bus, and the fine interpolation up to its last step.

        Cubic interpolation passes through the same points at the same times. It also uses the set point of the next
        cycle, which the drive already has at the beginning of this one, so it adds no latency.
        """
        return self.bus_delay_cycles + 1.0 - self.drive.position_period_s / self.bus.cycle_time_s

    @property
    def sends_torque(self) -> bool:
        """Whether the master sends an additive torque command (S-0-0081) with each set point."""
        return self.control.feed_forward == MODEL

    @property
    def gear_gives(self) -> bool:
        """Whether the controller models elastic gears or backlash."""
        return self.control.gear_stiffness_n_m_rad > 0.0 or self.control.gear_backlash_rad > 0.0

    @functools.cached_property
    def rotary_axes(self) -> tuple[Rotary, ...]:
        """The rotary axes of the tool in order, empty for a robot of three axes."""
        return tuple(axis for _, axis in present_axes(self.rotary, self.rotary_2))

    @functools.cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes, ``axis1``, ``axis2``, ...: the arms, then the rotary axes."""
        return tuple(f'axis{number}' for number in range(1, ARMS + 1 + len(self.rotary_axes)))

    @property
    def kind(self) -> str:
        """Kind of robot with separate kernels: ``built`` and each rotary axis, joined by +; empty for a plain robot."""
        kinds = ('built',) * self.rich.enabled + ROTARY_GROUPS[: len(self.rotary_axes)]
        return '+'.join(kinds)

    @property
    def controller(self) -> str:
        """Description of the controller."""
        torque = 'the whole model' if self.sends_torque else 'one inertia per axis'
        words = [f'torque of {torque}', f'{self.drive.interpolation} set points']
        if self.gear_gives:
            words.append('gears that give')
        if self.control.shaping != UNSHAPED:
            words.append(f'shaped moves ({self.control.shaping})')
        later = self.bus.timing == SERCOS_2
        if later:
            words.append('timing of a SERCOS II ring')
        of_thesis = self.control == Control() and self.drive.interpolation == LINEAR and not later
        return f'{", ".join(words)}{" (of the thesis)" * of_thesis}'

    @property
    def gear_compliance_rad_n_m(self) -> float:
        """Gear compliance known to the controller, arm side; 0 for a rigid gear."""
        stiffness = self.control.gear_stiffness_n_m_rad
        return 1.0 / stiffness if stiffness > 0.0 else 0.0

    @property
    def torque_dead_time_s(self) -> float:
        """Dead time [s] from an additive torque command to the torque of the motor.

        F_currRef delays the reference. The current lags by the velocity error of its loop: R over K_Icurr of a phase,
        or L over R + K_Pcurr where the integrator is slower. Notch filters add their dead times.
        """
        drive, motor = self.drive, self.motor
        lag_s = motor.winding_inductance_h / (motor.winding_resistance_ohm + 2.0 * drive.current_gain_v_a)
        if drive.current_integral_gain_v_a_s > 0.0:
            lag_s = min(lag_s, motor.winding_resistance_ohm / (2.0 * drive.current_integral_gain_v_a_s))
        notch_s = sum(notch.dead_time_s(drive.velocity_period_s) for notch in notches(drive))
        return drive.current_reference_filter_s + lag_s + notch_s

    @property
    def shaft_speed_max_rpm(self) -> float:
        """Largest speed of a motor shaft in a move [rpm], limited by the motor or by the gear."""
        of_gear = self.gear.input_speed_max_rpm if self.gear.limit_moves else math.inf
        return min(self.motor.max_speed_rpm, of_gear)

    @property
    def shaft_speed_max_rad_s(self) -> float:
        """Largest speed of a motor shaft in a move [rad/s]."""
        return self.shaft_speed_max_rpm * math.tau / 60.0

    @property
    def gear_torque_max_n_m(self) -> float:
        """Largest torque [N m] at the output of a gear in a move; inf if moves are not limited by gears."""
        return self.gear.acceleration_torque_n_m if self.gear.limit_moves else math.inf

    @property
    def torque_max_n_m(self) -> float:
        """Largest motor torque [N m], limited by peak current or by the drive (S-0-0092)."""
        motor = self.motor
        return min(motor.peak_current_a * motor.torque_constant_n_m_a, self.drive.torque_limit_n_m)

    @property
    def following_error_delay_cycles(self) -> float:
        """Dead time of the following error [cycles]: feedback and set point, unless prescribed."""
        prescribed = self.motion.following_error_delay_cycles
        return prescribed if prescribed >= 0.0 else 1.0 + self.set_point_delay_cycles

    @property
    def in_position_cycles(self) -> int:
        """Consecutive bus cycles in which every drive must be within its position window to be in position."""
        return max(math.ceil(self.motion.in_position_time_s / self.bus.cycle_time_s - 1e-9), 1)

    @property
    def shortest_wait_s(self) -> float:
        """Shortest time [s] from the last set point of an exact stop until the program can continue.

        The drives must be in position for their time, a dead time after the set point; the ATs take effect after all
        outstanding cycles.
        """
        cycles = self.in_position_cycles + math.ceil(self.following_error_delay_cycles)
        return (cycles + self.bus.outstanding_cycles_max) * self.bus.cycle_time_s

    @property
    def decision_cycles(self) -> int:
        """Bus cycles from the ATs on which a script decides to the first command affected by the decision.

        When the ATs are known, the commands of all outstanding cycles have been sent, and a change is announced as
        many cycles in advance.
        """
        return 2 * self.bus.outstanding_cycles_max + 2

    @functools.cached_property
    def checksum(self) -> str:
        """Digest of every value that a run depends on; participants agree if their digests are equal.

        Values of absent rotary axes, those of the ring without ``sercos2``, and those of a supply, of gears, of
        joints, observers and drives that warm up are excluded if they are not enabled, so that the digests of such
        robots do not change; so are those of a neutral mounting with its procedures. Without ``thermal.in_drives``,
        temperatures follow from a run and do not change it.
        """
        values = _flat(self, len(self.rotary_axes))
        if self.bus.timing != SERCOS_2:
            for name in RING:
                del values[f'bus.{name}']
        unused = [
            f'{group}.'
            for group, is_used in (
                ('supply', self.supply.enabled),
                ('gear', self.gear.limit_moves),
                ('joints', self.joints.limit_moves),
                ('thermal', self.thermal.in_drives),
                ('mounting', not self.mounting.neutral),
                ('commissioning', not self.mounting.neutral),
            )
            if not is_used
        ]
        if self.drive.disturbance_bandwidth_hz == 0.0:
            unused.append('drive.disturbance_')
        values = {name: value for name, value in values.items() if not name.startswith(tuple(unused))}
        text = repr(sorted(values.items()))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def replace(self, **values: Any) -> 'Parameters':
        """Return a copy with values replaced by dotted name, with ``__`` for dots."""
        return self.replaced({key.replace('__', '.'): value for key, value in values.items()})

    def replaced(self, values: Mapping[str, Any]) -> 'Parameters':
        """Return a copy with values replaced by dotted name; only the groups concerned are checked again.

        Raises
        ------
        ParameterError
            A name is unknown, or a value has the wrong type or breaks a rule.

        """
        tree: dict[str, Any] = {}
        for name, value in values.items():
            group, _, key = name.partition('.')
            if key not in _FIELDS.get(group, ()):
                raise ParameterError(f'unknown parameter {name}')
            if group not in tree:
                own = getattr(self, group)
                tree[group] = {one: getattr(own, one) for one in _FIELDS[group]}
            tree[group][key] = value
        others = {name: getattr(self, name) for name in _GROUPS if name not in tree}
        return _built(
            tree, {name: cls for name, cls in _GROUPS.items() if name in tree}, others, 'parameters'
        )


_GROUPS: dict[str, Any] = {f.name: f.type for f in dataclasses.fields(Parameters)}
_FIELDS: dict[str, tuple[str, ...]] = {
    group: tuple(f.name for f in dataclasses.fields(cls)) for group, cls in _GROUPS.items()
}


# by the number of rotary axes whose values count
_FIELDS_WITH = tuple(
    {group: names for group, names in _FIELDS.items() if group not in ROTARY_GROUPS[count:]}
    for count in range(len(ROTARY_GROUPS) + 1)
)


def groups() -> dict[str, Any]:
    """Return the group classes by name, in the order of the file."""
    return dict(_GROUPS)


def commissioned(parameters: Parameters) -> Parameters:
    """Return ``parameters`` of a robot whose drives know all offsets."""
    return parameters if parameters.mounting.neutral else replace(parameters, mounting=Mounting())


def flatten(parameters: Parameters, absent: bool = False) -> dict[str, Any]:
    """Return every value of ``parameters`` by its dotted name, for example ``motor.peak_current_a``.

    Values of an absent second rotary axis are included only if ``absent``.
    """
    return _flat(parameters, len(ROTARY_GROUPS) if absent else max(1, len(parameters.rotary_axes)))


def _flat(parameters: Parameters, rotary: int) -> dict[str, Any]:
    """Return the values by dotted name, those of the first ``rotary`` rotary axes included."""
    return {
        f'{group}.{name}': getattr(getattr(parameters, group), name)
        for group, names in _FIELDS_WITH[rotary].items()
        for name in names
    }


def flat_document(parameters: Parameters) -> dict[str, Any]:
    """Return every value of ``parameters`` by its dotted name in JSON types; ``from_flat`` reads it."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in flatten(parameters).items()
    }


def from_flat(values: dict[str, Any], where: str = 'parameters') -> Parameters:
    """Build parameters from a complete set of ``values`` by dotted name; errors begin with ``where``.

    Raises
    ------
    ParameterError
        A name is unknown or missing, or a value has the wrong type or breaks a rule.

    """
    tree: dict[str, Any] = {}
    for name, value in values.items():
        group, dot, key = name.partition('.')
        if not dot:
            raise ParameterError(f'{where}: unknown parameter {name}')
        tree.setdefault(group, {})[key] = value
    return from_tree(tree, where)


def is_rich(plant: Any, where: str) -> bool:
    """Whether ``plant``, an alternative to ``rich.enabled`` in files, is the built robot.

    Raises ParameterError with a message that begins with ``where``.
    """
    if plant not in PLANTS:
        raise ParameterError(f'{where}: plant is {shown(plant)}, but must be {" or ".join(PLANTS)}')
    return bool(plant == PLANTS[1])


def from_tree(tree: parameter_file.Tree, where: str) -> Parameters:
    """Build parameters from the groups of a file; raises ParameterError with up to ten complaints."""
    if 'plant' in tree and isinstance(tree.get('rich'), dict):
        tree = tree | {'rich': tree['rich'] | {'enabled': is_rich(tree['plant'], where)}}
        del tree['plant']
    return _built(tree, _GROUPS, {}, where)


def _built(
    tree: parameter_file.Tree, groups: Mapping[str, Any], others: Mapping[str, Any], where: str
) -> Parameters:
    """Build parameters from unchecked groups and existing ones; raises ParameterError."""
    errors = Errors(where)
    with errors.raised_as(ParameterError):
        built = {**others, **parameter_file.checked_groups(tree, groups, errors)}
        if len(built) == len(_GROUPS):
            for name, sentence in broken_rules(**built):
                with errors.noted(parameter_file.place_of(tree, name)):
                    refuse(sentence)
    return Parameters(**built)


def _shared(group: Motor | Drive, rotary: Rotary) -> dict[str, Any]:
    """Return the values of the axis that have the same names in a group of the arms."""
    names = {field.name for field in fields(group)} & {field.name for field in fields(rotary)}
    return {name: getattr(rotary, name) for name in names}


def _nominal_loss(motor: Motor | Rotary) -> float:
    """Return the loss of a winding at the nominal current, relative to that of 1 A in 1 ohm."""
    return motor.winding_resistance_ohm * motor.nominal_current_a**2


def rotary_axis_parameters(parameters: Parameters, number: int) -> Parameters:
    """Return ``parameters`` with motor, gear and drive of rotary axis ``number``, from 0, in place of an arm's."""
    p, rotary = parameters, parameters.rotary_axes[number]
    payload_kg = p.dynamics.payload_mass_kg
    inertia, gear = rotary.shaft_inertia_kg_m2(payload_kg), rotary.gear_ratio
    to_shaft = math.radians(gear)
    low, high = rotary.angle_min_deg, rotary.angle_max_deg
    no_correction = (0.0, 0.0, 0.0)
    return replace(
        p,
        kinematics=replace(
            p.kinematics,
            arm_angle_min_deg=low,
            arm_angle_max_deg=high,
            arm_angle_correction_deg=no_correction,
        ),
        dynamics=replace(
            p.dynamics,
            gear_in=gear,
            gear_out=1.0,
            end_stop_min_deg=low - BEYOND_DEG,
            end_stop_max_deg=high + BEYOND_DEG,
        ),
        motor=replace(
            p.motor,
            **_shared(p.motor, rotary),
            brake_inertia_kg_m2=0.0,
        ),
        drive=replace(
            p.drive,
            **_shared(p.drive, rotary),
            feedforward_inertia_kg_m2=inertia,
            observer_arm_inertia_kg_m2=inertia * gear**2,
            following_error_limit_rad=rotary.following_error_limit_deg * to_shaft,
            position_window_rad=rotary.position_window_deg * to_shaft,
            velocity_limit_rad_s=rotary.max_speed_rad_s,
            torque_limit_n_m=rotary.peak_current_a * rotary.torque_constant_n_m_a,
            # the filters of the arms' drives are tuned to the resonances of the arms
            notch_1_frequency_hz=0.0,
            notch_2_frequency_hz=0.0,
            # so is the disturbance observer to their inertia
            disturbance_bandwidth_hz=0.0,
            disturbance_inertia_kg_m2=0.0,
        ),
        mounting=Mounting(),
        commissioning=replace(
            p.commissioning,
            alignment_current_a=min(p.commissioning.alignment_current_a, rotary.nominal_current_a),
            brake_test_torque_n_m=min(p.commissioning.brake_test_torque_n_m, 0.8 * rotary.brake_torque_n_m),
        ),
        rich=replace(
            p.rich,
            sensor_seed=p.rich.sensor_seed + SEED + number,
            break_away_torque_n_m=max(p.rich.break_away_torque_n_m, rotary.static_friction_n_m),
        ),
        thermal=p.thermal.of_motor(_nominal_loss(rotary), _nominal_loss(p.motor)),
    )

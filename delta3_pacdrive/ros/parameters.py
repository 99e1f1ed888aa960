"""The core's parameters as ROS parameters with the same names, rules and descriptions."""

import dataclasses
import math
from array import array
from collections.abc import Sequence
from typing import Any, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ParameterError, RunError
from delta3_pacdrive.planning.paths.move import MOVES_MAX
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.ros.wire import frames

GEAR = ('dynamics.gear_in', 'dynamics.gear_out')
SHOWN = {
    'unit_robot': (
        'kinematics', 'dynamics', 'gear', 'joints', 'motor', 'motion', 'bus', 'rotary', 'rotary_2',
        'drive.dc_link_voltage_v',
    ),
    'transformation_task': (
        'kinematics', 'motion', 'bus', *GEAR, 'dynamics.payload_mass_kg', 'motor.torque_constant_n_m_a',
        'motor.brake_release_s', 'drive.enable_settle_s', 'drive.position_period_s', 'control', 'gear', 'joints',
    ),
    'mc4_drive': (
        'drive', 'motor', 'bus', 'rich', *GEAR, 'dynamics.end_stop_min_deg', 'dynamics.end_stop_max_deg',
        'dynamics.payload_mass_kg', 'kinematics.arm_angle_correction_deg', 'control', 'supply',
        'thermal', 'mounting', 'commissioning',
    ),
    'plant': (
        'kinematics', 'dynamics', 'motor', 'bus', 'rich', 'rotary', 'rotary_2', 'drive.current_period_s',
        'motion.home_m', 'supply', 'thermal', 'mounting', 'drive.dc_link_voltage_v',
    ),
    'recorder': (),
    'robot_visualization': ('kinematics', *GEAR, 'dynamics.payload_mass_kg'),
}  # fmt: skip
"""Parameter groups and single parameters that each node declares; every node accepts all parameters."""
_OF_RCLPY = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')


def descriptor(
    description: str, low: float, high: float, kind: type, writable: bool = False
) -> ParameterDescriptor:
    """Return a descriptor, read-only unless ``writable``, with a closed range if ROS can express it."""
    result = ParameterDescriptor(description=description, read_only=not writable)
    bounded = math.isfinite(low) and math.isfinite(high)
    if bounded and kind is float:
        # shown as 0 instead of the smallest positive number; the core still rejects 0
        least = 0.0 if 0.0 < low < 1e-300 else low
        result.floating_point_range = [FloatingPointRange(from_value=least, to_value=high, step=0.0)]
    elif bounded and kind is int:
        result.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return result


class Own(NamedTuple):
    """A parameter of a node in addition to those of the robot."""

    name: str
    default: Any
    description: str
    low: float = 0.0
    high: float = 0.0  # equal to ``low`` for texts
    writable: bool = False  # at run time

    @property
    def entry(self) -> tuple[str, Any, ParameterDescriptor]:
        """The parameter as rclpy declares it."""
        kind = type(self.default)
        return self.name, self.default, descriptor(self.description, self.low, self.high, kind, self.writable)


PLANT = Own('plant', '', 'plain or rich, instead of rich.enabled')
FRAME_PREFIX = Own(
    frames.PREFIX, '', 'prefix of the frame base and of the links of the robot, the same for all its nodes'
)
OF_ALL = (PLANT, FRAME_PREFIX)  # parameters of every node in addition to its own
_ERROR_MAX_RAD = 1.0
OWN: dict[str, tuple[Own, ...]] = {
    'unit_robot': (
        Own('program', '', 'program file, or the name of a packaged program; empty: none'),
        Own('first_statement', 0, 'statement of the program with which it begins', 0, MOVES_MAX),
        # named as in joint_trajectory_controller
        *(
            Own(
                f'constraints.{axis}.{name}', 0.0, f'limit of the arm error {where} [rad]; 0: no limit',
                0.0, _ERROR_MAX_RAD, writable=True,
            )
            for name, where in (('trajectory', 'on a trajectory'), ('goal', 'at the end of a trajectory'))
            for axis in DRIVES
        ),
        Own(
            'constraints.goal_time', 0.0,
            'time in which the arms come to rest at the end of a trajectory [s]; 0: no limit', 0.0, 3600.0,
            writable=True,
        ),
        Own(
            'constraints.stopped_velocity_tolerance', 0.01, 'speed below which an arm is at rest [rad/s]',
            0.0, 10.0, writable=True,
        ),
        Own('cell', '', 'cell file: programs may name its outputs; empty: none'),
    ),
    'transformation_task': (
        Own('real_time_factor', 1.0, 'bus time over wall time; 0 = as fast as possible', 0.0, 1e3),
        Own(
            'wait_for_program', False,
            'stay in CP3 until a program is loaded, so that it starts at motion.start_cycle', 0, 1,
        ),
        Own('joint_motion', False, 'also publish joint_motion and jacobian in every cycle', 0, 1),
        Own('learned', '', 'file of learned torques, for the program they were learned with; empty: none'),
        Own(
            'script_cycle', -1,
            'bus cycle in which a script begins to decide; without a clock the bus waits for it', -1, 2**53,
        ),
        Own('shared_clock', '', 'file of the bus clock shared by several robots; empty: a separate clock'),
        Own('clock_member', 0, 'number of this robot on that clock', 0, 9),
    ),
    'mc4_drive': (
        Own('axis', 0, 'number of the axis: 1 to 3, or from 4 on for a rotary axis', 0, len(ALL_DRIVES)),
        Own('memory', '', 'file of the data stored by S-0-0264; empty: they cannot be stored'),
    ),
    'plant': (
        Own('cell', '', 'cell file: gripper, parts, sensors and belts of the robot; empty: none'),
        Own(
            'cell_start_cycle', -1,
            'bus cycle from which times of the cell file count; -1: motion.start_cycle', -1, 2**53,
        ),
    ),
    'recorder': (
        Own('bag', '', 'folder of the new bag'),
        Own('program', '', 'name of the program, for the metadata'),
    ),
    'robot_visualization': (
        Own('error_magnification', 100.0, 'factor by which the line of the TCP error is magnified', 1.0, 1e4),
    ),
}  # fmt: skip
"""Parameters of each node in addition to those of the robot."""


def declare_own(node: Node, kind: str) -> dict[str, Any]:
    """Declare a node's own parameters; return their values. Raises ParameterError for a wrong type or value."""
    entries = [own.entry for own in OWN[kind]]
    return dict(zip((name for name, _, _ in entries), _declare_all(node, entries), strict=True))


def _declare_all(node: Node, entries: list[Any]) -> list[Any]:
    """Declare (name, default, descriptor) entries; return their values."""
    try:
        return [parameter.value for parameter in node.declare_parameters('', entries)]
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise ParameterError(f'{node.get_fully_qualified_name()}: {error}') from None


def overrides(robot: core.Parameters, values: dict[str, Any]) -> list[Parameter]:
    """Return parameter overrides with the parameters of a robot and additional values."""
    flat = core.flatten(robot) | values
    return [Parameter(key, value=list(v) if isinstance(v, tuple) else v) for key, v in flat.items()]


def shows(kind: str, name: str) -> bool:
    """Whether nodes of a kind declare a parameter of the robot."""
    return name in SHOWN[kind] or name.partition('.')[0] in SHOWN[kind]


def declare_robot(
    node: Node,
    kind: str,
    writable: frozenset[str] = frozenset(),
    rotary: Sequence[int] = (),
) -> core.Parameters:
    """Read and validate every parameter of the robot; raises ParameterError for unknown overrides.

    The node declares those of its kind; the drive of a rotary axis declares the values of that axis: ``rotary``
    contains its number, from 0. ``writable`` names those that can be set at run time. Call this after the node's own
    parameters are declared.
    """
    defaults = core.flatten(core.load(), absent=True)
    name = node.get_fully_qualified_name()
    plant, prefix = _declare_all(node, [own.entry for own in OF_ALL])
    if plant:
        defaults['rich.enabled'] = core.is_rich(plant, name)
    try:
        frames.checked_prefix(prefix)
    except RunError as error:
        raise ParameterError(f'{name}: {error}') from None
    entries = []
    for group, cls in core.groups().items():
        for f in dataclasses.fields(cls):
            key = f'{group}.{f.name}'
            default = defaults[key]
            of_type = f.type if f.type in (int, float, bool, str) else list
            low, high = f.metadata.get('low', 0.0), f.metadata.get('high', 0.0)
            # a read-only parameter cannot be undeclared
            changeable = key in writable or not shows(kind, key) or bool(rotary)
            info = descriptor(f.metadata['description'], low, high, of_type, changeable)
            entries.append((key, list(default) if of_type is list else default, info))
    values = [list(value) if isinstance(value, array) else value for value in _declare_all(node, entries)]
    for name in getattr(node, '_parameter_overrides', {}):
        if not node.has_parameter(name) and not name.startswith(_OF_RCLPY):
            raise ParameterError(f'{node.get_fully_qualified_name()}: unknown parameter {name}')
    named = {key: value for (key, _, _), value in zip(entries, values, strict=True)}
    for key in named:
        if not shows(kind, key):
            node.undeclare_parameter(key)
    robot = core.from_flat(named, node.get_fully_qualified_name())
    for number in {*rotary}.intersection(range(len(robot.rotary_axes))):
        own = core.rotary_axis_parameters(robot, number)
        _show_own(node, own, [info for info in entries if shows(kind, info[0])], writable)
    return robot


def _show_own(node: Node, own: core.Parameters, entries: list[Any], writable: frozenset[str]) -> None:
    """Declare the node's parameters with values that differ from those of the robot.

    Read-only parameters lose their range, which applies to the arms.
    """
    values = core.flatten(own)
    shown: list[Any] = []
    for key, _, info in entries:
        node.undeclare_parameter(key)
        fixed = ParameterDescriptor(description=info.description, read_only=True)
        value = values[key]
        allowed = list(value) if isinstance(value, tuple) else value
        shown.append((key, allowed, info if key in writable else fixed))
    node.declare_parameters('', shown, ignore_override=True)

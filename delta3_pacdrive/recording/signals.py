"""Names of the signals of a run with unit and meaning. Without slow imports: the help of commands uses them."""

from collections.abc import Sequence

from delta3_pacdrive.axes import ROTARY_AXES_MAX, numbered

# name: (unit, meaning); arrays of shape (cycles, 3), columns axis 1..3 or x, y, z
SIGNALS = {
    'motor_command': ('rad', 'motor shaft command of the MDT'),
    'motor_position': ('rad', 'motor shaft position of the AT'),
    'motor_speed': ('rad/s', 'motor shaft speed of the AT'),
    'current': ('A', 'I_eff of the AT: one sample, the last of the current loop before it'),
    'following_error': ('rad', 'arm following error, dead time removed (7.3)'),
    'tcp_command': ('m', 'TCP of the command'),
    'tcp_actual': ('m', 'TCP by forward kinematics of the actual angles'),
    'tcp_error': ('m', 'TCP error, set-point delay removed'),
    'shaft_position': ('rad', 'true motor shaft position'),
    'shaft_speed': ('rad/s', 'true motor shaft speed'),
    'coupling_torque': ('N m', 'd of Eq. 4.31, motor side'),
}
# if the master commands torques (``Parameters.sends_torque``)
TORQUE_SIGNALS = {'torque_command': ('N m', 'additive torque command of the MDT (S-0-0081), motor side')}
# statistics of all current samples in a bus cycle, 16 per millisecond: from one period after the start of cycle k to
# the start of cycle k + 1, which is the sample of AT(k + 1)
CURRENT_SIGNALS = {
    'current_mean': ('A', 'I_eff, mean of all samples of the bus cycle'),
    'current_rms': ('A', 'I_eff, root of the mean square of all samples of the bus cycle'),
    'current_min': ('A', 'I_eff, least sample of the bus cycle'),
    'current_max': ('A', 'I_eff, greatest sample of the bus cycle'),
}
# only in simulations, not on topics
TRUE_SIGNALS = {
    'arm_angle': ('rad', 'true arm angle, after the gear'),
    'tcp_true': ('m', 'true TCP, with the tolerances of the arms'),
}
# if the DC link has a model (``supply.enabled``)
SUPPLY_SIGNALS = {
    'dc_link_voltage': ('V', 'voltage of the DC link'),
    'mains_power': ('W', 'power from the mains, mean of the bus cycle before'),
    'resistor_power': ('W', 'power in the brake resistor, mean of the bus cycle before'),
}
# if the robot warms up (``thermal.in_drives``)
THERMAL_SIGNALS = {
    'winding_temperature': ('degC', 'temperature of the windings'),
    'housing_temperature': ('degC', 'temperature of the housings of the motors'),
    'sink_temperature': ('degC', 'temperature of the heat sinks of the drives'),
}
# first rotary axis; angles and speeds of the tool
TURN_SIGNALS = {
    'turn_command': ('rad', 'angle of the tool that the MDT commands'),
    'turn_position': ('rad', 'angle of the tool by the motor shaft of the AT'),
    'turn_error': ('rad', 'error of the angle of the tool, set-point delay removed'),
    'turn_speed': ('rad/s', 'speed of the tool by the motor shaft of the AT'),
    'turn_current': ('A', 'I_eff of the motor of the rotary axis: one sample, the last before the AT'),
    'turn_true': ('rad', 'true angle of the tool, after gear and bar'),
}
# of all rotary axes
ROTARY_SIGNALS = {
    numbered(name, number): declared
    for number in range(ROTARY_AXES_MAX)
    for name, declared in TURN_SIGNALS.items()
}
# computed from other signals; each column of the master has its own unit
DERIVED_SIGNALS = {
    'master': (
        'm, m/s, m/s2',
        'virtual master of the command: distance s, speed v, acceleration a along the path (6)',
    ),
    'tcp_velocity': ('m/s', 'velocity of the actual TCP'),
    'tcp_acceleration': ('m/s2', 'acceleration of the actual TCP'),
    'gear_torque': ('N m', 'torque at the output of the gear, from the coupling torque and the shaft speed'),
}
# on request only; each column of the outputs has its own name
REQUESTED_SIGNALS = {
    'tcp_speed': ('m/s', 'speed of the actual TCP'),
    'joint_speed': ('rad/s', 'arm speeds through the Jacobian from the TCP of the command (4.12)'),
    'joint_acceleration': ('rad/s2', 'arm accelerations through the Jacobian, from the same (4.16)'),
    'jacobian': ('1, m/s, m/s2', 'of the TCP of the command: condition number of J, speed, acceleration'),
    'rod_force': (
        'N',
        'larger axial force of the two rods of each arm, tension positive, from the TCP command',
    ),
    'spring_force': (
        'N',
        'force of the springs that keeps the ball joints of each arm closed, from the same',
    ),
    'plate_load': ('N, N m', 'axial force and tilting moment of the payload on the plate, from the same'),
    'payload': ('kg', 'payload in the MDT of the bus cycle'),
    'outputs': ('1', 'digital outputs: gripper, output1 to output7'),
    'status_word': ('bits', 'status word S-0-0135 of the AT'),
    'fault': ('1', '1 from the bus cycle in which the AT report a fault'),
    'lost_telegrams': ('1', 'AT that did not reach the master, since bus time 0'),
    'overruns': ('1', 'bus cycles that began late, since bus time 0'),
    'cell_inputs': (
        '1',
        'inputs in the AT, in the order of the cell file, the vacuum switch last',
    ),
    'cell_vacuum': ('Pa', 'vacuum in the cup'),
    'cell_payload': ('kg', 'true mass of the payload'),
    'cell_belts': ('m', 'travel of each belt surface, in the order of the cell file'),
    'cell_force': ('N', 'holding force of the cup, and force required by the part'),
}
OF_CELLS = 'cell_'  # prefix of signals that exist only in a simulation with a cell file
CELL_INPUTS, CELL_BELTS = 16, 4  # number of columns, the maximum of a cell
OF_DRIVES = 'drive_'  # prefix of a channel (``drive/channels.py``) of all three drives, on request
OUTPUT_COLUMNS = ('gripper', *'1234567')
NAMED_COLUMNS: dict[str, Sequence[str]] = {
    'master': 'sva',
    'outputs': OUTPUT_COLUMNS,
    'cell_inputs': [str(n + 1) for n in range(CELL_INPUTS)],
    'cell_belts': [str(n + 1) for n in range(CELL_BELTS)],
    'cell_force': ('holding', 'needed'),
    'jacobian': ('condition', 'speed', 'acceleration'),
    'plate_load': ('force', 'moment'),
}
JOINT_MOTION = ('joint_speed', 'joint_acceleration', 'jacobian')  # from ``control/cycle/joint_motion.py``
FORCES = ('rod_force', 'spring_force', 'plate_load')  # from ``planning/limits/joint_forces.py``
ONE_COLUMN = (
    'tcp_error_norm',
    'tcp_speed',
    'payload',
    'fault',
    'lost_telegrams',
    'overruns',
    'cell_vacuum',
    'cell_payload',
    *SUPPLY_SIGNALS,
    *ROTARY_SIGNALS,
)


def columns_of(name: str, unit: str) -> list[tuple[str, str]]:
    """Return name and unit of each column of a signal; the name of a single column is empty."""
    names: Sequence[str] = 'xyz' if name.startswith('tcp_') else '123'
    if name in ONE_COLUMN:
        names = ('',)
    elif name in NAMED_COLUMNS:
        names = NAMED_COLUMNS[name]
    units = unit.split(', ')
    return list(zip(names, units if len(units) == len(names) else units * len(names), strict=True))

"""Tests of parameter files: the content of the default file, and messages of rejections."""

import dataclasses
import math
import re

import pytest
import yaml

from cases import for_each
from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError

FIELDS = {
    f'{group}.{field.name}': field
    for group, cls in parameters.groups().items()
    for field in dataclasses.fields(cls)
}
UNITS = re.compile(r'[\w.]+(_m|_s|_m2|_s2|_s3|_kg|_a|_v|_h|_ohm|_deg|_rad|_rpm|_hz|_w|_f|_n|_degc|_k_w|_1_k)')
SWITCHES = {name for name, field in FIELDS.items() if field.type is bool}
WORDS = {name for name, field in FIELDS.items() if field.type is str}
DIMENSIONLESS = (
    SWITCHES
    | WORDS
    | {
        'kinematics.serial_singularity_min',
        'kinematics.parallel_singularity_min',
        'drive.velocity_feedforward',
        'drive.current_feedforward',
        'drive.overspeed_factor',
        'dynamics.forearm_share_at_elbow',
        'dynamics.gear_in',
        'dynamics.gear_out',
        'motor.pole_pairs',
        'rich.cogging_periods',
        'rich.torque_ripple',
        'rich.sensor_seed',
        'rich.current_gain_error',
        'rich.encoder_periods',
        'bus.increments_per_rev',
        'bus.outstanding_cycles_max',
        'motion.following_error_delay_cycles',
        'motion.enable_cycle',
        'motion.start_cycle',
        'motor.coupling_effect',
        'control.shaping_damping',
        'supply.ready_share',
        'rich.frame_damping',
        'gear.life_exponent',
        'thermal.iron_loss_exponent',
        'thermal.motor_friction_share',
        'thermal.warm_friction_share',
        'thermal.time_factor',
        'thermal.fan_factor',
        *(f'{group}.{name}' for group in ('rotary', 'rotary_2') for name in ('pole_pairs', 'gear_ratio')),
        *(f'drive.notch_{number}_{name}' for number in (1, 2) for name in ('damping', 'depth')),
    }
)
CORRECTIONS = {name for name in FIELDS if '_correction_' in name}
SINGLE_MOTOR = {'motor.load_inertia_kg_m2', 'motor.load_torque_n_m', 'motor.coupling_effect'}
SIX_RODS = {
    f'rich.{name}'
    for name in (
        'parallelogram',
        'rod_spacing_m',
        'rod_difference_m',
        'plate_joint_height_m',
        'tool_length_m',
        'frame',
        'frame_mass_kg',
        'frame_frequency_hz',
        'frame_damping',
        'elastic_rods',
        'rod_stiffness_n_m',
    )
}
NOTCHES = {name for name in FIELDS if name.startswith('drive.notch_')}
GEARS = {'control.gear_stiffness_n_m_rad', 'control.gear_backlash_rad'}
SHAPING = {f'control.shaping{name}' for name in ('', '_frequency_hz', '_damping')}
IN_POSITION = {'drive.position_window_rad', 'motion.in_position_time_s', 'motion.in_position_timeout_s'}
ROTARY = {name for name in FIELDS if name.startswith('rotary')}
SUPPLY = {name for name in FIELDS if name.startswith('supply')}
OPTIONAL = CORRECTIONS | SINGLE_MOTOR | SIX_RODS | NOTCHES | GEARS | IN_POSITION | SHAPING | ROTARY | SUPPLY
RING = {
    f'bus.{name}' for name in ('timing', 'baud_rate_mbit_s', 'fibre_length_m', 'slave_delay_s', 'jitter_s')
}
OPTIONAL |= {'motion.tcp_speed_limit_m_s', 'drive.excitation_rms_a', 'drive.excitation_time_s'} | RING
OPTIONAL |= {'drive.disturbance_bandwidth_hz', 'drive.disturbance_inertia_kg_m2'}
OPTIONAL |= {
    name
    for name in FIELDS
    if name.startswith(('gear.', 'joints.', 'thermal.', 'mounting.', 'commissioning.'))
}
PRINTED_IN_THE_THESIS = {  # 2.2.3, 4.2, 4.8.1, 8.1, 11.1.1 and Fig. 9.3
    'kinematics.arm_azimuth_deg': (0.0, 120.0, 240.0),
    'bus.cycle_time_s': 1e-3,
    'bus.increments_per_rev': 2**19,
    'dynamics.forearm_share_at_elbow': 2 / 3,
    'motion.home_m': (0.0, 0.0, -0.75),
    'motor.peak_current_a': 17.0,
    'motor.nominal_current_a': 4.10,
    'motor.max_speed_rpm': 6000.0,
    'motor.torque_constant_n_m_a': 0.78,
    'motor.rotor_inertia_kg_m2': 0.58e-4,
    'motor.brake_inertia_kg_m2': 0.227e-4,
    'motor.winding_resistance_ohm': 2.7,
    'motor.winding_inductance_h': 13.0e-3,
    'motor.pole_pairs': 3,
}
CHOSEN = {  # what the derived figures of the parameter study were computed with
    'kinematics.upper_arm_length_m': 0.400,
    'kinematics.forearm_length_m': 0.950,
    'kinematics.base_radius_m': 0.200,
    'kinematics.plate_radius_m': 0.050,
    'drive.position_period_s': 250e-6,
    'drive.velocity_period_s': 125e-6,
    'drive.current_period_s': 62.5e-6,
    'drive.position_gain_rad_s_rad': 60.0,
    'drive.velocity_gain_a_s_rad': 0.35,
    'drive.velocity_integral_gain_a_rad': 20.0,
    'drive.current_gain_v_a': 30.0,
    'drive.current_integral_gain_v_a_s': 15000.0,
    'drive.feedforward_inertia_kg_m2': 6.41e-4,
    'drive.observer_arm_inertia_kg_m2': 0.9425,
    'drive.current_reference_filter_s': 2.0e-4,
    'drive.dc_link_voltage_v': 560.0,
    'drive.velocity_limit_rad_s': 6000.0 * math.tau / 60.0,  # of the motor, and so no limit
    'drive.torque_limit_n_m': 0.78 * 17.0,
    'dynamics.upper_arm_mass_kg': 1.30,
    'dynamics.elbow_mass_kg': 0.25,
    'dynamics.forearm_mass_kg': 0.45,
    'dynamics.plate_mass_kg': 0.85,
    'dynamics.payload_mass_kg': 0.50,
    'dynamics.gravity_m_s2': 9.81,
    'dynamics.gear_in': 32.0,
    'dynamics.gear_out': 1.0,
    'motor.viscous_friction_n_m_s_rad': 3.0e-4,
    'motor.static_friction_n_m': 0.10,
    'motor.friction_smoothing_rad_s': 1.0,
}


@pytest.fixture
def values(robot):
    """Return the default values by dotted name, to be spoilt."""
    return parameters.flatten(robot, absent=True)


@pytest.fixture
def tree():
    """Return the default file as a mapping of groups."""
    text = (parameters.config_directory() / parameters.DEFAULT_FILE).read_text(encoding='utf-8')
    return yaml.safe_load(text)['/**']['ros__parameters']


@pytest.fixture
def load_tree(tmp_path):
    """Return a function that writes a mapping of groups to a file and loads it."""

    def load(tree):
        path = tmp_path / 'robot.yaml'
        path.write_text(yaml.safe_dump({'/**': {'ros__parameters': tree}}), encoding='utf-8')
        return parameters.load(path)

    return load


def refusal(function, *arguments):
    """Return the message of a rejected call."""
    with pytest.raises(ParameterError) as caught:
        function(*arguments)
    sentence = str(caught.value)
    assert '\n' not in sentence
    assert sentence
    return sentence


def with_item(value, item):
    """Return ``value``, a tuple or a scalar, with its last number replaced."""
    return (*value[:2], item) if isinstance(value, tuple) else item


def replace(robot, name, value):
    return robot.replace(**{name.replace('.', '__'): value})


@for_each('name', FIELDS)
def test_every_parameter_has_a_description_a_range_and_a_unit(name):
    metadata = FIELDS[name].metadata
    assert metadata['description']
    if name in WORDS:
        assert all(choice in metadata['description'] for choice in metadata['choices'])
    else:
        assert math.isfinite(metadata['low'])
        assert metadata['low'] < metadata['high']
    assert (name in DIMENSIONLESS) != bool(UNITS.fullmatch(name))


@pytest.mark.parametrize('name', sorted(WORDS))
def test_unknown_word_is_rejected(name, robot):
    choices = FIELDS[name].metadata['choices']
    for choice in choices:
        assert parameters.flatten(replace(robot, name, choice))[name] == choice
    told = refusal(replace, robot, name, choices[0][:-1])
    assert told.endswith(
        f"{name} is '{choices[0][:-1]}', but must be one of {', '.join(choices)}: did you mean {choices[0]}?"
    )


@for_each('name', sorted(FIELDS.keys() - WORDS))
def test_every_default_lies_in_its_range(name, robot):
    value = parameters.flatten(robot, absent=True)[name]
    low, high = FIELDS[name].metadata['low'], FIELDS[name].metadata['high']
    for number in value if isinstance(value, tuple) else [value]:
        assert low <= number <= high
        assert math.isfinite(number)


@for_each(('name', 'value'), (PRINTED_IN_THE_THESIS | CHOSEN).items())
def test_default_robot_is_that_of_the_thesis(name, value, robot):
    assert parameters.flatten(robot)[name] == value


def test_the_file_holds_every_parameter_and_no_other(tree):
    assert {f'{group}.{key}' for group, values in tree.items() for key in values} == set(
        parameters.flatten(parameters.load())
    )


@for_each('name', sorted(FIELDS.keys() - OPTIONAL - WORDS))
def test_a_missing_parameter_is_named(name, values):
    others = {key: value for key, value in values.items() if key != name}
    assert f'missing parameter {name}' in refusal(parameters.from_flat, others)


def test_a_file_without_load_of_a_single_motor_and_six_rods_has_those_of_the_packaged_one(values, robot):
    for name in (*SINGLE_MOTOR, *SIX_RODS, 'dynamics.arm_coupling'):
        del values[name]
    assert parameters.from_flat(values) == robot


def test_a_file_without_an_interpolation_has_that_of_the_thesis(values, robot):
    del values['drive.interpolation']
    assert parameters.from_flat(values) == robot
    assert robot.drive.interpolation == 'linear'


def test_a_file_without_a_calibration_has_equal_arms(values, robot):
    assert len(CORRECTIONS) == 5
    for name in CORRECTIONS:
        del values[name]
    assert parameters.from_flat(values) == robot
    k = robot.kinematics
    assert k.upper_arm_lengths_m == (k.upper_arm_length_m,) * 3
    assert k.forearm_lengths_m == (k.forearm_length_m,) * 3
    assert k.base_radii_m == (k.base_radius_m,) * 3


@for_each('name', FIELDS)
def test_a_misspelt_parameter_is_named(name, values):
    misspelt = values | {f'{name}x': values[name]}
    assert f'unknown parameter {name}x' in refusal(parameters.from_flat, misspelt)


@for_each('name', sorted(FIELDS.keys() - WORDS))
@for_each('wrong', ['fast', '1.0', bool, None, {'a': 1}, [1.0, 2.0]])
def test_a_value_of_the_wrong_type_is_named(name, wrong, robot, values):
    if wrong is bool:  # a switch is no number, and a number no switch
        wrong = 1 if name in SWITCHES else True
    for value in wrong, with_item(values[name], wrong):
        assert re.search(
            rf'{name}\S* (is .*, but )?must be (a|true or false)', refusal(replace, robot, name, value)
        )


@for_each('name', sorted(FIELDS.keys() - SWITCHES - WORDS))
def test_a_value_out_of_range_is_named_with_its_rule(name, robot, values):
    low, high = FIELDS[name].metadata['low'], FIELDS[name].metadata['high']
    if FIELDS[name].type is int:
        outside = [low - 1, high + 1]
    else:
        outside = [low - 1.0, -math.inf, math.nan, *([high + 1.0, math.inf] if high < math.inf else [])]
    for value in outside:
        sentence = refusal(replace, robot, name, with_item(values[name], value))
        assert re.search(rf'{name}\S* (is \S+, but )?must be ', sentence)


def test_file_and_arguments_give_the_same_texts(tree, load_tree):
    tree['motor']['peak_current_a'] = -17.0
    told = refusal(load_tree, tree)
    assert told.endswith(': motor.peak_current_a is -17, but must be positive and at most 1000')
    del tree['motor']['peak_current_a']
    assert refusal(load_tree, tree).endswith('robot.yaml: missing parameter motor.peak_current_a')


@pytest.mark.parametrize('name', sorted(WORDS))
@pytest.mark.parametrize('wrong', [1.0, True, None, {'a': 1}, [1.0, 2.0]], ids=repr)
def test_unknown_word_is_named(name, wrong, robot):
    assert f'{name} is {wrong!r}, but must be one of ' in refusal(replace, robot, name, wrong)


@pytest.mark.parametrize('name', [name for name, field in FIELDS.items() if field.type is int])
def test_counts_are_whole_numbers(name, robot):
    assert f'{name} is 1500.5, but must be a whole number' in refusal(replace, robot, name, 1500.5)


@pytest.mark.parametrize('name', ['motion.jerk_max_m_s3', 'motor.pole_pairs', 'kinematics.arm_azimuth_deg'])
@pytest.mark.parametrize('digits', [400, 5000])
def test_a_number_beyond_all_machine_numbers_is_rejected(name, digits, robot, values):
    assert name in refusal(replace, robot, name, with_item(values[name], 16**digits))


@pytest.mark.parametrize(
    ('change', 'rule'),
    [
        ({'bus__cycle_time_s': 3e-3}, 'bus.cycle_time_s is 0.003, but must be 0.001, 0.002 or 0.004'),
        (
            {'bus__exchange_period_s': 750e-6},
            'bus.exchange_period_s is 0.00075, but must be 125e-6, 250e-6, 500e-6 or 0.001',
        ),
        (
            {'drive__velocity_period_s': 100e-6},
            'drive.velocity_period_s is 0.0001, but must be a whole multiple of',
        ),
        (
            {'drive__position_period_s': 300e-6},
            'drive.position_period_s is 0.0003, but must be a whole multiple of',
        ),
        ({'drive__position_period_s': 375e-6}, 'bus.cycle_time_s is 0.001, but must be a whole multiple of'),
        (
            {'drive__velocity_period_s': 250e-6, 'bus__exchange_period_s': 125e-6},
            'bus.exchange_period_s is 0.000125, but must be a whole multiple of',
        ),
        (
            {'kinematics__plate_radius_m': 0.3},
            'kinematics.plate_radius_m is 0.3, but must not exceed base_radius_m',
        ),
        (
            {'kinematics__workspace_bottom_m': -0.7},
            'workspace_bottom_m is -0.7, but must lie below workspace_top_m',
        ),
        (
            {'dynamics__end_stop_min_deg': -40.0},
            'end_stop_min_deg must not lie above kinematics.arm_angle_min_deg',
        ),
        (
            {'dynamics__end_stop_max_deg': 90.0},
            'end_stop_max_deg must not lie below kinematics.arm_angle_max_deg',
        ),
        (
            {'kinematics__arm_azimuth_deg': (0.0, 120.0, 360.0)},
            'kinematics.arm_azimuth_deg is (0.0, 120.0, 360.0), but the arms must differ in direction',
        ),
        (
            {
                'rich__enabled': True,
                'bus__exchange_period_s': 125e-6,
                'rich__break_away_torque_n_m': 0.09,
            },
            'rich.break_away_torque_n_m is 0.09, but must not be less than motor.static_friction_n_m (0.1)',
        ),
        (
            {'rich__enabled': True, 'bus__exchange_period_s': 500e-6},
            'rich.gear needs a bus.exchange_period_s of at most 0.00025, not 0.0005',
        ),
        ({'motor__nominal_curent_a': 4.0}, 'unknown parameter motor.nominal_curent_a'),
    ],
)
def test_rules_between_parameters_name_both(change, rule, robot):
    assert rule in refusal(lambda: robot.replace(**change))


def test_disabled_effect_sets_no_limit(robot):
    plain = robot.replace(motor__static_friction_n_m=0.3)
    assert plain.motor.static_friction_n_m > plain.rich.break_away_torque_n_m
    without_friction = {'rich__enabled': True, 'rich__friction': False, 'bus__exchange_period_s': 125e-6}
    assert plain.replace(**without_friction).rich.enabled
    with pytest.raises(ParameterError, match='break_away'):
        plain.replace(rich__enabled=True, bus__exchange_period_s=125e-6)


@pytest.mark.parametrize('cycle_time_s', [1e-3, 2e-3, 4e-3])
@pytest.mark.parametrize('exchange_period_s', [125e-6, 250e-6, 500e-6, 1e-3])
def test_every_bus_cycle_is_compatible_with_every_exchange_period(cycle_time_s, exchange_period_s, robot):
    bus = robot.replace(bus__cycle_time_s=cycle_time_s, bus__exchange_period_s=exchange_period_s).bus
    assert (bus.cycle_time_s, bus.exchange_period_s) == (cycle_time_s, exchange_period_s)


def test_the_rich_robot_is_the_default_one_with_its_effects_on(robot):
    rich = parameters.load('rich')
    assert rich == robot.replace(rich__enabled=True, bus__exchange_period_s=125e-6)
    assert rich.rich.effects == rich.rich
    for path in ('built', 'rich.yaml', parameters.config_directory() / 'rich.yaml'):
        assert parameters.load(path) == rich
    assert parameters.load('delta3') == parameters.load('delta3.yaml') == robot


def test_a_file_may_name_its_plant(tmp_path, robot):
    text = (parameters.config_directory() / 'delta3.yaml').read_text(encoding='utf-8')
    file = tmp_path / 'own.yaml'
    for plant, enabled in (('rich', True), ('plain', False)):
        named = text.replace('  ros__parameters:\n', f'  ros__parameters:\n    plant: {plant}\n')
        file.write_text(named.replace('exchange_period_s: 1.0e-3', 'exchange_period_s: 125.0e-6'))
        assert parameters.load(file) == robot.replace(rich__enabled=enabled, bus__exchange_period_s=125e-6)
    file.write_text(text.replace('  ros__parameters:\n', '  ros__parameters:\n    plant: poor\n'))
    assert "plant is 'poor', but must be plain or rich" in refusal(parameters.load, file)


def test_without_enabled_no_effect_is_on(robot):
    off = parameters.flatten(robot.replace(rich__enabled=False), absent=True)
    on = {name for name in SWITCHES if off[name] and name.startswith('rich.')}
    assert on  # they stand ready
    assert not any(getattr(robot.rich.effects, name.removeprefix('rich.')) for name in on)


def test_user_file_has_priority_over_the_packaged_one_of_its_name(robot, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parameters.write(robot.replace(rich__sensor_seed=7), tmp_path / 'rich.yaml')
    assert parameters.load('rich.yaml').rich.sensor_seed == 7
    (tmp_path / 'rich.yaml').write_text('/**: {ros__parameters: {rich: {enabled: true}}}')
    assert 'missing parameter group kinematics' in refusal(parameters.load, 'rich.yaml')
    assert refusal(parameters.load, 'richer').startswith('cannot read parameter file richer')


def test_a_folder_hides_no_packaged_file_of_its_name(tmp_path, monkeypatch):
    wanted = {name: parameters.load(name).checksum for name in ('rich', 'model+rotary')}
    for name in ('rich', 'model', 'rotary'):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    assert {name: parameters.load(name).checksum for name in wanted} == wanted
    # the controller that a program of the thesis has, too
    (tmp_path / 'experiment1').mkdir()
    assert parameters.of_run(None, 'experiment1') == parameters.THESIS_CONTROLLER


def test_all_errors_of_a_file_are_reported_with_their_places(tmp_path):
    default = parameters.config_directory() / parameters.DEFAULT_FILE
    lines = default.read_text(encoding='utf-8').splitlines()
    path = tmp_path / 'robot.yaml'
    expected = []
    changes = {
        'torque_constant_n_m_a: ': ('torque_constant_n_m_a: fast', 'must be a number'),
        'peak_current_a: ': (
            'peak_curent_a: 5.0',
            'unknown parameter motor.peak_curent_a: did you mean peak_current_a?',
        ),
    }
    for number, line in enumerate(lines[: lines.index('    bus:')]):
        for key, (changed, reason) in changes.items():
            if line.strip().startswith(key):
                indent = len(line) - len(line.lstrip())
                lines[number] = line[:indent] + changed
                column = indent + 1 + (changed.index(' ') + 1 if reason.startswith('must') else 0)
                expected.append((f'{path}:{number + 1}:{column}: ', reason))
    path.write_text('\n'.join(lines))
    errors = refusal(parameters.load, path).split('; ')
    assert len(expected) == 2
    assert errors[0] == f'{path}: missing parameter motor.peak_current_a'
    assert len(errors) == 3
    for place, reason in expected:
        (told,) = [error for error in errors if error.startswith(place)]
        assert reason in told


BOMB = 'a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\n'


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (b'', 'not a ROS parameter file'),
        (b'# nothing but a comment\n', 'not a ROS parameter file'),
        (b'just a text', 'not a ROS parameter file'),
        (b'[1, 2]', 'not a ROS parameter file'),
        (b'/**: {other: {}}', 'not a ROS parameter file'),
        (b'/**: {ros__parameters: 5}', 'not a ROS parameter file'),
        (b'a: {ros__parameters: {}}\nb: {ros__parameters: {}}', 'not a ROS parameter file'),
        (b'/**: {ros__parameters: {}}', 'missing parameter group'),
        (b'/**: {ros__parameters: {legs: {}}}', 'unknown parameter group legs'),
        (b'/**: {ros__parameters: {motor: 5}}', 'missing parameter group'),
        (b'/**: {ros__parameters: {1: 2}}', 'unknown parameter group 1'),
        (BOMB.encode(), 'aliases are not allowed'),
        (b'a: 1\nb: {c: 1, c: 2}', ":2:11: parameter file is not valid YAML: the key 'c' occurs twice"),
        (b'{[a]: 1, [a]: 2}', 'is not valid YAML'),
        (b'a: {<<: {b: 1}}', 'is not valid YAML'),
        (b'a: !!python/object/apply:os.getcwd []', 'is not valid YAML'),
        (b'a: 1\n---\nb: 2', 'is not valid YAML'),
        (b'a: [1', 'is not valid YAML'),
        (b'a: 2026-99-99', 'not a ROS parameter file'),  # a text
        (b'[' * 20_000, 'is not valid YAML'),
        (b'a: \xff\xfe', 'is not valid YAML'),
        (b'a: \x00', 'is not valid YAML'),
        (b'#' * (4 * 1024 * 1024 + 1), 'larger than 4 MiB'),
    ],
    ids=lambda value: repr(value)[:40] if isinstance(value, bytes) else '',
)
def test_hostile_file_is_rejected_with_one_message(content, reason, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_bytes(content)
    sentence = refusal(parameters.load, path)
    assert reason in sentence
    assert str(path) in sentence


def test_missing_file_is_rejected_with_one_message(tmp_path):
    assert 'cannot read parameter file' in refusal(parameters.load, tmp_path)
    assert 'cannot read parameter file' in refusal(parameters.load, tmp_path / 'missing.yaml')


def test_equal_values_have_equal_checksums(robot, tree, load_tree):
    assert load_tree(tree).checksum == parameters.load().checksum == robot.replace().checksum
    assert load_tree(dict(reversed(tree.items()))).checksum == robot.checksum


def with_procedures(robot, name, changed):
    """Return a robot on which data of procedures count; they do not if the drives know all offsets."""
    if name == 'drive.disturbance_inertia_kg_m2':
        return robot.replace(drive__disturbance_bandwidth_hz=20.0)
    if not name.startswith('commissioning.'):
        return robot
    assert replace(robot, name, changed).checksum == robot.checksum
    return robot.replace(mounting__commissioned=False)


@for_each('name', FIELDS)
def test_checksum_depends_on_the_last_bit_of_every_value(name, robot, values):
    if name == 'bus.cycle_time_s':
        robot = robot.replace(bus__exchange_period_s=500e-6)
        changed = 2e-3
    elif name == 'bus.exchange_period_s':
        changed = 500e-6
    elif isinstance(values[name], tuple):
        changed = (*values[name][:2], math.nextafter(values[name][2], math.inf))
    elif name in SWITCHES:
        changed = not values[name]
        robot = robot.replace(bus__exchange_period_s=125e-6)
    elif name in WORDS:
        changed = next(word for word in FIELDS[name].metadata['choices'] if word != values[name])
    elif name == 'bus.baud_rate_mbit_s':
        changed = 8
    elif isinstance(values[name], int):
        changed = values[name] + 1
    elif name.endswith('_hz'):  # nothing lies right beside off
        robot, changed = replace(robot, name, 210.0), math.nextafter(210.0, math.inf)
    else:
        changed = math.nextafter(values[name], math.inf)
    if name in ROTARY - {'rotary.present', 'rotary_2.present'}:  # what is not there does not count
        assert replace(robot, name, changed).checksum == robot.checksum
        robot = robot.replace(rotary__present=True, rotary_2__present=name.startswith('rotary_2.'))
    if name in RING - {'bus.timing'}:  # the timing of the thesis has no ring
        assert replace(robot, name, changed).checksum == robot.checksum
        robot = robot.replace(bus__timing='sercos2')
    if name in SUPPLY - {'supply.enabled'}:
        assert replace(robot, name, changed).checksum == robot.checksum
        robot = robot.replace(supply__enabled=True)
    group, key = name.split('.')
    robot = with_procedures(robot, name, changed)
    if group in ('gear', 'joints') and key != 'limit_moves':
        robot = robot.replace(**{f'{group}__limit_moves': False})
        assert replace(robot, name, changed).checksum == robot.checksum
        robot = robot.replace(**{f'{group}__limit_moves': True})
    if name == 'rotary_2.present':
        robot = robot.replace(rotary__present=True)
    if group == 'thermal' and key != 'in_drives':
        assert replace(robot, name, changed).checksum == robot.checksum
        robot = robot.replace(thermal__in_drives=True)
    assert replace(robot, name, changed).checksum != robot.checksum


def test_parameters_are_immutable(robot):
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.motor.peak_current_a = 20.0


def test_derived_quantities_follow_the_thesis(robot):
    changed = robot.replace(dynamics__gear_in=60.0, dynamics__gear_out=4.0, dynamics__payload_mass_kg=2.0)
    assert changed.dynamics.gear_ratio == 15.0
    assert changed.dynamics.plate_total_mass_kg == pytest.approx(0.85 + 2.0 + 0.45, rel=1e-15)
    assert robot.kinematics.radius_difference_m == pytest.approx(0.15, rel=1e-15)
    assert robot.motor.max_speed_rad_s == pytest.approx(200.0 * math.pi, rel=1e-15)


@pytest.mark.parametrize(('cycle_time_s', 'delay'), [(1e-3, 2.75), (2e-3, 2.875), (4e-3, 2.9375)])
def test_dead_time_of_the_following_error_results_from_the_timing(cycle_time_s, delay, robot):
    slow = robot.replace(bus__cycle_time_s=cycle_time_s, bus__exchange_period_s=125e-6)
    assert slow.following_error_delay_cycles == pytest.approx(delay, rel=1e-12)
    assert slow.replace(motion__following_error_delay_cycles=0.0).following_error_delay_cycles == 0.0
    later = slow.replace(bus__timing='sercos2')
    assert later.set_point_delay_cycles == slow.set_point_delay_cycles + 1.0
    assert later.following_error_delay_cycles == slow.following_error_delay_cycles + 1.0

"""The same program gives the same bits in every environment."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.planning import learned_torques
from delta3_pacdrive.planning.learned_torques import Learned, Origin
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.bags.bag_reader import open_bag
from delta3_pacdrive.recording.signals import JOINT_MOTION
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER
from delta3_pacdrive.studies.runs import derived_signals, runs, trace_export
from delta3_pacdrive.studies.runs.run_signals import energy_of_round, temperatures_of_round
from same_bits import FIGURES, assert_same, assert_same_where_recorded
from thoroughness import some

Runner = Callable[..., subprocess.CompletedProcess[str]]
LONG = pytest.mark.long
ONE_PROCESS = ['--single-process']


@pytest.fixture(scope='module')
def simulated() -> Trace:
    robot = parameters.load()
    return simulation.run(programs.load('experiment1', robot.motion), robot)


@pytest.fixture
def busy_processor() -> Iterator[None]:
    """Keep one core busy."""
    hog = subprocess.Popen([sys.executable, '-c', 'while True: pass'])
    yield
    hog.kill()
    hog.wait()


# every kind of move, rounded corners, outputs and payloads
MIXED = """
start_m: [-0.1525, 0.0, -0.85]
payload_kg: 0.0
limits: {speed_m_s: 3.0, acceleration_m_s2: 60.0, jerk_m_s3: 8000.0}
moves:
- output: {name: gripper, value: true, payload_kg: 0.7}
- dwell: {time_s: 0.0305}
- move_l: {to_m: {by_m: [0.0, 0.0, 0.025]}, blend_m: 0.02}
- move_l: {to_m: {by_m: [0.305, 0.0, 0.0]}, blend_m: 0.02}
- output: {name: output1, value: true}
- move_c: {via_m: [0.1, 0.1, -0.85], to_m: [0.0, 0.15, -0.84]}
- output: {name: gripper, value: false, before_m: 0.01, payload_kg: 0.0}
- output: {name: output3, value: true, after_s: 0.1207}
- dwell: {time_s: 0.15}
- move_sb: {through_m: [[-0.1, 0.05, -0.82], [-0.12, -0.1, -0.83], [0.0, 0.0, -0.85]]}
- output: {name: output2, value: true, before_s: 0.0323}
- cubic: {to_m: [0.05, 0.0, -0.84], duration_s: 0.15, end_velocity_m_s: [0.3, 0.1, 0.0]}
- cubic: {to_m: [0.1, 0.05, -0.85], duration_s: 0.2}
- joints:
    points:
    - {time_s: 0.3, angles_rad: [0.3, 0.35, 0.4], speeds_rad_s: [0.1, 0, 0]}
    - {time_s: 0.6, angles_rad: [0.35, 0.3, 0.35], speeds_rad_s: [0, 0, 0]}
"""


def _run(delta3: Runner, bag: Path, *options: str, program: str = 'experiment1') -> tuple[Trace, dict]:
    done = delta3('run', program, '--json', '--bag', bag, *options)
    assert done.returncode == 0, done.stderr
    return trace_file.load(bag), json.loads(done.stdout)


@pytest.mark.parametrize(
    'options',
    [
        pytest.param(['--real-time-factor', '0'], id='separate processes as fast as possible'),
        pytest.param(
            [*ONE_PROCESS, '--real-time-factor', '0'], id='one process as fast as possible', marks=LONG
        ),
        pytest.param([*ONE_PROCESS, '--namespace', 'cell2'], id='in real time', marks=pytest.mark.real_time),
    ],
)
def test_graph_gives_the_bits_of_the_simulation(
    options: list[str], simulated: Trace, delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    recorded, result = _run(delta3, tmp_path / 'bag', '--logs', str(tmp_path / 'logs'), *options)
    assert_same(simulated, recorded, result)
    assert result['lost_telegrams'] == 0
    assert {'cycles', 'bus_time_s', 'wall_time_s', 'overruns'} <= result.keys()
    if ONE_PROCESS[0] not in options:
        logs = {path.stem: path.read_text(encoding='utf-8') for path in (tmp_path / 'logs').glob('*.log')}
        drives = {f'mc4_drive_{axis}' for axis in (1, 2, 3)}
        assert logs.keys() == drives | {'plant', 'transformation_task', 'unit_robot', 'recorder'}
        assert 'bus phase CP4' in logs['transformation_task']


@pytest.mark.long
def test_joint_motion_on_line_has_the_bits_that_a_trace_gives(
    simulated: Trace, delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    """It is in the bag; of cycles that a recorder on a busy machine may miss nothing is known."""
    recorded, _ = _run(delta3, tmp_path / 'bag', '--real-time-factor', '0', '--joint-motion')
    store, told = get_typestore(Stores.ROS2_JAZZY), {'joint_motion': {}, 'jacobian': {}}

    def take(name: str, kind: str) -> Callable[[bytes], None]:
        def note(data: bytes) -> None:
            message = store.deserialize_cdr(data, kind)
            vector = getattr(message, 'vector', None)
            stamp = message.header.stamp
            told[name][(stamp.sec * 1_000_000_000 + stamp.nanosec) // 1_000_000] = (
                [*message.velocity, *message.effort] if vector is None else [vector.x, vector.y, vector.z]
            )

        return note

    open_bag(tmp_path / 'bag').read(
        {
            '/joint_motion': take('joint_motion', 'sensor_msgs/msg/JointState'),
            '/jacobian': take('jacobian', 'geometry_msgs/msg/Vector3Stamped'),
        }
    )
    found = derived_signals.on_request(simulated, JOINT_MOTION)
    wanted = {
        'joint_motion': np.hstack([found['joint_speed'], found['joint_acceleration']]),
        'jacobian': found['jacobian'],
    }
    for name, values in wanted.items():
        inside = [cycle for cycle in told[name] if 0 < cycle < len(values) - 1]
        assert len(inside) > 300, name
        for cycle in inside:
            assert told[name][cycle] == values[cycle].tolist(), (name, cycle)
    of_bag = derived_signals.on_request(recorded, JOINT_MOTION)
    cycles = np.rint(recorded.time_s / 1e-3).astype(int)
    for row in np.flatnonzero(np.diff(cycles, 2) == 0)[:1000] + 1:
        if cycles[row + 1] - cycles[row] == 1 and cycles[row] in told['jacobian']:
            assert of_bag['jacobian'][row].tolist() == told['jacobian'][cycles[row]], cycles[row]


@pytest.mark.long
def test_bag_and_simulation_record_the_same_changes(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    robot = parameters.load(parameters.of_run(None, 'packaging'))
    names = ['payload', 'outputs', 'fault', 'lost_telegrams', 'status_word']
    simulated = simulation.run(programs.load('packaging', robot.motion), robot, signals=names)
    simulated = trace_export.completed(simulated, names)
    recorded, _ = _run(delta3, tmp_path / 'bag', '--real-time-factor', '0', program='packaging')
    found = trace_export.completed(recorded, [*names, 'overruns'])
    cycles = [np.rint(trace.time_s / 1e-3).astype(int) for trace in (simulated, found)]
    common, ours, theirs = np.intersect1d(*cycles, return_indices=True)
    assert len(common) > 3000
    for name in names:
        np.testing.assert_array_equal(found[name][theirs], simulated[name][ours], err_msg=name)
    assert found['outputs'][:, 0].max() == 1.0
    assert found['overruns'].max() == 0.0  # there is no clock


# exact stops at which the robot is not there at once, so that the motion depends on its answers
WAITS = """
start_m: [0.0, 0.0, -0.75]
payload_kg: 10
in_position: true
limits: {speed_m_s: 1.0, acceleration_m_s2: 15.0}
moves:
- move_l: {to_m: [0.0, 0.5, -0.9]}
- output: {name: gripper, value: true}
- move_l: {to_m: [0.0, 0.0, -0.75]}
"""


@pytest.mark.long
def test_waits_for_the_robot_take_as_long_in_the_graph_as_in_the_simulation(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program = tmp_path / 'waits.yaml'
    program.write_text(WAITS)
    robot = parameters.load('delta3')
    simulated = simulation.run(programs.load(program, robot.motion), robot)
    options = ['--real-time-factor', '0', '--parameters', 'delta3']
    recorded, result = _run(delta3, tmp_path / 'bag', *options, program=str(program))
    assert_same(simulated, recorded, result)
    planned = simulation.plan_of(programs.load(program, robot.motion), robot).plan.duration_s
    assert simulated.meta['end_cycle'] > simulated.meta['start_cycle'] + planned / 1e-3 + 50


@pytest.mark.long
def test_a_busy_processor_changes_no_bit_in_real_time(
    simulated: Trace, delta3: Runner, tmp_path: Path, nothing_left_behind: None, busy_processor: None
) -> None:
    recorded, result = _run(delta3, tmp_path / 'bag')
    assert len(assert_same_where_recorded(simulated, recorded, 1e-3)) > 300
    for name in FIGURES:
        assert result[name] == simulated.meta['figures'][name], name


@pytest.mark.parametrize(
    'source',
    some(['rich', 'rich+model+gears', 'rich+model+gears+sercos2'], ['rich+model+gears+sercos2']),
)
def test_the_rich_robot_gives_the_bits_of_its_simulation(
    source: str, delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    """The noise of each drive's sensors, and the time at which set points take effect, are those of the simulation."""
    robot = parameters.load(source)
    simulated = simulation.run(programs.load('experiment1', robot.motion), robot)
    options = [*ONE_PROCESS, '--real-time-factor', '0', '--parameters', source]
    assert_same(simulated, *_run(delta3, tmp_path / 'bag', *options))


@pytest.mark.parametrize(
    'options', some([[], ONE_PROCESS], [ONE_PROCESS]), ids=['separate processes', 'one process']
)
def test_feed_forward_of_the_model_gives_the_bits_of_its_simulation(
    options: list[str], delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    """Set points have additional torques, payloads change them, and a notch filter delays them."""
    program, model = tmp_path / 'mixed.yaml', tmp_path / 'model.yaml'
    program.write_text(MIXED)
    robot = parameters.load().replace(
        control__feed_forward='model', drive__interpolation='cubic', drive__notch_1_frequency_hz=210.0
    )
    parameters.write(robot, model)
    simulated = simulation.run(programs.load(program, robot.motion), robot)
    options = ['--real-time-factor', '0', '--parameters', str(model), *options]
    recorded, result = _run(delta3, tmp_path / 'bag', *options, program=str(program))
    assert_same(simulated, recorded, result)
    cycles = len(simulated.time_s)
    np.testing.assert_array_equal(recorded['torque_command'][:cycles], simulated['torque_command'])


@pytest.mark.long
def test_time_optimal_arches_give_the_bits_of_their_simulation(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    """Their shapes, too, are found alike in every process."""
    robot = parameters.load('model')
    simulated = simulation.run(programs.load('packaging_fast', robot.motion), robot)
    options = ['--real-time-factor', '0', '--parameters', 'model']
    recorded, result = _run(delta3, tmp_path / 'bag', *options, program='packaging_fast')
    assert_same(simulated, recorded, result)
    assert result['energy'] == asdict(energy_of_round(simulated, robot, 10))
    temperature = asdict(temperatures_of_round(simulated, robot))
    assert result['temperature'] == {
        name: list(value) if isinstance(value, tuple) else value for name, value in temperature.items()
    }
    assert [one for one in result['warnings'] if one.startswith('the winding of motor 1 reaches 140 degC')]


@pytest.mark.long
def test_running_robot_receives_the_set_points_of_the_simulation(
    delta3: Runner,
    start_delta3: Callable[..., subprocess.Popen[str]],
    tmp_path: Path,
    nothing_left_behind: None,
) -> None:
    """Also of time-optimal arches over ten rounds, sent by ``move program``."""
    robot = parameters.load()
    program = programs.load('packaging_fast', robot.motion)
    simulated = simulation.run(program, robot)
    parameters.write(simulation.placed(robot, program), tmp_path / 'robot.yaml')
    process = start_delta3(
        'up', '--single-process', '--parameters', tmp_path / 'robot.yaml', '--bag', tmp_path / 'bag'
    )
    assert delta3('move', 'wait').returncode == 0
    moved = delta3('move', 'program', 'packaging_fast')
    assert moved.returncode == 0, moved.stderr
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 0, errors
    start, end = (simulated.meta[name] for name in ('start_cycle', 'end_cycle'))
    expected = simulated['motor_command'][start : end + 1]
    commands = trace_file.load(tmp_path / 'bag')['motor_command']
    first = np.flatnonzero((commands != commands[0]).any(axis=1))[0]
    moving = np.flatnonzero((expected != expected[0]).any(axis=1))[0]
    np.testing.assert_array_equal(commands[first - moving :][: len(expected)], expected)


@pytest.mark.long
def test_learned_torques_give_the_bits_of_their_simulation(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    robot = parameters.load('model')
    program = programs.load('experiment1', robot.motion)
    placed = simulation.placed(robot, program)
    plan = simulation.plan_of(program, placed).plan
    waves = 0.1 * np.sin(np.arange(500)[:, None] / np.array([7.0, 11.0, 13.0]))
    learned = Learned(waves, Origin.of('experiment1', plan, placed))
    file = learned_torques.save(learned, tmp_path / 'learned.npz')
    simulated = simulation.run(program, robot, learned=learned)
    options = ['--real-time-factor', '0', '--parameters', 'model', '--learned', str(file)]
    recorded, result = _run(delta3, tmp_path / 'bag', *options)
    assert_same(simulated, recorded, result)
    cycles = len(simulated.time_s)
    commanded = recorded['torque_command'][:cycles]
    np.testing.assert_array_equal(commanded, simulated['torque_command'])
    assert np.abs(commanded - simulation.run(program, robot)['torque_command']).max() > 0.09
    refused = delta3('run', 'experiment2', *options)
    assert refused.returncode == 1
    assert refused.stderr.splitlines()[-1].startswith(
        f'error: the learned torques of {file} do not fit: they belong'
    )


@pytest.mark.parametrize(
    'options', some([[], ONE_PROCESS], [ONE_PROCESS]), ids=['separate processes', 'one process']
)
def test_every_kind_of_move_gives_the_bits_of_the_simulation(
    options: list[str], delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program = tmp_path / 'mixed.yaml'
    program.write_text(MIXED)
    robot = parameters.load(parameters.of_run(None, program))
    simulated = simulation.run(programs.load(program, robot.motion), robot)
    bag = tmp_path / 'bag'
    recorded, result = _run(delta3, bag, '--real-time-factor', '0', *options, program=str(program))
    assert_same(simulated, recorded, result)
    _assert_same_story(runs.load(str(program)), runs.load(str(bag)))


@pytest.mark.long
def test_a_sampled_trajectory_gives_the_bits_of_its_simulation(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    robot = parameters.load()
    command = simulation.run(programs.load('experiment2', robot.motion), robot)
    trace_file.save(Trace(command.time_s + 7.0, {'tcp_command': command['tcp_command']}), tmp_path / 'a.csv')
    reference = ['--reference', tmp_path / 'a.csv', '--json']
    done = delta3('simulate', '--trace', tmp_path / 'a.npz', *reference)
    assert done.returncode == 0, done.stderr
    done = delta3('run', '--real-time-factor', '0', '--bag', tmp_path / 'bag', *reference)
    assert done.returncode == 0, done.stderr
    assert_same(
        trace_file.load(tmp_path / 'a.npz'), trace_file.load(tmp_path / 'bag'), json.loads(done.stdout)
    )


def _assert_same_story(simulated: runs.Run, recorded: runs.Run) -> None:
    """Moves and outputs of a recording are those of the simulation, in the first bus cycle from their time on."""

    def assert_cycle_of(time_s: float, exact_s: float) -> None:
        assert -1e-6 < time_s - exact_s < simulated.period_s + 1e-6

    assert recorded.robot == simulated.robot
    assert [move.kind for move in recorded.moves] == [move.kind for move in simulated.moves]
    for move, planned in zip(recorded.moves, simulated.moves, strict=True):
        assert_cycle_of(move.start_s, planned.start_s)
        assert_cycle_of(move.end_s, planned.end_s)
        assert move.length_m == planned.length_m
    told, expected = (
        [mark for mark in run.marks if mark.kind == runs.OUTPUT] for run in (recorded, simulated)
    )
    # a payload that is as it was before is no change
    assert [mark.text.partition(',')[0] for mark in told] == [
        mark.text.partition(',')[0] for mark in expected
    ]
    for mark, planned_mark in zip(told, expected, strict=True):
        assert_cycle_of(mark.time_s, planned_mark.time_s)


DISTURBED = """
start_m: [0.0, 0.0, -0.75]
moves:
- move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.8}
- move_l: {to_m: [0.0, 0.1, -0.8], speed_m_s: 0.8}
faults:
- {fault: drop_mdt, axis: axis1, after_s: 0.1}
- {fault: drop_at, axis: axis3, after_s: 0.15}
- {fault: overload, axis: axis2, torque_n_m: 3.0, after_s: 0.2, for_s: 0.05}
- {fault: encoder_noise, axis: axis1, noise_rad: 0.0002, after_s: 0.3}
- {fault: duplicate_mdt, axis: axis2, after_s: 0.35, cycles: 50}
- {fault: encoder_failure, axis: axis2, after_s: 0.5}
"""


@pytest.mark.parametrize(
    'options',
    [
        pytest.param(['--real-time-factor', '0'], id='separate processes, all outstanding cycles in use'),
        pytest.param(
            ['--single-process', '--real-time-factor', '0.25'],
            id='one process with time to spare, hardly any',
            marks=LONG,
        ),
    ],
)
def test_injected_faults_and_the_stop_give_the_bits_of_the_simulation(
    options: list[str], delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program = tmp_path / 'disturbed.yaml'
    program.write_text(DISTURBED)
    robot = parameters.load(parameters.of_run(None, program))
    simulated = simulation.run(programs.load(program, robot.motion), robot)
    done = delta3('run', program, '--bag', tmp_path / 'bag', *options)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f'error: {simulated.meta["stopped"]}'
    assert '8171' in done.stderr
    recorded = trace_file.load(tmp_path / 'bag')
    common = assert_same_where_recorded(simulated, recorded, robot.bus.cycle_time_s)
    # everything is on record, until all drives are without torque
    assert np.abs(simulated['current'][common[-1]]).max() == 0.0
    assert len(common) == common[-1] + 1


LINE = {
    'start_m': [0.0, 0.0, -0.75],
    'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.75], 'speed_m_s': 0.4}}],
}


LOST = [
    ('drop_mdt', 2, {}),
    ('delay_mdt', 8, {'by_cycles': 16}),
    ('corrupt_at', 20, {}),
    ('delay_at', 2, {'by_cycles': 1}),
    ('drop_at', 8, {}),
    *((kind, 20, {}) for kind in ('drop_mdt', 'drop_at', 'duplicate_at')),
    *((kind, 20, {'by_cycles': 3}) for kind in ('delay_mdt', 'delay_at')),
]


@pytest.mark.parametrize(
    ('kind', 'cycles', 'more'),
    some(LOST, LOST[:3]),
)
def test_however_many_telegrams_are_lost_the_graph_gives_the_bits_of_the_simulation(
    kind: str, cycles: int, more: dict, graph: Any, tmp_path: Path
) -> None:
    fault = {'fault': kind, 'axis': 'axis2', 'cycles': cycles, 'after_s': 0.25, **more}
    program = tmp_path / 'program.yaml'
    program.write_text(json.dumps(LINE | {'faults': [fault]}))
    robot = parameters.load()
    simulated = simulation.run(programs.load(program, robot.motion), robot)
    shafts = graph.listen(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
    graph.robot(('plant', '1', '2', '3'))
    task = graph.add(TransformationTaskNode, real_time_factor=0.0, wait_for_program=True)
    graph.add(UnitRobotNode, program=str(program))
    graph.spin_until(lambda: task.controller.answered >= len(simulated.time_s), 'the end')
    assert task.progress().fault.partition(':')[0] == simulated.meta['stopped'].partition(':')[0]
    clock = Clock(robot.bus.cycle_time_s)
    rows = {}
    for message in shafts:
        stamp = message.header.stamp
        if stamp.sec >= 0:
            rows[clock.count(stamp.sec, stamp.nanosec)] = [*message.position, *message.velocity]
    expected = np.hstack([simulated['shaft_position'], simulated['shaft_speed']])
    np.testing.assert_array_equal([rows[cycle] for cycle in range(len(expected))], expected)


def test_a_cell_on_the_bus_has_the_bits_of_the_one_in_a_simulation(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    robot = parameters.load(parameters.of_run(None, 'packaging'))
    simulated = simulation.run(
        programs.load('packaging', robot.motion), robot, cell=cell_file.load('cell'), signals=['cell_inputs']
    )
    recorded, result = _run(
        delta3, tmp_path / 'bag', '--real-time-factor', '0', '--cell', 'cell', program='packaging'
    )
    found = trace_export.completed(recorded, ['cell_inputs'])
    assert len(assert_same_where_recorded(simulated, found, robot.bus.cycle_time_s)) > 3000
    rows = np.rint(found.time_s / robot.bus.cycle_time_s).astype(int)
    within = rows < len(simulated.time_s)
    assert simulated['cell_inputs'].max() == 1.0
    np.testing.assert_array_equal(found['cell_inputs'][within], simulated['cell_inputs'][rows[within]])

    told, wanted = result['cell'], json.loads(json.dumps(simulated.meta['cell']))
    assert wanted['picked'] == wanted['outcomes']['placed'] > 5
    carried = [[part for part in one['parts'] if part['picked_cycle'] >= 0] for one in (told, wanted)]
    assert carried[0] == carried[1]
    for key in ('picked', 'missed', 'misses', 'place_error_max_m', 'place_error_rms_m', 'hold_use_max'):
        assert told[key] == wanted[key], key

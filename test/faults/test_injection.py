"""Facts about injected faults: how they are written down, when they happen, what they do to the machine."""

import itertools
import json
import math

import numpy as np
import pytest
import yaml

from delta3_pacdrive import simulation
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.faults import effects
from delta3_pacdrive.faults import fault as fault_table
from delta3_pacdrive.faults.fault import KINDS, NAMES, Fault, Target, applies_to, parse
from delta3_pacdrive.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.faults.telegram_faults import FaultyLink
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.plant.plant import Plant
from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.sercos.configuration_check import DRIVES

HOME = [0.0, 0.0, -0.78]
LINE = {'start_m': HOME, 'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.78], 'speed_m_s': 0.4}}]}


def example(kind):
    """Return a document of a kind with everything that it may have."""
    row = KINDS[kind]
    document = {'fault': kind, 'after_s': 0.25}
    if row.target == Target.AXIS:
        document['axis'] = 'axis2'
    elif row.target == Target.NODE:
        document['node'] = 'plant'
    if row.value:
        document[row.value] = row.high
    if row.telegram:
        document['cycles'] = 3
    elif not row.once:
        document['for_s'] = 0.5
    return document


def run(robot, *faults):
    document = LINE | {'faults': list(faults)}
    return simulation.run(programs.parse(document, robot.motion), robot)


@pytest.mark.parametrize('kind', NAMES)
def test_every_kind_is_read_and_written_the_same_way(kind):
    document = example(kind)
    fault = parse(document, 'fault')
    assert fault.to_document() == document
    assert Fault.from_row(fault.to_row()) == fault
    scheduled = Scheduled.of(fault, 100, 1e-3)
    assert Scheduled.from_document(json.loads(json.dumps(scheduled.to_document()))) == scheduled
    assert scheduled.first == 350
    assert KINDS[kind].text


@pytest.mark.parametrize('kind', NAMES)
def test_every_kind_applies_to_somebody(kind):
    fault = parse(example(kind), 'fault')
    assert any(applies_to(fault, node) for node in fault_table.NODES)
    if KINDS[kind].target == Target.AXIS:
        assert not applies_to(fault, 'axis1')
    own = [node for node in fault_table.NODES if applies_to(fault, node)]
    if kind in ('brake_worn', 'brake_stuck', 'overload', 'payload_lost'):
        assert own == ['plant']  # brakes, loads and what is gripped are the machine's
    elif kind in fault_table.AT_FAULTS or kind == 'emergency_stop':
        assert own == ['transformation_task']
    elif kind == 'clear':
        assert own == list(fault_table.NODES)
    else:
        assert own == [fault.target]


@pytest.mark.parametrize(
    ('document', 'sentence'),
    [
        (None, 'fault must be a mapping, not None'),
        ({}, 'fault.fault is None, but must be one of drop_mdt'),
        ({'fault': 'rain'}, "fault.fault is 'rain'"),
        ({'fault': 'drop_at'}, 'fault: missing key axis'),
        ({'fault': 'drop_at', 'axis': 'axis4'}, "fault.axis is 'axis4', but must be one of axis1"),
        ({'fault': 'drop_at', 'axis': 'axis1', 'cycles': 0}, 'fault.cycles is 0'),
        ({'fault': 'drop_at', 'axis': 'axis1', 'for_s': 1.0}, "unknown key 'for_s'"),
        ({'fault': 'encoder_jump', 'axis': 'axis1'}, 'missing key jump_rad'),
        (
            {'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': math.nan},
            'jump_rad must be a number, not nan',
        ),
        ({'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': True}, 'jump_rad must be a number, not True'),
        ({'fault': 'dc_link', 'axis': 'axis1', 'voltage_v': 1e4}, 'between 0 and 1000'),
        ({'fault': 'kill', 'node': 'axis1', 'after_s': -1.0}, 'after_s is -1'),
        ({'fault': 'kill', 'node': 'recorder'}, "fault.node is 'recorder'"),
        ({'fault': 'payload_lost', 'for_s': 1.0}, "unknown key 'for_s'"),
    ],
)
def test_a_fault_that_breaks_a_rule_is_refused_by_name(document, sentence):
    with pytest.raises(ProgramError) as caught:
        parse(document, 'fault')
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    'row', [[], [1.0] * 5, [99.0, 2, 0, 0, -1, 1], [0.5, 2, 0, 0, -1, 1], [0, 2, math.inf, 0, -1, 1]]
)
def test_a_row_of_numbers_that_is_no_fault_is_refused(row):
    with pytest.raises(ProgramError):
        Fault.from_row(row)


def test_a_program_file_holds_faults(robot):
    text = yaml.safe_dump(LINE | {'faults': [example(kind) for kind in NAMES]})
    read = programs.parse(yaml.safe_load(text), robot.motion)
    assert [fault.kind for fault in read.faults] == list(NAMES)
    with pytest.raises(ProgramError, match=r'faults\[1\]\.fault is'):
        programs.parse(LINE | {'faults': [example('drop_at'), {'fault': 'x'}]}, robot.motion)


# when -------------------------------------------------------------------------------------------------------------


def test_faults_begin_and_end_in_the_order_of_bus_time():
    schedule = Schedule()
    late = parse({'fault': 'encoder_failure', 'axis': 'axis1', 'after_s': 0.02, 'for_s': 0.005}, 'fault')
    early = parse({'fault': 'winding_short', 'axis': 'axis1', 'after_s': 0.01}, 'fault')
    for fault in (late, early):
        schedule.add(Scheduled.of(fault, 0, 1e-3))
    assert schedule.next_cycle == 10
    assert schedule.due(9) == []
    assert schedule.due(10) == [(early, True)]
    assert schedule.next_cycle == 20
    assert schedule.due(30) == [(late, True), (late, False)]
    assert schedule.next_cycle == NEVER


def test_telegrams_are_disturbed_for_as_many_cycles_as_are_asked_for():
    schedule = Schedule()
    assert not schedule.disturbs_telegrams
    fault = parse({'fault': 'drop_mdt', 'axis': 'axis3', 'cycles': 2}, 'fault')
    schedule.add(Scheduled.of(fault, 50, 1e-3))
    hit = [k for k in range(100) if schedule.telegram(fault_table.MDT_LOSSES, 'axis3', k)]
    assert hit == [50, 51]
    assert not any(schedule.telegram(fault_table.MDT_LOSSES, 'axis1', k) for k in range(100))
    assert not any(schedule.telegram(fault_table.AT_LOSSES, 'axis3', k) for k in range(100))


def test_the_next_event_is_a_change_or_a_telegram_that_is_disturbed():
    schedule = Schedule()
    assert schedule.next_event(0) == NEVER
    document = {'fault': 'encoder_failure', 'axis': 'axis1', 'after_s': 0.04, 'for_s': 0.03}
    schedule.add(Scheduled.of(parse(document, 'fault'), 0, 1e-3))
    schedule.add(Scheduled.of(parse({'fault': 'drop_at', 'axis': 'axis3', 'cycles': 2}, 'fault'), 50, 1e-3))
    assert schedule.next_event(0) == 40
    schedule.due(40)
    assert [schedule.next_event(cycle) for cycle in (41, 50, 51, 52)] == [50, 50, 51, 70]


def test_clear_forgets_what_is_still_to_come():
    schedule = Schedule()
    for after, kind in ((0.0, 'clear'), (0.5, 'encoder_failure'), (0.5, 'drop_at')):
        document = {'fault': kind, 'after_s': after} | ({'axis': 'axis1'} if kind != 'clear' else {})
        schedule.add(Scheduled.of(parse(document, 'fault'), 0, 1e-3))
    schedule.due(0)
    assert schedule.next_cycle == NEVER
    assert not schedule.disturbs_telegrams


# what -------------------------------------------------------------------------------------------------------------


class Machine:
    """Drive of axis 2 and plant, to which faults happen."""

    def __init__(self, robot):
        self.drive, self.plant = MC4(robot), Plant(robot)
        self.schedule = Schedule()
        self.nominal = self.drive.state.copy(), self.plant.state.copy()
        self.dc_link = robot.drive.dc_link_voltage_v

    def add(self, document):
        self.schedule.add(Scheduled.of(parse(document, 'fault'), 0, 1e-3))

    def go_to(self, cycle):
        changes, active = self.schedule.due(cycle), self.schedule.active
        effects.apply_to_drive(self.drive.state[0], 'axis2', changes, active, self.dc_link)
        effects.apply_to_plant(self.plant.state[0], changes, active)

    @property
    def is_as_new(self):
        return self.drive.state == self.nominal[0] and self.plant.state == self.nominal[1]

    def of_plant(self, name):
        return self.plant.state[name][0].tolist()

    def of_drive(self, name):
        return float(self.drive.state[name][0])


def test_clear_takes_every_fault_of_drive_and_plant_back(robot):
    machine = Machine(robot)
    for kind in KINDS.keys() - {
        'clear',
        'payload_lost',
    }:  # what has fallen off stays there until it is gripped again
        machine.add({key: value for key, value in example(kind).items() if key != 'for_s'})
    machine.go_to(250)
    assert not machine.is_as_new
    machine.add({'fault': 'clear', 'after_s': 0.3})
    machine.go_to(300)
    assert machine.is_as_new
    assert machine.schedule.active == []


@pytest.mark.parametrize(
    'kind', [name for name in NAMES if not KINDS[name].once and not KINDS[name].telegram]
)
def test_a_fault_that_ends_leaves_the_fields_as_they_were(kind, robot):
    machine = Machine(robot)
    machine.add(example(kind))
    machine.go_to(249)
    assert machine.is_as_new
    machine.go_to(250)
    assert not machine.is_as_new
    machine.go_to(750)
    assert machine.is_as_new


def of(kind, after_s, for_s, **value):
    return {'fault': kind, 'axis': 'axis2', 'after_s': after_s, 'for_s': for_s, **value}


def test_faults_of_one_kind_that_overlap_add_up_and_each_ends_at_its_time(robot):
    machine = Machine(robot)
    machine.add(of('overload', 0.1, 0.5, torque_n_m=3.0))
    machine.add(of('overload', 0.2, 0.1, torque_n_m=2.0))
    machine.add(of('brake_worn', 0.1, 0.5, lost_share=0.5))
    machine.add(of('brake_worn', 0.2, 0.1, lost_share=0.5))
    machine.add(of('encoder_jump', 0.1, 0.5, jump_rad=0.5))
    machine.add(of('encoder_jump', 0.2, 0.1, jump_rad=0.25))
    machine.add(of('encoder_drift', 0.1, 0.5, drift_rad_s=0.5))
    machine.add(of('encoder_drift', 0.2, 0.1, drift_rad_s=0.25))
    machine.add(of('encoder_noise', 0.1, 0.5, noise_rad=0.5))
    machine.add(of('encoder_noise', 0.2, 0.1, noise_rad=0.25))
    machine.add(of('dc_link', 0.1, 0.5, voltage_v=400.0))
    machine.add(of('dc_link', 0.2, 0.1, voltage_v=300.0))
    seen = {}
    for cycle in (150, 250, 350, 650):
        machine.go_to(cycle)
        seen[cycle] = (
            machine.of_plant('load_torque')[1],
            machine.of_plant('brake_share')[1],
            machine.of_drive('encoder_offset'),
            machine.of_drive('encoder_drift'),
            machine.of_drive('encoder_noise'),
            machine.of_drive('dc_link'),
        )
    assert seen[150] == (3.0, 0.5, 0.5, 0.5, 0.5, 400.0)
    assert seen[250] == (5.0, 0.25, 0.75, 0.75, 0.75, 300.0)
    assert seen[350] == seen[150]
    assert machine.is_as_new


def test_faults_of_other_axes_leave_a_drive_alone(robot):
    machine = Machine(robot)
    for kind in ('encoder_failure', 'encoder_jump', 'encoder_noise', 'winding_short', 'dc_link'):
        machine.add(example(kind) | {'axis': 'axis3'})
    machine.go_to(300)
    assert machine.is_as_new


def test_bridged_losses_cost_micrometres(robot):
    telegrams = itertools.product(('drop_mdt', 'drop_at'), DRIVES)
    faults = [
        {'fault': kind, 'axis': axis, 'after_s': 0.2 + 0.03 * n} for n, (kind, axis) in enumerate(telegrams)
    ]
    trace = run(robot, *faults)
    assert trace.meta['stopped'] == ''
    assert trace['tcp_actual'][-1] == pytest.approx([0.2, 0.0, -0.78], abs=1e-5)
    undisturbed = run(robot)
    away = np.linalg.norm(trace['shaft_position'] - undisturbed['shaft_position'], axis=1).max()
    assert 0.0 < away < 2e-3  # motor shaft; 25 um at the elbow


@pytest.mark.parametrize(
    ('fault', 'number'),
    [
        ({'fault': 'drop_mdt', 'axis': 'axis2', 'cycles': 2}, '8112'),
        ({'fault': 'corrupt_at', 'axis': 'axis2', 'cycles': 2}, '8506'),
        ({'fault': 'encoder_failure', 'axis': 'axis2'}, '8171'),
        ({'fault': 'winding_short', 'axis': 'axis2'}, '8905'),
        ({'fault': 'dc_link', 'axis': 'axis2', 'voltage_v': 200.0}, '8909'),
        ({'fault': 'emergency_stop'}, 'emergency stop'),
    ],
)
def test_a_fault_stops_the_robot_which_stays_where_it_can_be(fault, number, robot):
    trace = run(robot, fault | {'after_s': 0.3})
    assert number in trace.meta['stopped']
    start = robot.motion.start_cycle
    assert int(trace.meta['stopped'].partition('bus cycle ')[2].split(':')[0].split()[0]) - start in range(
        300, 304
    )
    # it stands, short of the end, and inside the workspace
    assert np.abs(trace['shaft_speed'][-1]).max() == 0.0
    assert np.abs(trace['current'][-1]).max() == 0.0
    assert 0.03 < trace['tcp_actual'][-1, 0] < 0.17
    radius = np.hypot(trace['tcp_actual'][:, 0], trace['tcp_actual'][:, 1])
    assert radius.max() < robot.kinematics.workspace_diameter_m / 2


def test_two_runs_with_noise_are_the_same_to_the_bit(robot):
    noise = {'fault': 'encoder_noise', 'axis': 'axis3', 'noise_rad': 1e-3, 'after_s': 0.1}
    first, second = run(robot, noise), run(robot, noise)
    for name, values in first.signals.items():
        np.testing.assert_array_equal(second[name], values, err_msg=name)
    assert np.ptp(first['current'][400:500, 2]) > 5 * np.ptp(run(robot)['current'][400:500, 2])


def test_a_lost_payload_is_felt_in_the_current_of_the_acceleration(robot):
    lost = run(robot, {'fault': 'payload_lost', 'after_s': 0.0})
    carried = run(robot)
    lighter = np.abs(lost['current'][150:220]).max() / np.abs(carried['current'][150:220]).max()
    assert 0.5 < lighter < 0.95


def test_a_simulation_has_no_processes(robot):
    with pytest.raises(RunError, match='a simulation has no processes'):
        run(robot, {'fault': 'kill', 'node': 'plant'})


# telegrams on their way -----------------------------------------------------------------------------------------------


def arrivals(*faults, axis='axis2', cycles=10):
    """Return what arrives of the AT 'at 0', 'at 1' ... of an axis under faults, and what is said of it."""
    schedule, said = Schedule(), []
    for fault in faults:
        schedule.add(Scheduled.of(parse(fault, 'fault'), 0, 1e-3))
    link = FaultyLink(schedule, fault_table.AT_FAULTS, said.append)
    return [what for k in range(cycles) for what in link.arrivals(axis, k, f'at {k}')], said


ALL = [(k, f'at {k}') for k in range(10)]


def test_without_a_fault_every_telegram_arrives_once_and_in_order():
    assert arrivals() == (ALL, [])
    assert arrivals({'fault': 'drop_mdt', 'axis': 'axis2'})[0] == ALL
    assert arrivals({'fault': 'drop_at', 'axis': 'axis1'})[0] == ALL


def test_a_dropped_telegram_is_known_to_be_lost_in_its_own_cycle():
    found, said = arrivals({'fault': 'drop_at', 'axis': 'axis2', 'after_s': 0.004, 'cycles': 2})
    assert found == [*ALL[:4], (4, None), (5, None), *ALL[6:]]
    assert said == []


def test_a_delayed_telegram_arrives_behind_the_one_in_whose_cycle_it_is_let_go():
    fault = {'fault': 'delay_at', 'axis': 'axis2', 'after_s': 0.003, 'by_cycles': 2}
    assert arrivals(fault)[0] == [*ALL[:3], (3, None), *ALL[4:6], (3, 'at 3'), *ALL[6:]]


def test_a_duplicated_telegram_arrives_twice_and_a_garbled_one_is_told():
    assert arrivals({'fault': 'duplicate_at', 'axis': 'axis2', 'after_s': 0.001})[0] == [*ALL[:2], *ALL[1:]]
    found, said = arrivals({'fault': 'corrupt_at', 'axis': 'axis2', 'after_s': 0.008})
    assert found == [*ALL[:8], (8, None), ALL[9]]
    assert said == ['axis2: the AT of bus cycle 8 is garbled']


def test_what_is_lost_does_not_come_twice_whichever_fault_was_asked_for_first():
    twice = {'fault': 'duplicate_at', 'axis': 'axis2', 'after_s': 0.005}
    lost = {'fault': 'drop_at', 'axis': 'axis2', 'after_s': 0.005}
    expected = [*ALL[:5], (5, None), *ALL[6:]]
    assert arrivals(twice, lost)[0] == expected
    assert arrivals(lost, twice)[0] == expected


def test_a_simulation_counts_the_at_that_are_lost(robot):
    def lost(*faults):
        return simulation.run(programs.parse(LINE | {'faults': list(faults)}, robot.motion), robot).meta

    one = {'fault': 'drop_at', 'axis': 'axis1', 'after_s': 0.1}
    assert lost()['lost_telegrams'] == 0
    assert lost(one, one | {'axis': 'axis3', 'after_s': 0.2})['lost_telegrams'] == 2
    assert lost({'fault': 'drop_mdt', 'axis': 'axis1', 'after_s': 0.1})['lost_telegrams'] == 0


def test_a_fault_that_is_due_after_the_end_of_the_program_is_noticed(robot):
    late = {'fault': 'drop_at', 'axis': 'axis1', 'after_s': 5.0}
    (notice,) = simulation.run(programs.parse(LINE | {'faults': [late]}, robot.motion), robot).meta['notices']
    assert notice.startswith('drop_at axis1 is due 5 s after the start, the program takes 0.')
    in_time = late | {'after_s': 0.1}
    assert (
        simulation.run(programs.parse(LINE | {'faults': [in_time]}, robot.motion), robot).meta['notices']
        == []
    )

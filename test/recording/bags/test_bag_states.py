"""Tests of states in a bag that are published on change: each is valid from its bus cycle on."""

import json

from bags import CLOCK, CYCLES, JOINT_STATE, META, STORE, TYPES, message, messages, record
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.bags import bag_states

TEXT = 'std_msgs/msg/String'
KINDS = {**TYPES, 'outputs': JOINT_STATE, 'motion/progress': TEXT}
NAMES = [f'output{n}' for n in range(9)]


def outputs(cycle, *values):
    return 'outputs', message('sercos/mdt', CLOCK.stamp(cycle), (values, [], []), frame='', names=NAMES)


def progress(cycle, **facts):
    known = {'session': '3fa9', 'bus_time_s': cycle * 1e-3, 'fault': '', 'fault_cycle': 0, 'lost_telegrams': 0,
             'overruns': 0} | facts  # fmt: skip
    text = STORE.types[TEXT](json.dumps(known))
    return 'motion/progress', bytes(STORE.serialize_cdr(text, TEXT))


def states(folder, *more, meta=META):
    bag = record(folder, [*messages(), *more], meta, types=KINDS)
    return bag_states.read(trace_file.load(bag))


def test_outputs_and_payload_hold_from_the_cycle_of_their_change_on(tmp_path):
    meta = META | {'parameters': {'dynamics.payload_mass_kg': 0.25}}
    found = states(
        tmp_path / 'bag', outputs(5, 0, 0, 1, 0, 0, 0, 0, 0, 0.5), outputs(2, *[1] + 7 * [0], 1.5), meta=meta
    )
    assert found['payload'][:, 0].tolist() == [0.25, 0.25, 1.5, 1.5, 1.5, 0.5, 0.5, 0.5]
    assert found['outputs'][:, 0].tolist() == [0, 0, 1, 1, 1, 0, 0, 0]
    assert found['outputs'][:, 2].tolist() == [0, 0, 0, 0, 0, 1, 1, 1]
    assert found['outputs'].shape == (CYCLES, 8)
    assert 'fault' not in found


def test_counters_are_those_of_the_newest_report_and_a_fault_counts_from_its_cycle(tmp_path):
    found = states(
        tmp_path / 'bag',
        progress(0, overruns=1),
        progress(4, lost_telegrams=2, overruns=3, fault='axis1 is silent', fault_cycle=3),
        progress(6, lost_telegrams=2, overruns=3),
    )
    assert found['overruns'][:, 0].tolist() == [1, 1, 1, 1, 3, 3, 3, 3]
    assert found['lost_telegrams'][:, 0].tolist() == [0, 0, 0, 0, 2, 2, 2, 2]
    assert found['fault'][:, 0].tolist() == [0, 0, 0, 1, 1, 1, 0, 0]
    assert 'payload' not in found


def test_messages_of_another_writer_are_ignored(tmp_path):
    found = states(
        tmp_path / 'bag',
        outputs(2, 1.0, 2.0),
        outputs(2, *[float('nan')] * 9),
        ('motion/progress', b'none'),
        progress(3, overruns='many'),
        progress(3, bus_time_s=float('inf')),
        progress(3, bus_time_s=1e300),
    )
    assert found == {}

"""Tests of the current samples in a bag: figures of every cycle with complete samples."""

import numpy as np
import pytest

from bags import AXES, CLOCK, CYCLES, JOINT_STATE, RUN, STORE, TYPES, messages, record
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.bags.current_samples import figures_of, of_cycles, samples_of_cycles
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, SIGNALS

TOPICS = {f'{axis}/motor_current': JOINT_STATE for axis in AXES}
SAMPLES = np.random.default_rng(21).normal(size=(CYCLES, 3, 16))
CYCLE_NS = 1_000_000


def sample_messages(exchanges=1, cycles=range(CYCLES), axes=AXES):
    """Return (topic, bytes) of the currents of all drives, in messages of one exchange each."""
    types, found = STORE.types, []
    for cycle in cycles:
        for n in range(exchanges):
            sec, nanosec = CLOCK.stamp(cycle)
            stamp = types['builtin_interfaces/msg/Time'](sec, nanosec + n * CYCLE_NS // exchanges)
            header = types['std_msgs/msg/Header'](stamp, 'free 000.5000 3fa9')
            for axis in axes:
                own = SAMPLES[cycle, AXES.index(axis)].reshape(exchanges, -1)[n]
                whole = types[JOINT_STATE](header, [axis], np.empty(0), np.empty(0), own)
                found.append((f'{axis}/motor_current', bytes(STORE.serialize_cdr(whole, JOINT_STATE))))
    return found


def expected(name, cycles):
    samples = SAMPLES[list(cycles)]
    return {
        'current_mean': samples.mean(axis=2),
        'current_rms': np.sqrt((samples**2).mean(axis=2)),
        'current_min': samples.min(axis=2),
        'current_max': samples.max(axis=2),
    }[name]


@pytest.mark.parametrize('exchanges', [1, 4, 8])
def test_bag_yields_current_figures_of_all_samples_of_each_cycle(exchanges, tmp_path):
    bag = record(tmp_path / 'bag', messages() + sample_messages(exchanges), types=TYPES | TOPICS)
    trace = trace_file.load(bag)
    assert list(trace.signals) == [*SIGNALS, *CURRENT_SIGNALS]
    assert len(trace.time_s) == CYCLES
    for name in CURRENT_SIGNALS:
        np.testing.assert_allclose(trace[name], expected(name, range(CYCLES)), rtol=1e-14)
    np.testing.assert_array_equal(trace['current'], RUN['current'])


def test_a_cycle_of_which_samples_are_missing_is_left_out_as_with_any_topic(tmp_path):
    lost = sample_messages(4)
    del lost[5 * 12 + 4]  # a message of axis 2 in cycle 5
    bag = record(tmp_path / 'bag', messages() + lost, types=TYPES | TOPICS)
    trace = trace_file.load(bag)
    kept = [cycle for cycle in range(CYCLES) if cycle != 5]
    assert trace.time_s.tolist() == [cycle * 1e-3 for cycle in kept]
    for name in CURRENT_SIGNALS:
        np.testing.assert_allclose(trace[name], expected(name, kept), rtol=1e-14)


@pytest.mark.parametrize('axes', [AXES[:2], AXES[2:]])
def test_bag_without_all_currents_yields_those_of_the_at(axes, tmp_path):
    types = TYPES | {topic: kind for topic, kind in TOPICS.items() if topic[:5] in axes}
    trace = trace_file.load(record(tmp_path / 'bag', messages() + sample_messages(axes=axes), types=types))
    assert list(trace.signals) == list(SIGNALS)


def test_invalid_current_is_counted_as_rejected(tmp_path):
    types = STORE.types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](0, 0), 'free 000.5000 3fa9')
    wrong = types[JOINT_STATE](header, ['axis1'], np.empty(0), np.empty(0), np.empty(0))
    stray = [('axis1/motor_current', bytes(STORE.serialize_cdr(wrong, JOINT_STATE)))]
    bag = record(tmp_path / 'bag', messages() + stray + sample_messages(), types=TYPES | TOPICS)
    trace = trace_file.load(bag)
    assert trace.meta['refused'] == {'axis1/motor_current': 1}
    np.testing.assert_allclose(trace['current_rms'], expected('current_rms', range(CYCLES)), rtol=1e-14)


def test_first_message_of_another_layout_does_not_define_the_topic(tmp_path):
    stranger = sample_messages(4)[:1]
    bag = record(tmp_path / 'bag', messages() + stranger + sample_messages(), types=TYPES | TOPICS)
    trace = trace_file.load(bag)
    assert trace.meta['refused'] == {'axis1/motor_current': 1}
    np.testing.assert_allclose(trace['current_rms'], expected('current_rms', range(CYCLES)), rtol=1e-14)


def test_sums_accumulate_sample_by_sample_as_in_a_drive():
    samples = np.array([[1e16, 1.0, -1e16, 1.0]])
    mean, rms, least, greatest = figures_of(samples)
    assert mean[0] == 0.25  # the first 1 is lost beside 1e16, however one would add otherwise
    assert (least[0], greatest[0]) == (-1e16, 1e16)
    assert rms[0] == pytest.approx(1e16 / np.sqrt(2.0))


def test_currents_without_a_complete_cycle_give_no_figures():
    stamps, values = np.array([0, 250_000, 1_250_000, 1_500_000]), np.ones((4, 4))
    cycles, _ = samples_of_cycles((stamps, values), CYCLE_NS)
    assert cycles.tolist() == []
    empty = np.empty(0, np.int64), np.empty((0, 1))
    assert of_cycles([empty] * 3, CYCLE_NS)[1] == {}


@pytest.mark.parametrize('exchange_ns', [CYCLE_NS, CYCLE_NS // 8])
@pytest.mark.parametrize('off_ns', [1, CYCLE_NS // 16, CYCLE_NS // 3])
def test_message_of_another_publisher_between_two_of_a_drive_costs_no_cycle(exchange_ns, off_ns):
    stamps = np.arange(0, 20 * CYCLE_NS, exchange_ns)
    values = np.arange(float(2 * len(stamps))).reshape(-1, 2)
    cycles, samples = samples_of_cycles((stamps, values), CYCLE_NS)
    foreign = np.append(stamps, 7 * CYCLE_NS + off_ns), np.vstack([values, [[99.0, 99.0]]])
    with_it, same = samples_of_cycles(foreign, CYCLE_NS)
    assert len(cycles) == 20
    assert (with_it == cycles).all()
    assert (same == samples).all()

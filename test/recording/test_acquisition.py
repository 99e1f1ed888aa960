"""Tests of the acquisition of an oscilloscope: triggers, pre-trigger, modes and lost samples."""

import numpy as np
import pytest

from delta3_pacdrive.errors import ParameterError, RunError
from delta3_pacdrive.recording.acquisition import Acquisition, setting
from delta3_pacdrive.robot.drive.scope import Block

STEP_S = 62.5e-6


def values(n):
    """Return the channel values of a drive at samples: a saw tooth from -50 to 49, and the number."""
    n = np.asarray(n)
    return np.column_stack([n % 100 - 50.0, n.astype(float)])


def feed(acquisition, first, last, axis=0, size=37, columns=values):
    """Hand samples over in blocks; the last one is ``last - 1``."""
    for begin in range(first, last, size):
        numbers = np.arange(begin, min(begin + size, last))
        acquisition.add(axis, Block(begin, columns(numbers)))


def of(robot, samples, channels=('axis1.speed', 'axis1.voltage'), before=0, **more):
    return setting(robot, list(channels), 16_000.0, samples * STEP_S, pre_trigger_s=before * STEP_S, **more)


def recorded(robot, samples, last=2000, first=1, **more):
    records = []
    acquisition = Acquisition(of(robot, samples, **more), records.append)
    feed(acquisition, first, last)
    return records, acquisition


def test_record_without_a_trigger_starts_immediately(robot):
    (record,), acquisition = recorded(robot, 500, first=7)
    assert acquisition.done
    assert (record.first, len(record.values), record.trigger) == (7, 500, None)
    assert np.array_equal(record.values, values(np.arange(7, 507)))
    assert record.time_s[0] == pytest.approx(7 * STEP_S)


@pytest.mark.parametrize('size', [1, 16, 37, 128, 5000])
@pytest.mark.parametrize(
    ('edge', 'level', 'sample'),
    [
        ('rising', 10.0, 160),  # the first tooth has passed the level before sample 120
        ('falling', 10.0, 200),
        ('both', 10.0, 160),
        ('rising', -60.0, None),
        ('change', 0.0, 121),
        ('rising', 9.5, 160),
    ],
)
def test_a_trigger_is_the_sample_that_crosses_its_level(size, edge, level, sample, robot):
    records = []
    asked = of(robot, 50, before=20, trigger='axis1.speed', level=level, edge=edge)
    acquisition = Acquisition(asked, records.append)
    feed(acquisition, 120 if sample != 160 else 140, 500, size=size)
    if edge == 'change' or sample is None:
        assert [record.first + record.trigger for record in records] == ([121] if sample else [])
        return
    (record,) = records
    assert record.first + record.trigger == sample
    assert record.first == max(sample - 20, 120 if sample != 160 else 140)
    assert np.array_equal(record.values, values(record.first + np.arange(50)))


def test_an_event_soon_after_the_begin_has_less_before_it(robot):
    (record,), _ = recorded(robot, 60, first=55, before=40, trigger='axis1.speed', level=10.0)
    assert (record.first, record.trigger, len(record.values)) == (55, 5, 60)


def test_normal_trigger_rearms_and_ends_after_the_requested_records(robot):
    more = {'trigger': 'axis1.speed', 'level': 0.0, 'mode': 'normal', 'before': 10}
    records, acquisition = recorded(robot, 120, **more)
    triggers = [record.first + record.trigger for record in records]
    assert triggers[:4] == [50, 250, 450, 650]  # the record of 50 holds that of 150
    assert not acquisition.done
    records, acquisition = recorded(robot, 120, records=2, **more)
    assert len(records) == 2
    assert acquisition.done


@pytest.mark.parametrize('size', [1, 16, 1000])
def test_no_event_between_two_records_is_missed(size, robot):
    records = []
    asked = of(robot, 40, trigger='axis1.speed', level=0.0, mode='normal')
    feed(Acquisition(asked, records.append), 1, 1000, size=size)
    assert [record.first for record in records] == list(range(50, 960, 100))


def test_rolling_keeps_the_newest(robot):
    records, acquisition = recorded(robot, 310, mode='rolling')
    assert not records
    before = acquisition.newest()
    acquisition.finish()
    (record,) = records
    assert (record.first, len(record.values)) == (1690, 310)
    assert before.first == record.first
    assert np.array_equal(before.values, record.values)
    assert Acquisition(record.setting, records.append).newest() is None


def test_truncated_record_is_kept_and_missing_event_is_not(robot):
    records, acquisition = recorded(robot, 500, last=100, trigger='axis1.speed', level=0.0)
    acquisition.finish()
    assert [(record.first, len(record.values)) for record in records] == [(50, 50)]
    records, acquisition = recorded(robot, 500, trigger='axis1.speed', level=200.0)
    acquisition.finish()
    assert not records


def test_samples_of_several_drives_are_put_together_by_their_numbers(robot):
    records = []
    asked = of(robot, 200, ['axis3.speed', 'axis1.voltage'], trigger='axis2.current', level=30.0)
    acquisition = Acquisition(asked, records.append)

    def one(factor):
        return lambda n: np.asarray(n)[:, None] * factor

    feed(acquisition, 20, 400, 0, 50, one(1.0))
    feed(acquisition, 11, 400, 2, 16, one(3.0))
    assert not records
    feed(acquisition, 1, 400, 1, 128, one(0.5))
    (record,) = records
    assert record.first + record.trigger == 60
    numbers = 60.0 + np.arange(200)
    assert np.array_equal(record.values, np.column_stack([3.0 * numbers, numbers]))
    assert record.names == ('axis3.speed', 'axis1.voltage')
    assert record.units == ('rad/s', 'V')


def test_a_record_with_a_gap_is_rejected_and_the_samples_are_counted(robot):
    acquisition = Acquisition(of(robot, 500), [].append)
    feed(acquisition, 1, 100)
    with pytest.raises(RunError, match=r'^28 samples of axis1 were lost during a record'):
        feed(acquisition, 128, 500)
    assert acquisition.lost == 28


def test_a_gap_before_the_event_does_no_harm_unless_it_reaches_into_the_pre_trigger(robot):
    for begin, fine in ((200, True), (445, False)):
        records = []
        asked = of(robot, 60, before=30, trigger='axis1.voltage', level=460.0)
        acquisition = Acquisition(asked, records.append)
        feed(acquisition, 1, 100)
        if fine:
            feed(acquisition, begin, 600)
            (record,) = records
            assert (record.first, record.trigger) == (430, 30)
        else:
            with pytest.raises(RunError, match='were lost just before the trigger'):
                feed(acquisition, begin, 600)
        assert acquisition.lost == begin - 100


def test_new_bus_session_does_not_count_as_a_loss(robot):
    records = []
    acquisition = Acquisition(of(robot, 60, trigger='axis1.voltage', level=460.0), records.append)
    feed(acquisition, 400, 450)
    feed(acquisition, 1, 600)
    assert acquisition.lost == 0
    assert [record.first for record in records] == [460]
    acquisition = Acquisition(of(robot, 600), records.append)
    feed(acquisition, 400, 450)
    with pytest.raises(RunError, match='the bus was restarted while axis1 was recorded'):
        feed(acquisition, 1, 10)


def test_faults_and_programs_of_any_drive_that_is_shown_trigger(robot):
    for text in ('fault', 'program'):
        asked = of(robot, 10, ['axis1.speed', 'axis3.speed'], trigger=text)
        assert [(axis, channel.name) for axis, channel in asked.trigger.sources] == [(0, text), (2, text)]
    assert of(robot, 10, trigger='fault').trigger.sentence == 'a fault of a drive'


@pytest.mark.parametrize(
    ('more', 'sentence'),
    [
        ({'trigger': 'axis1.speed', 'level': 2.0}, 'axis1.speed rising through 2 rad/s'),
        ({'trigger': 'axis1.state', 'edge': 'both'}, 'axis1.state through 0'),
        ({'trigger': 'axis1.S-0-0104'}, 'a change of axis1.S-0-0104'),
        ({'trigger': 'program'}, 'the start of a program'),
    ],
)
def test_trigger_describes_its_condition(more, sentence, robot):
    assert of(robot, 10, **more).trigger.sentence == sentence


@pytest.mark.parametrize(
    ('more', 'sentence'),
    [
        (
            {'samples': 1_000_001},
            'has 1000001 samples at 16000 Hz, the limit is 1000000: choose a lower rate',
        ),
        ({'samples': 0.3}, 'has no samples at 16000 Hz'),
        ({'before': 10, 'trigger': 'fault'}, 'the pre-trigger of 0.000625 s must be shorter than the record'),
        ({'before': 5}, 'a pre-trigger needs a trigger'),
        ({'mode': 'rolling', 'trigger': 'fault'}, 'does not use a trigger'),
        ({'mode': 'normal'}, 'the mode normal needs a trigger'),
        ({'trigger': 'axis1.fautl'}, "no channel 'fautl': did you mean fault"),
        ({'trigger': 'faults'}, "'faults' is not a valid channel"),
    ],
)
def test_invalid_settings_are_rejected_with_a_message(more, sentence, robot):
    with pytest.raises(ParameterError, match=sentence):
        of(robot, **{'samples': 10, **more})

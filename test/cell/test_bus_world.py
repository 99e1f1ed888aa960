"""Tests of a cell on the bus: delays of outputs and inputs, and single reports of parts."""

import json
from dataclasses import replace

import pytest

from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.bus_world import BusWorld
from delta3_pacdrive.cell.parts import Outcome, PartRecord
from delta3_pacdrive.cell.parts_report import PartsLog
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.errors import Code, Reason, TelegramError

CYCLE_S = 1e-3
PICK, UP = (-0.1, 0.0, -0.85), (-0.1, 0.0, -0.8)
DOCUMENT = {
    'name': 'bench',
    'cup': {
        'output': 'gripper', 'diameter_mm': 40, 'vacuum_pa': 60000,
        'switch': {'input': 'vacuum', 'on_pa': 40000, 'off_pa': 30000},
    },
    'parts': {'bar': {'mass_kg': 0.5, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'supplies': {'infeed': {'part': 'bar', 'at_mm': [-100, 0, -870], 'count': 2, 'refill_s': 0.02}},
    'inputs': {'start': {'changes': [{'after_s': 0.003, 'value': True}]}},
}  # fmt: skip


class Bench:
    """A cell whose robot follows the positions of the test, and all its messages."""

    def __init__(self, document=DOCUMENT):
        self.inputs, self.parts, self.belts = {}, [], []
        self.world = World(cell_file.parse(document), CYCLE_S)
        self.around = BusWorld(self.world, self)
        self.around.begin(0)
        self.simulated = World(cell_file.parse(document), CYCLE_S)  # forgets nothing

    def send_inputs(self, cycle, inputs):
        assert cycle not in self.inputs
        self.inputs[cycle] = dict(inputs)

    def send_belts(self, cycle):
        self.belts.append((cycle, [belt.count for belt in self.world.belts.values()]))

    def publish_parts(self, document):
        self.parts.append(document)

    def run(self, cycles, outputs=0, tcp=PICK):
        """Command outputs with the MDT of each bus cycle; return the attached payload."""
        carried = None
        for _ in range(cycles):
            cycle = self.around.cycle + 1
            assert self.around.knows(cycle)
            carried = self.around.step(cycle, tcp)
            self.simulated.step(cycle, tcp, self.around.outputs)
            self.around.take_outputs(cycle, outputs)
        return carried

    def drop_part(self):
        self.around.drop_part()
        self.simulated.drop_part(self.around.cycle + 1)

    def log(self, *more, **options):
        """Return the log of all reports."""
        log = PartsLog(**options)
        for told in (*self.parts, *more):
            log.add(json.dumps(told))
        return log


@pytest.fixture
def bench():
    return Bench()


def test_a_cycle_waits_for_the_outputs_of_the_mdt_before(bench):
    assert bench.around.knows(0)
    bench.around.step(0, PICK)
    assert not bench.around.knows(1)
    bench.around.take_outputs(0, 1)
    assert bench.around.knows(1)
    assert not bench.around.knows(2)


def test_outputs_act_in_the_cycle_after_their_mdt_however_early_it_arrived(bench):
    for cycle in range(8):
        bench.around.take_outputs(cycle, int(cycle >= 3))
    seen = []
    for cycle in range(8):
        bench.around.step(cycle, PICK)
        seen.append(bench.around.outputs)
    assert seen == [0, 0, 0, 0, 1, 1, 1, 1]


def test_an_mdt_that_is_lost_leaves_the_outputs_as_they_were(bench):
    bench.around.take_outputs(0, 1)
    bench.around.take_outputs(2, 0)
    seen = []
    for cycle in range(4):
        bench.around.step(cycle, PICK)
        seen.append(bench.around.outputs)
    assert seen == [0, 1, 1, 0]


def test_inputs_are_sent_in_their_own_cycle(bench):
    bench.run(6)
    assert [bench.inputs[cycle]['start'] for cycle in range(6)] == [False, False, False, True, True, True]


def test_a_cell_without_inputs_sends_none():
    bench = Bench({'name': 'empty'})
    assert bench.run(3) is None
    assert bench.inputs == {}


def test_payload_of_the_robot_is_the_part_held_by_the_cup(bench):
    assert bench.run(5) == 0.0
    assert bench.run(20, outputs=1) == 0.5
    assert bench.run(20, outputs=0) == 0.0


def test_bus_time_without_the_plant_elapses_with_the_robot_at_rest(bench):
    bench.run(2)
    bench.around.begin(50)
    bench.around.step(50, PICK)
    assert bench.around.cycle == 50
    assert list(bench.inputs) == [0, 1, 50]
    assert bench.inputs[50]['start']


def test_published_log_of_parts_equals_the_report_of_the_cell(bench):
    bench.run(5)
    bench.run(30, outputs=1)
    assert bench.log().report()['parts'][0]['outcome'] == 'in hand'
    bench.drop_part()
    bench.run(1, outputs=1, tcp=UP)
    assert bench.log().report()['parts'][0]['outcome'] == 'lost'
    bench.run(30, outputs=0, tcp=UP)
    bench.run(10, outputs=1, tcp=UP)
    bench.run(10, outputs=0, tcp=UP)
    report = bench.log().report()
    assert report == json.loads(json.dumps(bench.simulated.report()))
    assert (report['cell'], report['picked'], report['missed']) == ('bench', 1, 1)
    assert report['parts'][0]['outcome'] == 'lost'
    assert len({one['cycle'] for one in bench.parts}) == len(bench.parts) < 10


@pytest.mark.parametrize('tcp', [UP, PICK], ids=['nothing is taken', 'a part is in hand'])
def test_unfinished_request_is_reported_to_its_client_in_the_end(bench, tcp):
    bench.run(30, outputs=1, tcp=tcp)
    for step in range(50):
        bench.run(1, outputs=1, tcp=(tcp[0], tcp[1], tcp[2] + 1e-4 * step))
    bench.simulated.finish()
    wanted = json.loads(json.dumps(bench.simulated.report()))
    assert wanted['missed'] + wanted['outcomes']['in hand'] == 1
    assert bench.log().report() != wanted
    assert bench.log(bench.around.to_dict()['under_way']).report() == wanted


PASSING = {
    'cup': {'output': 'gripper', 'diameter_mm': 40, 'vacuum_pa': 60000},
    'parts': {'bar': {'mass_kg': 0.5, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'belts': {
        'line': {
            'origin_mm': [-700, 100, -870], 'length_mm': 500, 'encoder': {'bits': 14, 'circumference_mm': 200},
            'speed': [{'after_s': 0, 'speed_m_s': 4.0, 'acceleration_m_s2': 100}],
            'stream': {'part': 'bar', 'count': 200, 'spacing_mm': 20},
        }
    },
}  # fmt: skip


def test_long_running_cell_stores_no_finished_parts_and_keeps_correct_counts():
    bench = Bench(PASSING)
    for _ in range(40):
        bench.run(20, outputs=1)
        bench.run(10)
        assert bench.world.records == bench.world.misses == []
    bench.run(100)
    whole, bounded = bench.log().report(), bench.log(kept_max=12).report()
    assert whole == json.loads(json.dumps(bench.simulated.report()))
    assert (whole['outcomes']['passed'], whole['missed']) == (200, 40)
    assert [one['number'] for one in bounded.pop('parts')] == list(range(188, 200))
    assert bounded.pop('misses') == whole['misses'][-12:]
    assert bounded == {name: whole[name] for name in bounded}


def part(number, **values):
    record = PartRecord(
        number, 'bar', 'infeed', Outcome.PLACED, picked_cycle=5, where='box', hold_use=0.1 * number
    )
    return replace(record, place_error_m=(1e-3 * number, 0.0, 0.0), **values).to_document()


def test_log_keeps_active_entries_and_sums_the_oldest_finished_ones():
    parts = [part(0, outcome=Outcome.WAITING), *(part(number) for number in (3, 1, 2, 4))]
    log, whole = PartsLog(kept_max=3), PartsLog()
    for n, one in enumerate(parts):
        text = json.dumps(
            {'cell': 'bench', 'inputs': [], 'belts': [], 'cycle': n, 'parts': [one], 'misses': []}
        )
        log.add(text)
        whole.add(text)
    found, wanted = log.report(), whole.report()
    assert [one['number'] for one in found['parts']] == [0, 2, 4]
    assert found['place_error_max_m'] == 4e-3
    assert found['place_error_rms_m'] == pytest.approx(wanted['place_error_rms_m'], rel=1e-12)
    for name in ('outcomes', 'picked', 'missed', 'hold_use_max'):
        assert found[name] == wanted[name]


def test_largest_error_of_summed_parts_is_kept_in_any_order():
    for order in ((9, 3, 1, 2, 4), (1, 9, 3, 2, 4), (1, 2, 3, 4, 9)):
        log, whole = PartsLog(kept_max=2), PartsLog()
        for number in order:
            text = {
                'cell': 'bench',
                'inputs': [],
                'belts': [],
                'cycle': 1,
                'parts': [part(number)],
                'misses': [],
            }
            log.add(json.dumps(text))
            whole.add(json.dumps(text))
        found, wanted = log.report(), whole.report()
        assert len(found.pop('parts')) == 2 < len(wanted.pop('parts'))
        rms_m = wanted.pop('place_error_rms_m')
        assert found.pop('place_error_rms_m') == pytest.approx(rms_m, rel=1e-12)
        assert found == wanted
        assert found['place_error_max_m'] == pytest.approx(9e-3)


@pytest.mark.parametrize('text', ['', '[]', '{}', '{"parts": [1], "misses": []}', 'x' * 1000])
def test_third_party_parts_log_is_rejected_and_changes_nothing(text):
    log = PartsLog()
    with pytest.raises(TelegramError, match='is not a valid log of parts'):
        log.add(text)
    assert log.report() is None


STAY = {'cycle': 1, 'how': 'riding', 'at_m': [0, 0, 0], 'angle_rad': 0.0, 'belt': 'line', 'count': 2}
FOREIGN_STAYS = ({'how': 'flying'}, {'at_m': [0, 0]}, {'count': 0.5}, {'belt': 7}, {'more': 1})
STRANGE = {
    'outcome': ['eaten', None, 3],
    'number': [1e999, '1', True, 10**400, None],
    'hold_use': [float('nan'), 'much', 10**400],
    'place_error_m': [[1e-3], 'far', None, [0.0, 0.0, float('inf')]],
    'where': [5, None],
    'size_m': [[1.0], None],
    'stays': [None, [3], [{}], [STAY] * 201, *([STAY | more] for more in FOREIGN_STAYS)],
}
OF_LATER = ('size_m', 'stays')  # a recording of before does not tell them


@pytest.mark.parametrize(('name', 'value'), [(name, value) for name in STRANGE for value in STRANGE[name]])
def test_invalid_part_is_rejected_and_changes_nothing(name, value):
    log = PartsLog(kept_max=0)
    told = {'cell': 'bench', 'inputs': [], 'belts': [], 'misses': []}
    log.add(json.dumps(told | {'parts': [part(1)]}))
    before = log.report()
    with pytest.raises(TelegramError, match='is not a valid log of parts'):
        log.add(json.dumps(told | {'parts': [part(2) | {name: value}]}))
    if name not in OF_LATER:
        with pytest.raises(TelegramError, match='is not a valid log of parts'):
            log.add(json.dumps(told | {'parts': [{key: one for key, one in part(2).items() if key != name}]}))
    assert log.report() == before


def test_a_part_of_a_recording_of_before_has_been_nowhere():
    log = PartsLog()
    told = {'cell': 'bench', 'inputs': [], 'belts': [], 'misses': []}
    log.add(json.dumps(told | {'parts': [{key: one for key, one in part(2).items() if key not in OF_LATER}]}))
    (found,) = log.report()['parts']
    assert (found['stays'], found['size_m']) == ([], (0.0, 0.0, 0.0))


@pytest.mark.parametrize('about', [{'cell': 3}, {'inputs': 'all'}, {'belts': [1]}])
def test_a_log_of_a_nameless_cell_is_rejected(about):
    told = {'cell': 'bench', 'inputs': [], 'belts': [], 'misses': [], 'parts': []}
    with pytest.raises(TelegramError, match='is not a valid log of parts'):
        PartsLog().add(json.dumps(told | about))


def test_externally_forced_input_is_valid_until_its_release(bench):
    bench.run(1)
    assert bench.around.force('start', True) == 'start is on from bus cycle 1 on'
    bench.run(1)
    assert bench.around.to_dict()['inputs']['start'] == {'value': True, 'forced': True}
    assert bench.around.force('start', False) == 'start is off from bus cycle 2 on'
    bench.run(5)
    assert not bench.inputs[6]['start']
    assert bench.around.force('start', None) == 'start is no longer forced from bus cycle 7 on'
    bench.run(1)
    assert bench.inputs[7]['start']
    assert not bench.around.to_dict()['inputs']['start']['forced']


def test_an_input_that_there_is_not_is_rejected_by_the_names_that_there_are(bench):
    reason = bench.around.force('strat', True)
    assert isinstance(reason, Reason)
    assert reason.code is Code.CONTENT
    assert str(reason) == "unknown input 'strat', the inputs are: start, vacuum: did you mean start?"

"""Tests of the playing of recordings, without a browser."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

import delta3_pacdrive as d3
from cell_truth import picks_from_a_belt
from delta3_pacdrive import kinematics, simulation
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import runs
from delta3_pacdrive.view.playback import SPEEDS, Clock, Film, Player, overload_of
from delta3_pacdrive.view.values import TurnInstant, tool_angle_rad


@pytest.fixture(scope='module')
def run(tmp_path_factory, robot):
    """Return a run of a program with a fault, from its trace."""
    text = """
        moves:
        - output: {name: gripper, value: true, payload_kg: 0.4}
        - move_l: {to_m: [0.2, 0.1, -0.82]}
        - move_l: {to_m: [-0.2, 0.0, -0.8]}
        faults:
        - {fault: overload, axis: axis2, torque_n_m: 40.0, after_s: 0.4, for_s: 0.5}
    """
    folder = tmp_path_factory.mktemp('run')
    (folder / 'p.yaml').write_text(text)
    trace = simulation.run(program_file.load(folder / 'p.yaml', robot.motion), robot)
    trace.save(folder / 'p.npz')
    return runs.load(str(folder / 'p.npz'))


def test_the_clock_runs_at_its_speed_and_begins_again():
    clock = Clock(1.0, 3.0)
    for speed in SPEEDS:
        clock.seek(1.5)
        clock.speed = speed
        clock.advance(0.25)
        assert clock.time_s == pytest.approx(1.5 + 0.25 * speed)
    clock.advance(10.0)
    assert (clock.time_s, clock.playing) == (1.0, True)


def test_finite_clock_stops_at_its_end():
    clock = Clock(0.0, 2.0)
    clock.again = False
    clock.advance(5.0)
    assert (clock.time_s, clock.playing) == (2.0, False)
    clock.advance(1.0)
    assert clock.time_s == 2.0
    clock.play()
    assert (clock.time_s, clock.playing) == (0.0, True)
    clock.seek(-4.0)
    assert clock.time_s == 0.0
    clock.seek(float('nan'))
    assert clock.time_s == 2.0


def test_an_instant_is_that_of_its_cycle(run, robot):
    film = Film(run)
    for row in (0, 250, len(film.time_s) - 1):
        instant = film.at(row)
        assert film.row(instant.time_s) == row
        assert film.row(instant.time_s + 0.9 * run.period_s) == row
        tcp = kinematics.forward(instant.theta_rad, robot)
        assert tcp == pytest.approx(run.window['tcp_actual'][row], abs=1e-9)
        assert instant.true_m == pytest.approx(run.window['tcp_true'][row])
        assert instant.torque_n_m == pytest.approx(
            run.window['current'][row] * robot.motor.torque_constant_n_m_a
        )


def test_the_load_of_a_motor_is_that_of_all_samples_of_its_current(run, robot):
    film, nominal, limit = Film(run), robot.motor.nominal_current_a, robot.drive.overload_time_s
    expected = overload_of(run.window['current_rms'] / nominal, run.period_s) / limit
    row = int(expected.max(axis=1).argmax())
    assert expected[row].max() > 0.01
    assert film.at(row).overload.tolist() == expected[row].tolist()
    of_the_at = overload_of(run.window['current'] / nominal, run.period_s) / limit
    assert film.at(row).overload.tolist() != of_the_at[row].tolist()


def test_readout_is_that_of_its_time(run):
    film = Film(run)
    first = film.facts(0, 'playing', 1.0)
    assert (first.moves, first.fault) == (len(run.moves), '')
    middle = film.facts(film.row(0.1), 'playing', 0.5)
    assert (middle.outputs, middle.payload_kg, middle.override) == (1, 0.4, 0.5)
    injected = next(mark for mark in run.marks if mark.text.startswith('injected: '))
    disturbed = film.facts(film.row(injected.time_s + 0.5 * run.period_s), 'playing', 1.0)
    assert 'axis2' in disturbed.fault
    assert disturbed.sources == ()  # no drive has told of it yet
    last = film.facts(len(film.time_s) - 1, 'paused', 1.0)
    assert 'axis2' in last.fault
    assert last.sources == ('axis2',)


def test_tool_of_a_rotary_axis_is_shown_at_its_recorded_angle(run, tmp_path, robot):
    text = 'moves: [{move_l: {to_m: [0.1, 0.0, -0.8], turn_deg: 60}}]'
    (tmp_path / 'p.yaml').write_text(text)
    turning = robot.replace(rotary__present=True)
    simulation.run(program_file.load(tmp_path / 'p.yaml', turning.motion), turning).save(tmp_path / 'p.npz')
    turned = runs.load(str(tmp_path / 'p.npz'))
    row = len(turned.window.time_s) // 2
    angle, error, true = (
        float(turned.window[f'turn_{name}'][row, 0]) for name in ('position', 'error', 'true')
    )
    assert 0.1 < angle < 1.0
    assert Film(turned).at(row).turns == (TurnInstant(angle, error, true),)
    assert Film(run).at(row).turns == ()


def test_part_on_a_rotary_axis_is_shown_at_its_recorded_angle(tmp_path, robot):
    (tmp_path / 'p.yaml').write_text("""
        start_m: [-0.1525, 0.0, -0.85]
        payload_kg: 0.0
        moves:
        - output: {name: gripper, value: true, payload_kg: 0.5}
        - dwell: {time_s: 0.05}
        - move_l: {to_m: {by_m: [0, 0, 0.05]}}
        - move_l: {to_m: {by_m: [0.2, 0, 0]}, turn_deg: 120}
    """)
    turning = robot.replace(rotary__present=True)
    program = program_file.load(tmp_path / 'p.yaml', turning.motion)
    d3.simulate(program, turning, cell='cell').save(tmp_path / 'p.npz')
    film = Film(runs.load(str(tmp_path / 'p.npz')))
    for row in (0, len(film.time_s) // 2, len(film.time_s) - 1):
        now = film.at(row)
        (part,) = (one for one in now.cell.parts if one.number == 0)
        assert part.angle_rad == pytest.approx(tool_angle_rad(now.turns), abs=np.radians(0.2))
    assert part.angle_rad == pytest.approx(np.radians(120.0), abs=np.radians(0.2))


def test_a_recording_without_positions_is_rejected(run):
    trace = Trace(run.window.time_s, {'current': run.window['current']}, run.window.meta)
    bare = runs.Run(**{name: getattr(run, name) for name in run.__dataclass_fields__} | {'window': trace})
    with pytest.raises(TraceError, match=r'cannot be shown without motor_position .* it has only current$'):
        Film(bare)


def test_the_load_of_a_recording_is_that_which_the_drives_count(robot):
    rng = np.random.default_rng(5)
    ratio = rng.uniform(0.0, 3.0, (400, 3))
    found = overload_of(ratio, 1e-3)
    for axis in range(3):
        sums = np.concatenate([[0.0], np.cumsum((ratio[:, axis] ** 2 - 1.0) * 1e-3)])
        assert found[:, axis] == pytest.approx((sums - np.minimum.accumulate(sums))[1:], abs=1e-12)


def test_drives_are_shown_by_their_status_words(run):
    film = Film(run)
    (tripped,) = [mark.time_s for mark in run.marks if mark.kind == 'fault' and mark.text.startswith('stop')]

    def told(time_s):
        return [(drive.state, drive.brake) for drive in film.facts(film.row(time_s), 'paused', 1.0).drives]

    assert told(0.0) == [('ENABLED', 'free')] * 3
    assert told(tripped + 0.02)[1][0] in ('STOPPING', 'FAULT')
    assert told(run.window.time_s[-1])[1] == ('FAULT', 'held')
    assert {state for state, _ in told(run.window.time_s[-1])} <= {'READY', 'FAULT'}


def test_unrecorded_drives_send_no_reports(run):
    film = Film(replace(run, drives=()))
    assert [(drive.state, drive.brake) for drive in film.facts(0, 'paused', 1.0).drives] == [('', '')] * 3


def test_load_of_a_recording_is_constant_where_the_current_is_missing():
    ratio = np.full((300, 3), 2.0)
    ratio[100:150, 1] = np.nan
    found = overload_of(ratio, 1e-3)
    assert found[-1] == pytest.approx([0.9, 0.75, 0.9])
    assert (found[100:150, 1] == found[99, 1]).all()


def test_the_tcp_error_is_the_recorded_one_and_only_without_it_that_of_the_following_error(run, robot):
    film, told = Film(run), run.window['tcp_error']
    row = int(np.linalg.norm(told, axis=1).argmax())
    assert film.at(row).error_m.tolist() == told[row].tolist()
    signals = {name: values for name, values in run.window.signals.items() if name != 'tcp_error'}
    bare = Film(replace(run, window=Trace(run.window.time_s, signals, run.window.meta)))
    lag = run.window['following_error'][row]
    commanded = kinematics.forward(film.at(row).theta_rad + lag, robot)
    assert bare.at(row).error_m == pytest.approx(commanded - run.window['tcp_actual'][row], abs=1e-9)
    assert film.before(10.0, 100.0)[row, 1:4] == pytest.approx(1e3 * told[row])


def test_parts_of_a_recording_are_where_they_truly_were(tmp_path):
    trace, truth = picks_from_a_belt()
    trace.save(tmp_path / 'run.npz')
    film = Film(runs.load(str(tmp_path / 'run.npz')))
    assert [thing.kind for thing in film.things] == ['belt', 'window', 'barrier', 'box']
    start, shown = trace.meta['start_cycle'], 0
    assert start > 0  # times of a recording count from the start of its program
    for row in range(1200, 1800, 7):
        instant = film.at(row)
        cycle = round(instant.time_s / film.run.period_s) + start
        _, true = truth.cycles[cycle]
        assert instant.cell.ways_m['line'] == pytest.approx(trace['cell_belts'][cycle, 0], abs=1e-9)
        shown += len(instant.cell.parts)
        for part in instant.cell.parts:
            assert part.size_m == (0.06, 0.04, 0.02)
            # in hand it goes with the TCP that is drawn, which the encoders see
            assert part.at_m == pytest.approx(true[part.number][0], abs=2e-4)
    assert shown >= 100
    assert film.facts(1400, 'playing', 1.0).payload_kg is None


def test_inputs_of_a_recording_are_read_and_a_recording_without_a_cell_has_none(run, tmp_path):
    trace = d3.simulate('packaging', signals=['cell_inputs'], cell='cell')
    trace.save(tmp_path / 'run.npz')
    film = Film(runs.load(str(tmp_path / 'run.npz')))
    names, seen = trace.meta['cell']['inputs'], set()
    for row in range(0, len(film.time_s), 20):
        told = film.facts(row, 'playing', 1.0).inputs
        assert [one.name for one in told] == names
        assert [one.on for one in told] == [
            value > 0.0 for value in film.run.window['cell_inputs'][row][: len(names)]
        ]
        seen |= {(one.name, one.on) for one in told}
    assert {on for _, on in seen} == {True, False}
    bare = Film(run)
    assert (bare.things, bare.at(0).cell, bare.facts(0, 'playing', 1.0).inputs) == ((), None, ())


class Slider:
    """A slider like that of viser: changes of its value by the program are sent to the page."""

    def __init__(self, value):
        self._value, self.sent, self.asked = value, [], None

    @property
    def value(self):
        return self._value

    @value.setter
    def value(self, value):
        if value != self._value:
            self.sent.append(value)
        self._value = value

    def on_update(self, asked):
        self.asked = asked

    def slide(self, value):
        """Move the slider as a user of the page."""
        self._value = value
        self.sent.clear()
        self.asked(SimpleNamespace(client='somebody'))


@pytest.mark.parametrize('playing', [True, False])
def test_slider_set_during_transfers_is_sent_with_its_last_value(run, playing):
    page, sliders = MagicMock(), []
    page.server.gui.add_slider.side_effect = lambda *given: sliders.append(Slider(given[-1])) or sliders[0]
    player, drawn = Player(page, Film(run)), []

    def show(instant):
        drawn.append(instant.time_s)
        if len(drawn) == 8:
            player.clock.playing = playing
            sliders[0].slide(0.5)
        elif len(drawn) == 16:
            player.stop()

    page.show.side_effect = show
    player.clock.play()
    player.run()
    assert sliders[0].sent[-1] == 0.5
    assert drawn[-1] == pytest.approx(0.5, abs=1e-3)

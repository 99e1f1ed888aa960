"""Tests of optimisations in a folder: a second run of the best, no repeated work, complete reports."""

import os
import signal

import pytest
import yaml

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.fleet.optimisation import report
from delta3_pacdrive.studies.fleet.optimisation.run import PARAMETERS, PROGRAM, Study
from delta3_pacdrive.studies.fleet.sweep import engine, single_run
from delta3_pacdrive.studies.fleet.sweep.study import Settings
from delta3_pacdrive.studies.framework.study import silent

for needed in ('optuna', 'distributed', 'pyarrow'):
    pytest.importorskip(needed, reason='optimisations need the extra "optimise"')

SPEC = """\
program: short.yaml
parameters: delta3
trials: 12
together: 4
vary:
  drive.position_gain_rad_s_rad: {uniform: [30.0, 120.0]}
  program.moves[0].move_l.speed_m_s: {list: [-1.0, 0.05, 0.5]}
goal: {minimise: tcp_error_max_m}
keep: [tcp_error_max_m, program_s]
limits: {program_s: 0.9}
"""
SHORT = """\
start_m: [0.0, 0.0, -0.8]
moves:
- move_l: {to_m: [0.02, 0.0, -0.8], speed_m_s: 0.5}
"""


class Here:
    """A cluster that is this process, and counts runs; it may fall to pieces."""

    def __init__(self, monkeypatch):
        self.made, self.lost_after = [], None
        monkeypatch.setattr(engine, 'cluster', lambda workers, scheduler: self)
        monkeypatch.setattr(engine, 'workers_of', lambda client: 1)
        monkeypatch.setattr(engine, 'make', self.make)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def make(self, client, sweep, work, keep):
        for batch in work:
            if len(self.made) == self.lost_after:
                raise KeyboardInterrupt
            self.made += [number for number, _ in batch]
            keep(engine.made(sweep, batch))


@pytest.fixture
def here(monkeypatch):
    return Here(monkeypatch)


@pytest.fixture
def path(tmp_path):
    (tmp_path / 'short.yaml').write_text(SHORT, encoding='utf-8')
    (tmp_path / 'own.yaml').write_text(SPEC, encoding='utf-8')
    return tmp_path / 'own.yaml'


def study(path, folder, progress=silent, workers=1):
    return Study(Settings(path, workers), folder, 'delta3 optimise own.yaml', progress)


def told(document):
    return {
        name: document[name] for name in ('best', 'base', 'outcomes', 'importance', 'trials_within_limits')
    }


def test_interrupted_search_continues_to_the_same_end(path, here, tmp_path):
    whole = study(path, tmp_path / 'whole').run()
    assert sorted(here.made) == list(range(1, 13))
    here.made.clear()
    here.lost_after = 6  # in the middle of a round
    first = study(path, tmp_path / 'some')
    with pytest.raises(KeyboardInterrupt):
        first.run()
    assert first.kept == 6
    here.lost_after = None
    resumed = study(path, tmp_path / 'some').run()
    assert sorted(here.made) == list(range(1, 13))
    assert told(resumed) == told(whole)
    assert (resumed['runs_made'], whole['runs_made']) == (6, 12)
    table = [(tmp_path / name / 'trials.csv').read_text().splitlines()[-12:] for name in ('whole', 'some')]
    assert table[0] == table[1]
    # and more trials go on from there
    here.made.clear()
    path.write_text(SPEC.replace('trials: 12', 'trials: 14'), encoding='utf-8')
    assert study(path, tmp_path / 'some').run()['runs_made'] == 2
    assert sorted(here.made) == [13, 14]


def test_the_best_is_driven_again_from_its_files_to_the_last_bit(path, here, tmp_path):
    document = study(path, tmp_path / 'out').run()
    best = document['best']
    robot = parameters.load(tmp_path / 'out' / PARAMETERS)
    assert robot.drive.position_gain_rad_s_rad == best['values']['drive.position_gain_rad_s_rad']
    program = program_file.load(tmp_path / 'out' / PROGRAM, robot.motion)
    trace = simulation.run(program, robot)
    assert trace.meta['figures']['tcp_error_max_m'] == best['value']
    assert trace.meta['program_s'] == best['kept']['program_s'] <= 0.9
    assert best['values']['program.moves[0].move_l.speed_m_s'] == 0.05
    assert (
        document['again']
        == f'delta3 simulate {tmp_path}/out/{PROGRAM} --parameters {tmp_path}/out/{PARAMETERS}'
    )
    assert best['value'] < document['base']['value']
    assert document['base']['values']['drive.position_gain_rad_s_rad'] == 60.0
    assert document['base']['trial'] == 1
    lines = list(report.text(document))
    refused = document['outcomes']['refused']
    assert refused
    within = document['trials_within_limits']
    assert (
        lines[0]
        == f'own: 12 trials of short: {12 - refused} done, {refused} refused; {within} within the limits'
    )
    assert f'least tcp_error_max_m: {best["value"]:.5g} in trial {best["trial"]}, ' in '\n'.join(lines)
    assert any(line.startswith(f'{refused} trials: ') and 'speed' in line for line in lines)
    assert lines[-1] == f'again: {document["again"]}'


def test_file_values_outside_the_choices_have_a_separate_base_run(path, here, tmp_path):
    path.write_text(SPEC.replace('[30.0, 120.0]', '[70.0, 120.0]').replace('12', '4', 1), encoding='utf-8')
    document = study(path, tmp_path / 'out').run()
    assert sorted(here.made)[0] == 0
    assert document['base']['trial'] == 0
    robot = parameters.load('delta3')
    trace = simulation.run(program_file.load(path.parent / 'short.yaml', robot.motion), robot)
    assert document['base']['value'] == trace.meta['figures']['tcp_error_max_m']


def test_optimisation_without_a_feasible_trial_writes_no_best_files(path, here, tmp_path):
    path.write_text(
        SPEC.replace('program_s: 0.9', 'program_s: 0.001').replace('trials: 12', 'trials: 4'),
        encoding='utf-8',
    )
    document = study(path, tmp_path / 'out').run()
    assert document['best'] is None
    assert document['again'] is None
    assert not (tmp_path / 'out' / PARAMETERS).exists()
    lines = list(report.text(document))
    assert 'no trial is within the limits' in lines
    assert any(
        line.startswith(f'trial {document["nearest"]["trial"]} exceeds them least: program_s ')
        for line in lines
    )


def test_folder_with_trials_of_another_search_is_rejected(path, here, tmp_path, monkeypatch):
    study(path, tmp_path / 'out').run()
    monkeypatch.setattr(engine, 'to_row', lambda values: {'drive.position_gain_rad_s_rad': 1.0})
    with pytest.raises(SweepError, match=r'trial 1 in .* has other values than those of this search'):
        study(path, tmp_path / 'out').run()


@pytest.mark.long
def test_a_killed_worker_changes_nothing_on_two_workers(path, here, tmp_path, monkeypatch):
    serial = study(path, tmp_path / 'serial').run()
    monkeypatch.undo()
    killed = []
    made = engine.make

    def make(client, sweep, work, keep):
        if not killed:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)
        made(client, sweep, work, keep)

    monkeypatch.setattr(engine, 'make', make)
    document = study(path, tmp_path / 'two', workers=2).run()
    assert killed
    assert told(document) == told(serial)


def test_only_whole_documents_are_left_as_programs(path):
    own = study(path, path.parent / 'out')
    runner = single_run.Runner(own.optimisation.sweep)
    document = runner.document({'program.moves[0].move_l.speed_m_s': 0.2})
    assert document['moves'][0]['move_l']['speed_m_s'] == 0.2
    assert runner.document({}) == yaml.safe_load(SHORT)

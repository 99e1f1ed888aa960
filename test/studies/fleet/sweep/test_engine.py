"""Tests of sweeps on several processes: the same table for any number, resumed, and with a killed process."""

import json
import os
import signal

import pyarrow.parquet as parquet
import pytest

from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.studies.fleet.sweep import engine
from delta3_pacdrive.studies.fleet.sweep.run import Study
from delta3_pacdrive.studies.fleet.sweep.sampling import values_of
from delta3_pacdrive.studies.fleet.sweep.specification import load
from delta3_pacdrive.studies.fleet.sweep.store import MANIFEST, TABLE, Store
from delta3_pacdrive.studies.fleet.sweep.study import Settings
from delta3_pacdrive.studies.framework.study import silent

distributed = pytest.importorskip('distributed', reason='sweeps need the extra "sweep"')
CommClosedError = distributed.comm.CommClosedError

SPEC = """\
program: short.yaml
parameters: delta3
runs: 36
vary:
  dynamics.payload_mass_kg: {uniform: [0.0, 12.0]}
  drive.velocity_gain_a_s_rad: {list: [0.3, 0.35]}
keep: [tcp_error_max_m, current_rms_a_1]
limits: {tcp_error_max_m: 0.001}
"""
SHORT = """\
start_m: [0.0, 0.0, -0.8]
moves:
- move_l: {to_m: [0.02, 0.0, -0.8], speed_m_s: 0.5}
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / 'short.yaml').write_text(SHORT, encoding='utf-8')
    (tmp_path / 'own.yaml').write_text(SPEC, encoding='utf-8')
    return tmp_path / 'own.yaml'


@pytest.fixture
def serial(path):
    """Return the rows as one process makes them, run by run, the last one first."""
    sweep = load(path)
    values = values_of(sweep)
    rows = [engine.made(sweep, [(n, engine.values_in(values, n))])[0] for n in range(sweep.runs, 0, -1)]
    names = dict.fromkeys(name for row in rows for name in row)
    return [{name: row.get(name) for name in names} for row in rows[::-1]]


def rows_of(folder):
    return parquet.read_table(folder / TABLE).to_pylist()


def study(path, folder, workers, progress=silent):
    return Study(Settings(path, workers), folder, 'delta3 sweep own.yaml', progress)


@pytest.mark.long
def test_a_killed_worker_and_an_interruption_change_no_bit_of_the_table(path, serial, tmp_path):
    folder, killed = tmp_path / 'out', []

    def kill(stage, done, _total):
        if done and not killed:
            (client,) = clients
            pids = client.run(os.getpid)
            os.kill(next(iter(pids.values())), signal.SIGKILL)
            killed.append(done)
        elif killed and done >= killed[0] + 10:
            raise KeyboardInterrupt

    clients = []
    cluster = engine.cluster

    def watched(workers, scheduler):
        return Watched(cluster(workers, scheduler), clients)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, 'cluster', watched)
        first = study(path, folder, 2, kill)
        with pytest.raises(KeyboardInterrupt):
            first.run()
    assert killed
    assert 10 <= first.kept < 36
    parts = sorted(part.name for part in folder.glob('part_*.parquet'))
    assert parts
    assert not (folder / TABLE).exists()
    # goes on, on one worker
    document = study(path, folder, 1).run()
    assert document['runs_made'] == 36 - first.kept
    assert rows_of(folder) == serial
    assert list(folder.glob('part_*')) == []
    refused = sum(row['outcome'] == 'refused' for row in serial)
    assert 0 < refused < 36
    assert document['outcomes'] == {'done': 36 - refused, 'stopped': 0, 'refused': refused}
    # and there is nothing to be done any more
    again = study(path, folder, 2).run()
    assert (again['runs_made'], again['workers']) == (0, 0)
    assert rows_of(folder) == serial


class Watched:
    """Notes the client of a cluster."""

    def __init__(self, cluster, clients):
        self._cluster, self._clients = cluster, clients

    def __enter__(self):
        self._clients.append(self._cluster.__enter__())
        return self._clients[-1]

    def __exit__(self, *error):
        return self._cluster.__exit__(*error)


def test_folder_of_another_sweep_is_rejected_and_unchanged(path, tmp_path):
    folder = tmp_path / 'out'
    Store(folder, load(path)).open()
    before = (folder / MANIFEST).read_text()
    path.write_text(SPEC.replace('36', '35'), encoding='utf-8')
    with pytest.raises(SweepError, match='contains sweep own, which differs'):
        study(path, folder, 1).run()
    assert (folder / MANIFEST).read_text() == before
    (folder / MANIFEST).write_text('{"', encoding='utf-8')
    with pytest.raises(SweepError, match='cannot store a sweep in'):
        study(path, folder, 1).run()


def test_batches_are_the_same_however_many_runs_are_missing(path):
    sweep = load(path)
    whole = list(engine.batches(sweep, range(1, 37)))
    assert [number for batch in whole for number in batch] == list(range(1, 37))
    some = list(engine.batches(sweep, [3, 4, 30]))
    assert [number for batch in some for number in batch] == [3, 4, 30]
    assert all(any(set(batch) <= set(other) for other in whole) for batch in some)


def test_absent_cluster_and_one_of_other_sources_are_rejected_with_one_message(path, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, 'CONNECT_S', 0.5)
    settings = Settings(path, scheduler='tcp://127.0.0.1:1')
    with pytest.raises(SweepError, match=r'no cluster responds at tcp://127.0.0.1:1') as told:
        Study(settings, tmp_path / 'out', 'test', silent).run()
    assert '\n' not in str(told.value)

    class Client:
        def run(self, function):
            return {'tcp://here': 'delta3_pacdrive 0.0.1'}

    with pytest.raises(
        SweepError, match=r'worker tcp://here has delta3_pacdrive 0\.0\.1, but this is delta3_pacdrive '
    ):
        engine.require_same_version(Client(), 'tcp://there')
    with pytest.raises(SweepError, match='has no worker'):
        engine.require_same_version(type('Empty', (), {'run': lambda self, function: {}})(), 'tcp://there')


def test_late_worker_with_other_sources_executes_no_run(path):
    sweep = load(path)
    with pytest.raises(
        SweepError, match=r'a worker has delta3_pacdrive .*, but this is delta3_pacdrive 0\.0\.1'
    ):
        engine.made_by_same('delta3_pacdrive 0.0.1', sweep, [(1, {})])


@pytest.mark.parametrize(
    ('status', 'error', 'sentence'),
    [
        ('connecting', OSError('full'), 'the scheduler does not respond'),
        ('running', CommClosedError('gone'), 'the scheduler does not respond'),
        ('running', OSError('full'), 'failed: OSError: full'),
    ],
)
def test_broken_cluster_is_reported_with_one_message(status, error, sentence, path, monkeypatch):

    class Future:
        def result(self):
            raise error

    class Client:
        loop = None

        def submit(self, *work, **how):
            return Future()

    client = Client()
    client.status = status
    monkeypatch.setattr(engine, 'workers_of', lambda client: 1)
    monkeypatch.setattr(distributed, 'as_completed', lambda futures, loop: iter(futures))
    sweep = load(path)
    with pytest.raises(SweepError, match=sentence) as told:
        engine.make(client, sweep, engine.work_of(sweep, values_of(sweep), [1]), lambda rows: None)
    assert '\n' not in str(told.value)


def test_dry_run_lists_the_work_without_writing(path, tmp_path):
    told = study(path, tmp_path / 'out', 1).dry_run()
    assert (told['runs'], told['runs_made']) == (36, 0)
    assert told['core_seconds'] == pytest.approx(36 * told['seconds_a_run'])
    assert told['disk_bytes'] > 36 * 7 * 8
    assert not (tmp_path / 'out').exists()


def test_a_run_is_made_again_with_all_of_its_signals(path, serial, tmp_path):
    trace = study(path, tmp_path / 'out', 1).again(5)
    assert trace.meta['figures']['tcp_error_max_m'] == serial[4]['tcp_error_max_m']
    with pytest.raises(SweepError, match='run is 37, but the sweep has runs 1 to 36'):
        study(path, tmp_path / 'out', 1).again(37)


def test_values_in_the_table_are_numbers_and_all_else_is_json():
    assert engine.to_row({'a': 1, 'b': True, 'c': 'cubic', 'd': [1, 2]}) == {
        'a': 1.0, 'b': 'true', 'c': '"cubic"', 'd': '[1, 2]',
    }  # fmt: skip
    assert json.loads(engine.to_row({'a': {'fault': 'drop_at'}})['a']) == {'fault': 'drop_at'}


@pytest.mark.long
def test_log_of_a_worker_does_not_grow():
    with engine.cluster(1, '') as client:
        for number in range(100):
            assert client.submit(abs, -number, pure=False).result() == number
        (noted,) = client.run(lambda dask_worker: len(dask_worker.state.stimulus_log)).values()
        told = client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.transition_log))
    assert 0 < noted <= 10
    assert 0 < told <= 10

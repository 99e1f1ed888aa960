"""Tests of the table of a sweep."""

from delta3_pacdrive.studies.fleet.sweep.specification import load
from delta3_pacdrive.studies.fleet.sweep.store import Store


def test_rows_of_the_table_are_sorted_by_run_for_any_order_of_workers(tmp_path):
    file = tmp_path / 'sweep.yaml'
    file.write_text('program: experiment1\nruns: 3\nvary: {dynamics.payload_mass_kg: {uniform: [0, 1]}}\n')
    store = Store(tmp_path / 'sweep', load(file))
    assert store.open() == {}
    rows = [{'run': run, 'value': float(run)} for run in (2, 0, 1)]
    for row in rows:
        store.add([row])
    store.finish(rows)
    assert list(store.open().values()) == sorted(rows, key=lambda row: row['run'])

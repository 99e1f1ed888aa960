"""Tests of figures and traces of a run (thesis 11.1.1)."""

import json
import struct
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs import run_figures, run_signals
from reports_read import read_drawing
from thoroughness import some

PROMISED = {
    'tcp_path_3d.png',
    'arm_angles.png',
    'arm_velocities.png',
    'arm_accelerations.png',
    'currents.png',
    'tcp_components.png',
    'tcp_error_norm.png',
    'following_error.png',
    'master.png',
    'tcp_speed.png',
}


@pytest.fixture(scope='module')
def trace() -> Trace:
    robot = parameters.load()
    return simulation.run(programs.load('experiment1', robot.motion), robot)


@pytest.mark.long
def test_every_promised_figure_is_drawn_in_a_readable_size(trace: Trace, tmp_path: Path, drawn: None) -> None:
    paths = run_figures.draw(trace, ReportFolder(tmp_path, Provenance.of('test')))
    assert {path.name for path in paths} == PROMISED
    for path in paths:
        data = path.read_bytes()
        assert data[:8] == b'\x89PNG\r\n\x1a\n'
        width, height = struct.unpack('>II', data[16:24])
        assert width >= 800
        assert height >= 400


@pytest.fixture(scope='module')
def turning(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    path = tmp_path_factory.mktemp('programs') / 'turning.yaml'
    path.write_text('name: turning\nmoves: [{move_l: {to_m: [0.2, 0.1, -0.8], turn_deg: [90, -40]}}]\n')
    robot = parameters.load('supply').replace(rotary__present=True, rotary_2__present=True)
    return simulation.run(programs.load(path, robot.motion), robot)


def test_a_run_has_one_figure_more_for_each_rotary_axis_and_for_a_modelled_dc_link(
    turning: Trace, tmp_path: Path
) -> None:
    paths = run_figures.draw(turning, ReportFolder(tmp_path, Provenance.of('test')))
    assert {path.name for path in paths} == {*PROMISED, 'turn.png', 'turn_2.png', 'supply.png'}
    ends = [make(turning).axes[0].lines[0].get_ydata()[-1] for make in run_figures.TURNS]
    assert ends == pytest.approx([90.0, -40.0], abs=0.5)


def test_figure_of_the_rotation_is_drawn_separately(turning: Trace, tmp_path: Path) -> None:
    asked = run_figures.draw(turning, ReportFolder(tmp_path, Provenance.of('test')), ['turn_position'])
    assert [path.name for path in asked] == ['turn.png']


def test_of_a_bag_the_turn_is_drawn_without_the_truth(turning: Trace) -> None:
    signals = {name: values for name, values in turning.signals.items() if name != 'turn_true'}
    angle = run_figures.turn(Trace(turning.time_s, signals, turning.meta)).axes[0]
    assert [line.get_label() for line in angle.lines] == ['actual', 'command']


def test_a_run_without_a_rotary_axis_has_no_turn_to_draw(trace: Trace, tmp_path: Path) -> None:
    with pytest.raises(TraceError, match='turn_position'):
        run_figures.draw(trace, ReportFolder(tmp_path, Provenance.of('test')), ['turn_position'])


def test_saved_trace_is_restored_to_the_bit(trace: Trace, tmp_path: Path) -> None:
    trace.save(tmp_path / 'run.npz')
    loaded = trace_file.load(tmp_path / 'run.npz')
    np.testing.assert_array_equal(loaded.time_s, trace.time_s)
    assert loaded.signals.keys() == trace.signals.keys()
    for name, values in trace.signals.items():
        np.testing.assert_array_equal(loaded[name], values)
    assert loaded.meta == trace.meta


@pytest.mark.parametrize('suffix', some(['npz', 'csv'], ['csv']))
def test_plotted_data_is_written_next_to_the_figures_with_its_origin(
    suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f'run.{suffix}'
    assert main(['simulate', '--trace', str(file), '--json']) == 0
    origin = json.loads(capsys.readouterr().out)['provenance']
    assert origin['command'] == f'delta3 simulate --trace {file} --json'
    assert main(['plot', str(file), '--output', str(tmp_path / 'figures'), '--json']) == 0
    files = json.loads(capsys.readouterr().out)['files']
    data, run = trace_file.load(files[-1]), trace_file.load(file)
    assert data.meta['provenance'] == origin
    assert data.meta['plotted']['parameters'] == run.meta['checksum'] == parameters.load().checksum
    assert all(Path(picture).read_bytes().count(b'delta3 plot') == 1 for picture in files[:-1])
    assert data.signals.keys() == run.signals.keys()
    for name, values in run.signals.items():
        np.testing.assert_array_equal(data[name], values)


@pytest.mark.parametrize('name', ['nowhere', 'nowhere.npz', 'text.npz', 'empty_folder'])
def test_invalid_recording_is_rejected_with_one_message(name: str, tmp_path: Path) -> None:
    (tmp_path / 'text.npz').write_text('no trace')
    (tmp_path / 'empty_folder').mkdir()
    with pytest.raises(TraceError) as refusal:
        trace_file.load(tmp_path / name)
    assert name in str(refusal.value)
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('name', ['run.xlsx', 'run', 'run.npz.bak'])
def test_trace_in_conflict_with_its_file_name_is_rejected_by_name(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    for command in (['simulate', '--trace'], ['tune', '--excite'], ['estimate', '--measurement']):
        with pytest.raises(SystemExit) as end:
            main([*command, str(path)])
        assert end.value.code == 2
        assert f'cannot write {path}: the name ' in (told := capsys.readouterr().err)
        assert 'must end in .npz, .csv or .parquet' in told
    with pytest.raises(TraceError, match=r'must end in \.npz, \.csv or \.parquet'):
        trace_file.save(Trace(np.zeros(1), {}), path)
    assert not list(tmp_path.iterdir())


def test_an_ending_in_capitals_is_the_same_ending(trace: Trace, tmp_path: Path) -> None:
    for name in ('RUN.NPZ', 'RUN.CSV'):
        trace_file.save(trace, tmp_path / name)
        assert trace_file.load(tmp_path / name).time_s.tobytes() == trace.time_s.tobytes()


# windows and signals


def late(trace: Trace, cycles: int, idle: int = 5000) -> Trace:
    """Return the run as recorded by a late recorder on a running robot: without the end, with long rest after it."""
    rest = {name: np.repeat(values[-1:], idle, axis=0) for name, values in trace.signals.items()}
    count = len(trace.time_s) + idle
    meta = {key: value for key, value in trace.meta.items() if key != 'end_cycle'}
    meta['start_cycle'] += cycles
    signals = {name: np.concatenate([values, rest[name]]) for name, values in trace.signals.items()}
    return Trace((cycles + np.arange(count)) * 1e-3, signals, meta)


def drawn(trace: Trace) -> tuple[float, float]:
    """Return the first and the last time of the curves of a figure [s]."""
    line = run_figures.currents(trace).axes[0].get_lines()[0]
    times = np.asarray(line.get_xdata(), dtype=float)
    return float(times[0]), float(times[-1])


def test_figures_of_a_robot_that_was_up_begin_with_the_program_and_end_with_its_motion(trace: Trace) -> None:
    own = late(trace, 500_000)
    first, last = drawn(own)
    assert first == pytest.approx(-run_signals.BEFORE_S)
    end_s = (trace.meta['end_cycle'] - trace.meta['start_cycle']) * 1e-3
    assert last == pytest.approx(end_s + run_signals.AFTER_S, abs=0.01)
    (label,) = {axes.get_xlabel() for axes in run_figures.currents(own).axes} - {''}
    assert label == 'time from program start [s]'


@pytest.mark.parametrize(
    ('signal', 'labels'),
    [
        ('tcp_speed', ['tcp_speed [m/s]']),
        ('jacobian', ['condition', 'speed [m/s]', 'acceleration [m/s2]']),
        ('outputs', ['gripper', *'1234567']),
        ('drive_voltage', ['1 [V]', '2 [V]', '3 [V]']),
        ('status_word', ['1 [bits]', '2 [bits]', '3 [bits]']),
    ],
)
def test_a_signal_on_request_has_a_panel_for_each_of_its_columns(
    signal: str, labels: list[str], trace: Trace
) -> None:
    values = np.arange(float(len(trace.time_s) * len(labels))).reshape(-1, len(labels))
    run = Trace(trace.time_s, {signal: values}, trace.meta)
    figure = read_drawing(partial(run_figures.signal_panels, run, signal))
    assert [axes.get_ylabel() for axes in figure.axes] == labels


@pytest.mark.parametrize(('rest_s', 'together'), [(2.0, True), (60.0, False)])
def test_a_program_long_after_the_first_makes_no_spikes_of_it(
    rest_s: float, together: bool, trace: Trace
) -> None:
    one = late(trace, 500_000, round(rest_s / 1e-3))
    again = late(trace, 500_000 + len(one.time_s), 10)
    signals = {name: np.concatenate([values, again[name]]) for name, values in one.signals.items()}
    starts = [one.meta['start_cycle'], again.meta['start_cycle']]
    both = Trace(np.concatenate([one.time_s, again.time_s]), signals, one.meta | {'starts': starts})
    end_s = (trace.meta['end_cycle'] - trace.meta['start_cycle']) * 1e-3 + run_signals.AFTER_S
    second_s = (starts[1] - starts[0]) * 1e-3
    assert drawn(both)[1] == pytest.approx(end_s + (second_s if together else 0.0), abs=0.02)
    assert drawn(run_signals.windowed(both, second_s, second_s + 0.3)) == pytest.approx(
        (second_s, second_s + 0.3)
    )


@pytest.mark.parametrize(
    ('window', 'expected'),
    [
        ((0.2, 0.5), (0.2, 0.5)),
        ((0.2, None), (0.2, None)),
        ((None, 0.5), (-run_signals.BEFORE_S, 0.5)),
        ((-0.01, 0.0), (-0.01, 0.0)),
        ((4.0, 4.5), (4.0, 4.5)),
        ((4.0, None), (4.0, 6.512)),  # behind the program: what is there
    ],
)
def test_a_window_counts_from_the_start_of_the_program(
    window: tuple[float | None, float | None], expected: tuple[float, float | None], trace: Trace
) -> None:
    own = late(trace, 500_000)
    first, last = drawn(run_signals.windowed(own, *window))
    assert first == pytest.approx(expected[0], abs=1e-9)
    assert last == pytest.approx(drawn(own)[1] if expected[1] is None else expected[1], abs=0.1)


def test_a_window_without_a_program_counts_bus_time(trace: Trace) -> None:
    meta = {key: value for key, value in trace.meta.items() if key not in ('start_cycle', 'end_cycle')}
    own = run_signals.windowed(Trace(trace.time_s, trace.signals, meta), 0.3, 0.4)
    assert drawn(own) == pytest.approx((0.3, 0.4))


def test_a_gap_in_a_recording_makes_no_spike(trace: Trace) -> None:
    keep = np.ones(len(trace.time_s), dtype=bool)
    keep[400:430] = False
    cut = Trace(trace.time_s[keep], {n: v[keep] for n, v in trace.signals.items()}, trace.meta)
    for whole, gapped in zip(
        run_figures.arm_accelerations(trace).axes, run_figures.arm_accelerations(cut).axes, strict=True
    ):
        highest = [
            max(np.nanmax(np.abs(np.asarray(line.get_ydata(), float))) for line in axes.get_lines())
            for axes in (whole, gapped)
        ]
        assert highest[1] <= highest[0]


def test_command_draws_and_writes_the_requested_window_and_signals(
    trace: Trace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = late(trace, 500_000)
    own.meta['starts'] = [own.meta['start_cycle'], own.meta['start_cycle'] + 3000]
    own.save(tmp_path / 'run.npz')
    arguments = ['--from', '0.1', '--to', '0.3', '--signals', 'current,coupling_torque']
    folder = tmp_path / 'figures'
    assert main(['plot', str(tmp_path / 'run.npz'), *arguments, '--output', str(folder)]) == 0
    printed = capsys.readouterr()
    assert 'programs started at 0, 3 s' in printed.err
    assert {path.name for path in folder.iterdir()} == {
        'currents.png',
        'coupling_torque.png',
        'signals.csv',
        'signals.csv-metadata.json',
        'index.html',
    }
    data = trace_file.load(folder / 'signals.csv')
    assert set(data.signals) == {'current', 'coupling_torque'}
    assert data.time_s[[0, -1]] == pytest.approx([500.22, 500.42])  # bus time
    assert len(data.time_s) == 201
    first = round(0.22 / 1e-3)
    np.testing.assert_array_equal(data['current'], trace['current'][first : first + 201])


@pytest.mark.parametrize('signal', sorted(set(run_figures.FIGURES.values())))
def test_signal_requests_its_figures(signal: str, turning: Trace, tmp_path: Path) -> None:
    chosen = run_figures.draw(turning, ReportFolder(tmp_path, Provenance.of('test')), [signal])
    expected = {f'{make.__name__}.png' for make, subject in run_figures.FIGURES.items() if subject == signal}
    assert {path.name for path in chosen} == expected != set()


@pytest.mark.parametrize(
    ('arguments', 'status', 'sentence'),
    [
        (['--from', '2', '--to', '1'], 2, '--from is 2, but must be less than --to, 1'),
        (['--from', 'nan'], 2, "argument --from: 'nan' must be a number"),
        (['--to', 'x'], 2, "argument --to: 'x' must be a number"),
        (['--signals', 'currents'], 2, "unknown signal 'currents', expected some of motor_command"),
        (['--signals', ','], 2, 'at least one signal is required'),
        (['--from', '100', '--to', '101'], 1, 'contains no cycle of that window: it goes from -0.12 to'),
    ],
)
def test_invalid_input_of_a_run_report_is_rejected_with_a_message(
    arguments: list[str],
    status: int,
    sentence: str,
    trace: Trace,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    trace.save(tmp_path / 'run.npz')
    try:
        found = main(['plot', str(tmp_path / 'run.npz'), *arguments, '--output', str(tmp_path / 'figures')])
    except SystemExit as end:
        found = end.code
    assert found == status
    assert sentence in capsys.readouterr().err

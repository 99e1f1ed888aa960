"""Tests of printed text and provenance: correct numbers in the printed units."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.cli import estimate, experiment, jacobian, output, simulate, tune
from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.numerics.units import millimetres
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.drives.tuning import run as tuning_run
from delta3_pacdrive.studies.estimation import run as estimation_run
from delta3_pacdrive.studies.framework.provenance import Provenance, digest, write_json, write_table
from delta3_pacdrive.studies.thesis.experiments import run as experiment_run
from delta3_pacdrive.studies.thesis.jacobian import run as jacobian_run

# every number is another one, so that none can stand for another
FIGURES = {
    'measured_cycles': 1400,
    'tcp_error_max_m': 0.00123,
    'tcp_error_rms_m': 0.00045,
    'following_error_max_rad': 0.0021,
    'final_tcp_m': [0.1, -0.02, -0.753],
    'current_peak_a': [1.11, 2.22, 3.33],
    'current_rms_a': [0.44, 0.55, 0.66],
    'at_current_peak_a': [1.01, 2.02, 3.03],
    'at_current_rms_a': [0.34, None, 0.36],
}
RESULT = FIGURES | {
    'controller': 'torque of a hand',
    'energy': {'copper_j': 12.3, 'friction_j': 4.5, 'drawn_j': 20.1, 'returned_j': 3.3},
    'bus_time_s': 3.0,
    'wall_time_s': 1.5,
    'cycles': 2987,
    'repeat': 10,
    'program_s': 4.0,
    'notices': ['moves[0] is slowed down', 'moves[3] as well'],
    'overruns': 7,
    'lost_telegrams': 9,
}


def printed(capsys):
    """Return the printed texts by the name before them."""
    rows = {}
    for line in capsys.readouterr().out.splitlines():
        name, _, text = line.strip().partition('  ')
        rows.setdefault(name, []).append(text.strip())
    return rows


def test_a_place_that_is_rounded_to_zero_has_no_sign():
    assert millimetres([-1e-9, 1e-9, -0.8000004]) == '(0.000, 0.000, -800.000) mm'


def test_figures_of_a_run_are_printed_with_name_and_unit(capsys):
    print('\n'.join(output.figures_text(RESULT)))
    assert printed(capsys) == {
        'bus time': ['3.000 s in 2987 cycles'],
        'wall time': ['1.500 s (2.00 x real time)'],
        'controller': ['torque of a hand'],
        'TCP error': ['1.230 mm max, 0.450 mm rms'],
        'final TCP': ['(100.000, -20.000, -753.000) mm'],
        'current peak': ['1.11 / 2.22 / 3.33 A'],
        'current rms': ['0.44 / 0.55 / 0.66 A'],
        'peak in the AT': ['1.01 / 2.02 / 3.03 A'],
        'rms in the AT': ['0.34 / - / 0.36 A'],
        'rounds': ['10 in 4.000 s: 150.0 per minute'],
        'energy': ['16.8 J lost a round: 12.3 in windings, 4.5 in friction; 20.1 drawn, 3.3 of it returned'],
        'note': ['moves[0] is slowed down', 'moves[3] as well'],
        'bus': ['7 overruns, 9 lost AT'],
    }


OF_TURNS = {
    'turn_error_max_rad': 0.003,
    'turn_encoder_place_error_max_rad': 0.0007,
    'turn_current_peak_a': 3.21,
    'turn_current_rms_a': 1.23,
}


def test_tool_deviation_is_reported_with_its_source(capsys):
    print('\n'.join(output.figures_text(RESULT | OF_TURNS)))
    graph = printed(capsys)
    assert graph['tool'] == ['error max at move ends 0.0401 deg by its encoder; during motion 0.1719 deg']
    assert graph['tool current'] == ['peak 3.21 A; rms in the AT 1.23 A']
    print('\n'.join(output.figures_text(RESULT | OF_TURNS | {'turn_place_error_max_rad': 0.0008})))
    assert printed(capsys)['tool'] == [
        'error max at move ends 0.0458 deg, 0.0401 deg by its encoder; during motion 0.1719 deg'
    ]


def test_currents_are_compared_with_their_limits_and_one_beyond_is_a_warning(robot, capsys):
    hot = RESULT | OF_TURNS | {'current_peak_a': [17.0, 8.5, None], 'current_rms_a': [4.24, 2.86, None]}
    turning = robot.replace(rotary__present=True)
    used = output.currents_used(hot | {'turn_current_rms_a': 1.7}, turning)
    assert used['current_peak_used'] == [1.0, 0.5, None]
    assert used['current_rms_used'] == [4.24 / 4.1, 2.86 / 4.1, None]
    print('\n'.join(output.figures_text(hot | used)))
    rows = printed(capsys)
    assert rows['current peak'] == ['17.00 / 8.50 / - A, 100.0 / 50 / - % of the peak current (17 A)']
    assert rows['current rms'] == ['4.24 / 2.86 / - A, 103 / 70 / - % of the nominal current (4.1 A)']
    assert rows['tool current'] == [
        'peak 3.21 A, 49 % of the peak current (6.5 A); rms in the AT 1.23 A, 77 % of the nominal current (1.6 A)'
    ]
    motor, tool = rows['warning']
    assert motor.startswith('motor 1 draws 4.24 A rms, 103 % of the nominal current (4.1 A): it overheats')
    assert tool.startswith('the motor of the rotary axis draws 1.70 A rms, 106 %')


@pytest.fixture
def simulated(monkeypatch):
    """Return the function that lets simulations end with some figures."""
    monkeypatch.setattr(simulation, 'load_kernels', lambda _: None)

    def end(**changes):
        meta = {
            'figures': FIGURES,
            'stopped': '',
            'lost_telegrams': 9,
            'notices': ['slowed'],
            'program_s': 0.8,
            'repeat': 1,
            'planned_end_m': FIGURES['final_tcp_m'],
            'cycle_time_s': 1e-3,
            'program': 'experiment1',
            'start_cycle': 0,
        }
        trace = Trace(np.arange(250) * 1e-3, {}, meta | changes)
        monkeypatch.setattr(simulation, 'run', lambda *_, **__: trace)

    return end


def test_simulate_prints_the_values_of_its_trace(simulated, capsys):
    simulated()
    assert simulate.main([]) == 0
    rows = printed(capsys)
    assert rows['TCP error'] == ['1.230 mm max, 0.450 mm rms']
    assert rows['bus time'] == ['0.250 s in 250 cycles']
    assert rows['bus'] == ['0 overruns, 9 lost AT']
    assert rows['note'] == ['slowed']
    assert 'rounds' not in rows


def test_simulate_reports_the_same_in_si_to_programs(simulated, capsys):
    simulated()
    assert simulate.main(['--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert {key: result[key] for key in FIGURES} == FIGURES
    assert result['bus_time_s'] == pytest.approx(0.250, rel=1e-12)
    assert result['cycles'] == 250
    assert (result['ok'], result['lost_telegrams'], result['overruns']) == (True, 9, 0)
    assert result['provenance']['command'] == 'delta3 simulate --json'


def test_a_program_that_a_fault_stopped_is_an_error_with_its_reason_and_time(simulated, capsys):
    simulated(stopped='axis2 reports a fault in bus cycle 130: 8171')
    assert simulate.main(['--json']) == 1
    captured = capsys.readouterr()
    sentence = 'axis2 reports a fault in bus cycle 130: 8171; at rest after 0.249 s of bus time'
    assert json.loads(captured.out) == {'ok': False, 'error': sentence}
    assert captured.err.endswith(
        f'error: {sentence}\n'
    )  # behind the word about kernels, where none are compiled


# estimate


def row(symbol, estimate, low, high, **fields):
    own = {
        'quantity': symbol,
        'estimate': estimate,
        'low_95': low,
        'high_95': high,
        'unit': 'ohm',
        'true': None,
    }
    return own | {'half_width_relative': 0.125, 'error_relative': None, 'verdict': '', 'reason': ''} | fields


DOCUMENT = {
    'estimates': [
        row('R', 2.75, 2.5, 3.0, true=2.5, error_relative=0.1),
        row('L', 4.0, 3.25, 4.75),
        row('m_c', None, None, None, verdict='only together with others', reason='m_b makes up for it'),
    ],
    'identifiability': {
        'condition': 12.5,
        'condition_of_columns': 3.25,
        'collinear': [{'symbols': ['m_b', 'm_c'], 'condition_index': 44.4}],
    },
    'residuals': [
        {
            'signal': 'torque',
            'rms': 0.0125,
            'unit': 'N m',
            'sensor_noise': 0.01,
            'white': False,
            'lag': 17,
            'intervals_from': 'residuals',
        }
    ],
    'solver': {'converged': False, 'message': 'too many evaluations'},
    'files': ['report.json'],
}


def test_an_estimate_is_printed_with_half_the_width_of_its_interval(monkeypatch, capsys):
    monkeypatch.setattr(simulation, 'load_kernels', lambda _: None)
    monkeypatch.setattr(estimation_run, 'Study', returning(DOCUMENT))
    assert estimate.main([]) == 0
    text = capsys.readouterr().out
    lines = {line.split()[0]: line.strip() for line in text.splitlines()}
    assert lines['R'] == 'R  2.75 +- 0.25 ohm (95 %, 12 %)  true error +10 %'
    assert lines['L'] == 'L  4 +- 0.75 ohm (95 %, 12 %)'
    assert lines['m_c'] == 'm_c  only together with others: m_b makes up for it'
    assert lines['condition'] == 'condition  12.5 scaled, 3.25 of the columns'
    assert lines['collinear'] == 'collinear  m_b, m_c (index 44)'
    assert lines['torque'] == (
        'torque  residuals 0.0125 N m rms, sensor noise 0.01, correlated over 17 samples; '
        'intervals from residuals'
    )
    assert lines['note'] == 'note  too many evaluations'


# tune

LOOP = {
    'stable': True,
    'crossover_hz': 71.0,
    'phase_margin_deg': 61.5,
    'gain_margin_db': 18.5,
    'delay_margin_s': 0.00234,
    'sensitivity_peak': 1.45,
    'bandwidth_hz': 140.0,
    'step': {'rise_time_s': 0.00321, 'overshoot': 0.0456, 'settling_time_s': 0.0654},
}
EFFECT = {
    'following_error_max_rad': 3.5e-4,
    'following_error_rms_rad': 1.2e-4,
    'tcp_error_max_m': 99.9e-6,
    'tcp_error_rms_m': 33.3e-6,
    'current_peak_a': 1.06,
    'current_rms_a': 0.46,
    'fault': '',
}


ROW = {'inertia_kg_m2': 6.25e-4, 'load': 'heaviest mode'} | {
    name: LOOP | {'gain_margin_db': margin}
    for name, margin in (('velocity', 11.1), ('position', 22.2), ('cascade', 33.3), ('exchanged', 44.4))
}
VARIANT = {
    'loops': {'velocity': LOOP},
    'exchange_period_s': 0.0005,
    'workspace': [ROW],
    'effect': EFFECT,
    'instability': ['it swings'],
    'rejection': {'peak_rad': 0.025, 'peak_s': 0.0167, 'back_s': 0.0956, 'noise_a': 0.0289},
}
TUNING = {
    'load': {'name': 'axis2 at home', 'inertia_kg_m2': 6.4e-4, 'gravity_n_m': 0.2211},
    'speed_rad_s': 12.5,
    'proposal': None,
    'changed': ['velocity: as before'],
    'changes': [{'parameter': 'drive.position_gain_rad_s_rad', 'before': 60.0, 'after': 80.0}],
    'variants': {'now': VARIANT},
    'program': 'experiment1',
    'recorded': [
        {
            'axis': 3,
            'title': 'current loop',
            'trusted_hz': [4.0, 700.0],
            'agreement': {'decibels': 0.25, 'degrees': 1.5},
            'margins': {'phase_margin_deg': 58.5, 'gain_margin_db': 12.25},
        }
    ],
    'sweep': [],
    'files': ['report.json'],
}


@pytest.fixture
def tuned(monkeypatch, capsys):
    """Return the function that prints a tuning; it gives lines by their first words, blanks made single."""
    monkeypatch.setattr(simulation, 'load_kernels', lambda _: None)

    def show(**changes):
        monkeypatch.setattr(tuning_run, 'Study', returning(TUNING | changes))
        assert tune.main([]) == 0
        return [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]

    return show


def returning(document):
    """Return a replacement for a study: it returns a document."""
    return lambda *_: SimpleNamespace(run=lambda *_: document)


def test_a_tuning_prints_load_changes_and_recordings_in_their_units(tuned):
    lines = tuned()
    assert lines[0] == ('axis2 at home: 6.400e-4 kg m2 and 0.221 N m at the shaft, turning at 12.5 rad/s')
    assert lines[1] == 'drive.position_gain_rad_s_rad: 60 before, 80 after'
    assert (
        'recorded, axis 3, current loop: 4 to 700 Hz trusted, within 0.25 dB and 1.5 deg of the linear response; '
        'margins 58.5 deg and 12.2 dB'
    ) in lines
    assert lines[-1] == 'report.json'


def test_the_figures_of_a_loop_are_printed_in_milliseconds_and_per_cent(tuned):
    lines = tuned()
    assert 'velocity now 71 Hz 61.5 deg 18.5 dB 2.34 ms 1.45 140 Hz 3.21 ms 4.6 % 65.4 ms' in lines
    assert 'now: it swings' in lines
    assert '6.25e-4 kg m2 now 71 Hz 61.5 deg 11.1 dB 61.5 deg 1.45 44.4 dB heaviest mode' in lines
    assert 'loop gains crossover phase m. gain m. delay m. Ms bandwidth rise overshoot settling' in lines
    first = lines.index('velocity velocity velocity position cascade exchange 0.5 ms')
    assert lines[first + 1] == 'inertia at shaft gains crossover phase m. gain m. phase m. Ms gain m.'


def test_unstable_loop_and_undefined_figure_are_reported(tuned):
    unstable = VARIANT | {'loops': {'velocity': LOOP | {'stable': False, 'delay_margin_s': None}}}
    lines = tuned(variants={'now': unstable})
    assert 'velocity now 71 Hz 61.5 deg 18.5 dB - 1.45 140 Hz 3.21 ms 4.6 % 65.4 ms UNSTABLE' in lines


def test_the_effect_of_gains_is_printed_in_thousandths_of_a_degree_and_micrometres(tuned):
    stopped = VARIANT | {'effect': EFFECT | {'following_error_max_rad': None, 'fault': 'axis1 trips'}}
    lines = tuned(variants={'before': VARIANT, 'after': stopped})
    assert (
        'before following error 20.05e-3 deg max, 6.88e-3 deg rms; TCP error 99.9 um max, 33.3 um rms; '
        'current 1.06 A max'
    ) in lines
    assert 'after stops: axis1 trips' in lines


def test_disturbances_of_a_drive_and_changes_are_printed(tuned):
    lines = tuned()
    assert (
        'now the shaft deflects by 1.432 deg after 16.7 ms and returns to within 5 % after 95.6 ms; '
        'current due to noise 28.9 mA rms'
    ) in lines
    assert '- velocity: as before' in lines


def test_a_sweep_is_printed_with_margins_overshoot_and_error(tuned):
    degrees = {'current': 60.0, 'velocity': 50.0, 'position': 40.0}
    point = {
        'value': 0.25,
        'loops': {name: LOOP | {'phase_margin_deg': margin} for name, margin in degrees.items()},
        'overshoot': {'velocity': 0.125, 'position': 0.01},
        'workspace_stable': True,
        'effect': EFFECT,
    }
    assert tuned(sweep=[point])[-4:-1] == [
        'current velocity position velocity position following',
        'value phase m. phase m. phase m. overshoot overshoot error',
        '0.25 60.0 deg 50.0 deg 40.0 deg 12.5 % 1.0 % 20.05e-3 deg',
    ]


# jacobian


def lines(capsys):
    """Return the printed lines with single blanks."""
    return [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]


def shares(peak, momentary):
    return {'of_peak': {'max': peak}, 'momentary': {'max': momentary}}


def test_deviations_are_printed_peak_first_exact_first(monkeypatch, capsys):
    row = {
        'name': 'experiment 1',
        'samples': 1373,
        'condition': {'min': 1.234, 'max': 2.345},
        'exact': {'velocity': shares(0.011, 0.12), 'acceleration': shares(0.22, 0.33)},
        'inexact': {'velocity': shares(4.4, 55.0), 'acceleration': shares(6.6, 77.0)},
        'every_length_1_mm_off': {
            'velocity': {'of_peak': 0.81, 'momentary': 8.2},
            'acceleration': {'of_peak': 0.91, 'momentary': 9.2},
        },
    }
    document = {
        'errors_m': {'R_A': 0.035},
        'trajectories': [row],
        'threshold': 0.05,
        'findings': ['It deviates.'],
        'files': ['report.json'],
    }
    monkeypatch.setattr(simulation, 'load_kernels', lambda _: None)
    monkeypatch.setattr(jacobian_run, 'Study', returning(document))
    assert jacobian.main([]) == 0
    printed = lines(capsys)
    assert printed[0] == 'exact lengths R_A +35 mm all 1 mm off, at worst'
    assert printed[2] == 'experiment 1: 1373 samples, cond(J) 1.23 to 2.35'
    assert printed[3] == 'velocity 0.011 / 0.12 4.4 / 55 0.81 / 8.2'
    assert printed[4] == 'acceleration 0.22 / 0.33 6.6 / 77 0.91 / 9.2'
    assert printed[5].endswith('(* where above 5 % of the peak)')
    assert printed[6:] == ['- It deviates.', 'report.json']


# experiment


def test_signals_of_an_experiment_are_printed_model_first_with_their_causes(monkeypatch, tmp_path, capsys):
    row = {
        'text': 'TCP position',
        'column': 'all',
        'unit': 'mm',
        'model_max': 1.5,
        'model_rms': 2.5,
        'robot_max': 3.5,
        'robot_rms': 4.5,
        'deviation_max': 5.5,
        'deviation_rms': 6.5,
        'deviation_max_percent': 7.5,
    }
    document = {
        'program': 'experiment 1, pick and place',
        'signals': [row, row | {'column': 'x', 'model_max': 99.0}],
        'findings': [{'sentence': 'They are alike.'}],
        'truth': 'It is off.',
        'attribution': {'explanations': ['Gears explain it.']},
        'notes': ['a note'],
        'files': ['report.json'],
    }
    monkeypatch.setattr(simulation, 'load_kernels', lambda _: None)
    monkeypatch.setattr(experiment_run, 'Study', returning(document))
    assert experiment.main(['1', '--no-attribution', '--output', str(tmp_path / 'out')]) == 0
    printed = lines(capsys)
    assert printed[0] == document['program']
    assert printed[1] == 'model max rms robot max rms apart max rms % of peak'
    assert printed[2] == 'TCP position mm 1.5 2.5 3.5 4.5 5.5 6.5 7.5'
    assert not any('99' in line for line in printed)  # single columns are in the table
    assert not any('reproduced' in line for line in printed)  # the claims have their own verdicts
    for line in ('- They are alike.', '- It is off.', '- Gears explain it.', 'note: a note', 'report.json'):
        assert line in printed


# provenance


def test_output_names_command_seed_parameters_and_inputs(robot):
    lines = Provenance.of('delta3 x', robot, 'mine.yaml', ['a 1', 'b 2'], 42).lines()
    assert lines['command'] == 'delta3 x'
    assert lines['seed'] == '42'
    assert lines['parameters'] == f'{robot.checksum} (mine.yaml)'
    assert lines['inputs'] == 'a 1; b 2'
    assert Provenance.of('delta3 x').lines()['seed'] == 'none'
    assert Provenance.of('delta3 x').lines()['parameters'] == 'none'


def test_the_digest_of_an_input_is_that_of_its_bytes(tmp_path):
    file, folder = tmp_path / 'a', tmp_path / 'bag'
    folder.mkdir()
    file.write_bytes(b'one')
    (folder / 'x').write_bytes(b'one')
    (folder / 'y').write_bytes(b'two')
    before = digest(file), digest(folder)
    assert (digest(file), digest(folder)) == before
    file.write_bytes(b'eno')
    (folder / 'y').write_bytes(b'owt')
    assert digest(file) != before[0]
    assert digest(folder) != before[1]
    with pytest.raises(ReportError, match='cannot read'):
        digest(tmp_path / 'nothing')


def test_a_report_holds_no_number_that_json_does_not_know(tmp_path):
    path = write_json({'a': 1.5}, tmp_path / 'deep' / 'report.json')
    assert json.loads(path.read_text()) == {'a': 1.5}
    for value in (float('nan'), float('inf')):
        with pytest.raises(ValueError, match='Out of range'):
            write_json({'a': value}, path)
    assert json.loads(path.read_text()) == {'a': 1.5}  # the old one, whole


def test_table_names_its_origin_above_the_header(tmp_path, robot):
    origin = Provenance.of('delta3 x', robot, seed=5)
    lines = write_table(tmp_path / 't.csv', ['a [m]', 'b'], [[1.0, 2]], origin).read_text().splitlines()
    assert lines[:2] == ['# command: delta3 x', '# seed: 5']
    assert lines[-2:] == ['a [m],b', '1.0,2']

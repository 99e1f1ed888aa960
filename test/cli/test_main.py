"""Tests of the main command line: printed text, check, completion and version."""

import json
import subprocess

import pytest

from delta3_pacdrive.cli import check, completion
from delta3_pacdrive.cli.main import COMMANDS, load_command, main
from delta3_pacdrive.cli.output import figures_text
from delta3_pacdrive.planning.program import file_reader as programs

FIGURES = {
    'bus_time_s': 2.5,
    'wall_time_s': 0.5,
    'cycles': 1250,
    'final_tcp_m': [0.1, -0.0002, -0.75],
    'tcp_error_max_m': 0.00031,
    'tcp_error_rms_m': 0.00012,
    'current_peak_a': [1.25, 2.5, 3.75],
    'current_rms_a': [0.1, 0.2, 0.3],
    'at_current_peak_a': [1.0, 2.0, 3.0],
    'at_current_rms_a': [0.05, 0.15, 0.25],
}


def printed(figures):
    """Return the printed values by the name of the row; rows of one name as a list."""
    rows = {}
    for line in figures_text(figures):
        assert line[14:16] == '  '
        rows.setdefault(line[:14].strip(), []).append(line[16:])
    return rows


def test_users_read_the_figures_of_a_run_in_their_units():
    assert printed(FIGURES) == {
        'bus time': ['2.500 s in 1250 cycles'],
        'wall time': ['0.500 s (5.00 x real time)'],
        'TCP error': ['0.310 mm max, 0.120 mm rms'],
        'final TCP': ['(100.000, -0.200, -750.000) mm'],
        'current peak': ['1.25 / 2.50 / 3.75 A'],
        'current rms': ['0.10 / 0.20 / 0.30 A'],
        'peak in the AT': ['1.00 / 2.00 / 3.00 A'],
        'rms in the AT': ['0.05 / 0.15 / 0.25 A'],
    }


def test_users_read_rounds_notices_and_the_bus():
    more = {'repeat': 6, 'program_s': 12.0, 'notices': ['one', 'two'], 'overruns': 3, 'lost_telegrams': 4}
    rows = printed(FIGURES | more)
    assert rows['rounds'] == ['6 in 12.000 s: 30.0 per minute']
    assert rows['note'] == ['one', 'two']
    assert rows['bus'] == ['3 overruns, 4 lost AT']
    assert 'rounds' not in printed(FIGURES | more | {'repeat': 1})


def test_users_read_the_outcome_of_parts_and_the_reasons():
    outcomes = {'waiting': 1, 'in hand': 0, 'placed': 3, 'lost': 7}
    parts = [
        {'number': n, 'type': 'bar', 'outcome': 'lost', 'reason': f'it slid off at {n}'} for n in range(7)
    ]
    cell = {
        'outcomes': outcomes, 'picked': 10, 'missed': 1, 'place_error_max_m': 2.5e-4, 'place_error_rms_m': 1e-4,
        'hold_use_max': 1.25, 'parts': [*parts, {'reason': ''}],
        'misses': [{'closed_cycle': 300, 'reason': 'there is no part'}],
    }  # fmt: skip
    rows = printed(FIGURES | {'cell': cell})
    assert rows['parts'] == ['10 picked, 3 placed, 7 lost, 1 missed']
    assert rows['place error'] == ['0.250 mm max, 0.100 mm rms']
    assert rows['cup'] == ['125 % of its force at most']
    assert rows['part'][0] == 'part 0 (bar), lost: it slid off at 0'
    assert rows['part'][5:] == ['and 3 more; --json lists all']
    none = cell | {'place_error_max_m': None, 'hold_use_max': None, 'parts': []}
    rows = printed(FIGURES | {'cell': none})
    assert rows['part'] == ['missed in bus cycle 300: there is no part']
    assert not {'place error', 'cup'} & rows.keys()


LINE = (
    'start_m: [0, 0, -0.8]\nmoves: [{move_l: {to_m: [0.1, 0, -0.8]}}, {dwell: {time_s: 0.25}}]\nrepeat: 1\n'
)


def test_check_reports_kind_length_and_time_of_every_move(tmp_path, capsys):
    path = tmp_path / 'line.yaml'
    path.write_text(LINE)
    assert check.main([str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f'{path}: good, program'
    assert lines[1].split()[:4] == ['1', 'line', '100.000', 'mm']
    assert lines[2].split() == ['2', 'dwell', '0.250', 's']
    time = float(lines[1].split()[4])
    # at 1.5 m/s, 15 m/s2 and 600 m/s3 at the most: longer than without limit of jerk, which takes 2 sqrt(s / a)
    assert 0.163 < time < 0.25
    assert lines[3].split()[:3] == ['whole', f'{time + 0.25:.3f}', 's,']


def test_check_reports_a_program_to_programs_in_the_same_form(tmp_path, capsys):
    path = tmp_path / 'line.yaml'
    path.write_text(
        LINE + 'faults: [{fault: overload, axis: axis1, torque_n_m: 2, after_s: 0.1, for_s: 0.2}]'
    )
    assert check.main([str(path), '--json']) == 0
    (result,) = json.loads(capsys.readouterr().out)['files']
    assert [move['kind'] for move in result['moves']] == ['line', 'dwell']
    assert result['moves'][0]['length_m'] == pytest.approx(0.1, abs=1e-9)
    assert result['time_s'] == pytest.approx(sum(move['time_s'] for move in result['moves']))
    assert result['faults'] == ['overload axis1 torque_n_m 2 after 0.1 s for 0.2 s']


def test_check_reports_a_move_that_is_slowed_down(tmp_path, capsys):
    path = tmp_path / 'fast.yaml'
    path.write_text(
        'start_m: [0, 0, -0.8]\n'
        'moves: [{move_l: {to_m: [0.4, 0, -0.8], speed_m_s: 9, acceleration_m_s2: 500, jerk_m_s3: .inf}}]'
    )
    assert check.main([str(path)]) == 0
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith('  note')]
    assert len(notes) == 2
    assert 'moves[0].move_l is slowed down' in notes[0]
    assert 'rms current' in notes[1]


def test_check_reports_all_errors_of_all_files(tmp_path, capsys):
    (tmp_path / 'bad.yaml').write_text('moves:\n- {move_l: {to_m: [0.1, x, -0.8]}}\n- {dwel: {time_s: 1}}\n')
    (tmp_path / 'far.yaml').write_text('moves: [{move_l: {to_m: [5, 0, -0.8]}}]')
    (tmp_path / 'faults.yaml').write_text('- {fault: drop_mdt, axis: axis1}\n- {fault: kil, node: plant}\n')
    names = [str(tmp_path / name) for name in ('bad.yaml', 'far.yaml', 'faults.yaml', 'none.yaml')]
    assert check.main([*names, 'packaging']) == 1
    output, errors = capsys.readouterr()
    lines = errors.splitlines()
    assert all(line.startswith('error: ') for line in lines)
    assert len(lines) == 5
    assert 'bad.yaml:2:25: moves[0]' in lines[0]
    assert "bad.yaml:3:4: moves[1]: unknown key 'dwel'" in lines[1]
    assert 'moves[0]' in lines[2]
    assert 'faults.yaml:2:11: faults[1].fault' in lines[3]
    assert 'cannot read file' in lines[4]
    assert 'packaging: good, program' in output


def test_check_reads_parameters_and_faults(tmp_path, capsys):
    path = tmp_path / 'faults.yaml'
    path.write_text('faults: [{fault: drop_mdt, axis: axis1, after_s: 0.2}]')
    assert check.main(['rich', str(path)]) == 0
    output = capsys.readouterr().out
    assert 'rich: good, parameters' in output
    assert 'drop_mdt axis1 after 0.2 s' in output
    path.write_text('/**: {ros__parameters: {motor: {}}}')
    assert check.main([str(path)]) == 1


@pytest.mark.parametrize(
    'text',
    [
        'motion: {speed_max_m_s: 2.0}\nbus: {}\n',
        'motion.speed_max_m_s: 2.0\n',
        '/**: {motion: {speed_max_m_s: 2.0}}\n',
        'ros__parameters: {motion: {speed_max_m_s: 2.0}}\n',
    ],
)
def test_check_reports_how_to_make_a_parameter_file_from_one_without_header(text, tmp_path, capsys):
    path = tmp_path / 'fast.yaml'
    path.write_text(text)
    assert check.main([str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'error: {path} holds ')
    assert 'without the header' in line
    assert 'begin it with the lines "/**:" and "  ros__parameters:"' in line


def test_packaged_programs_are_listed_in_the_help(capsys):
    for command in ('run', 'simulate', 'check'):
        with pytest.raises(SystemExit, match='0'):
            main([command, '--help'])
        text = ' '.join(capsys.readouterr().out.split())
        assert ', '.join(programs.packaged_names()) in text


def test_version_is_printed(capsys):
    assert main(['--version']) == 0
    name, version = capsys.readouterr().out.split()
    assert name == 'delta3_pacdrive'
    assert version[0].isdigit()


def completed(script, *words):
    """Return the completions of bash for the last word."""
    line = ' '.join(f"'{word}'" for word in words)
    ask = f'COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _delta3; printf "%s\\n" "${{COMPREPLY[@]}}"'
    done = subprocess.run(
        ['bash', '--norc', '-c', f'{script}\n{ask}'], capture_output=True, text=True, check=True, timeout=300
    )
    assert not done.stderr
    return done.stdout.split()


def test_bash_completes_commands_options_choices_and_programs(capsys):
    assert completion.main(['bash']) == 0
    script = capsys.readouterr().out
    assert set(completed(script, 'delta3', '')) == {*COMMANDS, '--help', '--version'}
    assert completed(script, 'delta3', 'sim') == ['simulate']
    assert completed(script, 'delta3', 'simulate', '--tra') == ['--trace']
    assert completed(script, 'delta3', 'simulate', 'pack') == [
        'packaging',
        'packaging_fast',
        'packaging_stops',
    ]
    assert completed(script, 'delta3', 'move', 'emer') == ['emergency_stop']
    assert completed(script, 'delta3', 'move', 'program', 'exper') == [
        'experiment1',
        'experiment2',
        'experiment3',
    ]
    assert completed(script, 'delta3', 'tune', '--sw') == ['--sweep']
    assert completed(script, 'delta3', 'nosuch', '--') == []


def test_a_former_name_of_a_command_works_with_a_warning(capsys):
    assert main(['arm', '--json']) == 0
    output, errors = capsys.readouterr()
    assert json.loads(output)['provenance']
    assert errors.startswith('warning: delta3 arm is deprecated')
    assert main(['two-link']) == 0
    assert not capsys.readouterr().err


def test_every_command_has_a_parser_of_its_name():
    for command in COMMANDS:
        parser = load_command(command).parser()
        assert parser.prog == f'delta3 {command}'
        assert 'None' not in parser.format_help()

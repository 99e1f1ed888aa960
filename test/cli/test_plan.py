"""Tests of ``delta3 plan``: table, JSON, and the same rejections as ``delta3 check``."""

import json
import math
from dataclasses import fields

import pytest
import yaml

from delta3_pacdrive import parameters
from delta3_pacdrive.cli import check, plan, simulate
from delta3_pacdrive.cli.command import PARAMETERS
from delta3_pacdrive.studies.places.planning import evaluation

LINE = 'start_m: [0, 0, -0.8]\nmoves: [{move_l: {to_m: [0.1, 0, -0.8]}}, {dwell: {time_s: 0.25}}]\n'
CORNER = """
start_mm: [-200, 0, -800]
limits: {acceleration_mm_s2: 20000, jerk_mm_s3: 2000000}
moves:
- move_l: {to_mm: [-100, 0, -800], speed_mm_s: 200, blend_mm: 5}
- move_l: {to_mm: [200, 0, -800], speed_mm_s: 1000, blend_mm: 20}
- move_l: {to_mm: [200, 20, -800], speed_mm_s: 1000}
- dwell: {time_s: 0.1}
"""


def test_a_plan_agrees_with_the_check_of_the_same_program(capsys):
    assert plan.main(['packaging_stops', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert check.main(['packaging_stops', '--json']) == 0
    (checked,) = json.loads(capsys.readouterr().out)['files']
    for key in ('program', 'time_s', 'repeat', 'override_max', 'rms_current_a', 'notices'):
        assert found[key] == checked[key], key
    for move, other in zip(found['moves'], checked['moves'], strict=True):
        assert (move['kind'], move['time_s']) == (other['kind'], other['time_s'])
        assert move['length_m'] == pytest.approx(other['length_m'])
        assert 0.95 <= move['limited_by']['used'] < 1.002
    assert found['provenance']['inputs'].startswith('packaging_stops ')


def test_users_read_a_table(tmp_path, capsys):
    (tmp_path / 'line.yaml').write_text(LINE)
    assert plan.main([str(tmp_path / 'line.yaml')]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'line: 2 moves'
    assert lines[3].split()[:4] == ['1', 'moves[0].move_l', 'line', '100.000']
    assert lines[4].endswith('time given')


def test_table_gives_the_place_in_a_pattern(tmp_path, capsys):
    (tmp_path / 'row.yaml').write_text(
        'patterns: {row: {rows: 1, columns: 2, pitch_mm: [50, 0]}}\n'
        'moves: [{for_each: {place_of: row, moves: [{move_l: {to_m: [0.1, 0, -0.8]}}]}}]\n'
    )
    assert plan.main([str(tmp_path / 'row.yaml')]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 'at place 0 of row line' in ' '.join(lines[3].split())
    assert 'at place 1 of row line' in ' '.join(lines[4].split())


def test_every_statement_of_a_long_sequence_has_its_line(tmp_path, capsys):
    count, moves = 300, []
    for n in range(count):
        radius, angle = 100.0 + 0.2 * n, 0.1 * n
        to = [radius * math.cos(angle), radius * math.sin(angle), -800]
        blend = {} if n == count - 1 else {'blend_mm': 3}
        moves.append({'move_l': {'to_mm': to, 'speed_mm_s': 200} | blend})
    (tmp_path / 'coil.yaml').write_text(json.dumps({'start_mm': [90, 0, -800], 'moves': moves}))
    assert plan.main([str(tmp_path / 'coil.yaml')]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'coil: 1 move'
    assert lines[3].split()[:5] == ['1', 'moves[0].move_l', 'to', 'moves[299].move_l', 'blended'] or (
        lines[3].split()[:3] == ['1', '300', 'statements']
    )
    statements, summary = lines[4 : 4 + count], lines[4 + count :]
    assert [line.split()[0] for line in statements] == [f'moves[{n}].move_l' for n in range(count)]
    assert max(map(len, statements)) < 140
    for name in ('whole', 'rms current', 'energy', 'used', 'distances'):
        assert sum(line.startswith(f'{name:>12}  ') for line in summary) == 1
    assert check.main([str(tmp_path / 'coil.yaml')]) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in told[2:-1]] == [f'moves[{n}].move_l' for n in range(count)]
    assert told[-1].startswith(' whole ')


def test_plan_and_check_return_the_same_statements_in_json(tmp_path, capsys):
    (tmp_path / 'corner.yaml').write_text(CORNER)
    assert plan.main([str(tmp_path / 'corner.yaml'), '--json']) == 0
    found = json.loads(capsys.readouterr().out)['moves']
    assert check.main([str(tmp_path / 'corner.yaml'), '--json']) == 0
    checked = json.loads(capsys.readouterr().out)['files'][0]['moves']
    assert found[0]['by_statement'] == checked[0]['by_statement']
    assert 'by_statement' not in found[1]
    assert 'by_statement' not in checked[1]
    first, second, last = found[0]['by_statement']
    assert first['statement'] == 'moves[0].move_l'
    assert [one['speed_max_m_s'] for one in (first, second)] == pytest.approx([0.2, 1.0], rel=2e-4)
    assert [one['limited_by']['limit_m_s'] for one in (first, second)] == [0.2, 1.0]
    assert last['length_m'] == pytest.approx(0.0, abs=1e-9)  # the blend before it reaches to its end
    assert last['start_s'] == pytest.approx(found[0]['time_s'])
    for command in (plan, check):
        assert command.main([str(tmp_path / 'corner.yaml')]) == 0
        lines = capsys.readouterr().out.splitlines()
        (line,) = (line for line in lines if line.split()[:1] == ['moves[2].move_l'])
        assert line.endswith('  all of it is in the blend before')


def test_a_script_names_the_statements_of_a_sequence_by_their_lines(tmp_path, capsys):
    (tmp_path / 'corner.py').write_text(
        'def main(robot):\n    robot.move_l(to_mm=[100, 0, -800], blend_mm=10)\n'
        '    robot.move_l(to_mm=[100, 100, -800])\n'
    )
    assert plan.main([str(tmp_path / 'corner.py'), '--json']) == 0
    (move,) = json.loads(capsys.readouterr().out)['moves']
    assert [one['statement'] for one in move['by_statement']] == ['2: move_l', '3: move_l']


@pytest.mark.parametrize(
    'text',
    [
        'moves: [{move_l: {to_m: [5, 0, -0.8]}}]',
        'moves: [{move: 1}]',
        'moves: [{move_l: {to_m: [0.1, x, 0]}}]',
    ],
)
def test_unplannable_program_is_rejected_as_check_rejects_it(text, tmp_path, capsys):
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    assert check.main([str(path)]) == 1
    refused = capsys.readouterr().err
    assert plan.main([str(path)]) == 1
    output, errors = capsys.readouterr()
    assert output == ''
    # a program in a file of another kind is told by check what kind it is taken for
    assert (
        errors.removeprefix('error: ').split('; ')[0].strip()
        == refused.removeprefix('error: ').splitlines()[0]
    )


def test_check_reports_each_error_separately_with_any_text(tmp_path, capsys):
    path = tmp_path / 'back.yaml'
    path.write_text(
        'moves:\n- move_l: {to_m: [0.1, 0, -0.8], blend_m: 0.02}\n- move_l: {to_m: [0, 0, -0.8]}\n'
        'start_m: [0, 0, -0.8]\n'
    )
    sentence = f'{path}:2:3: moves[0].move_l: the path turns back at this corner, which cannot be rounded; '
    sentence += 'use blend_m: 0'
    assert check.main([str(path)]) == 1
    assert capsys.readouterr().err == f'error: {sentence}\n'
    assert check.main([str(path), '--json']) == 1
    assert json.loads(capsys.readouterr().out)['files'][0]['errors'] == [sentence]


def test_limits_of_each_move_are_reported_on_request(tmp_path, capsys):
    (tmp_path / 'line.yaml').write_text(LINE)
    assert plan.main([str(tmp_path / 'line.yaml'), '--json']) == 0
    brief = json.loads(capsys.readouterr().out)['moves'][0]
    assert plan.main([str(tmp_path / 'line.yaml'), '--json', '--limits']) == 0
    move = json.loads(capsys.readouterr().out)['moves'][0]
    limits = move.pop('limits')
    assert move == brief
    assert limits[0] == move['limited_by']
    assert {'motor_current', 'motor_speed', 'tcp_speed'} <= {limit['quantity'] for limit in limits}
    with pytest.raises(SystemExit, match='2'):
        plan.main(['--limits'])
    assert '--limits requires --json' in capsys.readouterr().err


@pytest.mark.parametrize('folder', ['file', 'file/plan', '/proc/plan'])
def test_impossible_folder_is_rejected_before_planning(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(evaluation, 'of_program', None)
    (tmp_path / 'file').touch()
    assert plan.main(['--output', folder]) == 1
    assert capsys.readouterr().err.startswith(f'error: cannot write to {folder}: ')


@pytest.mark.parametrize('text', ['', '# nothing\n', 'hello'])
def test_a_file_that_holds_no_program_is_rejected_by_its_name(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'no.yaml').write_text(text)
    for command in (plan, check):
        assert command.main(['no.yaml']) == 1
        assert capsys.readouterr().err.startswith('error: no.yaml: the program must be a mapping, not ')


def test_figures_and_tables_are_written_with_a_page(tmp_path, capsys):
    (tmp_path / 'line.yaml').write_text(LINE)
    folder = tmp_path / 'plan'
    assert plan.main([str(tmp_path / 'line.yaml'), '--output', str(folder), '--json']) == 0
    files = json.loads(capsys.readouterr().out)['files']
    names = {path.name for path in folder.iterdir()}
    assert {file.rpartition('/')[2] for file in files} == names
    assert {'index.html', 'moves.csv', 'plan.csv', 'virtual_master.png', 'limits.png'} <= names
    rows = [line for line in (folder / 'moves.csv').read_text().splitlines() if not line.startswith('#')]
    assert rows[0].startswith('move,statements,kind,start [s]')
    assert len(rows) == 3


def packaged_parameters():
    """Return the names of all packaged parameter files that change the robot."""
    groups = {field.name for field in fields(parameters.Parameters)}
    names = []
    for path in sorted(parameters.config_directory().glob('*.yaml')):
        tree = yaml.safe_load(path.read_text())
        if groups & set(next(iter(tree.values())).get('ros__parameters', ()) if '/**' in tree else ()):
            names.append(path.stem)
    return names


@pytest.mark.parametrize('name', packaged_parameters())
def test_each_packaged_robot_plans_and_executes_a_program_without_turns(name, tmp_path, capsys):
    (tmp_path / 'line.yaml').write_text(LINE)
    arguments = [str(tmp_path / 'line.yaml'), '--json', '--parameters', name]
    assert plan.main(arguments) == 0
    planned = json.loads(capsys.readouterr().out)
    uncommissioned = not parameters.load(name).mounting.commissioned
    assert simulate.main(arguments) == int(uncommissioned)  # its axes are not homed
    done = capsys.readouterr()
    if uncommissioned:
        assert 'the axes are not homed' in done.err
    else:
        assert json.loads(done.out)['program_s'] == pytest.approx(planned['time_s'], abs=0.01)


def test_the_help_names_the_packaged_parameter_files():
    words = PARAMETERS.replace(',', ' ').replace(';', ' ').split()
    aliases = {'rich': 'built', 'delta3': 'model'}
    assert {aliases.get(name, name) for name in packaged_parameters()} <= set(words)

"""The README says what is so: every block of it that needs no running robot runs as it stands, line by line.

Blocks that need one: ``system/test_readme.py`` and ``system/test_up.py``.
"""

import contextlib
import io
import json
from pathlib import Path

import pytest

from delta3_pacdrive.cli.main import main

SOURCE = Path(__file__).parent.parent
HERE = {
    'Use it from Python',
    'Programs',
    'Faults on purpose',
    'Experiments of the thesis',
    'Parameter estimation',
    'Tuning',
}
IN_THE_GRAPH = {'Run it', 'Single nodes', 'Moves', 'Recordings', 'Faults on purpose'}
PICTURES = {'delta3_pacdrive', 'Inside'}  # of the nodes and of the folders


def run_all(lines, shell):
    """Run command lines in one folder, in their order; return what they print."""
    printed = []
    for line in lines:
        done = shell(line)
        assert done.returncode == 0, f'{line}: {done.stdout[-2000:]}{done.stderr[-2000:]}'
        printed.append(done.stdout)
    return printed


def test_every_block_has_its_test(readme_blocks):
    assert {place for place, _, _ in readme_blocks} == HERE | IN_THE_GRAPH | PICTURES | {'Test it'}


def test_the_test_command_is_what_continuous_integration_calls(readme_lines):
    (command,) = readme_lines('Test it')
    assert (SOURCE / command).stat().st_mode & 0o100
    assert command in (SOURCE / '.ci/run').read_text(encoding='utf-8').split()


def test_the_python_example_prints_the_largest_tcp_error_as_the_command_does(readme_blocks, capsys):
    (example,) = (text for _, language, text in readme_blocks if language == 'python')
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(example, 'README.md', 'exec'), {})
    error_m, shape = printed.getvalue().split(maxsplit=1)
    assert main(['simulate', 'experiment1', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert float(error_m) == pytest.approx(result['tcp_error_max_m'], rel=1e-9)
    assert shape.strip() == f'({result["cycles"]}, 3)'


@pytest.mark.parametrize(
    ('line', 'printed'),
    [
        ('delta3 --version', 'delta3_pacdrive'),
        ('eval "$(delta3 completion bash)"', 'complete '),
        ('delta3 arm', 'elbow'),
        ('delta3 drive list', 'S-0-0104'),
        ('delta3 simulate', 'experiment 1'),
        ('delta3 bench kinematics', 'poses'),
        ('--error l_A=0.001 --error R_A=-0.002', 'R_A'),
    ],
)
def test_commands_in_the_text_run_as_they_stand(line, printed, shell):
    assert f'`{line}`' in (SOURCE / 'README.md').read_text(encoding='utf-8')
    if line.startswith('--error'):
        line = f'delta3 jacobian 1 {line}'
    done = shell(line + '\ncomplete -p delta3' if line.startswith('eval') else line)
    assert done.returncode == 0, done.stderr
    assert printed in done.stdout


def test_the_program_of_the_readme_is_driven_to_its_end(readme_blocks, shell, tmp_path):
    (text,) = (text for place, language, text in readme_blocks if (place, language) == ('Programs', 'yaml'))
    (tmp_path / 'program.yaml').write_text(text, encoding='utf-8')
    checked, simulated = run_all(['delta3 check program.yaml', 'delta3 simulate program.yaml --json'], shell)
    assert 'program.yaml: good' in checked
    assert json.loads(simulated)['ok']


def test_the_faults_of_the_readme_are_faults_of_a_program(readme_blocks, shell, tmp_path):
    (text,) = (
        text for place, language, text in readme_blocks if (place, language) == ('Faults on purpose', 'yaml')
    )
    (tmp_path / 'program.yaml').write_text(text + 'moves: [dwell: {time_s: 1.0}]', encoding='utf-8')
    (checked,) = run_all(['delta3 check program.yaml'], shell)
    assert 'dwell' in checked


def test_the_lines_on_experiments_run_as_they_stand(readme_lines, shell, tmp_path):
    run_all(readme_lines('Experiments of the thesis'), shell)
    assert len(list((tmp_path / 'experiment_1').glob('figure_11_*.png'))) == 8


def test_the_lines_on_estimation_run_as_they_stand(readme_lines, shell, tmp_path):
    lines = readme_lines('Parameter estimation')
    assert main(['simulate', 'excitation', '--trace', str(tmp_path / 'BAG.npz')]) == 0
    run_all([line.replace(' BAG ', ' BAG.npz ') for line in lines], shell)


def test_the_lines_on_tuning_run_as_they_stand(readme_lines, shell, tmp_path):
    run_all(readme_lines('Tuning'), shell)
    assert (tmp_path / 'scope.npz').exists()

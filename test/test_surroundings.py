"""Tests of every command in hostile environments: a result, or one message and a status."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.cli import main
from delta3_pacdrive.numerics.kernel import CACHE_DIRECTORY
from delta3_pacdrive.planning.program import file_reader as programs
from thoroughness import EVERYTHING

pytestmark = pytest.mark.timeout(600)
# commands in their cheapest real call, others without arguments; files named out are made where a command is called
CALLS = {
    'run': ['run', 'missing.yaml'],
    'up': ['up', '--parameters', 'missing.yaml'],
    'move': ['move', 'program', 'missing.yaml'],
    'faults': ['faults', 'list'],
    'soak': ['soak', '--minutes', '0'],
    'drive': ['drive', 'list'],
    'io': ['io', 'part', 'maybe'],
    'scope': ['scope', 'list'],
    'check': ['check', 'program.yaml'],
    'plan': ['plan', 'program.yaml'],
    'pose': ['pose', '0', '0', '-0.75'],
    'workspace': ['workspace', '--resolution', '120'],
    'simulate': ['simulate', 'program.yaml', '--trace', 'out.npz'],
    'view': ['view', 'missing.npz'],
    'record': ['record', 'there'],
    'export': ['export', 'trace', 'trace.npz', '--output', 'out.csv'],
    'plot': ['plot', 'trace.npz', '--signals', 'current', '--output', 'out'],
    'report': ['report', 'trace.npz', '--output', 'out.html'],
    'compare': ['compare', 'trace.npz', 'trace.npz'],
    'two-link': ['two-link'],
    'jacobian': ['jacobian', 'trace.npz', '--output', 'out'],
    'estimate': ['estimate', '--group', 'geometry', 'program.yaml', '--output', 'out'],
    'calibrate': ['calibrate', 'plan', '--number', '24', '--output', 'out'],
    'experiment': ['experiment', '1', '--no-attribution', '--seeds', '0', '--output', 'out'],
    'tune': ['tune', '--excite', 'out.npz'],
    'learn': ['learn', 'program.yaml', '--repetitions', '1', '--parameters', 'model', '--output', 'out'],
    'ripple': ['ripple', 'program.yaml', '--cycle-time', '1', '--output', 'out'],
    'sweep': ['sweep', 'sweep.yaml', '--dry-run'],
    'optimise': ['optimise', 'optimise.yaml', '--workers', '1', '--output', 'out'],
    'line': ['line', 'line', '--hours', '0.01', '--plans', '1', '--output', 'out'],
    'completion': ['completion', 'bash'],
    'bench': ['bench', 'shaping', '--moves', '1'],
}
REJECTED = {'run': 1, 'up': 1, 'move': 1, 'soak': 2, 'io': 2, 'view': 1, 'record': 1}  # status of these calls
# calls that take more than a second of processor time
SLOW = {'jacobian', 'estimate', 'calibrate', 'experiment', 'tune', 'learn', 'ripple', 'optimise', 'line'}
PROGRAM = 'start_m: [0, 0, -0.75]\nmoves: [{move_l: {to_m: [0.02, 0.01, -0.76]}}]\n'
VARIED = 'program: program.yaml\nvary: {drive.interpolation: {list: [linear, cubic]}}\n'
CACHED = {'NUMBA_CACHE_DIR': str(CACHE_DIRECTORY.parent)}  # kernels are compiled once for all surroundings
LOADER = {name: value for name, value in os.environ.items() if name.startswith(('LD_', '_ROS_WHEELS'))}
KEPT = {name: value for name, value in os.environ.items() if name not in ('HOME', 'XDG_CACHE_HOME')} | CACHED
BARE = (
    CACHED
    | LOADER
    | {
        'LC_ALL': 'C',
        'PYTHONUTF8': '0',
        'PYTHONCOERCECLOCALE': '0',
        'TMPDIR': '/nowhere',
        'PYTHONSAFEPATH': '1',
    }
)
HOMELESS = KEPT | {'PYTHONIOENCODING': 'cp1252', 'HOME': '/dev/null', 'COLUMNS': '1', 'NO_COLOR': '1'}
# without a home matplotlib makes a folder that each fork would delete at its end
OF_WINDOWS = HOMELESS | {'MPLCONFIGDIR': mpl.get_cachedir()}
NAMESPACES = ['cell 2', '2cell', 'a//b', 'cell-2']
LIMIT_S = 300.0


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Return a folder with the inputs of the calls."""
    folder = tmp_path_factory.mktemp('inputs')
    for name, text in {
        'program': PROGRAM,
        'sweep': f'{VARIED}runs: 1\n',
        'optimise': f'{VARIED}trials: 1\ngoal: {{minimise: tcp_error_max_m}}\n',
    }.items():
        (folder / f'{name}.yaml').write_text(text, encoding='utf-8')
    robot = parameters.load()
    simulation.run(programs.load(folder / 'program.yaml', robot.motion), robot).save(folder / 'trace.npz')
    (folder / 'there').mkdir()
    return folder


def calls(everything=EVERYTHING):
    """Return the command lines of a sweep: the help of each command, and its call."""
    helped = [[name, '--help'] for name in main.COMMANDS]
    return helped + [CALLS.get(name, [name]) for name in main.COMMANDS if everything or name not in SLOW]


def fault_of(done, arguments, expected=None, quiet=False):
    """Return the defect in the end of a command, or ''."""
    status, output, errors = done.returncode, done.stdout, done.stderr
    lines = [line for line in errors.splitlines() if line.strip()]
    if 'Traceback' in output + errors or 'Exception ignored' in errors or status < 0:
        return f'status {status}: {errors[-600:]}'
    if expected is not None and status != expected:
        return f'status {status} instead of {expected}: {errors[-300:]}'
    if status == 0:
        return '' if output or quiet else 'no output'
    told = [line for line in lines if 'error: ' in line]
    if quiet and not lines:  # the reader has gone
        return ''
    return '' if len(told) == 1 and told[0] == lines[-1] else f'not one sentence: {errors[-300:]}'


def sweep(run, arguments_of_all, files, tmp_path, **expected):
    """Run command lines, each in a separate folder; return the defects by command line."""
    lines = []
    for number, arguments in enumerate(arguments_of_all):
        folder = tmp_path / str(number)
        folder.mkdir()
        own = [str(files / word) if (files / word).exists() else word for word in arguments]
        lines.append((own, str(folder)))
    wrong = {}
    for arguments, (_, folder), done in zip(arguments_of_all, lines, run(lines), strict=True):
        rejected = REJECTED.get(arguments[0], 0) if arguments[0] in CALLS else None
        status = 0 if arguments[-1] == '--help' else rejected
        fault = fault_of(done, arguments, **{'expected': status} | expected)
        made = [word for word in arguments if word.startswith('out')]
        if not fault and not done.returncode and 'expected' not in expected:
            fault = ', '.join(f'{name} is missing' for name in made if not (Path(folder) / name).exists())
        if fault:
            wrong[shlex.join(arguments)] = fault
    return wrong


def ended(command, folder, environment, shell='', **options):
    """Return a command that has ended; ``shell`` follows it on a line of bash."""
    if shell:
        command = ['bash', '-c', f'set -o pipefail; "$@" {shell}', 'bash', *command]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, errors='replace', timeout=LIMIT_S,
        stdin=subprocess.DEVNULL, check=False,
    )  # fmt: skip


def afresh(arguments, folder, environment, shell=''):
    """Run a command in a new interpreter."""
    return ended([sys.executable, '-P', '-m', main.__name__, *arguments], folder, environment, shell)


# Frozen objects are not looked at when a fork collects its garbage at its end, which would copy the memory of all.
FORKS = """
import gc, importlib, json, os, sys
from delta3_pacdrive import cli, parameters, simulation
from delta3_pacdrive.cli.main import COMMANDS, main
for name in COMMANDS:
    importlib.import_module(f'{cli.__name__}.' + name.replace('-', '_'))
simulation.load_kernels(parameters.load())
gc.freeze()
for arguments, folder in json.load(sys.stdin):
    if not (child := os.fork()):
        os.chdir(folder)
        for number, name in enumerate((os.devnull, 'stdout', 'stderr')):
            os.dup2(os.open(name, os.O_RDWR | os.O_CREAT), number)
        sys.argv[1:] = arguments
        sys.exit(main())
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def forks(lines, environment):
    """Run command lines in their folders as forks of one interpreter that has this environment; return how they end."""
    done = subprocess.run(
        [sys.executable, '-P', '-c', FORKS], input=json.dumps(lines), env=environment, capture_output=True,
        text=True, timeout=len(lines) * LIMIT_S, check=True,
    )  # fmt: skip
    results = []
    for (arguments, folder), status in zip(lines, done.stdout.split(), strict=True):
        output, errors = ((Path(folder) / name).read_text(errors='replace') for name in ('stdout', 'stderr'))
        results.append(subprocess.CompletedProcess(arguments, int(status), output, errors))
    return results


def test_without_environment_and_in_ascii_every_command_works(files, tmp_path):
    assert sweep(lambda lines: forks(lines, BARE), calls(), files, tmp_path) == {}


@pytest.mark.long
def test_with_the_encoding_of_windows_without_a_home_and_one_column_wide_every_command_works(files, tmp_path):
    assert sweep(lambda lines: forks(lines, OF_WINDOWS), calls(), files, tmp_path) == {}


@pytest.mark.long
def test_every_command_ends_with_one_message_without_writable_folder_and_reader(files, tmp_path):
    def run(lines):
        return [afresh(arguments, '/proc', OF_WINDOWS, '| head -0') for arguments, _ in lines]

    assert sweep(run, calls(everything=False), files, tmp_path, expected=None, quiet=True) == {}
    assert list(Path('/proc').glob('out*')) == []


@pytest.mark.long
def test_figures_are_drawn_without_a_home(files, tmp_path):
    def run(lines):
        return [afresh(arguments, folder, HOMELESS) for arguments, folder in lines]

    assert sweep(run, [CALLS['plot']], files, tmp_path) == {}


@pytest.mark.parametrize('shell', ['<&- >&-', pytest.param('2>&-', marks=pytest.mark.long)])
def test_with_closed_streams_every_command_works(shell, files, tmp_path):
    lines = calls() if EVERYTHING else [[name, '--help'] for name in main.COMMANDS]

    def run(lines):
        return [afresh(arguments, folder, KEPT, shell) for arguments, folder in lines]

    assert sweep(run, lines, files, tmp_path, quiet=True) == {}


@pytest.mark.parametrize('line', ['run missing.yaml', 'sweep sweep.yaml --dry-run', 'plan program.yaml'])
def test_deleted_working_folder_is_named(line, files, tmp_path):
    gone = tmp_path / 'gone'
    gone.mkdir()
    script = f'rmdir {gone}; exec "$0" "$@"'
    own = [str(files / word) if (files / word).exists() else word for word in line.split()]
    command = [sys.executable, '-P', '-m', main.__name__, *own]
    done = ended(['bash', '-c', script, *command], gone, KEPT)
    if done.returncode:
        assert done.stderr == 'error: the working directory no longer exists\n'
    else:
        assert line.startswith('plan')


def foreign(folder, library, code):
    """Make a library of another Python, and return the environment in which it comes first."""
    (folder / library).mkdir(parents=True)
    (folder / library / '__init__.py').write_text(code, encoding='utf-8')
    return KEPT | {'PYTHONPATH': str(folder)}


@pytest.mark.parametrize(
    ('library', 'code'),
    [
        ('rclpy', 'from rclpy.impl import missing'),
        pytest.param('numpy', 'raise ImportError("made for Python 3.10")', marks=pytest.mark.long),
        pytest.param('yaml', 'print "made for Python 2"', marks=pytest.mark.long),
        pytest.param('numba', '__version__ = "0.1"', marks=pytest.mark.long),
    ],
)
def test_incompatible_library_first_on_the_path_is_named_in_one_message(library, code, files, tmp_path):
    environment = foreign(tmp_path / 'foreign', library, code)
    names = sorted(main.OF_ROBOTS) if library == 'rclpy' else list(main.COMMANDS)
    lines = [CALLS.get(name, [name]) for name in names if name not in SLOW]
    named = []

    def run(lines):
        results = [afresh(arguments, folder, environment) for arguments, folder in lines]
        named.extend(
            f'cannot load {library} from {tmp_path}/foreign/{library}' in one.stderr for one in results
        )
        return results

    assert sweep(run, lines, files, tmp_path, expected=None) == {}
    assert any(named)


def with_namespace():
    """Return the commands that take a namespace."""
    return [name for name in main.COMMANDS if '--namespace' in main.load_command(name).words()]


OF_NAMESPACES = {
    'run': ['run'],
    'up': ['up'],
    'move': ['move', 'state'],
    'faults': ['faults', 'inject', 'overload axis1 torque_n_m 2'],
    'drive': ['drive', 'axis1', 'S-0-0104'],
    'io': ['io'],
    'scope': ['scope', 'axis1.current'],
    'record': ['record', 'bag'],
    'view': ['view'],
    'tune': ['tune', '--apply'],
    'commission': ['commission', 'report'],
}


@pytest.mark.parametrize('name', with_namespace())
def test_invalid_namespace_gives_one_message(name, tmp_path, monkeypatch, capfd):
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(110 + os.getpid() % 100))
    for namespace in NAMESPACES:
        try:
            status = main.main([*OF_NAMESPACES.get(name, [name]), '--namespace', namespace])
        except SystemExit as end:
            status = end.code
        output, errors = capfd.readouterr()
        assert status in (1, 2)
        assert output == ''
        last = errors.splitlines()[-1]
        assert re.search(r'error: .*(namespace|no gains)', last), errors  # tune looks for the gains first
        assert len(errors.splitlines()) == 1 or 'usage' in errors
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_robot_runs_without_a_home(files, tmp_path):
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    line = ['run', str(files / 'program.yaml'), '--single-process', '--real-time-factor', '0', '--bag', 'bag']
    environment = HOMELESS | {'ROS_DOMAIN_ID': str(110 + os.getpid() % 100)}
    done = afresh(line, tmp_path, environment)
    assert fault_of(done, line, expected=0) == ''
    assert (tmp_path / 'bag' / 'metadata.yaml').exists()

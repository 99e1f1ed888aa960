"""Tests of the declaration of commands: parsed values reach the command, invalid options are named."""

from dataclasses import dataclass

import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.cli import progress
from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option, settings_of
from delta3_pacdrive.cli.main import COMMANDS, load_command
from delta3_pacdrive.cli.option_types import finite_number
from delta3_pacdrive.cli.output import Output, print_output
from delta3_pacdrive.numerics import kernel

NAMES_OF_FILES = {
    '--bag', '--csv', '--design', '--excite', '--figures', '--logs', '--output', '--parameters', '--recording',
    '--resume', '--robot', '--trace', '--volume',
}  # fmt: skip
ACTIONS = {'go': 'start', 'stop': 'end'}


@dataclass
class Options(JsonOptions):
    action: str = argument('one of the actions below', choices=ACTIONS, metavar='ACTION')
    inputs: list[str] = argument('numbers', default=(), nargs='*', metavar='INPUT')  # noqa: RUF009 (declared by a call)
    speed: float = option('how fast', 'V', default=0.0, type=finite_number, only=('go',))
    pose: tuple[float, float] | None = option('where', ('X', 'Y'), nargs=2, type=float)
    changes: list[str] | None = option('what', 'NAME', names=('--set', '-s'), action='append')  # noqa: RUF009
    now: bool = flag('at once', only=('go', 'stop', 'wait'), formerly='--immediately')
    limit: float | None = option('how far', 'M', type=float, formerly='--bound')
    exact: bool = flag('to the millimetre', needs='--limit', excludes=('--now', '--pose'))

    def check(self):
        return self.rejection(self.action)


def command(seen=None):
    def run(options):
        if seen is not None:
            seen.append(options)
        return Output(status=3)

    return Command('try', 'Tries.', Options, run, ACTIONS, mixed=True)


def read(*arguments):
    return command().read(arguments)


def test_a_command_runs_with_its_options_and_returns_its_status():
    seen = []
    assert (
        command(seen)(['go', '1', '--set', 'a', '2', '-s', 'b', '--now', '--speed', '-1e-3', '--json']) == 3
    )
    (options,) = seen
    assert (options.action, options.inputs, options.changes) == ('go', ['1', '2'], ['a', 'b'])
    assert (options.speed, options.now, options.json, options.pose) == (-1e-3, True, True, None)
    assert options.command_line == 'delta3 try go 1 --set a 2 -s b --now --speed -1e-3 --json'


def test_a_deprecated_name_works_with_a_warning_and_is_in_neither_help_nor_completion(capsys):
    options = read('go', '--immediately', '--bound=-2')
    assert (options.now, options.limit) == (True, -2.0)
    assert options.command_line == 'delta3 try go --now --limit=-2'
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith('warning: --immediately is deprecated')
    assert first.endswith('use --now')
    assert second.startswith('warning: --bound is deprecated')
    assert '--bound' not in command().parser().format_help()
    assert '--bound' not in command().words()
    assert read('go', '--now').now
    assert not capsys.readouterr().err


@pytest.mark.parametrize('text', ['-1', '-.5', '-1e3', '-2.5E-7', '-inf'])
def test_negative_number_is_not_read_as_option(text):
    assert read('go', text).inputs == [text]
    assert read('go', '--pose', text, text).pose == [float(text)] * 2


def test_given_options_are_those_that_differ_from_the_default():
    assert read('go').given() == ['ACTION']
    assert read('go', '--speed', '0').given() == ['ACTION']
    assert read('go', '1', '--speed', '2', '-s', 'x').given() == ['ACTION', 'INPUT', '--speed', '--set']


@pytest.mark.parametrize(
    ('arguments', 'name'),
    [(['go', ''], 'INPUT'), (['go', '-s', ''], '--set/-s'), (['go', '--set', 'a', '--set='], '--set/-s')],
)
def test_empty_argument_is_rejected_by_name(arguments, name, capsys):
    with pytest.raises(SystemExit) as end:
        read(*arguments)
    assert end.value.code == 2
    assert f'error: argument {name}: it must not be empty' in capsys.readouterr().err


def test_every_name_of_a_file_or_a_folder_must_not_be_empty(capsys):
    seen = 0
    for name in COMMANDS:
        command = load_command(name)
        for option_name in (
            sorted(NAMES_OF_FILES & set(command.words())) if isinstance(command, Command) else ()
        ):
            with pytest.raises(SystemExit):
                command.read([option_name, ''])
            assert f'error: argument {option_name}: ' in capsys.readouterr().err, (name, option_name)
            seen += 1
    assert seen > 25


def test_an_option_that_an_action_does_not_obey_is_rejected_by_name(capsys):
    with pytest.raises(SystemExit) as end:
        read('stop', '--speed', '1')
    assert end.value.code == 2
    assert '--speed is for go, not for stop' in capsys.readouterr().err
    assert read('stop', '--now').now


def test_several_actions_that_obey_an_option_are_listed():
    options = read('go', '--now')
    assert options.rejection('rest') == '--now is for go, stop and wait, not for rest'
    assert options.unsupported('wait') == []


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--exact'], '--exact requires --limit'),
        (['--exact', '--limit', '1', '--now'], '--exact cannot be combined with --now or --pose'),
    ],
)
def test_the_declared_rules_of_an_option_are_checked(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as end:
        read('go', *arguments)
    assert end.value.code == 2
    assert f'error: {sentence}\n' in capsys.readouterr().err
    assert read('go', '--limit', '1', '--exact').exact


def test_settings_get_the_options_of_the_same_names():
    @dataclass
    class Settings:
        speed: float
        limit: float | None
        place: str = 'home'

    options = read('go', '--speed', '3')
    assert settings_of(Settings, options, limit=2.0) == Settings(3.0, 2.0)
    assert settings_of(Settings, options, place='there') == Settings(3.0, None, 'there')


def test_one_place_prints_the_result_of_every_command(capsys):
    output = Output(lambda: {'ok': True}, iter(['a', 'b']), 3, ['note: n'], 'error: e')
    assert print_output(output, as_json=True) == 3
    assert capsys.readouterr() == ('{"ok": true}\n', 'error: e\n')
    assert print_output(output, as_json=False) == 3
    assert capsys.readouterr() == ('a\nb\n', 'note: n\nerror: e\n')
    assert print_output(Output(status=2), as_json=True) == 2
    assert capsys.readouterr() == ('', '')


def test_help_lists_actions_and_meaningful_defaults():
    text = command().parser().format_help()
    for line in ('  go    start', '  stop  end', 'how fast (default: 0.0)'):
        assert line in text
    assert text.count('(default') == 1
    assert text.index('--now') < text.index('--json')


def test_completion_offers_options_choices_and_programs():
    words = command().words()
    assert {'go', 'stop', '--set', '-s', '--json', '--help', 'experiment1'} <= set(words)


@pytest.mark.parametrize('kind', ['rich', 'rotary', 'rich+rotary'])
def test_compilation_of_kernels_of_a_kind_of_robot_is_reported(kind, monkeypatch, capsys):
    done, compiled = {''}, []

    def compile_kernels(robot, show):
        compiled.append(robot)
        show(0, 0)
        done.add(robot.kind)

    monkeypatch.setattr(kernel, 'all_compiled', lambda kind='': kind in done)
    monkeypatch.setattr(simulation, 'compile_kernels', compile_kernels)
    progress.announce_compilation()
    assert not compiled
    progress.announce_compilation(kind)
    assert capsys.readouterr().err == f'{kernel.COMPILING}: started\n'
    assert compiled == [parameters.load(kind)]
    progress.announce_compilation(kind)
    assert len(compiled) == 1

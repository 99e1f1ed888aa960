"""Declarative commands: parser, help, completion and option checks are derived from a dataclass of options."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from delta3_pacdrive.cli.option_types import FREQUENCY, STATEMENT, non_empty
from delta3_pacdrive.cli.output import Output, print_output, run_and_report
from delta3_pacdrive.configuration.packaged import program_names

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

# fields that take a program name; completion offers the packaged programs for them
PROGRAMS = ('program', 'file', 'inputs', 'values', 'run')
PARAMETERS = (
    'parameter file, or the name of a packaged one: built, model, rotary, rotary_2, gears, frame, supply, thermal, '
    'sercos2, uncommissioned; join several with +'
)


def argument(help_text: str, *, default: Any = MISSING, only: Sequence[str] = (), **more: Any) -> Any:
    """Declare a positional argument; it is required unless it has a default.

    Parameters
    ----------
    only
        Actions of the command that accept the argument; empty: all.
    more
        Further arguments of ``argparse``: ``type``, ``metavar``, ``choices``, ``nargs`` ...

    """
    if default is not MISSING and 'nargs' not in more:
        more['nargs'] = '?'
    return _declared({'help': help_text, **more}, None if default is MISSING else default, only=only)


def option(
    help_text: str,
    metavar: str | tuple[str, ...] | None = None,
    *,
    default: Any = None,
    names: Sequence[str] = (),
    only: Sequence[str] = (),
    needs: str = '',
    excludes: Sequence[str] = (),
    formerly: str = '',
    **more: Any,
) -> Any:
    """Declare an option with a value.

    Parameters
    ----------
    names
        Spellings on the command line; default: derived from the field name.
    needs
        Option without which this one is rejected.
    excludes
        Options that cannot be combined with this one.
    formerly
        Deprecated spelling. It still works, with a message on standard error, but help and completion omit it.

    """
    parser = {'help': help_text, **({} if metavar is None else {'metavar': metavar}), **more}
    rules = {'names': names, 'only': only, 'needs': needs, 'excludes': excludes, 'formerly': formerly}
    return _declared(parser, default, optional=True, **rules)


def flag(help_text: str, **rules: Any) -> Any:
    """Declare an option without a value; ``rules`` are the parameters of ``option`` from ``names`` to ``formerly``."""
    return option(help_text, default=False, action='store_true', **rules)


def _declared(parser: dict[str, Any], default: Any, optional: bool = False, **rules: Any) -> Any:
    known: dict[str, Any] = {'names': (), 'only': (), 'needs': '', 'excludes': (), 'formerly': ''}
    return field(default=default, metadata=known | rules | {'parser': parser, 'optional': optional})


@dataclass
class Options:
    """Options common to all commands; ``command_line`` is the complete command."""

    command_line: str = ''

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        return ''

    def given(self) -> list[str]:
        """Return the names of the options that differ from their defaults."""
        return [name(one) for one in _options(self) if getattr(self, one.name) != one.default]

    def unsupported(self, action: str) -> list[tuple[str, Sequence[str]]]:
        """Return the given options that an action does not support, each with the actions that do."""
        given, only = self.given(), {name(one): one.metadata['only'] for one in _options(self)}
        return [(one, only[one]) for one in given if only[one] and action not in only[one]]

    def violation(self) -> str:
        """Return the violated rule ``needs`` or ``excludes`` of a given option; empty if there is none."""
        given = self.given()
        for one in _options(self):
            own, rules = name(one), one.metadata
            if own in given and rules['needs'] and rules['needs'] not in given:
                return f'{own} requires {rules["needs"]}'
            if own in given and any(other in given for other in rules['excludes']):
                return f'{own} cannot be combined with {_listed(rules["excludes"], "or")}'
        return ''

    def rejection(self, action: str) -> str:
        """Return the error for an option that an action does not support; empty if there is none."""
        for one, only in self.unsupported(action):
            return f'{one} is for {_listed(only, "and")}, not for {action}'
        return ''


@dataclass
class JsonOptions(Options):
    """Options of a command with a result."""

    json: bool = flag('print the result as JSON')


@dataclass
class NodeOptions(Options):
    """Options of a command that connects to a running robot."""

    namespace: str = option('ROS namespace of the robot', default='/', type=str)


@dataclass
class RobotOptions(JsonOptions):
    """Options that select the robot model."""

    parameters: str | None = option(PARAMETERS, 'FILE')
    exchange_period: float | None = option(
        'exchange period between drives and plant [s]; 125e-6: exact reference', 'S', type=float
    )


def first_statement(only: Sequence[str] = ()) -> Any:
    """Declare ``--from``, the first statement of a program that is executed."""
    return option(
        'start at statement N of the program, counted from 0 as in messages: at the end pose of the statement before, '
        'with the payload at that point',
        'N',
        default=0,
        names=('--from',),
        only=only,
        type=STATEMENT,
    )


NO_PROGRAM = '--from is for a program, not for a'  # script, or a reference


@dataclass
class ProgramOptions(RobotOptions):
    """Options that select a program and a robot model."""

    program: str = argument(
        f'program file, or a packaged program: {", ".join(program_names())}', default='experiment1'
    )
    first: int = first_statement()


@dataclass
class ReferenceOptions(ProgramOptions):
    """Options that select a program, or a sampled trajectory instead."""

    reference: str | None = option(
        'play a sampled trajectory of the TCP or the arms instead of a program: table (.csv, .parquet, .mat), '
        'trace (.npz) or rosbag2 folder',
        'FILE',
    )
    columns: str | None = option(
        'column file that maps the columns of the reference table to signals; needed if its headings do not',
        'FILE',
        needs='--reference',
    )
    lowpass: float | None = option(
        'zero-phase low-pass filter for a noisy reference: cut-off [Hz]; the resulting change is reported',
        'HZ',
        type=FREQUENCY,
        needs='--reference',
        formerly='--smooth',
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.first and (self.reference or self.program.endswith('.py')):
            return f'{NO_PROGRAM} {"reference" if self.reference else "script"}'
        if self.reference and 'program' in self.given():
            return f'--reference replaces the program, but {self.program} is given too'
        return super().check()


def _options(kind: Any) -> list[Any]:
    """Return the declared options, ``--json`` last."""
    return sorted((one for one in fields(kind) if one.metadata), key=lambda one: one.name == 'json')


def name(one: Any) -> str:
    """Return the spelling of an option, or the name of an argument in the help."""
    if not one.metadata['optional']:
        return str(one.metadata['parser'].get('metavar') or one.name)
    return str(one.metadata['names'][0]) if one.metadata['names'] else '--' + one.name.replace('_', '-')


Settings = TypeVar('Settings')


def _listed(texts: Sequence[str], word: str) -> str:
    return f' {word} '.join(filter(None, [', '.join(texts[:-1]), texts[-1]]))


def settings_of(kind: type[Settings], options: Any, **others: Any) -> Settings:
    """Return settings of a class whose values are those of the options with the same field names.

    ``others`` are values that do not come directly from an option.
    """
    names = {one.name for one in fields(kind) if hasattr(options, one.name)}  # type: ignore[arg-type]
    return kind(**{name: getattr(options, name) for name in names} | others)


Chosen = TypeVar('Chosen', bound=Options)


class Command(Generic[Chosen]):
    """A sub-command of ``delta3``; calling it with arguments runs it and returns the exit status.

    Parameters
    ----------
    description
        First paragraph of the help.
    options
        Dataclass of the options.
    run
        Executes the command and returns its result.
    actions
        Values of the first argument, with their help texts.
    mixed
        Allow options between the values of one argument.

    """

    def __init__(
        self,
        name: str,
        description: str,
        options: type[Chosen],
        run: Callable[[Chosen], Output],
        actions: dict[str, str] | None = None,
        mixed: bool = False,
    ) -> None:
        self.name, self._options, self._run, self._mixed = name, options, run, mixed
        self._description, self._actions = description, actions or {}

    def parser(self) -> argparse.ArgumentParser:
        """Build the argument parser."""
        parser = _Parser(prog=f'delta3 {self.name}', description=self._description, formatter_class=_Help)
        if self._actions:
            width = max(map(len, self._actions))
            lines = [f'  {action:<{width}}  {text}' for action, text in self._actions.items()]
            parser.epilog = 'actions:\n' + '\n'.join(lines)
        for one in _options(self._options):
            more = one.metadata['parser']
            if not more.keys() & {'type', 'choices'} and more.get('action', 'append') == 'append':
                more = {'type': non_empty, **more}
            if not one.metadata['optional']:
                parser.add_argument(one.name, default=one.default, **more)
                continue
            names = one.metadata['names'] or (name(one),)
            parser.add_argument(*names, dest=one.name, default=one.default, **more)
        return parser

    def words(self) -> list[str]:
        """Return the words for completion: options, choices, program names."""
        found = ['-h', '--help']
        for one in _options(self._options):
            if one.metadata['optional']:
                found += one.metadata['names'] or (name(one),)
            found += [str(choice) for choice in one.metadata['parser'].get('choices') or ()]
        takes_program = any(one.name in PROGRAMS for one in _options(self._options))
        return found + (program_names() if takes_program else [])

    def read(self, arguments: Sequence[str]) -> Chosen:
        """Parse the arguments; exits with a usage error if they are invalid."""
        parser = self.parser()
        arguments = self._current_spelling(arguments)
        found = (parser.parse_intermixed_args if self._mixed else parser.parse_args)(arguments)
        typed = f'{parser.prog} {shlex.join(arguments)}'.strip()
        typed = typed.encode(errors='backslashreplace').decode()  # file names may be invalid UTF-8
        options = self._options(command_line=typed, **vars(found))
        if rejection := options.violation() or options.check():
            parser.error(rejection)
        return options

    def _current_spelling(self, arguments: Sequence[str]) -> list[str]:
        """Return the arguments with deprecated option names replaced; print a warning for each."""
        current = {
            one.metadata['formerly']: name(one) for one in _options(self._options) if one.metadata['formerly']
        }
        end = arguments.index('--') if '--' in arguments else len(arguments)
        renamed = list(arguments)
        for index, argument in enumerate(arguments[:end]):
            old, equals, value = argument.partition('=')
            if old in current:
                warn_renamed(old, current[old])
                renamed[index] = f'{current[old]}{equals}{value}'
        return renamed

    def __call__(self, arguments: Sequence[str] | None = None) -> int:
        """Run with the given arguments, by default those of the process."""
        options = self.read(list(sys.argv[1:] if arguments is None else arguments))
        as_json = getattr(options, 'json', False)
        return run_and_report(lambda: print_output(self._run(options), as_json), as_json)


def warn_renamed(old: str, new: str) -> None:
    """Warn on standard error that the name of an option or a command is deprecated."""
    print(f'warning: {old} is deprecated and will be removed in the next release; use {new}', file=sys.stderr)


class _Parser(argparse.ArgumentParser):
    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        # argparse parses -1 as a number, but -1e3 as an option
        self._negative_number_matcher = re.compile(r'^-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$|^-inf(inity)?$', re.I)

    def _print_message(self, message: str, file: Any = None) -> None:
        # argparse ignores write errors
        (file or sys.stderr).write(message)


class _Help(argparse.HelpFormatter):
    """Formatter that omits empty defaults and keeps the line breaks of action lists."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        hidden = action.default is None or action.default is False
        hidden = hidden or action.default in ('', (), argparse.SUPPRESS)
        if hidden or not (action.option_strings or action.nargs):
            return action.help
        text = action.default
        if isinstance(text, tuple):
            text = ' '.join(map(str, text))
        return f'{action.help} (default: {text})'

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if '\n' in text:
            return ''.join(indent + line for line in text.splitlines(keepends=True))
        return super()._fill_text(text, width, indent)

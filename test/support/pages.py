"""Runs the blocks of the README and of the pages of the documentation as a reader would (rules: CONTRIBUTING.md)."""

import contextlib
import doctest
import itertools
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

import commands
from thoroughness import EVERYTHING

SOURCE = Path(__file__).parents[2]
PAGES = [
    SOURCE / name
    for name in ('README.md', 'CONTRIBUTING.md', *sorted(str(path) for path in SOURCE.glob('docs/**/*.md')))
]
# their commands compute for a quarter of a minute and longer, and have tests of their own
LONG = [
    SOURCE / f'docs/{name}.md'
    for name in (
        'calibration', 'lines', 'measured', 'optimise', 'places_and_plans', 'student/errata', 'studies', 'sweeps',
        'tuning',
    )
]  # fmt: skip
LANGUAGES = {'bash', 'console', 'python', 'pycon', 'yaml', 'text'}
DIRECTIVES = re.compile(r'\{(?!code-block\})[\w-]+\}.*')
ROBOT = re.compile(
    r'^(\$ )?(delta3 (up|run|move|record|soak|drive \d|scope (?!list)|faults (?!list)|experiment .*--graph)|ros2 )',
    re.M,
)
BLOCK = re.compile(
    r'(?:^<!-- *ends: *(?P<ends>[^\n]*?) *-->\n+)?'
    r'(?:^<!-- *(?P<mark>terminal|until|elsewhere|long): *(?P<words>[^\n]*?) *-->\n+)?'
    r'^(?P<fence>```+|:::+) *(?P<language>[^\n]*)\n(?P<text>.*?)^(?P=fence) *$',
    re.M | re.S,
)
FIRST = SOURCE / 'docs/get_started.md'  # every command is run by the shell, as a reader runs it
SHELL_ONLY = set('|<>&;$`"*?()')  # in lines with one of these the shell does something
UP_PACE = '0.25'  # bus time over wall time of a robot that pages keep up and say no pace of
DRIVEN_ALL_THE_TIME = ('cell.md', 'belts.md')  # by scripts, which would take four times as long
END_S = 120.0
ENDED_BY_CTRL_C = 130
WAIT_S = 600.0
NETWORK = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_AUTOMATIC_DISCOVERY_RANGE')


@dataclass(frozen=True)
class Block:
    """A block of a page: line, language, written file, and the content of the comments above it."""

    line: int
    language: str
    text: str
    file: str
    mark: str
    words: str
    ends: tuple[str, ...]


def blocks(page: Path) -> list[Block]:
    """Return the blocks of a page that are code."""
    text = page.read_text(encoding='utf-8')
    found = []
    for match in BLOCK.finditer(text):
        language, code, file = match['language'].strip(), match['text'], ''
        if DIRECTIVES.fullmatch(language):
            continue
        if language.startswith('{code-block}'):
            language = language.removeprefix('{code-block}').strip()
            options = re.match(r'((?::[\w-]+:[^\n]*\n)*)\n*', code)
            assert options is not None
            file = dict(re.findall(r':([\w-]+): *([^\n]*)', options[1])).get('caption', '')
            code = code[options.end() :]
        line = text.count('\n', 0, match.start('fence')) + 1
        ends = tuple(re.split(', *', match['ends'])) if match['ends'] else ()
        found.append(Block(line, language, code, file, match['mark'] or '', match['words'] or '', ends))
    return found


def needs_robot(page: Path) -> bool:
    """Return whether a block of a page needs ROS and its time."""
    return any(block.language in ('bash', 'console') and ROBOT.search(block.text) for block in blocks(page))


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of a reader who has activated this one: its commands, its packages, and a ``ros2``."""
    programs = folder / 'bin'
    programs.mkdir()
    stand_in = programs / 'ros2'
    script = SOURCE / 'test' / 'support' / 'ros2.py'
    stand_in.write_text(f'#!/bin/sh\nexec "{sys.executable}" -P "{script}" "$@"\n', encoding='utf-8')
    stand_in.chmod(0o755)
    path = [str(programs), str(Path(sys.executable).parent), os.environ['PATH']]
    # what the tests have said about the network is none of a reader's settings
    own = {key: value for key, value in os.environ.items() if key not in NETWORK}
    return own | {
        'PATH': os.pathsep.join(path),
        'VIRTUAL_ENV': sys.prefix,
        'AMENT_PREFIX_PATH': sys.prefix,
    }


def pace_robots(folder: Path) -> None:
    """Let ``delta3 up`` run at the pace of the tests unless its options set another one.

    A robot that is up mostly waits for commands; in real time it would need both cores of a slow machine meanwhile.
    """
    stand_in = folder / 'bin' / 'delta3'
    command = str(Path(sys.executable).with_name('delta3'))
    stand_in.write_text(
        f"""#!{sys.executable} -P
import os, sys
words = [{command!r}, *sys.argv[1:]]
if words[1:2] == ['up'] and not any(word.startswith('--real-time') for word in words):
    words += ['--real-time-factor', {UP_PACE!r}]
os.execv(words[0], words)
""",
        encoding='utf-8',
    )
    stand_in.chmod(0o755)


def copy_sources(folder: Path) -> None:
    """Copy the sources, as a reader gets them."""
    command = ['git', 'ls-files', '-z']
    files = subprocess.run(command, cwd=SOURCE, capture_output=True, text=True, check=True).stdout.split('\0')
    for name in filter(None, files):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(SOURCE / name, folder / name)


class Terminal:
    """A shell of a reader; one line after the other, all of them have to succeed."""

    def __init__(self, folder: Path, variables: dict[str, str]) -> None:
        self._folder, self._variables = folder, variables
        self._process = self._start(['bash', '--norc', '-o', 'pipefail'])
        self._number = 0

    def _start(self, command: list[str]) -> subprocess.Popen[str]:
        return subprocess.Popen(
            command,
            cwd=self._folder,
            env=self._variables,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def run(self, commands: str) -> str:
        """Run commands; return their output."""
        self._number += 1
        end = f'--- end of block {self._number}:'
        script = self._folder / 'bin' / f'block_{self._number}.sh'
        script.write_text(commands, encoding='utf-8')
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        # an error ends the block, not the shell, whose background goes on
        self._process.stdin.write(
            f'trap \'status=$?; echo; echo "{end} $status $BASH_COMMAND"; trap - ERR\' ERR; '
            f'. "{script}"; echo; echo "{end} 0"\n'
        )
        self._process.stdin.flush()
        with killed_after(self._process, WAIT_S):
            printed = []
            for line in self._process.stdout:
                if line.startswith(end):
                    assert line.startswith(f'{end} 0'), f'{line}{"".join(printed)}'
                    return ''.join(printed)[:-1]
                printed.append(line)
        raise AssertionError(f'the shell ended, or took over {WAIT_S:g} s: {commands}{"".join(printed)}')

    def start(self, command: str, words: str) -> subprocess.Popen[str]:
        """Start a command in a new terminal; return after it has printed the words, or after a time in seconds."""
        process = self._start(['bash', '-c', f'exec {command}'])
        if seconds := re.fullmatch(r'(\d+) s', words):
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(float(seconds[1]))
            return process
        assert process.stdout is not None
        printed = []
        with killed_after(process, WAIT_S):
            for line in process.stdout:
                printed.append(line)
                if words in line:
                    threading.Thread(target=process.stdout.read, daemon=True).start()
                    return process
        raise AssertionError(f'{words!r} was not printed by {command}: {"".join(printed)}')

    def close(self) -> None:
        """End the shell."""
        self._process.communicate('exit\n', timeout=END_S)


@contextlib.contextmanager
def killed_after(process: subprocess.Popen[str], seconds: float) -> Iterator[None]:
    """Kill a process that takes too long, so that a reader of its output gets to the end."""
    timer = threading.Timer(seconds, os.killpg, (process.pid, signal.SIGKILL))
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def end(process: subprocess.Popen[str]) -> None:
    """End a command with Ctrl-C; it has to obey."""
    process.send_signal(signal.SIGINT)
    try:
        status = process.wait(END_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise
    assert status in (0, ENDED_BY_CTRL_C), f'{process.args} ended with status {status}'


def commands_and_prints(text: str) -> list[tuple[str, str]]:
    """Return the commands of a console block and the output of each of them."""
    parts = re.split(r'^\$ (.*)\n', text, flags=re.M)
    assert not parts[0].strip(), 'a console block begins with a command'
    return list(zip(parts[1::2], parts[2::2], strict=True))


def same(expected: str, printed: str) -> bool:
    """Compare, with ``...`` as a placeholder for any text and several spaces equal to one."""
    checker = doctest.OutputChecker()
    return checker.check_output(expected, printed, doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)


def run_page(page: Path, folder: Path) -> None:
    """Run the blocks of a page in their order."""
    variables = environment(folder)
    if page.name not in DRIVEN_ALL_THE_TIME:
        pace_robots(folder)
    if page.name == 'CONTRIBUTING.md':
        copy_sources(folder)
    names: dict[str, Any] = {'__name__': '__main__'}
    with contextlib.ExitStack() as stack, contextlib.chdir(folder):
        shell = Terminal(folder, variables)
        stack.callback(shell.close)
        others: dict[str, subprocess.Popen[str]] = {}
        stack.callback(lambda: [end(process) for process in others.values()])
        for block in blocks(page):
            place = f'{page.relative_to(SOURCE)}:{block.line}'
            try:
                run_block(block, shell, others, names, folder)
            except Exception as error:
                raise AssertionError(f'{place}: {error}') from error


def run_block(
    block: Block,
    shell: Terminal,
    others: dict[str, subprocess.Popen[str]],
    names: dict[str, Any],
    folder: Path,
) -> None:
    """Run one block; ``others`` are the commands in terminals of their own, ``names`` those of Python."""
    if (block.language == 'text' and not block.file) or block.mark == 'elsewhere':
        return
    for command in block.ends:
        end(others.pop(command))
    if block.mark == 'long' and not EVERYTHING:
        return
    if block.file:
        (folder / block.file).write_text(block.text, encoding='utf-8')
        if block.language == 'yaml':
            yaml.safe_load(block.text)
        return
    match block.language:
        case 'bash' if block.mark in ('terminal', 'until'):
            (command,) = (re.sub(r'\s+#.*', '', line) for line in block.text.splitlines() if line.strip())
            process = shell.start(command, block.words)
            if block.mark == 'until':
                end(process)
            else:
                others[command] = process
        case 'bash' if runs_here(block.text):
            for line in block.text.splitlines():
                done = commands.delta3(*shlex.split(line, comments=True)[1:], cwd=folder)
                assert done.returncode == 0, f'{line}: {done.stderr}'
        case 'bash':
            shell.run(block.text)
        case 'console':
            for command, expected in commands_and_prints(block.text):
                printed = shell.run(f'{command} || true')
                assert same(expected, printed), f'{command} prints\n{printed}'
        case 'python':
            exec(compile(block.text, f'block in line {block.line}', 'exec'), names)
        case 'pycon':
            run_dialogue(block, names)
        case _:
            raise AssertionError(f'{block.language!r} is none of {sorted(LANGUAGES)}, or has no file name')


def runs_here(text: str) -> bool:
    """Return whether every line is a plain command of delta3 without a robot, which needs no shell."""
    lines = text.splitlines()
    plain = all(
        line.startswith('delta3 ') and not SHELL_ONLY & set(line.partition(' #')[0]) for line in lines
    )
    return plain and not ROBOT.search(text) and '--help' not in text


def commands_in(text: str) -> Iterator[list[str]]:
    """Return the words of each command of delta3 in lines of a shell, at any place in its line."""
    for line in text.replace('\\\n', ' ').splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        for between, words in itertools.groupby(
            lexer, lambda word: word != '' and set(word) <= set('();<>|&')
        ):
            command = list(words)
            if not between and command[0] == 'delta3':
                yield command


def read_commands(text: str) -> int:
    """Have the options of every command of delta3 in a block read, and run none; return how many there are."""
    commands = list(commands_in(text))
    for _, name, *options in commands:
        if name in ('--help', '--version') or '--help' in options:
            continue  # it ends with a text
        try:
            import_module(f'delta3_pacdrive.cli.{name.replace("-", "_")}').main.read(options)
        except (ImportError, SystemExit) as refusal:
            raise AssertionError(f'delta3 {name} {shlex.join(options)} is refused') from refusal
    return len(commands)


def read_page(page: Path) -> None:
    """Read the blocks of a page as far as that goes without running them: options of commands, and Python."""
    for block in blocks(page):
        match block.language:
            case 'bash':
                read_commands(block.text)
            case 'console':
                read_commands('\n'.join(command for command, _ in commands_and_prints(block.text)))
            case 'python':
                compile(block.text, f'{page.name}:{block.line}', 'exec')


def run_dialogue(block: Block, names: dict[str, Any]) -> None:
    """Run a dialogue with Python; its output must agree."""
    test = doctest.DocTestParser().get_doctest(block.text, names, 'block', None, block.line)
    report: list[str] = []
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    runner.run(test, out=report.append, clear_globs=False)
    names.update(test.globs)
    assert runner.summarize(verbose=False).failed == 0, ''.join(report)

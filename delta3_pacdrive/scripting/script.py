"""Load and run scripts: Python files with a function ``main(robot)``."""

import ast
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason, ScriptError
from delta3_pacdrive.scripting.robot import Robot
from delta3_pacdrive.scripting.source_position import shown_file

SUFFIX = '.py'
MAIN = 'main'


def is_script(path: str | Path) -> bool:
    """Whether a program is a script, by its suffix."""
    return Path(path).suffix == SUFFIX


@dataclass(frozen=True)
class Script:
    """A loaded script."""

    path: Path
    main: Callable[[Robot], Any]

    @property
    def name(self) -> str:
        """File name without suffix."""
        return self.path.stem

    def run(self, robot: Robot) -> None:
        """Run the script; every error in it raises ScriptError with file and line."""
        with _errors_of(self.path), _importing_from(self.path):
            self.main(robot)


def load(path: str | Path) -> Script:
    """Import a script.

    Raises
    ------
    ProgramError
        The file cannot be read, or has no function ``main(robot)``; it is not executed then.
    ScriptError
        The file has a syntax error, or its execution fails.

    """
    path = Path(path)
    shown = shown_file(str(path))
    if not path.is_file():
        raise ProgramError(f'script {shown} does not exist')
    with _errors_of(path):
        tree = ast.parse(path.read_bytes(), str(path.absolute()))
    if not any(_names_main(node) for node in ast.walk(tree)):  # do not execute arbitrary files
        raise ProgramError(f'script {shown} has no function {MAIN}(robot)')
    specification = importlib.util.spec_from_file_location(f'delta3_script_{path.stem}', path.absolute())
    if specification is None or specification.loader is None:
        raise ProgramError(f'script {shown} is not a Python file')
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module  # required by dataclasses
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        with _errors_of(path), _importing_from(path):
            specification.loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = written
    main = getattr(module, MAIN, None)
    if not callable(main):
        raise ProgramError(f'script {shown} has no function {MAIN}(robot)')
    if inspect.iscoroutinefunction(main) or inspect.isgeneratorfunction(main):
        raise ProgramError(f'script {shown}: {MAIN} must be an ordinary function, without async and yield')
    try:
        inspect.signature(main).bind(None)
    except TypeError as error:
        raise ProgramError(f'script {shown}: {MAIN} must take the robot and nothing else: {error}') from None
    return Script(path, main)


def _names_main(node: ast.AST) -> bool:
    """Whether a syntax node may define ``main``."""
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            return name == MAIN
        case ast.Name(id=name, ctx=ast.Store()):
            return name == MAIN
        case ast.alias(name=name, asname=other):
            return (other or name) in (MAIN, '*')
    return False


@contextmanager
def _importing_from(path: Path) -> Iterator[None]:
    """Add the folder of a script to the import path."""
    folder = str(path.absolute().parent)
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        if folder in sys.path:
            sys.path.remove(folder)


@contextmanager
def _errors_of(path: Path) -> Iterator[None]:
    """Convert all errors of a script to ScriptError with file and line."""
    try:
        yield
    except ScriptError:
        raise
    except SyntaxError as error:
        place = f'{shown_file(error.filename or str(path))}:{error.lineno or 1}'
        raise ScriptError(Reason(Code.CONTENT, f'{error.msg}'), place) from None
    except SystemExit as error:
        if error.code:
            raise ScriptError(Reason(Code.CONTENT, f'ended with {error.code}'), _place(path, error)) from None
    except Delta3Error as error:
        raise ScriptError(Reason.of(error), _place(path, error)) from error
    except Exception as error:
        text = ' '.join(str(error).split())
        sentence = f'{type(error).__name__}: {text}' if text else type(error).__name__
        raise ScriptError(Reason(Code.CONTENT, sentence), _place(path, error)) from error


def _place(path: Path, error: BaseException) -> str:
    """Return file and line of the innermost frame of an error in the script."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename == str(path.absolute())]
    return f'{shown_file(own[-1].filename)}:{own[-1].lineno}' if own else shown_file(str(path))

"""Types of options: each takes what the command can obey, and refuses anything else with its limit."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def filled(text: str) -> str:
    """Take a text or a name; what is empty is a variable of a shell that was never set."""
    if not text:
        raise argparse.ArgumentTypeError('it must not be empty')
    return text


def folder(text: str) -> Path:
    """Take the name of a folder."""
    return Path(filled(text))


def number_within(low: float, high: float, unit: str = '') -> Callable[[str], float]:
    """Return the type of an option that is a number from ``low`` to ``high``."""

    def number(text: str) -> float:
        value = _number(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f'{text!r} must be a number between {low:g} and {high:g} {unit}'.rstrip()
            )
        return value

    return number


def finite_number(text: str) -> float:
    """Take a number of the command line."""
    value = _number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is no finite number')
    return value


def integer_within(low: int, high: int) -> Callable[[str], int]:
    """Return the type of an option that is a whole number from ``low`` to ``high``."""

    def integer(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text!r} must be a whole number between {low} and {high}')
        return value

    return integer


def trace_file(text: str) -> str:
    """Take the name of a trace to be written: its ending says how."""
    from delta3_pacdrive.recording.trace_file import suffix_refusal

    if refusal := suffix_refusal(text):
        raise argparse.ArgumentTypeError(f'cannot write {text}: {refusal}')
    return text


def signal_names(text: str) -> list[str]:
    """Take names of signals, or patterns such as ``tcp_*``, with commas between them."""
    names = [part.strip() for part in text.split(',') if part.strip()]
    if not names:
        raise argparse.ArgumentTypeError('it names no signal')
    return list(dict.fromkeys(names))


def csv_file(text: str) -> Path:
    """Take the name of a table to be written."""
    if Path(text).suffix.lower() != '.csv':
        raise argparse.ArgumentTypeError(f'cannot write {text}: the name of a table must end in .csv')
    return Path(text)


def program_file(text: str) -> str:
    """Take the name of a program file to be written."""
    if Path(text).suffix.lower() not in ('.yaml', '.yml'):
        raise argparse.ArgumentTypeError(f'cannot write {text}: the name of a program must end in .yaml')
    return text


STATEMENT = integer_within(0, 19_999)
SEED = integer_within(0, 2**31 - 1)
TIME = number_within(-1e9, 1e9, 's')
FREQUENCY = number_within(1e-3, 1e5, 'Hz')
NOISE = number_within(0.0, 1e3)

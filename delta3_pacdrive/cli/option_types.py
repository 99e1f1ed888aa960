"""Types of option values; each raises ArgumentTypeError with the allowed range or format."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def non_empty(text: str) -> str:
    """Read a text; reject an empty one, which is usually an unset shell variable."""
    if not text:
        raise argparse.ArgumentTypeError('it must not be empty')
    return text


def folder(text: str) -> Path:
    """Read the name of a folder."""
    return Path(non_empty(text))


def number_within(low: float, high: float, unit: str = '') -> Callable[[str], float]:
    """Return the option type of numbers from ``low`` to ``high``."""

    def number(text: str) -> float:
        value = _number(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f'{text!r} must be a number between {low:g} and {high:g} {unit}'.rstrip()
            )
        return value

    return number


def finite_number(text: str) -> float:
    """Read a finite number."""
    value = _number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not a finite number')
    return value


def integer_within(low: int, high: int) -> Callable[[str], int]:
    """Return the option type of integers from ``low`` to ``high``."""

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
    """Read the name of a trace to write; the suffix selects the format."""
    from delta3_pacdrive.recording.trace_file import suffix_refusal

    if refusal := suffix_refusal(text):
        raise argparse.ArgumentTypeError(f'cannot write {text}: {refusal}')
    return text


def signal_names(text: str) -> list[str]:
    """Read comma-separated signal names or patterns such as ``tcp_*``."""
    names = [part.strip() for part in text.split(',') if part.strip()]
    if not names:
        raise argparse.ArgumentTypeError('at least one signal is required')
    return list(dict.fromkeys(names))


def file_ending(*suffixes: str, of: str = '', alias: str = '') -> Callable[[str], str]:
    """Return the option type of files to write whose names end in one of some suffixes.

    ``of`` describes the file in the message, ``alias`` is another accepted suffix.
    """

    def file(text: str) -> str:
        if Path(text).suffix.lower() not in (*suffixes, *filter(None, [alias])):
            ends = ' or '.join(suffixes)
            raise argparse.ArgumentTypeError(
                f'cannot write {text}: the name{of and f" of {of}"} must end in {ends}'
            )
        return text

    return file


CSV = file_ending('.csv', of='a table')
PROGRAM = file_ending('.yaml', of='a program', alias='.yml')
STATEMENT = integer_within(0, 19_999)
SEED = integer_within(0, 2**31 - 1)
TIME = number_within(-1e9, 1e9, 's')
FREQUENCY = number_within(1e-3, 1e5, 'Hz')
NOISE = number_within(0.0, 1e3)

"""Inputs of a study: recordings, programs, numbers of experiments; each is noted with the digest of its bytes."""

from collections.abc import Iterable
from pathlib import Path

from delta3_pacdrive.analysis.provenance import digest
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.recording.trace_file import TABLES


def is_recording(text: str) -> bool:
    """Whether an input is a recording: a folder, or a file that is no program."""
    path = Path(text)
    return path.is_dir() or path.suffix.lower() == '.npz' or is_table(text)


def is_table(text: str) -> bool:
    """Whether an input is a table of measurements, by the end of its name."""
    return Path(text).suffix.lower() in TABLES


def program_name(text: str) -> str:
    """Return the program that an input means, which may be the number of an experiment."""
    return f'experiment{text}' if text in ('1', '2', '3') else text


def noted(inputs: Iterable[str]) -> list[str]:
    """Return each input with the digest of the file or folder that it means; raises ReportError or ProgramError."""
    return [
        f'{text} {digest(Path(text) if is_recording(text) else programs.find(program_name(text)))}'
        for text in inputs
    ]

"""Inputs of a study: recordings, programs and numbers of experiments, listed with the digests of their files."""

from collections.abc import Iterable
from pathlib import Path

from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.trace import BAG_FILES, is_bag
from delta3_pacdrive.recording.trace_file import TABLES
from delta3_pacdrive.studies.framework.provenance import digest


def is_recording(text: str) -> bool:
    """Whether an input is a recording: a bag, a trace file or a table."""
    path = Path(text)
    return is_bag(path) or path.suffix.lower() == '.npz' or is_table(text)


def is_table(text: str) -> bool:
    """Whether an input is a table of measurements, judged by its suffix."""
    return Path(text).suffix.lower() in TABLES


def bags_in(text: str) -> list[str]:
    """Return the bags in a folder of several robots, sorted by name; for any other input the input alone."""
    path = Path(text)
    try:
        if not path.is_dir() or _is_bag(path):
            return [text]
        return [str(bag) for bag in sorted(path.iterdir()) if bag.is_dir() and _is_bag(bag)] or [text]
    except OSError:  # the reader reports the error
        return [text]


def _is_bag(folder: Path) -> bool:
    return any(
        file.name.lower().endswith(BAG_FILES) or file.name == 'metadata.yaml' for file in folder.iterdir()
    )


def program_name(text: str) -> str:
    """Return the name of a program; numbers 1 to 3 denote experiments."""
    return f'experiment{text}' if text in ('1', '2', '3') else text


def with_digests(inputs: Iterable[str]) -> list[str]:
    """Return each input with the digest of its file or folder; raises ReportError or ProgramError."""
    return [
        f'{text} {digest(Path(text) if is_recording(text) else programs.find(program_name(text)))}'
        for text in inputs
    ]

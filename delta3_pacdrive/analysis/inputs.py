"""Inputs of a study: recordings, programs, numbers of experiments; each is noted with the digest of its bytes."""

from collections.abc import Iterable
from pathlib import Path

from delta3_pacdrive.analysis.provenance import digest
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.recording.trace import BAG_FILES, is_bag
from delta3_pacdrive.recording.trace_file import TABLES


def is_recording(text: str) -> bool:
    """Whether an input is a recording: a bag, a trace file or a table."""
    path = Path(text)
    return is_bag(path) or path.suffix.lower() == '.npz' or is_table(text)


def is_table(text: str) -> bool:
    """Whether an input is a table of measurements, by the end of its name."""
    return Path(text).suffix.lower() in TABLES


def bags_in(text: str) -> list[str]:
    """Return the bags in a folder of several robots, in the order of their names; of any other input itself."""
    path = Path(text)
    try:
        if not path.is_dir() or _is_bag(path):
            return [text]
        return [str(bag) for bag in sorted(path.iterdir()) if bag.is_dir() and _is_bag(bag)] or [text]
    except OSError:  # who reads it says why it cannot be read
        return [text]


def _is_bag(folder: Path) -> bool:
    return any(
        file.name.lower().endswith(BAG_FILES) or file.name == 'metadata.yaml' for file in folder.iterdir()
    )


def program_name(text: str) -> str:
    """Return the program that an input means, which may be the number of an experiment."""
    return f'experiment{text}' if text in ('1', '2', '3') else text


def noted(inputs: Iterable[str]) -> list[str]:
    """Return each input with the digest of the file or folder that it means; raises ReportError or ProgramError."""
    return [
        f'{text} {digest(Path(text) if is_recording(text) else programs.find(program_name(text)))}'
        for text in inputs
    ]

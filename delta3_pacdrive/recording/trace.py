"""Traces: all signals of a run by bus cycle, from a simulation or a recording."""

import json
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.bag_messages import BagMessages
from delta3_pacdrive.recording.signals import columns_of
from delta3_pacdrive.robot.drive.channels import is_full_name

PACKED = '.zstd'  # suffix of a file compressed by rosbag2
BAG_FILES = ('.mcap', '.db3', f'.mcap{PACKED}', f'.db3{PACKED}')
# for a file with channels of drives where signals of a run are expected
RECORD = 'it is a record of an oscilloscope, which delta3 report RUN --scope FILE shows'


@dataclass(frozen=True)
class Trace:
    """Signals of a run."""

    time_s: Floats  # bus time of each cycle, shape (cycles,)
    # arrays (cycles, 3) named as in SIGNALS, in simulations also TRUE_SIGNALS; others with the columns of columns_of()
    signals: dict[str, Floats]
    meta: dict[str, Any] = field(
        default_factory=dict
    )  # origin: program, checksum, gear ratio, timing, results
    messages: BagMessages | None = field(
        default=None, repr=False, compare=False
    )  # of the bag it was read from

    def __getitem__(self, name: str) -> Floats:
        """Return a signal; raises TraceError if it is missing."""
        try:
            return self.signals[name]
        except KeyError:
            raise TraceError(
                f'the recording has no signal {name}, only {", ".join(self.signals) or "none"}'
            ) from None

    def save(self, path: str | Path) -> None:
        """Write a ``.npz`` file atomically; raises TraceError."""
        with (
            os_errors_as_trace_error(f'write trace {path}'),
            whole_file.atomic_path(Path(path)) as partial,
            partial.open('wb') as file,
        ):
            np.savez_compressed(
                file,
                time_s=self.time_s,
                meta=np.array(json.dumps(self.meta)),
                **self.signals,  # type: ignore[arg-type]  # mypy takes an array for allow_pickle
            )

    @staticmethod
    def load(path: str | Path) -> 'Trace':
        """Read a ``.npz`` file; raises TraceError."""
        try:
            columns = whole_file.arrays_of(Path(path))
            if any(map(is_full_name, columns)):
                raise ValueError(RECORD)
            if absent := {'time_s', 'meta'} - columns.keys():
                raise ValueError(f'it has no {" and no ".join(sorted(absent))}')
            meta = json.loads(str(columns.pop('meta')))
            trace = Trace(columns.pop('time_s'), columns, meta)
            trace._check()
        except OSError as error:
            raise TraceError(f'cannot read trace {path}: {error.strerror or error}') from error
        except Exception as error:  # zipfile and numpy raise arbitrary errors for damaged files
            raise TraceError(f'{path} is not a trace file: {reason(error)}') from error
        return trace

    def _check(self) -> None:
        """Raise ValueError for types, shapes or times that a run does not have."""
        if not isinstance(self.meta, dict):
            raise ValueError('its meta is not a JSON object')
        for name, values in {'time_s': self.time_s, **self.signals}.items():
            columns = 0 if name == 'time_s' else len(columns_of(name, ''))
            shape = self.time_s.shape[:1] + (columns,) * (columns > 0)
            if values.dtype != np.float64 or values.shape != shape or not values.ndim:
                raise ValueError(f'its {name} is of type {values.dtype} and shape {values.shape}')
        if not (np.isfinite(self.time_s).all() and (np.diff(self.time_s) > 0.0).all()):
            raise ValueError('its time_s does not increase')


def is_bag(path: Path) -> bool:
    """Return whether a path is a folder or has the name of a bag file."""
    return path.is_dir() or path.name.lower().endswith(BAG_FILES)


@contextmanager
def os_errors_as_trace_error(action: str) -> Iterator[None]:
    """Convert OSError to TraceError with the message ``cannot <action>: ...``."""
    try:
        yield
    except OSError as error:
        raise TraceError(f'cannot {action}: {error.strerror or error}') from error


def reason(error: Exception) -> str:
    """Return the message of an arbitrary error on one short line."""
    return textwrap.shorten(str(error), 160, placeholder=' ...').rstrip('.') or type(error).__name__

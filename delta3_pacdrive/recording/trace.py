"""Traces: every signal of a run, cycle by cycle, from the simulation or from a recording."""

import json
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.drive.channels import is_full_name
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.signals import columns_of

PACKED = '.zstd'  # behind the name of a file that rosbag2 compressed
BAG_FILES = ('.mcap', '.db3', f'.mcap{PACKED}', f'.db3{PACKED}')
# told of a file that holds channels of drives where signals of a run are expected
RECORD = 'it is a record of an oscilloscope, which delta3 report RUN --scope FILE shows'


@dataclass(frozen=True)
class Trace:
    """A trace holds the signals of a run.

    Attributes
    ----------
    time_s
        Bus time of each cycle, shape (cycles,).
    signals
        Arrays (cycles, 3) by the names in ``SIGNALS``, of simulations in ``TRUE_SIGNALS`` as well; on request others,
        with as many columns as ``signals.columns_of`` says.
    meta
        Where it comes from: program, parameter checksum, gear ratio, timing, results.

    """

    time_s: Floats
    signals: dict[str, Floats]
    meta: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Floats:
        """Return a signal; raises TraceError if the run does not hold it."""
        try:
            return self.signals[name]
        except KeyError:
            raise TraceError(
                f'the recording has no signal {name}, only {", ".join(self.signals) or "none"}'
            ) from None

    def save(self, path: str | Path) -> None:
        """Write to a ``.npz`` file, whole or not at all; raises TraceError."""
        with (
            told(f'write trace {path}'),
            whole_file.atomic_path(Path(path)) as partial,
            partial.open('wb') as file,
        ):
            np.savez_compressed(
                file,
                time_s=self.time_s,
                meta=np.array(json.dumps(self.meta)),
                **self.signals,  # type: ignore[arg-type]  # an array would do as allow_pickle, mypy thinks
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
        except Exception as error:  # what zipfile and numpy trip over in a damaged file is not bounded
            raise TraceError(f'{path} is not a trace file: {reason(error)}') from error
        return trace

    def _check(self) -> None:
        """Raise ValueError for what no run writes."""
        if not isinstance(self.meta, dict):
            raise ValueError('its meta is no JSON object')
        for name, values in {'time_s': self.time_s, **self.signals}.items():
            columns = 0 if name == 'time_s' else len(columns_of(name, ''))
            shape = self.time_s.shape[:1] + (columns,) * (columns > 0)
            if values.dtype != np.float64 or values.shape != shape or not values.ndim:
                raise ValueError(f'its {name} is of type {values.dtype} and shape {values.shape}')
        if not (np.isfinite(self.time_s).all() and (np.diff(self.time_s) > 0.0).all()):
            raise ValueError('its time_s does not increase')


def is_bag(path: Path) -> bool:
    """Whether a path is a folder, or a single file of a bag, by its name."""
    return path.is_dir() or path.name.lower().endswith(BAG_FILES)


@contextmanager
def told(what: str) -> Iterator[None]:
    """Say what cannot be done, and why, if the disk does not let it be; raises TraceError."""
    try:
        yield
    except OSError as error:
        raise TraceError(f'cannot {what}: {error.strerror or error}') from error


def reason(error: Exception) -> str:
    """Return the message of somebody else's error as part of a sentence: short, on one line."""
    return textwrap.shorten(str(error), 160, placeholder=' ...').rstrip('.') or type(error).__name__

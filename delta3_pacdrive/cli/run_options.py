"""Options of the commands that show or compare runs."""

from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cli.command import JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import TIME
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.configuration.packaged import program_names
from delta3_pacdrive.errors import ParameterError

RUN = (
    'trace (.npz), table of measurements (.csv, .parquet, .mat), rosbag2 folder, folder with the bags of several '
    'robots, or a program to simulate: '
    f'{", ".join(program_names())}'
)
START, CORRELATION, NONE = 'start', 'correlation', 'none'


def _how(text: str) -> str:
    return CORRELATION if text == 'best' else text  # former name


@dataclass
class WindowOptions(JsonOptions):
    """Options of a command that shows a time window of a recording."""

    from_s: float | None = option(
        'start of the window [s]: bus time from the start of the (first) program, or of the bus without a program',
        'S',
        names=('--from',),
        type=TIME,
    )
    to_s: float | None = option('end of the window [s], like --from', 'S', names=('--to',), type=TIME)

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.from_s is None or self.to_s is None or self.from_s < self.to_s:
            return ''
        return f'--from is {self.from_s:g}, but must be less than --to, {self.to_s:g}'


@dataclass
class RunOptions(WindowOptions):
    """Options of a command about runs."""

    inputs: list[str] = argument(RUN, nargs='+', metavar='RUN')
    parameters: str | None = option(
        'parameter file, or packaged name such as built, for programs and for recordings without parameters; or one '
        'per run, separated by commas, empty for the default',
        'FILE[,FILE...]',
    )
    align: str = option(
        'align runs by the start of their programs, if recorded, or by the best correlation of their motion; none: '
        'keep their times',
        type=_how,
        choices=(START, CORRELATION, NONE),
        default=START,
    )
    columns: str | None = option(
        'column file that maps the columns of a table to signals, needed if its headings do not; or one per run, '
        'separated by commas, empty if not needed',
        'FILE[,FILE...]',
    )

    def __post_init__(self) -> None:
        """Replace a folder of several robots by the bags in it."""
        from delta3_pacdrive.studies.runs.inputs import bags_in

        self.inputs = [run for text in self.inputs for run in bags_in(text)]

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if rejection := super().check():
            return rejection
        for name, given in (('--parameters', self.parameters), ('--columns', self.columns)):
            count = len((given or '').split(','))
            if count > 1 and count != len(self.inputs):
                runs = 'is 1 run' if len(self.inputs) == 1 else f'are {len(self.inputs)} runs'
                return f'{name} names {count} files, but there {runs}'
        return ''

    def _each(self, given: str | None) -> list[str | None]:
        """Return the file of each run; a single file applies to all."""
        named = (given or '').split(',')
        return [one or None for one in (named if len(named) > 1 else named * len(self.inputs))]

    def sources(self) -> list[str | None]:
        """Return the parameter file of each run, None for the packaged one."""
        return self._each(self.parameters)

    def column_files(self) -> list[str | None]:
        """Return the column file of each run; a single file applies to all tables."""
        from delta3_pacdrive.studies.runs.inputs import is_table

        named = self._each(self.columns)
        if ',' in (self.columns or '') or not any(map(is_table, self.inputs)):
            return named
        return [one if is_table(text) else None for one, text in zip(named, self.inputs, strict=True)]

    def runs(self) -> list[Any]:
        """Load the runs; raises Delta3Error."""
        from delta3_pacdrive.studies.runs import runs
        from delta3_pacdrive.studies.runs.inputs import is_recording

        sources = self.sources()
        for text, source in zip(self.inputs, sources, strict=True):
            if not is_recording(text):
                announce_compilation(source)
        loaded = [
            runs.load(text, source, self.from_s, self.to_s, columns)
            for text, source, columns in zip(self.inputs, sources, self.column_files(), strict=True)
        ]
        # a single parameter file applies to the runs without parameters
        each = ',' in (self.parameters or '')
        if each or all(run.contains_robot for run in loaded):
            for run, source in zip(loaded, sources, strict=True):
                require_no_own_parameters(run, source)
        return loaded


def require_no_own_parameters(run: Any, source: str | None) -> None:
    """Raise ParameterError if a parameter file is given for a recording that contains its parameters."""
    if source and run.contains_robot:
        raise ParameterError(f'--parameters is {source}, but {run.name} contains the parameters of its robot')

"""What the commands share that show or compare runs: which runs, of which robots, and which part of them."""

from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cli.command import JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import TIME
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.configuration.packaged import program_names
from delta3_pacdrive.errors import ParameterError

RUN = f'trace (.npz, .csv), rosbag2 folder, or a program that is simulated: {", ".join(program_names())}'
START, BEST = 'start', 'best'


@dataclass
class WindowOptions(JsonOptions):
    """Options of a command that shows a part of what was recorded."""

    from_s: float | None = option(
        'begin here: bus time [s] from the start of the (first) program, or of the bus if there is none',
        'S',
        names=('--from',),
        type=TIME,
    )
    to_s: float | None = option('end here, as --from', 'S', names=('--to',), type=TIME)

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if self.from_s is None or self.to_s is None or self.from_s < self.to_s:
            return ''
        return f'--from is {self.from_s:g}, but must be less than --to, {self.to_s:g}'


@dataclass
class RunOptions(WindowOptions):
    """Options of a command about runs."""

    inputs: list[str] = argument(RUN, nargs='+', metavar='RUN')
    parameters: str | None = option(
        'parameter file for programs, and for recordings that do not tell theirs, or rich: the built robot; several, '
        'with commas between them: one for each run, nothing for the packaged file',
        'FILE[,FILE...]',
    )
    align: str = option(
        'bring runs to one time by the start of their programs, where they tell it, or by the best correlation of '
        'their motor speeds',
        choices=(START, BEST),
        default=START,
    )

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if refusal := super().check():
            return refusal
        count = len((self.parameters or '').split(','))
        if count > 1 and count != len(self.inputs):
            runs = 'is 1 run' if len(self.inputs) == 1 else f'are {len(self.inputs)} runs'
            return f'--parameters names {count} files, but there {runs}'
        return ''

    def sources(self) -> list[str | None]:
        """Return the parameter file of each run, None for the packaged one."""
        named = (self.parameters or '').split(',')
        return [one or None for one in (named if len(named) > 1 else named * len(self.inputs))]

    def runs(self) -> list[Any]:
        """Load the runs; raises Delta3Error."""
        from delta3_pacdrive.analysis import runs
        from delta3_pacdrive.analysis.inputs import is_recording

        sources = self.sources()
        for text, source in zip(self.inputs, sources, strict=True):
            if not is_recording(text):
                announce_compilation(source)
        loaded = [
            runs.load(text, source, self.from_s, self.to_s)
            for text, source in zip(self.inputs, sources, strict=True)
        ]
        # one file is for those that need one
        each = ',' in (self.parameters or '')
        if each or all(run.tells_robot for run in loaded):
            for run, source in zip(loaded, sources, strict=True):
                require_obeyed(run, source)
        return loaded


def require_obeyed(run: Any, source: str | None) -> None:
    """Refuse a parameter file for a recording that tells its own parameters; raises ParameterError."""
    if source and run.tells_robot:
        raise ParameterError(
            f'--parameters is {source}, but {run.name} tells the parameters of its robot itself'
        )

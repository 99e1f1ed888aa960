"""``delta3 export``: export the robot model or the signals of a recording for other tools."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import PARAMETERS, Command, argument, flag, option
from delta3_pacdrive.cli.option_types import integer_within, signal_names
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.run_options import WindowOptions

TRACE = 'trace'
MODELS = {
    'urdf': 'kinematic tree with passive joints, for robot_state_publisher, RViz, Foxglove ...',
    'mjcf': 'closed chain with the dynamics of the plant, for MuJoCo',
}
FORMATS = MODELS | {TRACE: 'signals of a trace or bag as .csv, .parquet or .npz (suffix of --output)'}
EVERY_MAX = 1_000_000


@dataclass
class Options(WindowOptions):
    """Options of the command."""

    format: str = argument('urdf, mjcf or trace', choices=tuple(FORMATS), metavar='FORMAT')
    recording: str | None = argument(
        'for trace: trace (.npz), table (.csv, .parquet, .mat) or bag (folder, .mcap, .db3)',
        default=None,
        metavar='RECORDING',
    )
    output: str | None = option('output file (default for models: standard output)', 'FILE')
    parameters: str | None = option(PARAMETERS, 'FILE', only=tuple(MODELS))
    signals: list[str] | None = option(
        "signals to export, such as current,tcp_error,'drive_*', or all: everything available (default: the recorded "
        'signals and those derived from them by default)',
        'NAMES',
        type=signal_names,
        only=(TRACE,),
    )
    every: int = option(
        'export every n-th bus cycle, counted from the start of the program',
        'N',
        default=1,
        type=integer_within(1, EVERY_MAX),
        only=(TRACE,),
    )
    overwrite: bool = flag('replace an existing file', only=(TRACE,))

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.format == TRACE:
            if self.recording is None or self.output is None:
                return 'trace requires a RECORDING and --output FILE'
        else:
            unused = [one for one in self.given() if one in ('--from', '--to', '--json')]
            if self.recording is not None or unused:
                return f'{unused[0] if unused else "a recording"} applies to {TRACE}, not to {self.format}'
        return self.rejection(self.format) or super().check()


def run(options: Options) -> Output:
    """Run the command; return its result."""
    return _trace(options) if options.format == TRACE else _model(options)


def _model(options: Options) -> Output:
    from delta3_pacdrive import parameters
    from delta3_pacdrive.scene.mjcf import mjcf
    from delta3_pacdrive.scene.urdf import urdf
    from delta3_pacdrive.studies.framework.provenance import write_text

    robot = parameters.load(options.parameters)
    text = urdf(robot) if options.format == 'urdf' else mjcf(robot)
    if options.output is None:
        return Output(text=[text.removesuffix('\n')])
    write_text(text, Path(options.output))
    return Output()


def _trace(options: Options) -> Output:
    from delta3_pacdrive.errors import TraceError
    from delta3_pacdrive.recording import trace_file as files
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.runs import trace_export
    from delta3_pacdrive.studies.runs.inputs import with_digests
    from delta3_pacdrive.studies.runs.runs import notes_of

    name, output = str(options.recording), Path(str(options.output))
    files.require_writable_trace(output)
    if output.exists() and not options.overwrite:
        raise TraceError(f'{output} exists already: --overwrite replaces it')
    if options.signals:
        trace_export.require_known(options.signals)
    trace = files.load(name)
    notes = notes_of(trace)
    origin = Provenance.of(options.command_line, inputs=with_digests([name]))
    trace = trace_export.completed(trace, options.signals)
    trace = trace_export.chosen(trace, options.signals, name)
    trace = trace_export.thinned(trace_export.part(trace, options.from_s, options.to_s), options.every)
    trace.meta['exported'] = origin.lines()
    files.save(trace, output)
    result = {
        'ok': True,
        'file': str(output),
        'rows': len(trace.time_s),
        'signals': list(trace.signals),
        'notes': list(notes),
        'provenance': origin.lines(),
    }
    text = f'{output}: {len(trace.time_s)} rows of {", ".join(trace.signals)}'
    return Output(result, [text], notes=[f'note: {note}' for note in notes])


main = Command(
    'export',
    'Export the robot as a model (lengths, masses, limits and shapes from its parameters), or the signals of a '
    'recording.',
    Options,
    run,
    FORMATS,
)

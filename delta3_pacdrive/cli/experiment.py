"""``delta3 experiment``: experiments 1 to 3 of the thesis, which compare the model with a robot."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option, settings_of
from delta3_pacdrive.cli.option_types import SEED, integer_within, number_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    number: int = argument('number of the experiment', type=int, choices=(1, 2, 3))
    parameters: str | None = option('parameter file of the model (default: the packaged one)', 'FILE')
    robot: str = option('parameter file of the robot', 'FILE', default='rich')
    seed: int | None = option("seed of the robot's sensor noise instead of that in its file", type=SEED)
    seeds: int = option(
        'number of further noise seeds for the range of each verdict',
        'N',
        default=8,
        type=integer_within(0, 1000),
    )
    no_attribution: bool = flag('do not attribute the difference to effects')
    graph: bool = flag('run both robots as ROS nodes and record bags into the folder')
    real_time_factor: float = option(
        'with --graph: bus time divided by wall time',
        'F',
        default=0.0,
        needs='--graph',
        type=number_within(0.0, 1000.0),
    )
    output: str | None = option('folder of the report (default: experiment_N)', 'DIR')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.cli import experiment_graph
    from delta3_pacdrive.studies.thesis.experiments import report, run, study

    settings = settings_of(study.Settings, options, attributed=not options.no_attribution)
    folder = Path(options.output or f'experiment_{options.number}').absolute()
    graph = None
    if options.graph:
        experiment_graph.require_no_bags(run.FILES, folder)
        graph = experiment_graph.Graph(folder, options.real_time_factor)
    return run_study(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show, graph),
        report.text,
        folder,
    )


main = Command(
    'experiment',
    'Run the program of an experiment on the model of the thesis and on a robot with the effects that the thesis '
    'neglects. Write all signals, figures 11.1 to 11.24, maxima, rms values and deviations, and the share of each '
    'effect.',
    Options,
    run,
)

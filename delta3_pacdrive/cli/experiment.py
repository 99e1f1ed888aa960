"""``delta3 experiment``: experiments 1 to 3 of the thesis, a model held against a robot, and what sets them apart."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option
from delta3_pacdrive.cli.option_types import SEED, integer_within, number_within
from delta3_pacdrive.cli.studies import run_study


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    number: int = argument('which experiment', type=int, choices=(1, 2, 3))
    parameters: str | None = option('parameter file of the model instead of the packaged one', 'FILE')
    robot: str = option('parameter file of the robot', 'FILE', default='rich')
    seed: int | None = option("of the robot's sensor noise, instead of the one in its file", type=SEED)
    seeds: int = option(
        'further seeds of the sensor noise, over which each verdict gets its range; 0: none',
        'N',
        default=8,
        type=integer_within(0, 1000),
    )
    no_attribution: bool = flag('do not look for what explains the difference')
    graph: bool = flag('run both as ROS nodes, recorded into bags in the folder')
    real_time_factor: float = option(
        'of --graph: bus time over wall time', 'F', default=0.0, type=number_within(0.0, 1000.0)
    )
    output: str | None = option('folder of the report; experiment_N if not given', 'DIR')

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if self.real_time_factor and not self.graph:
            return '--real-time-factor is for --graph: without nodes there is no clock'
        return ''


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.experiments import report, run, study
    from delta3_pacdrive.cli import experiment_graph

    settings = study.Settings(
        options.number,
        options.parameters,
        options.robot,
        options.seed,
        not options.no_attribution,
        options.seeds,
    )
    folder = Path(options.output or f'experiment_{options.number}').absolute()
    graph = None
    if options.graph:
        experiment_graph.refuse_existing(run.FILES, folder)
        graph = experiment_graph.Graph(folder, options.real_time_factor)
    return run_study(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show, graph).run(),
        report.text,
        writes=folder,
    )


main = Command(
    'experiment',
    'Run the program of an experiment on a model, the plain robot of the thesis, and on a robot with what the thesis '
    'leaves out; write every signal, figures 11.1 to 11.24, maxima, rms and deviations, and which effect explains how '
    'much of them.',
    Options,
    run,
)

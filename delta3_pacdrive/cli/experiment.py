"""``delta3 experiment``: experiments 1 to 3 of the thesis, a model held against a robot, and what sets them apart."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.cli.option_types import SEED, number_within
from delta3_pacdrive.cli.output import guarded, parser_for
from delta3_pacdrive.cli.studies import conduct

if TYPE_CHECKING:
    from collections.abc import Sequence

EXPERIMENTS = (1, 2, 3)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _experiment(options), options.json)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for(
        'experiment',
        'Run the program of an experiment on a model, the plain robot of the thesis, and on a robot with what the '
        'thesis leaves out; write every signal, figures 11.1 to 11.24, maxima, rms and deviations, and which effect '
        'explains how much of them.',
    )
    parser.add_argument('number', type=int, choices=EXPERIMENTS, help='which experiment')
    parser.add_argument(
        '--parameters', metavar='FILE', help='parameter file of the model instead of the packaged one'
    )
    parser.add_argument('--robot', metavar='FILE', default='rich', help='parameter file of the robot')
    parser.add_argument(
        '--seed', type=SEED, help="of the robot's sensor noise, instead of the one in its file"
    )
    parser.add_argument(
        '--no-attribution', action='store_true', help='do not look for what explains the difference'
    )
    parser.add_argument(
        '--graph', action='store_true', help='run both as ROS nodes, recorded into bags in the folder'
    )
    parser.add_argument(
        '--real-time-factor',
        type=number_within(0.0, 1000.0),
        default=0.0,
        metavar='F',
        help='of --graph: bus time over wall time',
    )
    parser.add_argument('--output', metavar='DIR', help='folder of the report; experiment_N if not given')
    parser.add_argument('--json', action='store_true', help='print the report as JSON')
    options = parser.parse_args(arguments)
    if options.real_time_factor and not options.graph:
        parser.error('--real-time-factor is for --graph: without nodes there is no clock')
    return options


def _experiment(options: argparse.Namespace) -> int:
    from delta3_pacdrive.analysis.experiments import report, run, study
    from delta3_pacdrive.cli import experiment_graph

    settings = study.Settings(
        options.number, options.parameters, options.robot, options.seed, not options.no_attribution
    )
    folder = Path(options.output or f'experiment_{options.number}').absolute()
    graph = None
    if options.graph:
        experiment_graph.refuse_existing(run.FILES, folder)
        graph = experiment_graph.Graph(folder, options.real_time_factor)
    return conduct(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show, graph).run(),
        report.text,
    )


if __name__ == '__main__':
    sys.exit(main())

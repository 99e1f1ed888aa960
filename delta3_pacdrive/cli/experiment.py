"""``delta3 experiment``: experiments 1 to 3 of the thesis, a model held against a robot, and what sets them apart."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.option_types import SEED, number_within
from delta3_pacdrive.cli.output import INTERRUPTED, announce_compilation, guarded, parser_for
from delta3_pacdrive.cli.progress import Progress

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
    progress = Progress(quiet=options.json)
    try:
        with progress:
            document = _run(options, progress)
    except KeyboardInterrupt:
        print('interrupted: no report was written', file=sys.stderr)
        return INTERRUPTED
    print(json.dumps(document)) if options.json else _print(document)
    return 0


def _run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis.experiments import report
    from delta3_pacdrive.analysis.experiments.attribution import attribute
    from delta3_pacdrive.analysis.experiments.comparison import Comparison, Run
    from delta3_pacdrive.analysis.provenance import digest
    from delta3_pacdrive.cli import experiment_graph
    from delta3_pacdrive.motion import program as programs
    from delta3_pacdrive.recording.trace import Trace

    robots = {'model': core.load(options.parameters), 'robot': core.load(options.robot)}
    notes = []
    if options.seed is not None:
        robots['robot'] = robots['robot'].replace(rich__sensor_seed=options.seed)
        if not robots['robot'].rich.effects.sensors:
            notes.append('the robot has no sensor noise, so --seed changes nothing')
    model, robot = robots.values()
    # a folder of that name in the working directory is not meant
    path = core.config_directory() / 'programs' / f'experiment{options.number}.yaml'
    program = programs.load(path, model.motion)
    folder = Path(options.output or f'experiment_{options.number}').absolute()
    names = (options.parameters or core.DEFAULT_FILE, options.robot)
    provenance = report.provenance_of(
        options.command_line, model, robot, names, [f'{path.stem} {digest(path)}']
    )
    if options.graph:
        experiment_graph.refuse_existing(robots, folder)
    announce_compilation()
    simulation.load_kernels(model)
    report.clear(options.number, folder)
    files = dict(zip(robots, report.write_parameters(model, robot, folder), strict=True))
    progress.show('simulation', 0, 0)
    simulated = {who: simulation.run(program, parameters) for who, parameters in robots.items()}
    comparison = Comparison.of(*(Run.of(simulated[who], robots[who]) for who in robots))
    if options.graph:
        recorded, more = experiment_graph.record(path, files, folder, options.real_time_factor, progress.show)
        notes += more
        notes += [f'{who}: {experiment_graph.same_as(recorded[who], simulated[who])}' for who in robots]
        # a recorder ends without knowing when the program ended
        ends = {who: {'end_cycle': trace.meta['end_cycle']} for who, trace in simulated.items()}
        traces = {who: Trace(t.time_s, t.signals, t.meta | ends[who]) for who, t in recorded.items()}
        comparison = Comparison.of(*(Run.of(traces[who], robots[who]) for who in robots))
    attribution = None
    if not options.no_attribution:
        attribution = attribute(
            program,
            Run.of(simulated['model'], model),
            model,
            robot,
            lambda done, total: progress.show(f'effects, {total} simulations', done, total),
        )
    progress.show('tables and figures', 0, 0)
    return report.write(options.number, program.name, comparison, attribution, notes, folder, provenance)


def _print(document: dict[str, Any]) -> None:
    print(document['program'])
    columns = ('model max', 'rms', 'robot max', 'rms', 'apart max', 'rms', '% of peak')
    print(f'{"":>42} {"":>8}' + ''.join(f'{column:>11}' for column in columns))
    for row in document['signals']:
        if row['column'] not in ('', 'all'):
            continue
        keys = ('model_max', 'model_rms', 'robot_max', 'robot_rms', 'deviation_max', 'deviation_rms')
        values = [row[key] for key in (*keys, 'deviation_max_percent')]
        numbers = ''.join(f'{"" if value is None else format(value, ".4g"):>11}' for value in values)
        print(f'{row["text"]:>42} {row["unit"]:>8}{numbers}')
    print(f'\nWhat the thesis found is {document["verdict"]}.')
    sentences = [finding['sentence'] for finding in document['findings']]
    sentences += [document['truth']] if document['truth'] else []
    print('\n'.join(f'- {sentence}' for sentence in sentences))
    if document['attribution'] is not None:
        print('\nWhat explains it (Shapley values; of a deviation shares of its mean square):')
        print('\n'.join(f'- {sentence}' for sentence in document['attribution']['explanations']))
    print()
    for note in document['notes']:
        print(f'note: {note}')
    print('\n'.join(document['files']))


if __name__ == '__main__':
    sys.exit(main())

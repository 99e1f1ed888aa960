"""``delta3 bench``: figures of the robot, each beside what it is measured against. Never a test."""

import argparse
import sys
from collections.abc import Sequence

from delta3_pacdrive.benchmarks import graph
from delta3_pacdrive.cli.output import guarded, parser_for, print_json


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = parser_for(
        'bench',
        'Measure the graph (timing, processor time, memory), planning, or the speed of simulation and kinematics.',
    )
    parser.add_argument('what', choices=['graph', 'motion', 'simulate', 'kinematics'])
    parser.add_argument(
        '--seconds', type=float, metavar='S', help='bus time of motion per case [s]; 60 unless told'
    )
    parser.add_argument(
        '--case', choices=graph.CASES, action='append', help='only this case of graph (may be repeated)'
    )
    parser.add_argument(
        '--scheduling',
        choices=graph.SCHEDULINGS,
        action='append',
        help='only this column of graph (may be repeated)',
    )
    parser.add_argument('--no-graph', action='store_true', help='motion: only what needs no running robot')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    options = parser.parse_args(arguments)
    if options.what == 'kinematics' and options.seconds is not None:
        parser.error('--seconds is for graph, motion and simulate, not for kinematics')
    options.seconds = 60.0 if options.seconds is None else options.seconds
    if not 1.0 <= options.seconds <= 3600.0:
        parser.error(f'--seconds is {options.seconds}, but must be between 1 and 3600')
    for name in ('case', 'scheduling'):
        if getattr(options, name) and options.what != 'graph':
            parser.error(f'--{name} is for graph, not for {options.what}')
    if options.no_graph and options.what != 'motion':
        parser.error(f'--no-graph is for motion, not for {options.what}')
    return guarded(lambda: _run(options), options.json)


def _run(options: argparse.Namespace) -> int:
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.benchmarks import motion, simulation

    measure, show = {
        'graph': (graph.measure, graph.show),
        'motion': (motion.measure, motion.show),
        'simulate': (simulation.measure_simulation, simulation.show_simulation),
        'kinematics': (simulation.measure_kinematics, simulation.show_kinematics),
    }[options.what]
    result = measure(options)
    if options.json:
        print_json(result, options, core.load())
    else:
        show(result)
    return 0


if __name__ == '__main__':
    sys.exit(main())

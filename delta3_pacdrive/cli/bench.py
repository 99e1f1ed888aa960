"""``delta3 bench``: benchmarks of graph, planner, simulation and studies."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.benchmarks import graph, network, robots
from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.output import Output, with_provenance
from delta3_pacdrive.cli.progress import Progress
from delta3_pacdrive.cli.up import ROBOTS_MAX

Text = Callable[[Any], Iterable[str]]
SECONDS, NETWORK_SECONDS = 60.0, 4.0
KINDS = (
    'graph', 'robots', 'motion', 'simulate', 'kinematics', 'estimation', 'control', 'cell', 'sweep', 'network',
    'shaping', 'steering', 'timing',
)  # fmt: skip


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    what: str = argument('kind of benchmark', choices=KINDS)
    seconds: float | None = option(
        f'bus time of motion per case [s] (default: {SECONDS:g}; cell: 12; network: 4)',
        'S',
        type=float,
        only=('graph', 'robots', 'motion', 'simulate', 'cell', 'network'),
    )
    case: list[str] | None = option(
        'graph: only this case; repeatable', choices=graph.CASES, action='append', only=('graph',)
    )
    scheduling: list[str] | None = option(
        'graph: only this column; repeatable',
        choices=graph.SCHEDULINGS,
        action='append',
        only=('graph',),
    )
    view: bool = flag('graph: compare without and with a watched web page', only=('graph',))
    scope: bool = flag('graph: compare without and with an oscilloscope in the drives', only=('graph',))
    robots: int | None = option(
        'robots: number of robots in real time (default: 2)',
        'N',
        type=integer_within(1, ROBOTS_MAX),
        only=('robots',),
    )
    no_graph: bool = flag('motion: skip the cases that need a running robot', only=('motion',))
    seeds: int | None = option(
        'estimation: number of noise seeds (default: 200)', 'N', type=int, only=('estimation',)
    )
    link: list[str] | None = option(
        'network: only this link; repeatable',
        'LINK',
        choices=tuple(network.CASES),
        action='append',
        only=('network',),
    )
    runs: int | None = option(
        'sweep: number of runs with one and with two workers (default: 300)', 'N', type=int, only=('sweep',)
    )
    moves: int | None = option(
        'shaping: number of random moves (default: 100)',
        'N',
        type=integer_within(1, 100_000),
        only=('shaping',),
    )
    streams: int | None = option(
        'steering: number of random streams (default: 1000)',
        'N',
        type=integer_within(1, 10_000_000),
        only=('steering',),
    )
    output: str | None = option(
        'cell, steering: folder for table and figures', 'DIR', only=('cell', 'steering')
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if rejection := self.rejection(self.what):
            return rejection
        if self.seconds is not None and not 1.0 <= self.seconds <= 3600.0:
            return f'--seconds is {self.seconds}, but must be between 1 and 3600'
        if self.seeds is not None and not 2 <= self.seeds <= 10_000:
            return f'--seeds is {self.seeds}, but must be between 2 and 10000'
        if self.runs is not None and not 20 <= self.runs <= 1_000_000:
            return f'--runs is {self.runs}, but must be between 20 and 1000000'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core

    text, result = _measured(options, SECONDS if options.seconds is None else options.seconds)
    return Output(with_provenance(result, options, core.load()), text(result))


def _measured(options: Options, seconds: float) -> tuple[Text, dict[str, Any]]:
    """Return the function that converts the result to lines of text, and the result.

    Heavy modules are imported late: they would disturb the measurement of the graph.
    """
    if options.what == 'graph':
        beside = {graph.BESIDE_PAGE: options.view, graph.BESIDE_SCOPE: options.scope}
        cases = options.case or tuple(
            dict.fromkeys(case for cases, yes in beside.items() if yes for case in cases)
        )
        return graph.text, graph.measure(seconds, cases, options.scheduling, options.json)
    if options.what == 'robots':
        return robots.text, robots.measure(seconds, options.robots, options.json)
    if options.what == 'cell':
        return _cell(options)
    if options.what == 'steering':
        return _steering(options)
    from delta3_pacdrive.benchmarks import control, estimation, motion, shaping, simulation, sweep, timing

    if options.what == 'estimation':
        return estimation.text, estimation.measure(options.seeds or estimation.SEEDS)
    if options.what == 'motion':
        return motion.text, motion.measure(None if options.no_graph else seconds)
    if options.what == 'simulate':
        return simulation.simulation_text, simulation.measure_simulation(seconds)
    if options.what == 'kinematics':
        return simulation.kinematics_text, simulation.measure_kinematics()
    with Progress() as progress:
        if options.what == 'network':
            own_s = options.seconds or NETWORK_SECONDS
            return network.text, network.measure(options.link, own_s, progress.show)
        if options.what == 'sweep':
            return sweep.text, sweep.measure(options.runs or sweep.RUNS, progress.show)
        if options.what == 'shaping':
            return shaping.text, shaping.measure(options.moves or shaping.MOVES, show=progress.show)
        if options.what == 'timing':
            return timing.text, timing.measure(show=progress.show)
        return control.text, control.measure(show=progress.show)


def _cell(options: Options) -> tuple[Text, dict[str, Any]]:
    from delta3_pacdrive.benchmarks import belts as belt_bench
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder

    require_writable_folder(options.output)
    with Progress() as progress:
        result = belt_bench.measure(seconds=options.seconds or belt_bench.SECONDS, show=progress.show)
    tables, drawings = [belt_bench.table(result)], belt_bench.drawings(result)
    return belt_bench.text, _reported(
        options, 'Picking from a belt', belt_bench.text, result, (tables, drawings)
    )


def _steering(options: Options) -> tuple[Text, dict[str, Any]]:
    from delta3_pacdrive.benchmarks import steering
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder

    require_writable_folder(options.output)
    with Progress() as progress:
        result = steering.measure(options.streams or steering.STREAMS, progress.show)
    parts = [steering.table(result)], steering.drawings(result)
    return steering.text, _reported(options, 'Steering on line', steering.text, result, parts)


def _reported(
    options: Options, title: str, text: Text, result: dict[str, Any], parts: tuple[Any, Any]
) -> dict[str, Any]:
    """Write the report if requested, with tables and drawings; return the result."""
    from pathlib import Path

    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import ReportFolder

    if options.output is None:
        return result
    tables, drawings = parts
    folder = ReportFolder(Path(options.output), Provenance.of(options.command_line))
    return folder.results(title, result, text(result), tables, drawings)


main = Command(
    'bench',
    'Measure the graph (timing, processor time, memory), several robots on one machine, planning, the speed of '
    'simulation and kinematics, the coverage of confidence intervals of estimates, the packaging cycle with each '
    'controller, the residual vibration with each input shaper, picking from a belt, steering on line, TCP errors with '
    'each timing of the bus, sweeps with one and two workers, or a robot with its drives on another host.',
    Options,
    run,
)

"""``delta3 faults``: run the fault catalogue, or inject one fault into a running robot."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option
from delta3_pacdrive.cli.option_types import CSV, folder
from delta3_pacdrive.cli.output import INTERRUPTED, Output, answered, with_provenance
from delta3_pacdrive.cli.progress import Progress, announce_compilation
from delta3_pacdrive.errors import RunError

if TYPE_CHECKING:
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.verification.fault_catalogue.cases import Case
    from delta3_pacdrive.verification.fault_catalogue.cell_cases import CellCase

ACTIONS = {
    'run': 'test every fault in every state on a separate robot without a clock, and the faults of simulated cells',
    'list': 'list the kinds of faults and their values',
    'inject': "inject one fault, in YAML, into a running robot: '{fault: drop_at, axis: axis2}'",
}
WIDTHS = (31, 16, 7, 8, 14, 9, 9)
HEADINGS = ('fault', 'state', 'bus', 'wall', 'reaction', 'TCP', 'recovered')


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    action: str = argument('one of the actions below', default='run', choices=ACTIONS, metavar='ACTION')
    fault: str = argument('fault to inject', default='', type=str)
    short: bool = flag('run: only a few faults in various states, without cells', only=('run',))
    only: str | None = option('run: only cases that contain this text', 'TEXT', only=('run',))
    csv: str | None = option('run: write the table to this file', 'FILE', type=CSV, only=('run',))
    logs: Path | None = option(
        'run: keep the logs of the processes in this folder', 'DIR', type=folder, only=('run',)
    )
    parameters: str | None = option(
        'run: parameter file of the robot, or model: with feed-forward of the model torque',
        'FILE',
        only=('run',),
    )
    namespace: str = option('inject: ROS namespace of the robot', default='/', only=('inject',))

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if (self.action == 'inject') != bool(self.fault):
            return 'inject requires a fault' if self.action == 'inject' else 'only inject takes a fault'
        return self.rejection(self.action)


def _list(_: Options) -> Output:
    from delta3_pacdrive.robot.faults.fault import KINDS

    return Output({name: vars(kind) for name, kind in KINDS.items()}, itertools.starmap(_kind, KINDS.items()))


def _kind(name: str, kind: Any) -> str:
    value = f'{kind.value} {kind.low:g} to {kind.high:g}' if kind.value else ''
    lasts = 'cycles' if kind.telegram else '' if kind.once else 'for_s'
    return f'{name:<16} {kind.text:<40} {kind.target or "robot":<6} {lasts:<7} {value}'


def _inject(options: Options) -> Output:
    from delta3_pacdrive.ros.clients.robot_client import operating

    with operating(options.namespace) as operator:
        return answered(operator.inject(options.fault))


def columns(cells: Sequence[str]) -> str:
    """Return a line of the table."""
    texts = [f'{cell:<{width}}' for cell, width in zip(cells, WIDTHS, strict=True)]
    return ' '.join(texts).rstrip()


def line_of(row: dict[str, Any]) -> str:
    """Return the line of a case, with a second one if the result is unexpected."""
    found, silent, recovered = row['detected_s'], row['silent_s'], row['recovered_s']
    cells = (
        row['case'],
        row['state'],
        '' if found is None else f'{found * 1e3:.0f} ms',
        '' if silent is None else f'{silent:.1f} s',
        f'{row["reaction"]}{" *" if row["exercised"] else ""}',
        f'{row["deviation_m"] * 1e3:.2f} mm',
        'never' if recovered is None else f'{recovered:.1f} s',
    )
    text = columns(cells)
    if row['ok']:
        return text
    seen = row['reported'] or row['evidence'] or 'no effect'
    what = row['problem'] or f'{seen}, expected: {row["expected"] or "goes on"}'
    return f'{text}\n    NOT AS EXPECTED: {what}'


def _chosen(options: Options, robot: 'Parameters') -> 'tuple[list[Case], list[CellCase]]':
    """Return the selected cases of a robot and of simulated cells; raises RunError."""
    from delta3_pacdrive.parameters import ARMS
    from delta3_pacdrive.verification.fault_catalogue import cell_runner as of_cells
    from delta3_pacdrive.verification.fault_catalogue.cases import cases

    only = options.only or ''
    in_cells = [] if options.short else of_cells.cases(only)
    try:
        found = cases(
            options.short,
            only,
            robot.axes[ARMS:],
            supplied=robot.supply.enabled,
            warms=robot.thermal.in_drives,
        )
        return found, in_cells
    except RunError:
        if not in_cells:
            raise
        return [], in_cells


def _run_catalogue(options: Options) -> Output:
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.framework.provenance import Provenance, write_table
    from delta3_pacdrive.verification.fault_catalogue import cell_runner as of_cells
    from delta3_pacdrive.verification.fault_catalogue.cases import Outcome
    from delta3_pacdrive.verification.fault_catalogue.runner import run_catalogue

    robot = core.load(options.parameters)
    todo, in_cells = _chosen(options, robot)
    count = len(todo) + len(in_cells)
    announce_compilation(options.parameters)
    if not options.json:
        print(columns(HEADINGS), flush=True)
    outcomes: list[Outcome] = []
    rows: list[dict[str, Any]] = []

    ended = ''
    try:
        # without a thread: the runner forks processes
        with Progress(quiet=not options.json, threaded=False) as progress:

            def show(outcome: Outcome | of_cells.CellOutcome) -> None:
                rows.append(outcome.to_row())
                if not options.json:
                    print(line_of(rows[-1]), flush=True)
                progress.show(f'{len(rows)} of {count} cases', len(rows), count)

            path = Path(options.parameters) if options.parameters else None
            if todo:
                run_catalogue(todo, options.logs, outcomes, show, path)
            for case in in_cells:
                show(of_cells.run_case(case, of_cells.robot_of(options.parameters)))
    except KeyboardInterrupt:
        ended = 'interrupted'
    except RunError as error:
        ended = str(error)
    bad = [row for row in rows if not row['ok']]
    if options.csv and rows:
        origin = Provenance.of(options.command_line, robot)
        write_table(Path(options.csv), list(rows[0]), (list(row.values()) for row in rows), origin)
    message, status = '', int(bool(bad))
    if ended:
        message = f'error: {ended}: the table is incomplete'
        status = INTERRUPTED if ended == 'interrupted' else 1
    elif bad and not options.json:
        message = f'error: {len(bad)} of {len(rows)} cases had unexpected results'
    result = {'ok': not bad and not ended, 'ended': ended, 'cases': rows}
    text = f'{len(rows)} of {count} cases, {len(rows) - len(bad)} as expected; * in the exercise'
    return Output(with_provenance(result, options, robot), [text], status, message=message)


def run(options: Options) -> Output:
    """Run the command; return its result."""
    return {'run': _run_catalogue, 'list': _list, 'inject': _inject}[options.action](options)


main = Command('faults', 'Inject faults and report the reactions of the robot.', Options, run, ACTIONS)

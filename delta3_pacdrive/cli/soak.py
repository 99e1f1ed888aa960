"""``delta3 soak``: run random programs with random faults and check invariants."""

import json
import signal
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from delta3_pacdrive.bringup import child
from delta3_pacdrive.cli.command import Command, JsonOptions, option
from delta3_pacdrive.cli.output import INTERRUPTED, Output, with_provenance
from delta3_pacdrive.cli.progress import Progress, announce_compilation
from delta3_pacdrive.errors import RunError

PACES = {'fast': 0.0, 'real-time': 1.0}  # real-time factor of the bus


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    minutes: float = option('total duration [min]', 'N', default=10.0, type=float)
    seed: int = option('seed of programs and faults', default=1, type=int)
    pace: str | None = option('run only without a clock, or only in real time (default: both)', choices=PACES)
    replay: int | None = option('run only program N of the sequence of a seed and a pace', 'N', type=int)

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if not 0.0 < self.minutes <= 1e5:
            return f'--minutes is {self.minutes:g}, but must be between 0 and 100000'
        if self.replay is not None and (self.replay < 1 or not self.pace):
            return '--replay takes the number of a program, from 1, and requires --pace'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core

    rows: dict[str, dict[str, Any]] = {}
    interrupted = False
    for pace in [options.pace] if options.pace else list(PACES):
        rows[pace] = _soak(options, pace) if options.pace else _in_a_process(options, pace)
        interrupted = rows[pace].pop('interrupted')
        if interrupted:
            break
    ok = all(row['ok'] for row in rows.values()) and not interrupted
    complaint = '' if ok or interrupted else _complaint(options, rows)
    result: dict[str, Any] = {
        'ok': ok,
        'interrupted': interrupted,
        'seed': options.seed,
        'minutes': options.minutes,
    }
    if complaint:
        result['error'] = complaint
    message = 'interrupted: partial figures' if interrupted else ''
    if complaint and not options.json:
        message = f'error: {complaint}'
    return Output(
        with_provenance(result | rows, options, core.load(), seed=options.seed),
        [line for pace, row in rows.items() for line in _text(pace, row)],
        INTERRUPTED if interrupted else int(not ok),
        message=message,
    )


def _complaint(options: Options, rows: dict[str, dict[str, Any]]) -> str:
    for pace, row in rows.items():
        if row['refused'] and not row['programs']:
            which = f'program {options.replay}' if options.replay else f'all {row["refused"]} programs'
            return f'{pace}: the planner rejected {which}: {row["refusal"]}'
        if not row['programs']:
            return f'{pace}: no program was completed within {options.minutes:g} minutes'
    if any(row['violations'] for row in rows.values()):
        return 'the soak found violations'
    for pace, row in rows.items():
        if not row['watched']:
            return f'{pace}: {row["unseen"]} of {row["cycles"]} bus cycles were not monitored: this machine is too slow'
    lacking = [(pace, row['injected'] - row['survived']) for pace, row in rows.items()]
    return '; '.join(f'{pace}: {count} faults were not survived' for pace, count in lacking if count)


def _in_a_process(options: Options, pace: str) -> dict[str, Any]:
    """Run one pace in a separate process: a bring-up forks, which is not safe in a process that has used ROS."""
    minutes, seed = str(options.minutes / len(PACES)), str(options.seed)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with child.start('soak', '--pace', pace, '--minutes', minutes, '--seed', seed, '--json') as process:
        try:
            output, _ = process.communicate()
        except KeyboardInterrupt:
            output = child.end(process)
    result = json.loads(output.splitlines()[-1]) if output else {}
    if pace not in result:
        raise RunError(result.get('error', f'the soak {pace} ended with status {process.returncode}'))
    row: dict[str, Any] = result[pace]
    return row | {'interrupted': result['interrupted']}


def _soak(options: Options, pace: str) -> dict[str, Any]:
    from delta3_pacdrive.verification.soak.runner import Figures, run_soak

    announce_compilation()
    figures = Figures()
    interrupted = False
    # without a thread: the runner forks processes
    with Progress(threaded=False) as progress:

        def show(now: Figures) -> None:
            text = f'{pace}: {now.programs} programs, {now.injected} faults, {now.cycles} cycles'
            progress.show(f'{text}, {len(now.violations)} violations')

        try:
            run_soak(
                60.0 * options.minutes,
                options.seed,
                pace,
                PACES[pace],
                figures=figures,
                show=show,
                replay=options.replay,
            )
        except KeyboardInterrupt:
            interrupted = True
    return asdict(figures) | {'watched': figures.watched, 'ok': figures.ok, 'interrupted': interrupted}


def _text(name: str, row: dict[str, Any]) -> Iterator[str]:
    slope, half = row['growth_mb'], row['growth_half_width_mb']
    grows = (
        'too few programs to estimate the growth of private memory'
        if slope is None
        else f'private memory grows by {slope:.2f} +- {half:.2f} MB in 100,000 cycles'
    )
    kinds = ', '.join(f'{kind} {count}' for kind, count in sorted(row['kinds'].items()))
    yield f"""{name}:
    {row['programs']} programs in {row['cycles']} cycles, {row['refused']} rejected by the planner; {row['unseen']} \
cycles not monitored
    {row['injected']} faults injected, {row['survived']} survived; {row['stopped']} programs stopped by them
    {row['undisturbed']} undisturbed programs: true TCP within {row['error_max_m'] * 1e3:.3f} mm of the command, \
ends within {row['end_max_m'] * 1e3:.4f} mm
    {row['lost_at']} AT lost of at most {row['lost_at_injected']} injected, \
{row['lost_mdt']} MDT of {row['lost_mdt_injected']}
    RSS of the surviving processes: {row['rss_start_mb']:.1f} MB, \
{row['rss_cycles']} cycles later {row['rss_end_mb']:.1f} MB; {grows}
    {kinds or 'no faults'}"""
    for violation in row['violations']:
        if not violation['number']:
            yield f'    VIOLATED by bus cycle {violation["cycle"]}: {violation["sentence"]}'
            continue
        program = violation['program'].rstrip('\n').replace('\n', '\n        ')
        yield f"""    VIOLATED in bus cycle {violation['cycle']}: {violation['sentence']}
        program {violation['number']}: delta3 soak --seed {violation['seed']} --pace {violation['pace']} \
--replay {violation['number']}
        {program}"""


main = Command(
    'soak',
    'Run random programs with random faults, half of the time without a clock and half in real time, and check '
    'invariants.',
    Options,
    run,
)

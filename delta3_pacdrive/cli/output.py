"""Output of the commands: one-line errors, results as text or JSON."""

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext, redirect_stdout, suppress
from dataclasses import asdict, dataclass
from typing import Any

from delta3_pacdrive import interrupts
from delta3_pacdrive.errors import Delta3Error, RunInterruptedError, loading_failure
from delta3_pacdrive.numerics.units import millimetres

NAME_WIDTH = 14  # of the names in front of lines of text
WRONG_MAX = 5  # listed parts with a problem
INTERRUPTED = 130  # exit status after Ctrl-C


def fail(error: Delta3Error, as_json: bool = False) -> int:
    """Print an error in one line, with ``as_json`` also as JSON on standard output; return the exit status."""
    text = ' '.join(str(error).split())
    try:
        print(f'error: {text}', file=sys.stderr)
        if as_json:
            print(json.dumps({'ok': False, 'error': text}))
        sys.stdout.flush()
    except OSError:  # the reader has gone; the exit status remains
        discard_output()
    return 1


def stdout_reserved(as_json: bool) -> AbstractContextManager[Any]:
    """Return a context in which other output goes to standard error, if the command prints JSON."""
    return redirect_stdout(sys.stderr) if as_json else nullcontext()


def discard_output() -> None:
    """Redirect standard output to the null device, so that the flush at interpreter exit cannot fail."""
    with suppress(OSError):  # a stream without a file descriptor, as in tests
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def run_and_report(action: Callable[[], int], as_json: bool = False) -> int:
    """Run a command; report errors of this package and of the operating system in one line with exit status 1.

    Ctrl-C, SIGTERM and SIGHUP give the status 130, 143 or 129.
    """
    interrupts.answer_as_json(as_json)
    try:
        status = action()
        sys.stdout.flush()
    except Exception as error:
        sentence = _sentence(error)
        if sentence is None and not interrupts.asked():
            raise
        interrupts.ignore()
        if isinstance(error, BrokenPipeError):
            discard_output()
            return _status(1)
        if sentence is None:  # an interrupt that third-party code turned into another exception
            sentence = interrupts.sentence(interrupts.asked())
        status = fail(Delta3Error(sentence), as_json)
        return _status(INTERRUPTED if _is_interrupt(error) else status)
    except KeyboardInterrupt as error:
        interrupts.ignore()
        fail(Delta3Error(str(error) or 'interrupted'), as_json)
        return _status(INTERRUPTED)
    return _status(status)


def _is_interrupt(error: Exception) -> bool:
    # rclpy raises its own exception if it handled the signal; rclpy is not imported here
    return isinstance(error, RunInterruptedError) or type(error).__name__ == 'ExternalShutdownException'


def _status(status: int) -> int:
    """Return the exit status, or that of the signal that ended the command."""
    return interrupts.status(interrupts.asked()) if status and interrupts.asked() else status


def _sentence(error: Exception) -> str | None:
    """Return the message of an expected error; None for a bug."""
    if isinstance(error, Delta3Error):
        return str(error)
    if _is_interrupt(error):
        return str(error) or 'interrupted'
    if isinstance(error, MemoryError):
        return 'not enough memory'
    if isinstance(error, ImportError) and 'map segment' in str(error):
        return f'not enough memory: {error}'
    if isinstance(error, OSError):
        try:
            os.getcwd()
        except FileNotFoundError:
            return 'the working directory no longer exists'
        place = f' {error.filename}' if error.filename else ''
        return f'cannot read or write{place}: {error.strerror}' if error.strerror else str(error)
    if isinstance(error, UnicodeError):
        return f'invalid UTF-8 in a name or text: {error}'
    return loading_failure(error)


@dataclass(frozen=True)
class Output:
    """Result of a command. A command that prints while it runs only returns its status."""

    document: Any = None  # for --json: the document, or a function that returns it; None: nothing to print
    text: Iterable[str] = ()  # the same as lines; each is printed when a generator yields it
    status: int = 0  # exit status
    notes: Sequence[str] = ()  # lines on standard error before the text, not with --json
    message: str = ''  # line on standard error after the result


def json_text(document: Any) -> str:
    """Return a document as standard JSON, which has no NaN and no infinity: both become null."""
    try:
        return json.dumps(document, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(document), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_output(output: Output, as_json: bool) -> int:
    """Print the result of a command as text or JSON; return the exit status."""
    if as_json:
        document = output.document() if callable(output.document) else output.document
        if document is not None:
            print(json_text(document))
    else:
        for note in output.notes:
            print(note, file=sys.stderr)
        for line in output.text:
            print(line)
    if output.message:
        print(output.message, file=sys.stderr)
    return output.status


def with_provenance(
    result: dict[str, Any],
    options: Any,
    robot: Any = None,
    inputs: Sequence[str] = (),
    seed: int | None = None,
) -> Callable[[], dict[str, Any]]:
    """Return a function that returns a result with its provenance, which takes time to compute."""

    def document() -> dict[str, Any]:
        from delta3_pacdrive.studies.framework.provenance import Provenance

        source = getattr(options, 'parameters', None)
        origin = Provenance.of(options.command_line, robot, source, inputs, seed)
        return result | {'provenance': origin.lines()}

    return document


def output_of_run(
    result: dict[str, Any],
    options: Any,
    robot: Any,
    inputs: Sequence[str],
    ready: str = '',
    notes: Sequence[str] = (),
) -> Output:
    """Return the output of a run with its notes."""
    result = result | {'controller': robot.controller} | currents_used(result, robot)
    text = [f'{result["program"]}: done{ready}', *figures_text(result), *notes]
    return Output(with_provenance(result, options, robot, inputs), text)


def answered(sentence: str) -> Output:
    """Return the output of a request to a robot, with its reply."""
    return Output({'ok': True, 'answer': sentence}, [sentence])


def currents_used(result: dict[str, Any], robot: Any) -> dict[str, Any]:
    """Return the current limits of the motors [A], the share that a run used, and a warning for each exceeded one."""
    from delta3_pacdrive.parameters import numbered
    from delta3_pacdrive.planning.rotating_move import axis_text
    from delta3_pacdrive.robot.motor import thermal_warnings

    used: dict[str, Any] = {
        'warnings': thermal_warnings(result['current_rms_a'], robot.motor.nominal_current_a)
    }
    if 'temperature' in result:
        from delta3_pacdrive.planning.limits.temperature import Temperatures

        used['warnings'] += Temperatures(**result['temperature']).warnings()
    if 'gears' in result:
        from delta3_pacdrive.planning.limits.gear_load import GearFigures

        used['warnings'] += GearFigures(**result['gears']).warnings(robot.gear)
        used['gear_limits'] = asdict(robot.gear)
    for name, limit in (('peak', robot.motor.peak_current_a), ('rms', robot.motor.nominal_current_a)):
        currents = result[f'current_{name}_a']
        used[f'current_{name}_limit_a'] = limit
        used[f'current_{name}_used'] = [None if one is None else one / limit for one in currents]
    for number, rotary in enumerate(robot.rotary_axes):
        if (rms := result.get(numbered('turn_current_rms_a', number))) is not None:
            motor = f'the motor of {axis_text(robot, number)}'
            used['warnings'] += thermal_warnings([rms], rotary.nominal_current_a, [motor])
            used[numbered('turn_current_peak_limit_a', number)] = rotary.peak_current_a
            used[numbered('turn_current_rms_limit_a', number)] = rotary.nominal_current_a
    return used


def _amperes(of_axes: Sequence[float | None], limit: float | None = None, name: str = '') -> str:
    from delta3_pacdrive.robot.motor import share_text

    share = '' if limit is None else f', {share_text(of_axes, limit, name)}'
    return ' / '.join('-' if value is None else f'{value:.2f}' for value in of_axes) + f' A{share}'


def parts_rows(cell: dict[str, Any]) -> list[tuple[str, str]]:
    """Return rows with the counts of parts by outcome and the first few problems."""
    counts = cell['outcomes']
    others = [f'{counts[name]} {name}' for name in counts if counts[name] and name != 'waiting']
    rows = [('parts', ', '.join([f'{cell["picked"]} picked', *others, f'{cell["missed"]} missed']))]
    if cell['place_error_max_m'] is not None:
        most, rms = 1e3 * cell['place_error_max_m'], 1e3 * cell['place_error_rms_m']
        rows.append(('place error', f'{most:.3f} mm max, {rms:.3f} mm rms'))
    if cell['hold_use_max'] is not None:
        rows.append(('cup', f'{100.0 * cell["hold_use_max"]:.0f} % of its force at most'))
    wrong = [
        f'part {part["number"]} ({part["type"]}), {part["outcome"]}: {part["reason"]}'
        for part in cell['parts']
        if part['reason']
    ]
    wrong += [f'missed in bus cycle {miss["closed_cycle"]}: {miss["reason"]}' for miss in cell['misses']]
    rows += [('part', sentence) for sentence in wrong[:WRONG_MAX]]
    if len(wrong) > WRONG_MAX:
        rows.append(('part', f'and {len(wrong) - WRONG_MAX} more; --json lists all'))
    return rows


def figures_text(result: dict[str, Any]) -> list[str]:
    """Return the figures of a run as lines of text."""
    from delta3_pacdrive.parameters import ROTARY_AXES_MAX
    from delta3_pacdrive.studies.framework.columns import named_lines

    factor = result['bus_time_s'] / result['wall_time_s']
    rows = [
        ('bus time', f'{result["bus_time_s"]:.3f} s in {result["cycles"]} cycles'),
        ('wall time', f'{result["wall_time_s"]:.3f} s ({factor:.2f} x real time)'),
        *([('controller', result['controller'])] if 'controller' in result else ()),
        *_measured_rows(result),
    ]
    for number in range(ROTARY_AXES_MAX):
        rows += _rotary_rows(result, number)
    if result.get('repeat', 1) > 1:
        rounds = 60.0 * result['repeat'] / result['program_s']
        rows.append(('rounds', f'{result["repeat"]} in {result["program_s"]:.3f} s: {rounds:.1f} per minute'))
    if 'temperature' in result:
        from delta3_pacdrive.planning.limits.temperature import Temperatures

        rows.append(('temperature', Temperatures(**result['temperature']).text))
    if 'energy' in result:
        from delta3_pacdrive.planning.limits.energy import Energy

        rows.append(('energy', Energy(**result['energy']).text(result.get('repeat', 1))))
    if 'supply' in result:
        from delta3_pacdrive.planning.limits.supply import SupplyLoad
        from delta3_pacdrive.studies.runs.run_supply import EnergyBalance

        rows += SupplyLoad(**result['supply']['load']).rows()
        rows.append(('balance', EnergyBalance(**result['supply']['balance']).text))
    if 'gears' in result:
        from delta3_pacdrive.parameters import Gear
        from delta3_pacdrive.planning.limits.gear_load import GearFigures

        lines = GearFigures(**result['gears']).lines(Gear(**result['gear_limits']))
        rows += zip(('gears', ''), lines, strict=True)
    if 'from_exact' in result:
        apart = result['from_exact']
        rows.append(
            (
                'from exact',
                f'TCP {1e3 * apart["tcp_max_m"]:.4f} mm max, {1e3 * apart["tcp_rms_m"]:.4f} mm rms, current '
                f'{apart["current_max_a"]:.4f} A max, d {apart["coupling_torque_max_n_m"]:.4f} N m max: deviation of '
                'decoupled from coupled arms',
            )
        )
    if 'cell' in result:
        rows += parts_rows(result['cell'])
    rows += [('note', notice) for notice in result.get('notices', ())]
    rows += [('warning', warning) for warning in result.get('warnings', ())]
    if 'overruns' in result:
        rows.append(('bus', f'{result["overruns"]} overruns, {result["lost_telegrams"]} lost AT'))
    return named_lines(rows, NAME_WIDTH)


def _measured_rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of the TCP and of the currents, which are measured while moves are executed."""
    if not result.get('measured_cycles', 1):
        return [('TCP', 'errors and currents are measured during moves, and none was executed')]
    error_max, error_rms = (1e3 * result[name] for name in ('tcp_error_max_m', 'tcp_error_rms_m'))
    return [
        ('TCP error', f'{error_max:.3f} mm max, {error_rms:.3f} mm rms'),
        ('final TCP', millimetres(result['final_tcp_m'])),
        ('current peak', _amperes(result['current_peak_a'], result.get('current_peak_limit_a'), 'peak')),
        ('current rms', _amperes(result['current_rms_a'], result.get('current_rms_limit_a'), 'nominal')),
        ('peak in the AT', _amperes(result['at_current_peak_a'])),
        ('rms in the AT', _amperes(result['at_current_rms_a'])),
    ]


def _rotary_rows(result: dict[str, Any], number: int) -> list[tuple[str, str]]:
    """Return the rows of a rotary axis; empty if the run has no results of it."""
    from delta3_pacdrive.parameters import numbered

    def found(name: str) -> Any:
        return result.get(numbered(f'turn_{name}', number))

    if found('error_max_rad') is None:
        return []
    encoder, moving = (math.degrees(found(f'{name}error_max_rad')) for name in ('encoder_place_', ''))
    at_end = f'{encoder:.4f} deg by its encoder'
    if (true := found('place_error_max_rad')) is not None:  # the true angle is known in simulation only
        at_end = f'{math.degrees(true):.4f} deg, {at_end}'
    peak, rms = (
        _amperes([found(f'current_{name}_a')], found(f'current_{name}_limit_a'), limit)
        for name, limit in (('peak', 'peak'), ('rms', 'nominal'))
    )
    tool = numbered('tool', number, ' ')
    return [
        (tool, f'error max at move ends {at_end}; during motion {moving:.4f} deg'),
        (f'{tool} current', f'peak {peak}; rms in the AT {rms}'),
    ]

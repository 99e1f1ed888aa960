"""``delta3 tune``: step and frequency responses of a drive's loops, margins, and what gains do to a program."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.option_types import NOISE, SEED, trace_file
from delta3_pacdrive.cli.output import (
    INTERRUPTED,
    add_parameter_options,
    announce_compilation,
    finite_number,
    guarded,
    parser_for,
)
from delta3_pacdrive.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _tune(options), options.json)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for(
        'tune',
        'Step and frequency responses of the current, velocity and position loop with their margins: of the real drive '
        'code on a bench, of its linear difference equations and of a recording; what other gains change, up to the '
        'following error of a program.',
    )
    add_parameter_options(parser)
    parser.add_argument(
        '--pose',
        nargs=3,
        type=finite_number,
        metavar=('X', 'Y', 'Z'),
        help='TCP whose load is moved [m]; home, if not given',
    )
    parser.add_argument(
        '--payload', type=finite_number, metavar='KG', help='carried instead of what the parameters say'
    )
    parser.add_argument(
        '--axis', type=int, choices=(1, 2, 3), default=1, help='whose load, and whose recording'
    )
    parser.add_argument(
        '--speed', type=finite_number, default=10.0, metavar='RAD_S',
        help='at which the bench turns, motor side; 0 shows the friction of standstill',
    )  # fmt: skip
    parser.add_argument(
        '--amplitude', type=finite_number, default=1.0, metavar='X', help='multiple of the usual excitations'
    )
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME=VALUE', dest='changes',
        help='compare with this gain, feed-forward or filter; name of the group drive, symbol (K_Ppos) or IDN '
        '(S-0-0104); repeatable',
    )  # fmt: skip
    parser.add_argument(
        '--sweep', metavar='NAME=LOW:HIGH:N', help='draw margins and errors over N values of a gain'
    )
    parser.add_argument(
        '--program', default='experiment1', metavar='PROGRAM', help='whose following error is compared'
    )
    parser.add_argument(
        '--recording', metavar='FILE', help='trace (.npz, .csv) or folder of a bag to evaluate as well'
    )
    parser.add_argument(
        '--excite',
        type=trace_file,
        metavar='FILE',
        help='excite one axis of the simulated robot and write the trace of it instead',
    )
    parser.add_argument(
        '--place', choices=('current', 'position'), default='current', help='set point that --excite adds to'
    )
    parser.add_argument(
        '--noise', type=NOISE, default=0.0, metavar='X', help='sensor noise of --excite, 1: typical'
    )
    parser.add_argument('--seed', type=SEED, default=0, help='of the noise')
    parser.add_argument('--output', metavar='FOLDER', default='tuning', help='for report, tables, figures')
    options = parser.parse_args(arguments)
    if options.excite and (options.recording or options.changes or options.sweep):
        parser.error('--excite only writes a recording: it takes no --recording, --set or --sweep')
    if options.excite and options.exchange_period is not None:
        parser.error('--excite exchanges as often as the drives compute: it takes no --exchange-period')
    if not options.excite and (options.place != 'current' or options.noise or options.seed):
        parser.error('--place, --noise and --seed are for --excite')
    return options


def _tune(options: argparse.Namespace) -> int:
    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis.tuning.run import Study, robot_of
    from delta3_pacdrive.analysis.tuning.study import Settings

    settings = Settings(
        options.parameters,
        tuple(options.pose) if options.pose else None,
        options.payload,
        options.axis,
        options.speed,
        options.amplitude,
        tuple(options.changes),
        options.sweep,
        options.program,
        options.recording,
        options.exchange_period,
    )
    announce_compilation()
    simulation.load_kernels(robot_of(settings))
    try:
        with Progress(quiet=options.json) as progress:
            if options.excite:
                result = _excite(options, settings, progress)
            else:
                result = Study(settings, Path(options.output), options.command_line, progress.show).run()
    except KeyboardInterrupt:
        print('interrupted: no report was written', file=sys.stderr)
        return INTERRUPTED
    if options.json:
        print(json.dumps(result))
    elif options.excite:
        print(f'{options.excite}: {result["samples"]} samples of {1e6 * result["sample_time_s"]:g} us')
    else:
        _print(result)
    return 0


def _excite(options: argparse.Namespace, settings: Any, progress: Progress) -> dict[str, Any]:
    from delta3_pacdrive.analysis.estimation import measurement
    from delta3_pacdrive.analysis.tuning.bench import Place
    from delta3_pacdrive.analysis.tuning.oscilloscope import SPEED_SHARE, Excitation, record
    from delta3_pacdrive.analysis.tuning.run import robot_of
    from delta3_pacdrive.errors import TraceError
    from delta3_pacdrive.recording import bag_trace

    folder = Path(options.excite).parent
    if not folder.is_dir():
        raise TraceError(f'cannot write trace {options.excite}: there is no folder {folder}')
    robot = robot_of(settings)
    excitation = Excitation(
        Place.PLANT if options.place == 'current' else Place.POSITION,
        settings.axis - 1,
        settings.pose_m or robot.motion.home_m,
        SPEED_SHARE * settings.speed_rad_s,
        settings.amplitude,
    )
    trace = record(robot, excitation, lambda done, total: progress.show('excitation', done, total))
    trace = measurement.with_noise(trace, robot, options.noise, options.seed)
    progress.show('writing', 0, 0)
    bag_trace.save(trace, options.excite)
    return {
        'ok': True,
        'file': options.excite,
        'samples': len(trace.time_s),
        'sample_time_s': trace.meta['sample_time_s'],
        'signals': sorted(trace.signals),
    }


def _print(document: dict[str, Any]) -> None:
    load = document['load']
    print(
        f'{load["name"]}: {1e4 * load["inertia_kg_m2"]:.3f}e-4 kg m2 and {load["gravity_n_m"]:.3f} N m at the shaft, '
        f'which turns at {document["speed_rad_s"]:g} rad/s'
    )
    for change in document['changes']:
        print(f'{change["parameter"]}: {change["before"]:g} before, {change["after"]:g} after')
    _print_loops(document['variants'])
    _print_workspace(document['variants'])
    _print_effect(document)
    for one in document['recorded']:
        band, near = one['trusted_hz'], one['agreement']
        told = 'no frequency is trustworthy' if band is None else (
            f'{band[0]:.3g} to {band[1]:.4g} Hz trustworthy, '
            f'within {near["decibels"]:.2f} dB and {near["degrees"]:.1f} deg of the linear one'
        )  # fmt: skip
        if one['margins'] is not None:
            margins = [one['margins'][key] for key in ('phase_margin_deg', 'gain_margin_db')]
            told += f'; margins {_cell(margins[0], "{:.1f} deg")} and {_cell(margins[1], "{:.1f} dB")}'
        print(f'recorded, axis {one["axis"]}, {one["title"]}: {told}')
    if document['sweep']:
        _print_sweep(document['sweep'])
    print('\n'.join(document['files']))


def _print_loops(variants: dict[str, Any]) -> None:
    print(
        '\n  loop      gains   crossover  phase m.  gain m.  delay m.    Ms  bandwidth     rise  overshoot  settling'
    )
    for loop in next(iter(variants.values()))['loops']:
        for name, variant in variants.items():
            row = variant['loops'][loop]
            step = row.get('step') or {}
            step = {key: _scaled(value, 100.0 if key == 'overshoot' else 1e3) for key, value in step.items()}
            cells = [
                _cell(row['crossover_hz'], '{:8.4g} Hz'), _cell(row['phase_margin_deg'], '{:6.1f} deg'),
                _cell(row['gain_margin_db'], '{:5.1f} dB'), _cell(_scaled(row['delay_margin_s'], 1e3), '{:6.2f} ms'),
                _cell(row['sensitivity_peak'], '{:5.2f}'), _cell(row['bandwidth_hz'], '{:7.4g} Hz'),
                _cell(step.get('rise_time_s'), '{:6.2f} ms'), _cell(step.get('overshoot'), '{:7.1f} %'),
                _cell(step.get('settling_time_s'), '{:6.1f} ms'),
            ]  # fmt: skip
            state = '' if row['stable'] else '  UNSTABLE'
            print(f'  {loop:<9} {name:<7} {"  ".join(cells)}{state}')
            if 'fault' in row:
                print(f'  {"":<9} {name:<7} on the bench: {row["fault"]}')
    for name, variant in variants.items():
        for sentence in variant['instability']:
            print(f'  {name}: {sentence}')
        near = [loop['agreement'] for loop in variant['loops'].values() if loop.get('agreement')]
        if near:
            distance = (max(a[unit] for a in near) for unit in ('decibels', 'degrees'))
            told = '{:.2f} dB and {:.1f} deg'.format(*distance)
            print(f'  drive on the bench against linear loops, {name}: within {told} where it is trustworthy')


def _print_workspace(variants: dict[str, Any]) -> None:
    period = 1e3 * next(iter(variants.values()))['exchange_period_s']
    print(
        f'\n  inertia at shaft  gains    velocity loop: crossover, phase m., gain m.  position  '
        f'cascade: Ms  gain m. exchanged every {period:g} ms'
    )
    for name, variant in variants.items():
        for row in variant['workspace']:
            speed, position, cascade = (row[key] for key in ('velocity', 'position', 'cascade'))
            exchanged = row['exchanged']
            told = _cell(exchanged['gain_margin_db'], '{:5.1f} dB') if exchanged['stable'] else 'UNSTABLE'
            cells = [
                _cell(speed['crossover_hz'], '{:13.4g} Hz'), _cell(speed['phase_margin_deg'], '{:7.1f} deg'),
                _cell(speed['gain_margin_db'], '{:5.1f} dB'), _cell(position['phase_margin_deg'], '{:8.1f} deg'),
                _cell(cascade['sensitivity_peak'], '{:8.2f}'), f'{told:>11}',
            ]  # fmt: skip
            print(
                f'  {1e4 * row["inertia_kg_m2"]:6.2f}e-4 kg m2   {name:<7}{"  ".join(cells)}  {row["load"]}'
            )


def _print_effect(document: dict[str, Any]) -> None:
    print(f'\n  {document["program"]}')
    for name, variant in document['variants'].items():
        effect = variant['effect']
        if effect['following_error_max_rad'] is None:
            print(f'  {name:<7} stops: {effect["fault"]}')
            continue
        print(
            f'  {name:<7} following error {1e3 * math.degrees(effect["following_error_max_rad"]):.2f}e-3 deg max, '
            f'{1e3 * math.degrees(effect["following_error_rms_rad"]):.2f}e-3 deg rms; TCP error '
            f'{1e6 * effect["tcp_error_max_m"]:.1f} um max, {1e6 * effect["tcp_error_rms_m"]:.1f} um rms; '
            f'current {effect["current_peak_a"]:.2f} A max{"; " + effect["fault"] if effect["fault"] else ""}'
        )


def _print_sweep(points: list[dict[str, Any]]) -> None:
    print(
        '\n  value       phase margin: current, velocity, position   overshoot: velocity, position   following error'
    )
    for point in points:
        loops = point['loops']
        margins = '  '.join(_cell(loop['phase_margin_deg'], '{:6.1f} deg') for loop in loops.values())
        over = '  '.join(
            _cell(_scaled(point['overshoot'][n], 100.0), '{:6.1f} %') for n in ('velocity', 'position')
        )
        error = point['effect']['following_error_max_rad']
        told = point['effect']['fault'] if error is None else f'{1e3 * math.degrees(error):.2f}e-3 deg'
        state = '' if point['workspace_stable'] else '  unstable in the workspace'
        if not all(loop['stable'] for loop in loops.values()):
            state = '  UNSTABLE'
        print(f'  {point["value"]:<10.5g}  {margins}   {over}   {told}{state}')


def _cell(value: float | None, form: str) -> str:
    """Return a number in its form, or a dash in its place."""
    return form.format(value) if value is not None else '-'.rjust(len(form.format(0.0)))


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


if __name__ == '__main__':
    sys.exit(main())

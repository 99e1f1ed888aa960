"""Data of a page as one JSON object: packed signals, moves, marks, plots and the robot.

Times are in seconds from the start of the program, or bus time without a program; later runs are shifted to the time of
the first one. ``signals`` of a run are packed by ``columns``, one row per bus cycle from ``first_s`` on, every
``period_s``. ``differences`` are later runs minus the first one, in its cycles. ``cell`` contains the surroundings of
the robot in the first run (see ``around``), ``records`` those of oscilloscopes (see ``scopes``); both are optional.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.record_file import SavedRecord
from delta3_pacdrive.scene import parts, tool_bar
from delta3_pacdrive.scene.poses import frames
from delta3_pacdrive.studies.report_page import scopes
from delta3_pacdrive.studies.report_page.packed_columns import packed, resolution_of
from delta3_pacdrive.studies.report_page.plots import APART, PLOTS, is_shown, others, quantity
from delta3_pacdrive.studies.report_page.surroundings import surroundings
from delta3_pacdrive.studies.runs.run_comparison import Comparison, subtracted
from delta3_pacdrive.studies.runs.runs import Run, named

VERSION = 1


def report_document(
    title: str,
    runs: Sequence[Run],
    comparisons: Sequence[Comparison],
    coarser: float = 1.0,
    records: Sequence[SavedRecord] = (),
) -> dict[str, Any]:
    """Return the document of a page; ``coarser`` scales the resolution of all signals.

    ``comparisons`` are those of the later runs with the first one; ``records`` have the time of the first run.
    """
    clocked = [
        comparison.alignment.clocked(run) for run, comparison in zip(runs[1:], comparisons, strict=True)
    ]
    runs = [runs[0], *clocked]
    held = [signals_of(run) for run in runs]
    shifts = [0.0, *(comparison.alignment.shift_s for comparison in comparisons)]
    every = list(dict.fromkeys(name for signals in held for name in signals))
    shown = [plot.document(every) for plot in (*PLOTS, *others(every))]
    cell = surroundings(runs[0])
    found: dict[str, Any] = {
        'version': VERSION,
        'title': title,
        'time': 'time from program start' if runs[0].knows_start else 'bus time',
        'runs': [
            _run(name, run, signals, shift, coarser)
            for name, run, signals, shift in zip(named(runs), runs, held, shifts, strict=True)
        ],
        'differences': [
            _differences(runs[0], run, (held[0], signals), comparison, coarser)
            for run, signals, comparison in zip(runs[1:], held[1:], comparisons, strict=True)
        ],
        'plots': [plot for plot in shown if plot is not None],
    }
    if cell is not None:
        found['cell'] = cell
    if records:
        found['records'] = scopes.document(records, coarser)
        found['runs'][0]['marks'] += scopes.marks(records)
    return found


def signals_of(run: Run) -> dict[str, Floats]:
    """Return the signals that a page shows, including computed ones, each of shape (cycles, columns)."""
    found = {name: values for name, values in run.window.signals.items() if is_shown(name)}
    if 'tcp_velocity' in run.window.signals:
        found['tcp_speed'] = np.linalg.norm(run.window['tcp_velocity'], axis=1, keepdims=True)
    if 'tcp_acceleration' in run.window.signals:
        found['tcp_acceleration_norm'] = np.linalg.norm(run.window['tcp_acceleration'], axis=1, keepdims=True)
    for name, columns in APART.items():
        if name in run.window.signals:
            for n, column in enumerate(columns):
                found[f'{name}_{column}'] = run.window[name][:, n : n + 1]
    if 'tcp_error' in found:
        found['tcp_error_norm'] = np.linalg.norm(found['tcp_error'], axis=1, keepdims=True)
    return found


def _run(
    name: str, run: Run, signals: Mapping[str, Floats], shift_s: float, coarser: float
) -> dict[str, Any]:
    return {
        'name': name,
        'title': run.title,
        'kind': run.kind,
        'first_s': float(run.window.time_s[0]) + shift_s,
        'period_s': run.period_s,
        'cycles': len(run.window.time_s),
        'shift_s': shift_s,
        'gear_ratio': run.robot.dynamics.gear_ratio,
        'payload_kg': run.robot.dynamics.payload_mass_kg,
        'payloads': [
            [float(row['time_s']) + shift_s, row['payload_kg']]
            for row in run.outputs
            if row.get('payload_kg') is not None
        ],
        'robot': _robot(run),
        'moves': [
            [move.number, move.kind, move.start_s + shift_s, move.end_s + shift_s] for move in run.moves
        ],
        'marks': [[mark.time_s + shift_s, mark.kind, mark.text] for mark in run.marks],
        'signals': _packed(signals, run, coarser),
    }


def _robot(run: Run) -> dict[str, Any]:
    """Return the parts of the robot and their joints, from which the page computes poses."""
    robot = run.robot
    carried = [row['payload_kg'] for row in run.outputs if row.get('payload_kg') is not None]
    payload = max([robot.dynamics.payload_mass_kg, *carried])
    hips, joints = frames(robot)
    return (
        parts.document(robot, payload)
        | {
            'azimuths': list(robot.kinematics.arm_azimuth_rad),
            'hips': hips.tolist(),
            'joints': joints.tolist(),
            'arms': list(robot.kinematics.upper_arm_lengths_m),
        }
        | dict(zip(['bar_top'], _bar_tops_m(robot), strict=False))
    )


def _bar_tops_m(robot: Parameters) -> list[float]:
    """Return the height of the end of each bar of rotary axes above the TCP [m]."""
    tool_height_m = parts.Sizes.of(robot.kinematics).tool_height_m
    return [tool_bar.top_m(tool_height_m) for _ in tool_bar.bars(robot)]


def _differences(
    first: Run,
    second: Run,
    signals: tuple[Mapping[str, Floats], Mapping[str, Floats]],
    comparison: Comparison,
    coarser: float,
) -> dict[str, Any]:
    """Return the differences of the signals of two runs in those cycles of the first one that both have."""
    time_s = comparison.time_s
    found = subtracted(first, second, *signals, time_s=time_s, alignment=comparison.alignment)
    return {
        'first_s': float(time_s[0]),
        'period_s': first.period_s,
        'cycles': len(time_s),
        'signals': _packed(found, first, coarser),
    }


def _packed(signals: Mapping[str, Floats], run: Run, coarser: float) -> dict[str, Any]:
    grid = run.robot.bus.increments_per_rev
    return {
        name: packed(values, coarser * resolution_of(name, quantity(name)[0], grid))
        for name, values in signals.items()
    }

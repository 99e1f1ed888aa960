"""Signals of simulated runs: the virtual master, the following error, a stop by a fault, both robots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import delta3_pacdrive as d3
from delta3_pacdrive.studies.drives.ripple import figures, run
from delta3_pacdrive.studies.drives.ripple.study import Results
from delta3_pacdrive.studies.framework.figure_style import AXIS_COLOURS, NORM_COLOUR, dress, empty_figure
from delta3_pacdrive.studies.framework.study import silent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delta3_pacdrive.numerics.types import Floats

MM = 1e3
NAMES = ('axis 1', 'axis 2', 'axis 3')


def panels(heights: tuple[float, ...], height_in: float) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels above each other that share their time axis."""
    figure = empty_figure(height_in)
    axes = list(figure.subplots(len(heights), sharex=True, height_ratios=heights, squeeze=False)[:, 0])
    for one in axes:
        dress(one)
    return figure, axes


def program_time(trace: d3.Trace) -> Floats:
    """Return the time from the start of the program [s]."""
    return trace.time_s - trace.time_s[trace.meta['start_cycle']]


def draw_current(axes: Axes, trace: d3.Trace, axis: int, **style: Any) -> None:
    """Draw the current of a motor as the band of all samples of each bus cycle."""
    low, high = (trace[f'current_{name}'][:, axis] for name in ('min', 'max'))
    axes.fill_between(program_time(trace), low, high, linewidth=0.8, **style)


def speed_profile() -> Figure:
    """Draw distance, speed, acceleration and jerk of the virtual master on one straight line."""
    limits = {'speed_m_s': 1.0, 'acceleration_m_s2': 12.0, 'jerk_m_s3': 300.0}
    document = {
        'start_m': [-0.15, 0.0, -0.8],
        'limits': limits,
        'moves': [{'move_l': {'to_m': [0.15, 0.0, -0.8]}}],
    }
    robot = d3.load_parameters()
    trace = d3.simulate(d3.load_program(document, robot), robot)
    time_s, period_s = program_time(trace), trace.meta['cycle_time_s']
    distance = trace['tcp_command'][:, 0] - trace['tcp_command'][0, 0]
    rows = [distance]
    for _ in range(3):
        rows.append(np.gradient(rows[-1], period_s))
    figure, axes = panels((1, 1, 1, 1), 6.0)
    labels = ('distance s [m]', 'speed [m/s]', 'acceleration [m/s²]', 'jerk [m/s³]')
    for one, values, label, limit in zip(axes, rows, labels, (None, *limits.values()), strict=True):
        one.plot(time_s, values, color=AXIS_COLOURS[0], linewidth=1.6)
        one.set_ylabel(label, fontsize=9)
        for bound in () if limit is None else (limit, -limit)[: 1 if 'speed' in label else 2]:
            one.axhline(bound, color='#888888', linewidth=0.9, linestyle=(0, (4, 3)))
    axes[0].set_title('MoveL over 0.3 m: the virtual master within its limits (dashed)', fontsize=11)
    axes[-1].set(
        xlabel='time from the start of the program [s]', xlim=(-0.02, trace.meta['program_s'] + 0.03)
    )
    return figure


def following_error() -> Figure:
    """Draw the TCP error as it is at one instant, and without the dead time; then the following error of each axis."""
    trace = d3.simulate('experiment3')
    time_s = program_time(trace)
    raw = MM * np.linalg.norm(trace['tcp_command'] - trace['tcp_actual'], axis=1)
    aligned = MM * np.linalg.norm(trace['tcp_error'], axis=1)
    figure, (top, middle, bottom) = panels((1, 1, 1), 5.6)
    top.plot(time_s, raw, color='#888888', linewidth=1.6)
    top.set_ylabel('command - actual\n[mm]', fontsize=9)
    middle.plot(time_s, aligned, color=NORM_COLOUR, linewidth=1.6)
    middle.set_ylabel('dead time removed\n[mm]', fontsize=9)
    for n, name in enumerate(NAMES):
        following = np.degrees(trace['following_error'][:, n])
        bottom.plot(time_s, following, color=AXIS_COLOURS[n], label=name, linewidth=1.4)
    bottom.set_ylabel('following error\n[deg, arm]', fontsize=9)
    bottom.legend(ncols=3, fontsize=9, frameon=False, loc='lower right')
    top.set_title('Experiment 3: nearly all of the raw TCP error is the set-point delay', fontsize=11)
    bottom.set(xlabel='time from the start of the program [s]', xlim=(-0.05, trace.meta['program_s'] + 0.1))
    return figure


def fault_stop() -> Figure:
    """Draw speed and distance from the path where axis 2 loses two telegrams in a row."""
    robot = d3.load_parameters()
    document = {
        'start_m': [-0.2, 0.0, -0.8],
        'limits': {'speed_m_s': 1.0, 'acceleration_m_s2': 15.0, 'jerk_m_s3': 600.0},
        'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.8]}}],
    }
    faults = {'faults': [{'fault': 'drop_mdt', 'axis': 'axis2', 'cycles': 2, 'after_s': 0.25}]}
    runs = {
        'undisturbed': d3.simulate(d3.load_program(document, robot), robot),
        'two MDT of axis 2 lost': d3.simulate(d3.load_program(document | faults, robot), robot),
    }
    figure, (top, middle, bottom) = panels((1, 1, 1), 5.6)
    for (name, trace), colour in zip(runs.items(), ('#AAAAAA', AXIS_COLOURS[1]), strict=True):
        time_s = program_time(trace)
        speed = np.linalg.norm(np.gradient(trace['tcp_actual'], trace.meta['cycle_time_s'], axis=0), axis=1)
        top.plot(time_s, speed, color=colour, label=name, linewidth=1.6)
        beside = MM * np.hypot(trace['tcp_actual'][:, 1], trace['tcp_actual'][:, 2] + 0.8)
        middle.plot(time_s, beside, color=colour, linewidth=1.6)
    for n, name in enumerate(NAMES):
        trace = runs['two MDT of axis 2 lost']
        draw_current(bottom, trace, n, color=AXIS_COLOURS[n], label=name)
    top.set_ylabel('TCP speed [m/s]', fontsize=9)
    middle.set_ylabel('TCP beside\nits path [mm]', fontsize=9)
    bottom.set_ylabel('$I_{eff}$, all\nsamples [A]', fontsize=9)
    top.legend(fontsize=9, frameon=False, loc='center')
    bottom.legend(fontsize=9, frameon=False, loc='upper right')
    top.set_title(
        'Axis 2 loses two telegrams and brakes by itself (8112); the master stops the others', fontsize=11
    )
    bottom.set(xlabel='time from the start of the program [s]', xlim=(0.2, 0.5))
    return figure


def inside_a_cycle() -> Figure:
    """Draw what linear and cubic interpolation make of three slow bus cycles."""
    robot = d3.load_parameters().replace(bus__cycle_time_s=4e-3)
    both = [
        run.measure(
            d3.load_program('experiment1', robot), robot.replace(drive__interpolation=name), 1, silent
        )
        for name in ('linear', 'cubic')
    ]
    return figures.inside_a_cycle(Results('experiment 1', 1, tuple(both), 0.8), both)


def built_robot() -> Figure:
    """Draw what elastic gears, stiction and inexact lengths do to currents and to the true TCP."""
    runs = {
        'nominal': d3.simulate('experiment1'),
        'built': d3.simulate('experiment1', d3.load_parameters('built')),
    }
    figure, (top, bottom) = panels((1, 1), 4.6)
    for (name, trace), colour in zip(runs.items(), (AXIS_COLOURS[0], AXIS_COLOURS[1]), strict=True):
        time_s = program_time(trace)
        style = {'color': colour, 'label': f'{name} robot', 'linewidth': 1.0 if name == 'built' else 1.6}
        draw_current(top, trace, 0, color=colour, label=style['label'], zorder=2 if name == 'built' else 3)
        seen, unseen = trace['tcp_error'], trace['tcp_actual'] - trace['tcp_true']
        bottom.plot(time_s, MM * np.linalg.norm(seen + unseen, axis=1), **style)
    top.set_ylabel('$I_{eff}$ of axis 1,\nall samples [A]', fontsize=9)
    bottom.set_ylabel('true TCP error [mm]', fontsize=9)
    top.legend(ncols=2, fontsize=9, frameon=False)
    top.set_title('Experiment 1 on the nominal and on the built robot', fontsize=11)
    bottom.set(
        xlabel='time from the start of the program [s]', xlim=(-0.05, runs['nominal'].meta['program_s'] + 0.1)
    )
    return figure

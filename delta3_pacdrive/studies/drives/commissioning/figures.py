"""Figures of a commissioning: measured open loops before and after, and the inertia over the frequency."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.studies.drives.commissioning.mechanics import HIGHEST_HZ, RIGID_HZ, Mechanics
from delta3_pacdrive.studies.drives.commissioning.responses import usable
from delta3_pacdrive.studies.drives.commissioning.study import Measurement, Results
from delta3_pacdrive.studies.drives.loops.response import decibels, degrees
from delta3_pacdrive.studies.framework.figure_style import (
    AXIS_COLOURS,
    MUTED,
    dress,
    titled_figure,
)
from delta3_pacdrive.studies.framework.report_folder import Drawings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delta3_pacdrive.studies.drives.commissioning.robot import ProgramRun

LEGEND: dict[str, Any] = {'fontsize': 8, 'frameon': False}


def by_name(found: Results) -> Drawings:
    """Return the drawing functions of the figures by file name."""
    loops = {f'loop_{name}.png': partial(loop, name, one) for name, one in found.measured.items()}
    before = next(iter(found.measured.values()))
    return loops | {'inertia.png': partial(inertia, before, found.mechanics)}


def loop(name: str, measured: Measurement) -> Figure:
    """Draw the measured open loops of the axes, cut at the current set point; grey lines are too uncertain."""
    figure = titled_figure(f'All loops, open at the current set point: {name}', 6.6)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2, 2, 1))
    for one, margins, colour in zip(measured.responses, measured.margins, AXIS_COLOURS, strict=True):
        hertz, shown = one.cascade.frequencies_hz, usable(one.cascade)
        label = f'axis {one.axis + 1}'
        if margins.phase_margin_deg is not None:
            label += f': {margins.phase_margin_deg:.0f} deg at {margins.crossover_hz:.0f} Hz'
        if margins.gain_margin_db is not None:
            label += f', {margins.gain_margin_db:.1f} dB at {margins.gain_margin_hz:.0f} Hz'
        for mask, style in ((~shown, {'color': '#CCCCCC'}), (shown, {'color': colour, 'label': label})):
            values = np.where(mask, one.cascade.values, np.nan)
            top.plot(hertz, decibels(values), linewidth=1.3, **style)
            phase = np.full(len(hertz), np.nan)
            if mask.any():
                phase[mask] = degrees(one.cascade.values[mask])
            middle.plot(hertz, phase, linewidth=1.3, color=style['color'])
        bottom.plot(hertz, one.cascade.coherence, color=colour, linewidth=1.0)
    top.axhline(0.0, color=MUTED, linewidth=0.8)
    middle.axhline(-180.0, color=MUTED, linewidth=0.8)
    dress(top, xscale='log', ylabel='magnitude [dB]')
    dress(
        middle, xscale='log', ylabel='phase [deg]', ylim=(-360.0, 75.0), yticks=np.arange(-360.0, 1.0, 90.0)
    )
    dress(bottom, xscale='log', ylabel='coherence [1]', ylim=(-0.05, 1.05), xlabel='frequency [Hz]')
    top.legend(loc='lower left', **LEGEND)
    return figure


def inertia(measured: Measurement, mechanics: Sequence[Mechanics]) -> Figure:
    """Draw the measured inertia over the frequency (points), its fit (lines) and the model (dashed)."""
    figure = titled_figure('Inertia at the pose, motor side', 6.6)
    panels = figure.subplots(3, 1, sharex=True)
    for axes, one, fitted, colour in zip(panels, measured.responses, mechanics, AXIS_COLOURS, strict=True):
        hertz, values = one.inertia.frequencies_hz, np.abs(one.inertia.values)
        axes.plot(hertz, 1e4 * values, '.', color='#CCCCCC')
        kept = one.inertia.trusted
        axes.plot(hertz[kept], 1e4 * values[kept], '.', color=colour, label=f'axis {one.axis + 1}, measured')
        band = hertz[hertz <= (RIGID_HZ if fitted.gear is None else HIGHEST_HZ)]
        axes.plot(band, 1e4 * np.abs(fitted.curve(band)), color=colour, linewidth=1.2, label='fit')
        axes.axhline(
            1e4 * fitted.model_inertia_kg_m2, color=MUTED, linestyle='--', linewidth=1.0, label='model'
        )
        dress(axes, xscale='log', yscale='log', ylabel='[kg cm2]')
        axes.legend(loc='lower left', **LEGEND)
    panels[-1].set_xlabel('frequency [Hz]')
    return figure


def following_error(ran: ProgramRun, program: str) -> Figure:
    """Draw the following errors of the drives in the test program, motor side."""
    figure = titled_figure(f'Following error: {program}', 4.0, parse_math=False)
    axes = figure.subplots()
    for number, colour in enumerate(AXIS_COLOURS):
        axes.plot(
            ran.time_s, ran.following_error_rad[:, number], color=colour, linewidth=0.8, label=DRIVES[number]
        )
    dress(axes, xlabel='time [s]', ylabel='following error [rad]')
    axes.legend(loc='upper right', fontsize=8, frameon=False)
    return figure

"""Figure of an oscilloscope record: one panel per unit, time from the trigger."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.errors import FigureError
from delta3_pacdrive.recording.acquisition import Record
from delta3_pacdrive.recording.tables.quantities import ONE
from delta3_pacdrive.studies.framework.figure_style import (
    COLOURS,
    MUTED,
    add_foot,
    column_of_panels,
    legend_above,
    save,
    titled_figure,
)
from delta3_pacdrive.studies.framework.provenance import Provenance, os_errors_as

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL_IN = 2.2


def figure_of(record: Record) -> Figure:
    """Channels inside the drives, one panel per unit, over the time from the trigger."""
    units = list(dict.fromkeys(record.units))
    trigger = record.setting.trigger
    title = 'Oscilloscope' if trigger is None else f'Oscilloscope, trigger: {trigger.sentence}'
    figure = titled_figure(title, 1.2 + PANEL_IN * len(units), parse_math=False)
    what = 'time from the trigger [ms]' if record.trigger is not None else 'time from the first sample [ms]'
    panels = column_of_panels(figure, ['' if unit == ONE else f'[{unit}]' for unit in units], what)
    origin = record.first + (record.trigger or 0)
    time_ms = 1e3 * (record.time_s - origin * record.setting.sample_time_s)
    colours = dict(zip(record.names, np.resize(COLOURS, len(record.names)).tolist(), strict=True))
    for panel, unit in zip(panels, units, strict=True):
        for name, of, values in zip(record.names, record.units, record.values.T, strict=True):
            if of == unit:
                panel.plot(
                    time_ms, values, label=name, color=colours[name], linewidth=0.8, drawstyle='steps-post'
                )
        if record.trigger is not None:
            panel.axvline(0.0, color=MUTED, linewidth=0.8, linestyle=':')
        legend_above(panel)
    return figure


def draw(record: Record, path: Path, provenance: Provenance) -> Path:
    """Draw a record as PNG; raises FigureError."""
    figure = figure_of(record)
    add_foot(figure, provenance)
    with os_errors_as(f'cannot write figure {path}', FigureError):
        save(figure, path, provenance.lines())
    return path

"""Picture of a calibration: the one that ``calibrate`` draws of what is left before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.analysis.calibration import figures
from delta3_pacdrive.analysis.calibration.data import Method, Wanted
from delta3_pacdrive.analysis.calibration.run import Study
from delta3_pacdrive.analysis.calibration.study import Settings
from delta3_pacdrive.analysis.study import silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def make() -> Figure:
    """Calibrate the built robot, and draw what is left."""
    settings = Settings(None, 'built', Wanted(Method.BASE, 24, 8, 2e-5), 0)
    found, _ = Study(settings, Path(), 'docs/figures/draw.py', silent).found()
    return figures.what_is_left(found)

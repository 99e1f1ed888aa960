"""Picture of a calibration: the one that ``calibrate`` draws of the residuals before and after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.studies.calibration import figures
from delta3_pacdrive.studies.calibration.run import Study
from delta3_pacdrive.studies.calibration.study import Method, Requirements, Settings
from delta3_pacdrive.studies.framework.study import silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def make() -> Figure:
    """Calibrate the built robot and draw the residuals."""
    settings = Settings(None, 'built', Requirements(Method.BASE, 24, 8, 2e-5), 0)
    result, _ = Study(settings, Path(), 'docs/figures/draw.py', silent).result()
    return figures.residuals(result)

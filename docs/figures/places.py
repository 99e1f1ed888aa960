"""Pictures of a place of the robot: those that ``delta3 pose --output`` draws."""

from __future__ import annotations

from typing import TYPE_CHECKING

import delta3_pacdrive as d3
from delta3_pacdrive.analysis.pose import evaluation, figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLACE_M = (0.2, 0.1, -0.85)


def three_spheres() -> Figure:
    """Draw the spheres around the elbows."""
    robot = d3.load_parameters()
    return figures.three_spheres(evaluation.of_point(PLACE_M, robot), robot)


def eight_solutions() -> Figure:
    """Draw all solutions of the inverse kinematics."""
    robot = d3.load_parameters()
    return figures.eight_solutions(evaluation.of_point(PLACE_M, robot), robot)

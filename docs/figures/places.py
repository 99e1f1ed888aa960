"""Pictures of a place, a plan and the workspace: those that ``pose``, ``plan`` and ``workspace`` draw."""

from __future__ import annotations

from typing import TYPE_CHECKING

import delta3_pacdrive as d3
from delta3_pacdrive.studies.places.planning import evaluation as plans
from delta3_pacdrive.studies.places.planning import figures as plan_figures
from delta3_pacdrive.studies.places.pose import evaluation, figures
from delta3_pacdrive.studies.places.workspace import evaluation as maps
from delta3_pacdrive.studies.places.workspace import figures as map_figures
from delta3_pacdrive.studies.places.workspace.study import Settings

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


def limits() -> Figure:
    """Draw what limits the packaging cycle."""
    robot = d3.load_parameters()
    return plan_figures.limits(plans.of_program(d3.load_program('packaging', robot), robot))


def speed() -> Figure:
    """Draw the speed that the TCP reaches in every direction."""
    robot = d3.load_parameters()
    slices = maps.default_slices(robot)
    quantity = next(one for one in maps.QUANTITIES if one.key == 'speed')
    return map_figures.quantity_map(maps.study(Settings(0.1, slices), robot), slices, robot, quantity)

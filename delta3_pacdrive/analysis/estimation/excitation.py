"""Exciting trajectories: closed curves through the workspace that show the parameters of a group best.

A curve is a sum of three harmonics in x, y and z, stretched to fill the workspace, run through twice as MoveSB (6.3):
fast, for inertias, and slowly, which tells friction from them. Its coefficients minimise the condition number of the
jacobian of the signals over the parameters, both scaled (as Swevers et al. do for robots): a random search, then
Nelder and Mead from the best curve.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.analysis.estimation.geometry_model import GeometryModel
from delta3_pacdrive.analysis.estimation.identifiability import Identifiability, analyse
from delta3_pacdrive.analysis.estimation.motor_models import TorqueModel, slope
from delta3_pacdrive.analysis.estimation.problem import Model, Problem
from delta3_pacdrive.analysis.estimation.quantities import GROUPS, start_values
from delta3_pacdrive.analysis.study import OnProgress, silent
from delta3_pacdrive.errors import EstimationError, ProgramError, UnreachableError
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.plan import sample_plan
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace

HARMONICS = 3
POINTS = 32
DECIMALS = 4
FILL = 0.9  # of the radius of the workspace, and of its height
FAST = {'speed_m_s': 3.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 2000.0}
SLOW = {'speed_m_s': 0.8, 'acceleration_m_s2': 10.0, 'jerk_m_s3': 500.0}
SAMPLE_S = 1e-3


@dataclass(frozen=True)
class Design:
    """A design is an exciting program, and what it is worth.

    Attributes
    ----------
    document
        Of the program, as a program file holds it.
    condition
        Of the scaled jacobian.
    first_condition
        Of the best curve of the random search.
    evaluations
        Curves that were tried.

    """

    document: dict[str, Any]
    condition: float
    first_condition: float
    evaluations: int


def curve(coefficients: Floats, parameters: Parameters) -> Floats:
    """Points [m] of the closed curve of 6 ``HARMONICS`` coefficients, shape (POINTS, 3); it fills the workspace."""
    shape = np.asarray(coefficients).reshape(HARMONICS, 2, 3)
    phase = np.arange(POINTS) * math.tau / POINTS
    order = np.arange(1, HARMONICS + 1)[:, None]
    points = np.einsum('hp,ha->pa', np.cos(order * phase), shape[:, 0])
    points = points + np.einsum('hp,ha->pa', np.sin(order * phase), shape[:, 1])
    p = parameters.kinematics
    radius = np.hypot(points[:, 0], points[:, 1]).max()
    low, high = points[:, 2].min(), points[:, 2].max()
    middle, height = (
        (p.workspace_top_m + p.workspace_bottom_m) / 2.0,
        p.workspace_top_m - p.workspace_bottom_m,
    )
    points[:, :2] *= FILL * p.workspace_diameter_m / 2.0 / max(radius, 1e-12)
    points[:, 2] = middle + FILL * height * ((points[:, 2] - low) / max(high - low, 1e-12) - 0.5)
    return np.asarray(np.round(points, DECIMALS))


def document_of(points: Floats, name: str) -> dict[str, Any]:
    """Return the program, as a file holds it, that follows a closed curve fast and then slowly."""

    def through() -> list[list[float]]:
        # a list of its own for each move: a file may hold no references
        return [*points[1:].tolist(), points[0].tolist()]

    return {
        'name': name,
        'start_m': points[0].tolist(),
        'moves': [
            {'move_sb': {'through_m': through(), **FAST}},
            {'dwell': {'time_s': 0.05}},
            {'move_sb': {'through_m': through(), **SLOW}},
        ],
    }


def planned_trace(program: Program, parameters: Parameters) -> Trace:
    """Signals of a program that is followed exactly: shafts, TCP and the currents that the motion asks for.

    Raises
    ------
    ProgramError
        The program is refused.

    """
    start = program.start_m or parameters.motion.home_m
    plan = program_planner.plan(program, start, parameters).plan
    times = np.arange(0.0, plan.duration_s, SAMPLE_S)
    points = sample_plan(plan, times)[0]
    ratio, motor = parameters.dynamics.gear_ratio, parameters.motor
    arms = kinematics.inverse(points, parameters.kinematics)
    rates = slope(arms, SAMPLE_S)
    torque = dynamics.inverse(arms, rates, slope(rates, SAMPLE_S), parameters) / ratio
    speed = rates * ratio
    friction = motor.viscous_friction_n_m_s_rad * speed + motor.static_friction_n_m * np.tanh(
        speed / motor.friction_smoothing_rad_s
    )
    signals = {
        'motor_position': arms * ratio,
        'motor_speed': speed,
        'current': (torque + friction) / motor.torque_constant_n_m_a,
        'tcp_measured': points,
    }
    meta = {'cycle_time_s': SAMPLE_S, 'start_cycle': 0, 'end_cycle': len(times) - 1}
    return Trace(times, signals, meta)


def quality(program: Program, group: str, parameters: Parameters) -> Identifiability:
    """Return what a program tells of a group, mechanical part, by its plan alone; raises ProgramError."""
    trace, quantities = planned_trace(program, parameters), GROUPS[group].chosen()
    model: Model = (GeometryModel if group == 'geometry' else TorqueModel)(trace, parameters)
    return analyse(Problem(quantities, [model], parameters), start_values(quantities, parameters, 0.0))


def design(
    group: str,
    parameters: Parameters,
    seed: int = 0,
    tries: int = 60,
    refinements: int = 240,
    on_progress: OnProgress = silent,
) -> Design:
    """Find an exciting program for a group; raises EstimationError if no curve can be planned.

    The same seed gives the same program. ``on_progress`` is told the curves tried and the best condition.
    """
    generator = np.random.default_rng(seed)
    found: list[float] = []

    def document(coefficients: Floats) -> dict[str, Any]:
        return document_of(curve(coefficients, parameters), f'excitation of {group}')

    def condition(coefficients: Floats) -> float:
        try:
            program = programs.parse(document(coefficients), parameters.motion)
            found.append(quality(program, group, parameters).condition)
        except (ProgramError, UnreachableError, EstimationError):
            found.append(math.inf)
        on_progress(f'curve {len(found)}, condition {min(found):.4g}', len(found), tries + refinements)
        return found[-1]

    order = np.repeat(np.arange(1, HARMONICS + 1), 6)
    candidates = generator.standard_normal((tries, 6 * HARMONICS)) / order
    conditions = [condition(candidate) for candidate in candidates]
    first = candidates[int(np.argmin(conditions))]
    if not math.isfinite(min(conditions)):
        raise EstimationError('no exciting curve can be planned in the workspace of this robot')
    result = minimize(
        lambda c: min(condition(c), 1e12),
        first,
        method='Nelder-Mead',
        options={'maxfev': refinements, 'xatol': 1e-6, 'fatol': 1e-6, 'adaptive': True},
    )
    return Design(document(result.x), float(result.fun), float(min(conditions)), len(found))

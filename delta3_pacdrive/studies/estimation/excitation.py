"""Exciting trajectories: closed curves through the workspace, optimised to identify the parameters of a group.

A curve is a sum of three harmonics in x, y and z, scaled to fill the workspace. It is executed twice as MoveSB (6.3),
fast to identify inertias and slowly to separate friction from them. The coefficients minimise the condition number of
the scaled Jacobian of the signals over the parameters (Swevers et al.), by a random search and then Nelder-Mead from
the best curve.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import EstimationError, ProgramError, UnreachableError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.motor import friction_torques
from delta3_pacdrive.studies.estimation.identifiability import Identifiability, analyse
from delta3_pacdrive.studies.estimation.models import GeometryModel, TorqueModel, slope
from delta3_pacdrive.studies.estimation.problem import Model, Problem
from delta3_pacdrive.studies.estimation.quantities import GROUPS, start_values
from delta3_pacdrive.studies.framework.study import OnProgress, silent

HARMONICS = 3
POINTS = 32
DECIMALS = 4
FILL = 0.9  # share of the radius and of the height of the workspace
FAST = {'speed_m_s': 3.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 2000.0}
SLOW = {'speed_m_s': 0.8, 'acceleration_m_s2': 10.0, 'jerk_m_s3': 500.0}
SAMPLE_S = 1e-3


@dataclass(frozen=True)
class Design:
    """Exciting program and its quality."""

    document: dict[str, Any]  # program in the format of a program file
    condition: float  # condition number of the scaled Jacobian
    first_condition: float  # of the best curve of the random search
    evaluations: int  # number of curves tried


def curve(coefficients: Floats, parameters: Parameters) -> Floats:
    """Return points [m] of the closed curve of 6 ``HARMONICS`` coefficients, shape (POINTS, 3).

    The curve is scaled to fill the workspace.
    """
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
    """Return the program that follows a closed curve fast and then slowly, ready for YAML."""

    def through() -> list[list[float]]:
        # a new list for each move: YAML would write references to a shared one
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
    """Return the signals of an exactly followed program: shafts, TCP and the required currents.

    Raises
    ------
    ProgramError
        The program is rejected.

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
    signals = {
        'motor_position': arms * ratio,
        'motor_speed': speed,
        'current': (torque + friction_torques(speed, motor)) / motor.torque_constant_n_m_a,
        'tcp_measured': points,
    }
    meta = {'cycle_time_s': SAMPLE_S, 'start_cycle': 0, 'end_cycle': len(times) - 1}
    return Trace(times, signals, meta)


def quality(program: Program, group: str, parameters: Parameters) -> Identifiability:
    """Return the identifiability of a group from the plan of a program alone; raises ProgramError."""
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

    The same seed gives the same program. ``on_progress`` receives the number of curves tried and the best condition.
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

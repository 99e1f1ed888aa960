"""Estimations of the default robot from its own signals."""

from delta3_pacdrive.studies.estimation.identifiability import Verdict
from delta3_pacdrive.studies.estimation.models import GeometryModel, TorqueModel, WindingModel
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.quantities import COMBINATIONS, GROUPS, TABLE, start_values, values_of
from delta3_pacdrive.studies.estimation.solver import fit

EXACT = 1e-3  # relative, without noise; the issue asks for 1e-2
THROUGH = [[0.0, 0.25, -0.86], [-0.3, 0.1, -0.74], [-0.1, -0.3, -0.9], [0.25, -0.2, -0.75], [0.2, 0.0, -0.8]]
LIMITS = {'speed_m_s': 2.5, 'acceleration_m_s2': 30.0, 'jerk_m_s3': 1500.0}
MODELS = {
    'motor': lambda trace, robot: [WindingModel(trace, robot), TorqueModel(trace, robot)],
    'masses': lambda trace, robot: [TorqueModel(trace, robot)],
    'geometry': lambda trace, robot: [GeometryModel(trace, robot)],
}
IDENTIFIABLE = {
    'motor': {'R', 'L', 'K_m', 'F_v', 'F_s', 'I_m'},
    'masses': {'m_b', 'F_v', 'F_s', 'm_nt', 'm_br r_Gb', 'I_b', 'm_c + r m_fb'},
    'geometry': {'l_A', 'l_B', 'alpha_1', 'alpha_2', 'alpha_3', 'R_A - R_B'},
}


def problem_of(group, trace, robot, free=(), known=(), models=None):
    quantities = GROUPS[group].chosen(free, known)
    return Problem(quantities, models or MODELS[group](trace, robot), robot)


def estimate_from(problem, robot, off):
    return fit(problem, start_values(problem.quantities, robot, off))


def shown(found):
    """Return the estimates that mean anything, by symbol."""
    return {e.symbol: e for e in found.estimates if e.verdict is Verdict.IDENTIFIABLE}


def errors(found, robot):
    """Return the errors of these estimates, relative to the reference of each parameter's changes."""
    true, combined = values_of(robot), {c.symbol: c for c in COMBINATIONS}
    out = {}
    for symbol, e in shown(found).items():
        truth = true[symbol] if symbol in true else combined[symbol].value(true, robot)
        out[symbol] = (e.value - truth) / (TABLE[symbol].extent(truth) if symbol in TABLE else abs(truth))
    return out


def quiet(*_):
    """Show nothing."""

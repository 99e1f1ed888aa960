"""Closure of the arms at externally measured TCP positions (4.4): the geometry P1."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation.measurement import NOISE, moving_rows, sample_time_s
from delta3_pacdrive.studies.estimation.problem import Block
from delta3_pacdrive.studies.estimation.quantities import FRAME, GROUPS, OF_ARMS, OFFSETS

POSES_MAX = 1000


class GeometryModel:
    """Compares measured positions of the TCP with those that follow from the arm angles.

    Forearm i spans s_i = X - C_i(theta_i) and closes if |s_i| = l_B (4.4). S^-1 maps the three gaps e_i = |s_i| - l_B
    to a position error, with the directions s_i/|s_i| as rows of S. To first order this is the error of the forward
    kinematics, but it is also defined for a geometry that does not close. Arms may differ from one another.

    Raises
    ------
    EstimationError
        The trace contains no measured TCP.

    """

    step, accuracy = 1e-5, 1e-6
    depends = frozenset(GROUPS['geometry'].possible)

    def __init__(self, trace: Trace, parameters: Parameters) -> None:
        rows = moving_rows(trace)
        every = max(1, -(-(rows.stop - rows.start) // POSES_MAX))
        rows = slice(rows.start, rows.stop, every)
        self._angles = trace['motor_position'][rows] / parameters.dynamics.gear_ratio
        self._points = trace['tcp_measured'][rows]
        self.shapes = (self._points.shape,)
        period = sample_time_s(trace) * every
        self.blocks = (Block('TCP', 'm', NOISE.tcp_measured_m, period, float(trace.time_s[rows.start])),)

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured TCP less that of the arm angles [m], shape (n, 3)."""
        # rotation about the fixed axes of the measuring frame
        turned = Rotation.from_euler('xyz', _vector(values, FRAME[3:]))
        points = (self._points - _vector(values, FRAME[:3])) @ turned.as_matrix()
        theta = self._angles + _vector(values, OFFSETS)
        arm, forearm, radius, turn = (_vector(values, names) for names in OF_ARMS)
        alpha = _vector(values, ('alpha_1', 'alpha_2', 'alpha_3')) + turn
        arm, forearm = values['l_A'] + arm, values['l_B'] + forearm
        reach = values['R_A'] - values['R_B'] + radius + arm * np.cos(theta)
        elbows = np.stack([reach * np.cos(alpha), reach * np.sin(alpha), -arm * np.sin(theta)], axis=-1)
        forearms = points[:, None, :] - elbows
        lengths = np.linalg.norm(forearms, axis=-1)
        try:
            error = np.linalg.solve(forearms / lengths[..., None], (lengths - forearm)[..., None])
        except np.linalg.LinAlgError:
            raise EstimationError(
                'the geometry has become singular: the start values are too far off'
            ) from None
        return [np.asarray(error[..., 0])]


def _vector(values: Mapping[str, float], symbols: tuple[str, ...]) -> Floats:
    return np.array([values[symbol] for symbol in symbols])

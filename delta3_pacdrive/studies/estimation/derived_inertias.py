"""Inertias in a parameter file that follow from its arms: feed-forward, shaft observer and load of a single motor.

With the matrix A of (4.26) over the workspace, at the payload of the file:

    FF inertia   mean of the diagonal of A over k_r^2
    A_bar        (lambda_min + lambda_max) / 2 over all eigenvalues of A
    I_Load       A_bar less the rotor, arm side

evaluated at the reachable points of an even grid.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.capability import REACHED, capability

RADII, AZIMUTHS, HEIGHTS = 21, 24, 11  # grid points
CLOSE = 0.05  # relative deviation at which a value still fits the arms
DIGITS = 4


@dataclass(frozen=True)
class Derived:
    """Value in a parameter file, and the value derived from its arms [kg m2]."""

    name: str
    value: float
    derived: float

    @property
    def fits(self) -> bool:
        """Whether the value fits the arms."""
        return abs(self.value - self.derived) <= CLOSE * self.derived

    @property
    def text(self) -> str:
        """Deviation of the value from the derived one, as a sentence."""
        percent = 100.0 * (self.value / self.derived - 1.0)
        return f'{self.name} is {self.value:g} kg m2, but the arms lead to {self.derived:g} kg m2 ({percent:+.0f} %)'


def derived_inertias(parameters: Parameters) -> list[Derived]:
    """Return the inertias derived from the arms; raises ParameterError if no point of the workspace is reachable."""
    points, areas = _grid(parameters)
    legal = capability(points, parameters).limit == REACHED
    if not legal.any():
        raise ParameterError('no inertias can be derived: the arms reach no point of the workspace')
    theta = kinematics.inverse(points[legal], parameters.kinematics)
    mass = dynamics.mass_matrix(theta, parameters)
    eigenvalues = np.linalg.eigvalsh(mass)
    mean = float(np.average(np.einsum('nii->n', mass) / 3.0, weights=areas[legal]))
    middle = 0.5 * float(eigenvalues.min() + eigenvalues.max())
    square = parameters.dynamics.gear_ratio**2
    values = {
        'drive.feedforward_inertia_kg_m2': mean / square,
        'drive.observer_arm_inertia_kg_m2': middle,
        'motor.load_inertia_kg_m2': middle - dynamics.rotor_inertia(parameters),
    }
    given = core.flat_document(parameters)
    return [Derived(name, given[name], _rounded(value)) for name, value in values.items()]


def _grid(parameters: Parameters) -> tuple[Floats, Floats]:
    """Return points of the workspace [m], shape (n, 3), and the share of the volume that each represents."""
    k = parameters.kinematics
    radius, azimuth, z = np.meshgrid(
        np.linspace(0.0, 0.5 * k.workspace_diameter_m, RADII),
        np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False),
        np.linspace(k.workspace_bottom_m, k.workspace_top_m, HEIGHTS),
        indexing='ij',
    )
    weight = radius.copy()
    weight[-1] *= 0.5  # the rim and both ends bound half a cell
    weight[:, :, [0, -1]] *= 0.5
    points = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
    return points.reshape(-1, 3), weight.ravel()


def _rounded(value: float) -> float:
    return float(f'{value:.{DIGITS}g}')


def write(source: str, derived: Sequence[Derived], path: Path) -> bool:
    """Write a parameter file with the derived values; return whether it keeps the comments of its source.

    A single file keeps its text except for these values. Joined files (``+``) and files of differences become one
    complete file.
    """
    robot = core.load(source)
    wanted = robot.replace(**{one.name.replace('.', '__'): one.derived for one in derived})
    files = core.parts(source)
    text = _with_values(files[0], derived) if len(files) == 1 else None
    with whole_file.atomic_path(path) as partial:
        if text is not None:
            partial.write_text(text, encoding='utf-8')
            if core.load(partial) == wanted:
                return True
        core.write(wanted, partial, [f'{source} with inertias that follow from its arms'])
    return False


def _with_values(path: Path, derived: Sequence[Derived]) -> str | None:
    """Return the text of a file with the derived values; None unless each key occurs once, on its own line."""
    text = path.read_text(encoding='utf-8')
    for one in derived:
        key = one.name.partition('.')[2]
        value = f'{one.derived!r}'
        found = re.findall(rf'(?m)^(\s*{key}\s*:[ \t]*)([^\s#]+)([ \t]*)', text)
        if len(found) != 1:
            return None
        ((head, old, space),) = found
        # a comment keeps its column
        gap = ' ' * max(len(old) + len(space) - len(value), 1) if space else ''
        text = text.replace(head + old + space, head + value + gap)
    return text

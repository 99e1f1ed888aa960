"""Data of an analysed pose."""

from dataclasses import dataclass
from typing import Annotated

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.limits.capability import Capability
from delta3_pacdrive.planning.limits.joint_forces import JointForces
from delta3_pacdrive.studies.framework.columns import HIDDEN, Column


@dataclass(frozen=True)
class Solution:
    """Solution of the inverse kinematics (Fig. 4.6)."""

    number: Annotated[int, Column('solution')]  # 0 to 7: bit i is set if arm i + 1 has its elbow inward
    elbows: Annotated[tuple[str, ...], Column('elbow {}')]  # direction of each, ``out`` or ``in``
    # shape (3,); nan for an arm that cannot reach
    arm_angle_rad: Annotated[Floats, Column('theta_{} [rad]', key='arm_angles_rad')]
    # all arm angles are within their limits
    is_legal: Annotated[bool, Column('within arm limits', key='within_arm_limits')]
    loop_error_m: Annotated[float, Column('loop error [m]')]  # of the forearm lengths; nan without a solution


@dataclass(frozen=True)
class Margin:
    """Distance of one quantity to one of its limits."""

    name: Annotated[str, HIDDEN]  # of the quantity with the number of its arm
    key: Annotated[str, Column(key='quantity')]  # name in results
    arm: int | None  # 1 to 3; None for the whole robot
    value: Annotated[float, Column(key='value{unit!k}')]
    limit: Annotated[float, Column(key='limit{unit!k}')]  # largest allowed value, or smallest if not is_upper
    is_upper: Annotated[bool, HIDDEN]
    distance: Annotated[float, Column(key='distance{unit!k}')]  # to the limit, negative beyond it
    unit: Annotated[str, HIDDEN]
    is_kept: Annotated[bool, Column(key='kept')]  # up to rounding

    @property
    def sentence(self) -> str:
        """Value and limit as text."""
        unit = f' {self.unit}' if self.unit else ''
        return f'{self.name} is {self.value:.4g}{unit}, the limit is {self.limit:.4g}{unit}'


@dataclass(frozen=True)
class Pose:
    """Analysed pose; values that do not exist are None."""

    solutions: tuple[Solution, ...]  # all eight for the point; empty without a point
    margins: tuple[Margin, ...]
    refusals: tuple[str, ...]  # reasons why the robot may not take the pose
    payload_kg: float
    point_m: Floats | None = None  # TCP
    mirror_m: Floats | None = None  # second intersection of the three spheres, above the elbow plane
    arm_angle_rad: Floats | None = None  # shape (3,)
    number: int | None = None  # of the solution with these angles
    jacobian: Floats | None = None  # m/rad; None also at a singularity where it is not finite
    singular_values: Floats | None = None  # of the Jacobian [m/rad], largest first
    capability: Capability | None = None  # only for the working branch
    holding_torque_n_m: Floats | None = None  # arm side, shape (3,)
    holding_current_a: Floats | None = None
    forces: JointForces | None = None  # in rods and ball joints at rest, only for the working branch

    @property
    def is_reachable(self) -> bool:
        """Whether the robot may take this pose."""
        return not self.refusals

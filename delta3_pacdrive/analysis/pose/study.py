"""What is known of one pose: data only."""

from dataclasses import dataclass

from delta3_pacdrive.motion.capability import Capability
from delta3_pacdrive.numerics.types import Floats


@dataclass(frozen=True)
class Solution:
    """A solution of the inverse kinematics (Fig. 4.6).

    Attributes
    ----------
    number
        0 to 7: bit i is set where arm i + 1 has its elbow inward.
    arm_angle_rad
        Shape (3,); nan of an arm that cannot reach.
    loop_error_m
        By how much a forearm would have to be longer or shorter at most; nan without a solution.
    is_legal
        Whether every arm angle is within its limits.

    """

    number: int
    arm_angle_rad: Floats
    loop_error_m: float
    is_legal: bool

    @property
    def elbows(self) -> tuple[str, ...]:
        """Where the elbows point: ``out`` or ``in``."""
        return tuple('in' if self.number >> i & 1 else 'out' for i in range(3))


@dataclass(frozen=True)
class Margin:
    """Distance of one quantity to one of its limits.

    Attributes
    ----------
    what
        The quantity in words, with the number of its arm.
    key
        Its name in results.
    arm
        Number of the arm, 1 to 3; None for the robot as a whole.
    value, limit
        In ``unit``; the limit is the largest value allowed, or with ``is_upper`` false the smallest.
    distance
        To the limit, negative beyond it.
    is_kept
        Whether the limit is kept, but for rounding.

    """

    what: str
    key: str
    arm: int | None
    value: float
    limit: float
    is_upper: bool
    distance: float
    unit: str
    is_kept: bool

    @property
    def sentence(self) -> str:
        """Value and limit in words."""
        unit = f' {self.unit}' if self.unit else ''
        return f'{self.what} is {self.value:.4g}{unit}, the limit is {self.limit:.4g}{unit}'


@dataclass(frozen=True)
class Pose:
    """A pose.

    Attributes
    ----------
    point_m
        Of the TCP; None where the forearms do not meet.
    mirror_m
        The second intersection of the three spheres, above the elbow plane; None without angles.
    arm_angle_rad
        Shape (3,), None where an arm cannot reach.
    number
        Of the solution that these angles are; None where they are not known.
    solutions
        All eight for this point; empty without a point.
    margins
        Distances to all limits.
    refusals
        Why the robot may not be here, in sentences; empty if it may.
    payload_kg
        Carried.
    jacobian
        J [m/rad], None without a pose; also where it is singular.
    singular_values
        Of J [m/rad], largest first; None like J.
    capability
        What the motors can do; None but for the branch in which the robot works.
    holding_torque_n_m
        Torques that hold the arms at rest, arm side, shape (3,); None like J.
    holding_current_a
        Currents of the motors for that; None like J.

    """

    point_m: Floats | None
    mirror_m: Floats | None
    arm_angle_rad: Floats | None
    number: int | None
    solutions: tuple[Solution, ...]
    margins: tuple[Margin, ...]
    refusals: tuple[str, ...]
    payload_kg: float
    jacobian: Floats | None
    singular_values: Floats | None
    capability: Capability | None
    holding_torque_n_m: Floats | None
    holding_current_a: Floats | None

    @property
    def is_reachable(self) -> bool:
        """Whether the robot may be here."""
        return not self.refusals

"""P1 (Table 9-1): nominal and calibrated geometry of the arms, and the limits of the workspace."""

import math
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.configuration.fields import positive, quantity

PerArm = tuple[float, float, float]
EQUAL: PerArm = (0.0, 0.0, 0.0)


def _correction(description: str, limit: float) -> Any:
    return quantity(description, -limit, limit, default=EQUAL)


@dataclass(frozen=True)
class ArmDeviations:
    """Deviations of arms 1 to 3 from the drawing."""

    upper_arm_m: PerArm = EQUAL  # of l_A
    forearm_m: PerArm = EQUAL  # of l_B
    radius_m: PerArm = EQUAL  # of R
    azimuth_rad: PerArm = EQUAL  # of alpha
    angle_rad: PerArm = EQUAL  # arm angle less the angle of its referenced shaft


def radians(degrees: PerArm) -> PerArm:
    """Convert the angles of the three arms to [rad]."""
    first, second, third = degrees
    return math.radians(first), math.radians(second), math.radians(third)


def _sums(value: float, more: PerArm) -> PerArm:
    return value + more[0], value + more[1], value + more[2]


@dataclass(frozen=True)
class Kinematics:
    """P1: geometry of the arms and the limits of the workspace."""

    upper_arm_length_m: float = positive('l_A, upper arm', 2.0)
    forearm_length_m: float = positive('l_B, forearm', 4.0)
    base_radius_m: float = positive('R_A, circle of the motor axes', 2.0)
    plate_radius_m: float = positive('R_B, circle of the forearm joints on the plate', 2.0)
    arm_azimuth_deg: tuple[float, float, float] = quantity('alpha_i, direction of each arm', -360.0, 360.0)
    arm_angle_min_deg: float = quantity('smallest arm angle under control', -90.0, 0.0)
    arm_angle_max_deg: float = quantity('largest arm angle under control', 0.0, 150.0)
    forearm_swing_max_deg: float = positive('largest sideways swing of a forearm', 90.0)
    workspace_diameter_m: float = positive('diameter of the workspace cylinder', 8.0)
    workspace_top_m: float = quantity('z of the top of the workspace', -8.0, 0.0)
    workspace_bottom_m: float = quantity('z of the bottom of the workspace', -8.0, 0.0)
    serial_singularity_min: float = quantity('smallest s.b/(l_A l_B) a move may reach', 0.0, 1.0)
    parallel_singularity_min: float = quantity('smallest |det S|/l_B^3 a move may reach', 0.0, 1.0)
    upper_arm_correction_m: tuple[float, float, float] = _correction(
        'calibrated l_A of each arm, less that of the drawing', 0.02
    )
    forearm_correction_m: tuple[float, float, float] = _correction(
        'calibrated l_B of each arm, less that of the drawing', 0.02
    )
    radius_correction_m: tuple[float, float, float] = _correction(
        'calibrated R of each arm, less that of the drawing', 0.02
    )
    arm_azimuth_correction_deg: tuple[float, float, float] = _correction(
        'calibrated alpha of each arm, less that of the drawing', 5.0
    )
    arm_angle_correction_deg: tuple[float, float, float] = _correction(
        'calibrated arm angle, less that of the referenced shaft', 5.0
    )

    @property
    def corrections(self) -> ArmDeviations:
        """Deviations from the drawing known to the controller from a calibration."""
        return ArmDeviations(
            self.upper_arm_correction_m,
            self.forearm_correction_m,
            self.radius_correction_m,
            radians(self.arm_azimuth_correction_deg),
            radians(self.arm_angle_correction_deg),
        )

    @property
    def radius_difference_m(self) -> float:
        """R = R_A - R_B of the drawing (4.2)."""
        return self.base_radius_m - self.plate_radius_m

    @property
    def upper_arm_lengths_m(self) -> PerArm:
        """l_A of each arm, calibrated."""
        return _sums(self.upper_arm_length_m, self.upper_arm_correction_m)

    @property
    def forearm_lengths_m(self) -> PerArm:
        """l_B of each arm, calibrated."""
        return _sums(self.forearm_length_m, self.forearm_correction_m)

    @property
    def base_radii_m(self) -> PerArm:
        """R_A of each arm, calibrated; R_B is nominal."""
        return _sums(self.base_radius_m, self.radius_correction_m)

    @property
    def arm_azimuth_rad(self) -> PerArm:
        """The three azimuths alpha_i [rad], calibrated."""
        one, two, three = self.drawn_azimuth_rad
        more = self.corrections.azimuth_rad
        return one + more[0], two + more[1], three + more[2]

    @property
    def drawn_azimuth_rad(self) -> PerArm:
        """The three azimuths alpha_i [rad] of the drawing."""
        return radians(self.arm_azimuth_deg)

    @property
    def arm_angle_min_rad(self) -> float:
        """Smallest arm angle under control [rad]."""
        return math.radians(self.arm_angle_min_deg)

    @property
    def arm_angle_max_rad(self) -> float:
        """Largest arm angle under control [rad]."""
        return math.radians(self.arm_angle_max_deg)

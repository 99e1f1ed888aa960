"""Settings of a single-motor study, data only."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Settings of a single-motor study."""

    parameters: str | None  # file; None: the packaged one
    axis: int  # arm whose motion the motor executes, 1 to 3
    load_inertia_kg_m2: float | None = None  # I_Load; None: from the parameters
    load_torque_n_m: float | None = None  # tau_load; None: from the parameters
    coupling_effect: float | None = None  # CE; None: from the parameters
    trace: str | None = None  # file for all signals; None: none

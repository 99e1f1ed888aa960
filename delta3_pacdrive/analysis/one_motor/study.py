"""What the run of a single motor depends on."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """The settings are what the run depends on, apart from the contents of its files.

    Attributes
    ----------
    parameters
        Parameter file; None: the packaged one.
    axis
        Number of the arm whose motion the motor drives, 1 to 3.
    load_inertia_kg_m2, load_torque_n_m, coupling_effect
        I_Load, tau_load and CE instead of those of the parameters; None: as there.
    trace
        File that takes every signal of the motor; None: none.

    """

    parameters: str | None
    axis: int
    load_inertia_kg_m2: float | None = None
    load_torque_n_m: float | None = None
    coupling_effect: float | None = None
    trace: str | None = None

"""What an estimation depends on."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """The settings are what an estimation depends on, apart from the contents of its files.

    Attributes
    ----------
    group
        One of ``GROUP_NAMES``.
    inputs
        Traces (.npz, .csv, folders of bags), or one program to be simulated as measurement.
    parameters
        Parameter file; None: the packaged one.
    sampling
        Of a simulated measurement: 'drive' or 'bus'.
    method
        For the mechanical part: 'balance' of torques, 'replay' of the closed loop, or what fits the sampling.
    noise, seed
        Of a simulated measurement: multiple of typical sensor noise, and its seed.
    start_off
        Share by which the estimation starts beside the values of the parameter file; None: 0.3 for a simulated
        measurement, 0 for a trace.
    free, known
        Symbols that are freed, or held, beside what the group does by itself.

    """

    group: str
    inputs: tuple[str, ...] = ('excitation',)
    parameters: str | None = None
    sampling: str = 'drive'
    method: str = 'auto'
    noise: float = 0.0
    seed: int = 0
    start_off: float | None = None
    free: tuple[str, ...] = ()
    known: tuple[str, ...] = ()

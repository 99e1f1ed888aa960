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
        Multiple of typical sensor noise that a simulated measurement gets, with its seed, or that traces have.
    start_off
        Share by which the estimation starts beside the values of the parameter file; None: 0.3 for a simulated
        measurement, 0 for a trace.
    free, known
        Symbols, or effects of built robots, that are freed or held beside what the group does by itself.
    validate
        Recordings, or programs of a simulated measurement, that are kept aside: the estimates must predict them.
    apply
        Whether a parameter file with the estimates is left, and what it changes is shown.

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
    validate: tuple[str, ...] = ()
    apply: bool = False

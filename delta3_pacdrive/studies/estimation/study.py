"""Settings of an estimation, data only."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Settings of an estimation."""

    group: str  # one of GROUP_NAMES
    # traces (.npz, .csv, folders of bags), or one program to be simulated
    inputs: tuple[str, ...] = ('excitation',)
    parameters: str | None = None  # parameter file; None: the packaged one
    sampling: str = 'drive'  # of a simulated measurement: 'drive' or 'bus'
    # for the mechanical part: 'balance' of torques, 'replay' of the closed loop, or 'auto'
    method: str = 'auto'
    noise: float = 0.0  # sensor noise of the measurement, as a multiple of typical noise
    seed: int = 0
    # relative error of the start values; None: 0.3 for a simulation, 0 for a trace
    start_off: float | None = None
    free: tuple[str, ...] = ()  # symbols or effects freed in addition to those of the group
    known: tuple[str, ...] = ()  # symbols or effects to be held
    validate: tuple[str, ...] = ()  # validation recordings, or programs of a simulated measurement
    apply: bool = False  # whether to write a parameter file with the estimates and show its effect
    columns: str | None = None  # column file of tables

"""Frequency responses of one axis from the record of an excited stroke, and the margins of its loops.

All responses use the signal r that the generator has added: H = S_ry / S_rx is unbiased by noise inside the closed
loops. The velocity loop and the position loop follow from the measured plant and the gains of the drive.

    V   current reference after the notch filters -> filtered speed
    P   current reference after the notch filters -> encoder position
    y   current -> encoder position, as an inertia K_m I / (-w^2 Theta)
    L   all loops, open at the current set point: L = 1/S - 1, S = current set point / r
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.excitation import Multisine, signal_of
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.studies.drives.commissioning.robot import AxisRecord
from delta3_pacdrive.studies.drives.commissioning.strokes import Strokes
from delta3_pacdrive.studies.drives.loops import identification
from delta3_pacdrive.studies.drives.loops.identification import COHERENCE_MIN, Measured
from delta3_pacdrive.studies.drives.loops.response import Complex

Rows = NDArray[Any]
PAIRS = 2  # of strokes there and back
HALF_RAD, SPEED_RAD_S = 4.0, 5.0  # of the excited stroke: friction is constant, the inertia changes little
ERROR_MAX = 0.15  # relative standard error of a usable line
STROKES_MIN = 2  # excited ones
PERIODS_MIN = 4  # of the signal in a stroke, for three transforms of two periods each


def stroke(axis: int) -> Strokes:
    """Return the excited strokes of an axis, 0 to 2."""
    return Strokes(axis, HALF_RAD, (SPEED_RAD_S,) * PAIRS)


@dataclass(frozen=True)
class AxisResponse:
    """Measured frequency responses of an axis at a pose."""

    axis: int  # 0 to 2
    speed: Measured  # V [rad/(A s)]
    position: Measured  # P [rad/A]
    inertia: Measured  # y [kg m2]
    others: Complex  # motion of the other arms relative to this one, shape (2, F)
    cascade: Measured  # L


def responses(record: AxisRecord, pose_rad: float, parameters: Parameters) -> AxisResponse:
    """Return the responses of an excited stroke.

    Parameters
    ----------
    record
        Record of ``stroke``.
    pose_rad
        Motor position of the pose [rad].
    parameters
        Parameters of the robot; only the periods of the loops, the signal and K_m are used.

    Raises
    ------
    TuningError
        The record has too few periods of the signal at constant speed.

    """
    signal = signal_of(parameters)
    position = record.own('encoder_position') - pose_rad
    every = round(parameters.drive.velocity_period_s / record.sample_s)
    found: dict[str, list[Measured]] = {}
    pieces = [piece for pair in stroke(record.axis).pieces(position, record.sample_s) for piece in pair]
    added = record.own('current_added')
    if not pieces:
        raise TuningError(f'the record of axis{record.axis + 1} contains no stroke at constant speed')
    rows_of = [_whole_periods(record, piece, added, signal, every) for piece in pieces]
    counts = [len(rows) // signal.samples for rows in rows_of]
    if sum(count >= PERIODS_MIN for count in counts) < STROKES_MIN:
        raise TuningError(
            f'the strokes of axis{record.axis + 1} were excited for {", ".join(map(str, counts))} periods at constant '
            f'speed; {STROKES_MIN} strokes with {PERIODS_MIN} periods are needed'
        )
    # the generator may have started during the first stroke
    for rows in (rows for rows, count in zip(rows_of, counts, strict=True) if count >= PERIODS_MIN):
        for name, one in _of_piece(record, rows, position, signal, every).items():
            found.setdefault(name, []).append(one)
    mean = {name: _mean(ones) for name, ones in found.items()}
    frequencies = mean['inertia'].frequencies_hz
    to_inertia = -parameters.motor.torque_constant_n_m_a / (2.0 * np.pi * frequencies) ** 2
    inertia = replace(mean['inertia'], values=to_inertia * mean['inertia'].values)
    return AxisResponse(
        axis=record.axis,
        speed=mean['speed'],
        position=mean['position'],
        inertia=inertia,
        others=np.array([mean[name].values for name in _others(record.axis)]),
        cascade=identification.opened(mean['sensitivity']),
    )


def usable(measured: Measured) -> NDArray[np.bool_]:
    """Return the mask of lines that show a curve, also with noise: at a resonance they are better than none."""
    return (measured.error <= ERROR_MAX) & (measured.coherence >= COHERENCE_MIN)


def _others(axis: int) -> list[str]:
    return [name for number, name in enumerate(DRIVES) if number != axis]


def _whole_periods(record: AxisRecord, piece: slice, added: Floats, signal: Multisine, every: int) -> Rows:
    """Return the samples of whole periods of the signal in the middle of a piece, one per velocity period."""
    # the velocity loop computes in the periods of the current loop whose number is a multiple of ``every``
    start = piece.start + (1 - record.first - piece.start) % every
    rows = np.arange(max(start, every), piece.stop, every)
    rows = rows[added[rows] != 0.0]
    count = len(rows) // signal.samples
    surplus = (len(rows) - count * signal.samples) // 2
    return np.asarray(rows[surplus : surplus + count * signal.samples])


def _of_piece(
    record: AxisRecord, rows: Rows, position: Floats, signal: Multisine, every: int
) -> dict[str, Measured]:
    added, reference = record.own('current_added')[rows], record.own('current_reference')[rows]

    def response(x: Floats, y: Floats, instrument: Floats | None = added) -> Measured:
        return identification.response(
            x,
            y,
            every * record.sample_s,
            signal.samples,
            instrument=instrument,
            lines=signal.lines,
            drifts=True,
        )

    return {
        'speed': response(reference, record.own('speed_filtered')[rows]),
        'position': response(reference, position[rows]),
        # the encoder is read at the start of a period, the current of that instant is the last one of the period before
        'inertia': response(position[rows], record.own('current')[rows - 1]),
        'sensitivity': response(added, record.own('current_asked')[rows], None),
        **{
            name: response(position[rows], record.signals[f'{name}.encoder_position'][rows])
            for name in _others(record.axis)
        },
    }


def _mean(ones: Sequence[Measured]) -> Measured:
    """Return the mean of responses at the same frequencies; the coherence is that of the worse one."""
    return replace(
        ones[0],
        values=np.mean([one.values for one in ones], axis=0),
        coherence=np.min([one.coherence for one in ones], axis=0),
        averages=sum(one.averages for one in ones),
    )

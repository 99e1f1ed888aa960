"""Measured plants of the axes at all frequencies, for the search for gains.

In the trusted band the plant is the measured one. Elsewhere it is the fitted mechanics with the dead time, times the
quotient of measurement and fit, which is interpolated over the logarithm of the frequency.
"""

from collections.abc import Sequence

import numpy as np

from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.drives.commissioning.mechanics import Mechanics
from delta3_pacdrive.studies.drives.commissioning.responses import AxisResponse, usable
from delta3_pacdrive.studies.drives.loops.identification import Measured
from delta3_pacdrive.studies.drives.loops.response import Complex
from delta3_pacdrive.studies.drives.tuning.candidates import PlantResponse


def plant_of(
    responses: Sequence[AxisResponse],
    mechanics: Sequence[Mechanics],
    torque_constant_n_m_a: float,
    shares: Sequence[float] = (1.0,),
) -> PlantResponse:
    """Return the plants of the axes.

    Parameters
    ----------
    responses, mechanics
        Of the same axes, measured at one pose.
    torque_constant_n_m_a
        K_m.
    shares
        Inertias relative to that at the pose, each a plant: the measured one with the arm of this inertia in the fit.

    Raises
    ------
    TuningError
        Nothing can be trusted.

    """
    for response in responses:
        if not usable(response.speed).any() or not usable(response.position).any():
            raise TuningError(
                f'no line of the excitation of axis{response.axis + 1} can be trusted: raise drive.excitation_rms_a '
                '(P-0-0091)'
            )

    def respond(frequencies_hz: Floats) -> tuple[Complex, Complex]:
        speed, position = [], []
        for response, fitted in zip(responses, mechanics, strict=True):

            def of_speed(hertz: Floats, fitted: Mechanics = fitted) -> Complex:
                omega = 2.0 * np.pi * hertz
                lag = np.exp(-1j * omega * fitted.dead_time_s)
                return np.asarray(torque_constant_n_m_a * lag / (1j * omega * fitted.curve(hertz)))

            def of_position(hertz: Floats, fitted: Mechanics = fitted) -> Complex:
                return np.asarray(of_speed(hertz, fitted) / (2j * np.pi * hertz))

            own = of_speed(frequencies_hz) * _quotient(response.speed, of_speed, frequencies_hz)
            at = of_position(frequencies_hz) * _quotient(response.position, of_position, frequencies_hz)
            for share in shares:
                changed = fitted.curve(frequencies_hz) / fitted.curve(frequencies_hz, share)
                speed.append(own * changed)
                position.append(at * changed)
        return np.array(speed), np.array(position)

    return respond


def _quotient(measured: Measured, fit: object, frequencies_hz: Floats) -> Complex:
    kept = usable(measured)
    hertz = measured.frequencies_hz[kept]
    quotient = measured.values[kept] / fit(hertz)  # type: ignore[operator]
    at, known = np.log(frequencies_hz), np.log(hertz)
    size = np.interp(at, known, np.log(np.abs(quotient)))
    phase = np.interp(at, known, np.unwrap(np.angle(quotient)))
    return np.asarray(np.exp(size + 1j * phase))

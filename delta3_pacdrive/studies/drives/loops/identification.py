"""Frequency responses from recorded signals: Welch spectra, H1 estimate, coherence and standard error.

H1 = S_xy / S_xx is unbiased by noise at the output y. In a closed loop the input x contains that noise too; with the
added set point r, which is independent of the noise, H = S_ry / S_rx is unbiased. For unity feedback, L = S_rb / S_re
with feedback b and error e. If r is added to the controller output, L = 1/S - 1 with S = S_ru / S_rr of the sum u.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.drives.loops.response import Complex

AVERAGES_MIN = 3
ERROR_MAX = 0.05  # relative standard error of |H| up to which a value is trusted: 0.4 dB and 3 degrees
COHERENCE_MIN = 0.5  # below this value the error formula is unreliable
QUIET = 1e-12  # relative to the strongest line: an input below is not excited


@dataclass(frozen=True)
class Measured:
    """Measured frequency response with its coherence."""

    frequencies_hz: Floats  # shape (F,), ascending
    values: Complex  # shape (F,)
    coherence: Floats  # share of the output power that is coherent with the input, 0 to 1, shape (F,)
    averages: int  # independent pieces of the signal
    magnified: Floats | float = 1.0  # factor on relative errors of the formula behind the values, shape (F,)

    @property
    def error(self) -> Floats:
        """Relative standard deviation of |H| (Bendat and Piersol): sqrt((1 - g)/(2 n g)) with coherence g."""
        share = np.clip(self.coherence, 1e-12, 1.0)
        return np.asarray(self.magnified * np.sqrt((1.0 - share) / (2.0 * self.averages * share)))

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Mask of trusted values: small error and sufficient coherence."""
        return (self.error <= ERROR_MAX) & (self.coherence >= COHERENCE_MIN)

    @property
    def in_band(self) -> NDArray[np.bool_]:
        """Mask of the frequencies within ``band_hz``, shape (F,)."""
        low, high = self.band_hz() or (np.inf, -np.inf)
        return (self.frequencies_hz >= low) & (self.frequencies_hz <= high)

    def band_hz(self) -> tuple[float, float] | None:
        """Return the longest trusted band, measured in octaves; None if no value is trusted."""
        best, first = None, None
        for k, good in enumerate([*self.trusted.tolist(), False]):
            if good and first is None:
                first = k
            elif not good and first is not None:
                low, high = float(self.frequencies_hz[first]), float(self.frequencies_hz[k - 1])
                if best is None or high / low > best[1] / best[0]:
                    best = low, high
                first = None
        return best


def response(
    x: Floats,
    y: Floats,
    sample_s: float,
    piece: int,
    instrument: Floats | None = None,
    lines: NDArray[np.int64] | None = None,
    drifts: bool = False,
) -> Measured:
    """Estimate the frequency response from x to y.

    Parameters
    ----------
    x, y
        Signals, shape (samples,).
    sample_s
        Sampling period.
    piece
        Samples per transform; for a periodic signal its period.
    instrument
        External excitation of the loop; None: x itself (H1 estimate).
    lines
        Excited harmonics of ``piece`` of a periodic signal; None: arbitrary signal, with Hann windows that overlap by
        half.
    drifts
        For a periodic signal: pose and load change slowly. Two periods per transform and a Hann window then keep the
        changes out of the lines.

    Raises
    ------
    TuningError
        The signals are too short for three pieces, or x is constant.

    """
    hann = lines is None or drifts
    if lines is not None and drifts:
        piece, lines = 2 * piece, 2 * lines
    overlap = piece // 2 if hann else 0
    pieces = 1 + (len(x) - piece) // (piece - overlap)
    if pieces < AVERAGES_MIN:
        raise TuningError(
            f'{len(x)} samples are too short for {AVERAGES_MIN} pieces of {piece} '
            f'({piece * sample_s:g} s): spectra cannot be averaged'
        )
    if not np.ptp(x) > 0.0:
        raise TuningError('the input is constant: its frequency response is undefined')
    options = {
        'nperseg': piece,
        'noverlap': overlap,
        'window': 'hann' if hann else 'boxcar',
        'detrend': 'linear' if hann else 'constant',
    }

    def spectrum(a: Floats, b: Floats) -> tuple[Floats, Complex]:
        return signal.csd(a, b, fs=1.0 / sample_s, **options)  # type: ignore[no-any-return]

    r = x if instrument is None else instrument
    frequencies, rx = spectrum(r, x)
    keep = np.arange(1, len(frequencies)) if lines is None else lines
    (_, ry), (_, rr), (_, xx), (_, yy) = spectrum(r, y), spectrum(r, r), spectrum(x, x), spectrum(y, y)
    power = np.abs(rr)[keep]
    keep = keep[power > QUIET * power.max()]
    rx, ry, rr, xx, yy = (s[keep] for s in (rx, ry, np.abs(rr), np.abs(xx), np.abs(yy)))
    coherence = np.minimum(
        np.abs(rx) ** 2 / np.maximum(rr * xx, 1e-300), np.abs(ry) ** 2 / np.maximum(rr * yy, 1e-300)
    )
    # with half overlap and a Hann window the pieces count as about 0.95 times as many independent ones
    return Measured(frequencies[keep], ry / rx, np.minimum(coherence, 1.0), pieces)


def opened(sensitivity: Measured) -> Measured:
    """Return the open loop L = 1/S - 1 of a measured sensitivity; relative errors are large where L is small."""
    values = 1.0 / sensitivity.values - 1.0
    magnified = 1.0 / np.maximum(np.abs(1.0 - sensitivity.values), 1e-12)
    return replace(sensitivity, values=values, magnified=magnified)

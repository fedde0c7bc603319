"""Zero-phase low-pass filter and decimation in one step.

The same linear filter is applied to every column and to the right-hand side ("parallel filtering", Gautier 1997):
the model's equation stays exact, discontinuous columns included, while noise above the cut-off disappears. A
symmetric FIR filter has no phase and no transient beyond its half-length, so a log may be processed in blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_KAISER = 4.0
"""Side lobes near -45 dB with a half-length of one period of the cut-off."""


@dataclass(frozen=True)
class LowPass:
    """Symmetric taps (odd length, unit gain at 0 Hz) applied at every `step`-th sample."""

    taps: Array
    step: int
    cutoff: float
    """Cut-off (-6 dB), Hz; infinite for no filter."""

    @property
    def half(self) -> int:
        """Half-length in samples."""
        return len(self.taps) // 2

    def outputs(self, samples: int, margin: int = 0) -> NDArray[np.intp]:
        """Return the sample indices that outputs are centred on, `margin` samples clear of both ends."""
        first = self.half + margin
        return np.arange(first, samples - first, self.step, dtype=np.intp)

    def apply(self, rows: Array, margin: int = 0) -> Array:
        """Return filtered rows at `outputs(N, margin)`: (…, N) to (…, len(outputs))."""
        centres = self.outputs(rows.shape[-1], margin)
        count = len(centres)
        shape = rows.shape[:-1]
        if count == 0:
            return np.zeros((*shape, 0))
        if len(self.taps) == 1:
            picked: Array = rows[..., centres] * self.taps[0]
            return picked
        lags = -(-len(self.taps) // self.step)
        padded = np.zeros(lags * self.step)
        padded[: len(self.taps)] = self.taps
        kernel = padded.reshape(lags, self.step)
        begin = int(centres[0]) - self.half
        needed = (count + lags - 1) * self.step
        flat = rows.reshape(-1, rows.shape[-1])
        window = flat[:, begin : begin + needed]
        if window.shape[1] < needed:
            window = np.pad(window, ((0, 0), (0, needed - window.shape[1])))
        blocks = np.ascontiguousarray(window).reshape(len(flat), count + lags - 1, self.step)
        partial = blocks @ kernel.T
        result = partial[:, :count, 0].copy()
        for lag in range(1, lags):
            result += partial[:, lag : lag + count, lag]
        return result.reshape(*shape, count)


def low_pass(cutoff: float, dt: float, step: int) -> LowPass:
    """Return a Kaiser-windowed sinc with its -6 dB point at `cutoff` (Hz), for sample time `dt` (s)."""
    if not np.isfinite(cutoff) or cutoff >= 0.5 / dt:
        return LowPass(np.ones(1), step, float("inf"))
    half = max(1, round(1.0 / (cutoff * dt)))
    k = np.arange(-half, half + 1)
    taps = np.sinc(2.0 * cutoff * dt * k) * np.kaiser(2 * half + 1, _KAISER)
    return LowPass(taps / taps.sum(), step, cutoff)

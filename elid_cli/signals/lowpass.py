"""Zero-phase low-pass filter and decimation in one step.

The same linear filter is applied to every column and to the right-hand side ("parallel filtering", Gautier 1997):
the model's equation stays exact, discontinuous columns included, while noise above the cut-off disappears. A
symmetric FIR filter has no phase and no transient beyond its half-length, so a log may be processed in blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array

_KAISER = 4.0
"""Side lobes near -45 dB with a half-length of one period of the cut-off."""
REACH, _WINDOW = 8, 17.0
"""Interpolation between thinned samples: reach to each side, and the Kaiser window's parameter (-160 dB)."""
_MANY = 32
"""Rows from which a tile's product takes longer than the call for it."""


@dataclass(frozen=True)
class LowPass:
    """Taps (odd length; symmetric and of unit gain at 0 Hz, but for derivatives) applied at every `step`-th sample."""

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

    def thinned(self, every: int) -> LowPass:
        """Return the filter for rows of which every `every`-th sample is there (a divisor of `step`).

        It is this filter on what windowed-sinc interpolation between those samples gives; rows that hold nothing near
        the rate of those samples come out the same (`thinning` tells how nearly).
        """
        if every in self._thinned:
            return self._thinned[every]
        reach = -(-self.half // every) + REACH
        taps = np.zeros(2 * reach + 1)
        # where a tap lies between two of those samples, and which samples, `REACH` to either side, it is spread over
        below, phase = np.divmod(np.arange(-self.half, self.half + 1), every)
        near = np.arange(-REACH, REACH + 1)
        offset = phase[:, None] / every - near
        window = np.i0(_WINDOW * np.sqrt(np.maximum(1.0 - (offset / REACH) ** 2, 0.0))) * (np.abs(offset) <= REACH)
        between = np.sinc(offset) * window
        between *= (self.taps / between.sum(axis=1))[:, None]
        np.add.at(taps, below[:, None] + near + reach, between)
        self._thinned[every] = LowPass(taps, self.step // every, self.cutoff)
        return self._thinned[every]

    def differentiated(self, dt: float) -> LowPass:
        """Return the filter that gives this filter's outputs of the rows' central differences over time."""
        if dt not in self._differentiated:
            wide = np.pad(self.taps, 2)
            self._differentiated[dt] = LowPass((wide[:-2] - wide[2:]) / (2.0 * dt), self.step, self.cutoff)
        return self._differentiated[dt]

    @cached_property
    def window(self) -> LowPass:
        """The mean of rows over each output's window, by the size of this filter's taps there."""
        weights = np.abs(self.taps)
        return LowPass(weights / weights.sum(), self.step, self.cutoff)

    def apply(self, rows: Array, margin: int = 0) -> Array:
        """Return filtered rows at `outputs(N, margin)`: (…, N) to (…, len(outputs)); single precision stays single."""
        centres = self.outputs(rows.shape[-1], margin)
        count = len(centres)
        shape = rows.shape[:-1]
        if count == 0:
            return np.zeros((*shape, 0))
        if len(self.taps) == 1:
            return np.asarray(rows[..., centres] * self.taps[0])
        flat = rows.reshape(-1, rows.shape[-1])
        begin = int(centres[0]) - self.half
        result = self._filtered(flat, begin, count)
        sound = np.isfinite(result)
        for row in () if sound.all() else np.flatnonzero(~sound.all(axis=1)):
            finite = np.isfinite(flat[row])
            holes = np.concatenate([[0], np.cumsum(~finite)])
            seen = holes[centres + self.half + 1] - holes[centres - self.half]
            filled = self._filtered(np.where(finite, flat[row], 0.0)[None], begin, count)[0]
            result[row] = np.where(seen > 0, np.nan, filled)
        return result.reshape(*shape, count)

    def _filtered(self, rows: Array, begin: int, count: int) -> Array:
        """Return `count` outputs of rows (r, N), the first of them of the window that begins at sample `begin`."""
        kind = np.float32 if rows.dtype == np.float32 else np.float64
        result = np.empty((len(rows), count), dtype=kind)
        tile = min(self._tile, count)
        matrix = self._matrix(tile).astype(kind, copy=False)
        whole = count // tile if len(rows) < _MANY else 0
        if whole > 1:  # of few rows all tiles at once: a call for each would take longer than its product
            view = rows[:, begin:]
            row, sample = view.strides
            shape, strides = (whole, len(rows), len(matrix)), (tile * self.step * sample, row, sample)
            tiles = np.lib.stride_tricks.as_strided(view, shape, strides, writeable=False)
            result[:, : whole * tile] = np.matmul(tiles, matrix).transpose(1, 0, 2).reshape(len(rows), whole * tile)
        for first in range(whole * tile if whole > 1 else 0, count, tile):
            last = min(first + tile, count)
            here = matrix if last - first == tile else self._matrix(last - first).astype(kind, copy=False)
            start = begin + first * self.step
            np.matmul(rows[:, start : start + len(here)], here, out=result[:, first:last])
        return result

    @property
    def _tile(self) -> int:
        """Outputs made by one matrix product: their windows should overlap by half; eight were measured fastest."""
        return 8 if self.step > 1 else 64

    def _matrix(self, outputs: int) -> Array:
        """Return what a stretch of samples is multiplied by to give so many outputs, (samples, outputs)."""
        if outputs not in self._matrices:
            matrix = np.zeros(((outputs - 1) * self.step + len(self.taps), outputs))
            for k in range(outputs):
                matrix[k * self.step : k * self.step + len(self.taps), k] = self.taps
            self._matrices[outputs] = matrix
        return self._matrices[outputs]

    @cached_property
    def _matrices(self) -> dict[int, Array]:
        """Matrices that were made, by their outputs."""
        return {}

    @cached_property
    def _differentiated(self) -> dict[float, LowPass]:
        """Filters of derivatives that were made, by the sample time."""
        return {}

    @cached_property
    def _thinned(self) -> dict[int, LowPass]:
        """Filters of thinned rows that were made, by how thin they are."""
        return {}


@lru_cache(maxsize=64)
def low_pass(cutoff: float, dt: float, step: int) -> LowPass:
    """Return a Kaiser-windowed sinc with its -6 dB point at `cutoff` (Hz), for sample time `dt` (s)."""
    if not np.isfinite(cutoff) or cutoff >= 0.5 / dt:
        return LowPass(np.ones(1), step, float("inf"))
    half = max(1, round(1.0 / (cutoff * dt)))
    k = np.arange(-half, half + 1)
    taps = np.sinc(2.0 * cutoff * dt * k) * np.kaiser(2 * half + 1, _KAISER)
    return LowPass(taps / taps.sum(), step, cutoff)

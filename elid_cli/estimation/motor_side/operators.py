"""Linear operators on evenly spaced samples: thinning, derivatives, low-pass, splines of unknown coefficients."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.lapack import lapack
from elid_cli.signals.splines import DEGREE, ORDER, basis

WIDTH, SHORT_WIDTH = 9, 5
"""Samples of a difference, and of one for small corrections."""
EDGE = 8
"""Samples at either end that no torque row touches: differences of differences reach beyond it."""
_KAISER = 4.5


def thin(values: Array, step: int) -> tuple[Array, float]:
    """Return every `step`-th sample of values (N, n) under a triangular kernel, and its gain on white noise."""
    if step == 1:
        return values.copy(), 1.0
    kernel = np.bartlett(2 * step + 1)[1:-1]
    kernel /= kernel.sum()
    smooth = np.stack([np.convolve(column, kernel, "valid") for column in values.T], axis=1)
    return smooth[::step], float(np.linalg.norm(kernel))


def stencil(count: int, order: int, width: int, dt: float) -> Any:
    """Return derivatives of `count` samples as a sparse matrix, each from the `width` samples around it.

    `order` is 1 or 2. Zero where these reach beyond an end.
    """
    from scipy.sparse import diags_array

    reach = width // 2
    inside = np.r_[np.zeros(reach), np.ones(count - 2 * reach), np.zeros(reach)]
    weights = centred(order, dt, width)
    bands = [weight * inside[max(0, -k) : count - max(0, k)] for k, weight in enumerate(weights, -reach)]
    return diags_array(bands, offsets=range(-reach, reach + 1), format="csr")


def centred(order: int, dt: float, width: int = WIDTH) -> Array:
    """Return the weights of the `order`-th derivative (1 or 2) in the middle of `width` samples (Fornberg 1988)."""
    powers = np.vander(np.arange(width) - width // 2, increasing=True).T.astype(float)
    wanted = np.zeros(width)
    wanted[order] = order / dt**order  # 1! = 1, 2! = 2
    found: Array = np.linalg.solve(powers, wanted)
    return found


def low_pass_rows(count: int, dt: float, cutoff: float) -> tuple[Any, float, NDArray[np.intp]]:
    """Return a low-pass with fewer rows than samples, its gain on white noise, and the samples its rows lie on.

    Zero phase, -6 dB at `cutoff`, Hz. No row lies at the very ends. Cut-offs near the Nyquist frequency: all
    other samples.
    """
    from scipy.sparse import csr_matrix, identity

    nyquist = 0.5 / dt
    if cutoff > 0.8 * nyquist:
        return identity(count, format="csr")[EDGE : count - EDGE], 1.0, np.arange(EDGE, count - EDGE)
    kernel = _kernel(int(np.ceil(0.8 / (cutoff * dt))), cutoff / nyquist)
    reach, step = len(kernel) // 2, max(1, int(1 / (2.9 * cutoff * dt)))
    centres = np.arange(reach + EDGE, count - reach - EDGE, step)
    index = centres[:, None] + np.arange(-reach, reach + 1)
    ends = np.arange(0, index.size + 1, len(kernel))
    matrix = csr_matrix((np.tile(kernel, len(centres)), index.ravel(), ends), shape=(len(centres), count))
    return matrix, float(np.linalg.norm(kernel)), centres


def _kernel(reach: int, share: float) -> Array:
    """Return a low-pass of 2 reach + 1 weights, -6 dB at a share of the Nyquist frequency."""
    place = np.arange(-reach, reach + 1)
    kernel: Array = np.sinc(share * place) * np.kaiser(2 * reach + 1, _KAISER)
    kernel /= kernel.sum()
    return kernel


def filtered(values: Array, dt: float, cutoff: float, width: float = 1.2) -> tuple[Array, int]:
    """Return values (N, n) under a zero-phase low-pass, ends reflected oddly, and half its length in samples."""
    kernel = _kernel(int(width / (cutoff * dt)), min(2 * cutoff * dt, 0.95))
    reach = min(len(kernel) // 2, len(values) - 2)
    if reach < 1:
        return values, 0
    kernel = kernel[len(kernel) // 2 - reach : len(kernel) // 2 + reach + 1]
    before, after = 2 * values[0] - values[reach:0:-1], 2 * values[-1] - values[-2 : -reach - 2 : -1]
    whole = np.concatenate([before, values, after])
    size = 1 << (len(whole) + len(kernel) - 2).bit_length()
    spectrum = np.fft.rfft(whole, size, axis=0) * np.fft.rfft(kernel, size)[:, None]
    found: Array = np.fft.irfft(spectrum, size, axis=0)[2 * reach : len(whole)]
    return found, reach


def taper(count: int, reach: int) -> Array:
    """Return the window of a stretch of `count` samples, (N, 1): nothing where filters of `reach` reach beyond it."""
    empty, rise = min(reach // 2, count // 20) + 8, max(20, count // 40)
    edge = np.r_[np.zeros(empty), 0.5 - 0.5 * np.cos(np.pi * (np.arange(rise) + 0.5) / rise)]
    window = np.ones(count)
    window[: len(edge)], window[-len(edge) :] = edge, edge[::-1]
    return window[:, None]


class KnotSpline:
    """Quintic splines with even knots over samples: contiguous blocks of six basis values per sample.

    Parameters
    ----------
    t
        Time of the samples, s, (N,).
    spacing
        Wanted distance of knots, s.
    """

    def __init__(self, t: Array, spacing: float) -> None:
        intervals = max(8, round(float(t[-1] - t[0]) / spacing))
        self.width = float(t[-1] - t[0]) / intervals
        self.count, self._start = intervals + DEGREE, float(t[0])
        self.first, self._local = self._placed(t)

    def values(self, derivative: int) -> Array:
        """Return the six basis values' derivatives at every sample, (N, 6)."""
        found: Array = basis(self._local, derivative) / self.width**derivative
        return found

    def _placed(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the interval of every instant and where in it, 0 to 1, that lies; beyond the ends, at them."""
        place = (t - self._start) / self.width
        first = np.clip(place.astype(np.intp), 0, self.count - DEGREE - 1)
        return first, np.clip(place - first, 0.0, 1.0)

    def at(self, t: Array, coefficients: Array) -> Array:
        """Return the values of coefficients (count, n) at instants t (M,), (M, n)."""
        first, local = self._placed(t)
        found: Array = np.einsum("ml,mln->mn", basis(local), coefficients[first[:, None] + np.arange(ORDER)])
        return found

    @cached_property
    def matrices(self) -> list[Any]:
        """Values and four derivatives as sparse matrices, (N, count)."""
        from scipy.sparse import csr_matrix

        index = self.first[:, None] + np.arange(ORDER)
        ends = np.arange(0, index.size + 1, ORDER)
        shape = len(self.first), self.count
        return [csr_matrix((self.values(d).ravel(), index.ravel(), ends), shape=shape) for d in range(DEGREE)]

    @cached_property
    def _factor(self) -> Any:
        band = upper_band(self.matrices[0].T @ self.matrices[0], DEGREE, 1e-9)
        factor, info = lapack().dpbtrf(np.asfortranarray(band), overwrite_ab=1)
        if info:
            raise np.linalg.LinAlgError("not positive definite")
        return factor

    def fit(self, values: Array) -> Array:
        """Return the coefficients (count, n) that come nearest values (N, n)."""
        found: Array = lapack().dpbtrs(self._factor, self.matrices[0].T @ values)[0]
        return found


def upper_band(matrix: Any, width: int | None = None, ridge: float = 0.0) -> Array:
    """Return a symmetric sparse matrix in upper band storage, its diagonal raised by a share of its largest."""
    entries = matrix.tocoo()
    upper = entries.row <= entries.col
    row, column, data = entries.row[upper], entries.col[upper], entries.data[upper]
    reach = int((column - row).max()) if width is None else width
    band = np.zeros((reach + 1, matrix.shape[1]))
    np.add.at(band, (reach + row - column, column), data)
    band[reach] += ridge * band[reach].max()
    return band

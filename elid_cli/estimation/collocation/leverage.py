"""What a fit takes out of its own scores, parameter by parameter.

Fitted residuals are smaller than the noise, and correlated by the fit over as long as its columns last: the kernel's
sum over the scores falls short of their long-run covariance by what it collects of that. Where the noise is white, or
remembers for less long than the columns last, the share that is left is known (Bell and McCaffrey 2002 for clusters).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.regression.long_run import NARROWEST, KernelSum

Array = NDArray[np.float64]

LEAST_LEFT = 0.5
"""Smallest share of a long-run variance that is believed to be left."""
LASTING = 0.4
"""How much more of noise that remembers for long a fit takes out than of white noise. Measured: with a memory of 50 ms
(planar arm, 100 logs) errors were 1.05 of standard errors that did not know of it."""


def left(information: Array, inverse: Array, stretch: NDArray[np.intp], bandwidth: float, together: int = 1) -> Array:
    """Return the share of every estimate's long-run variance that the kernel's sum over fitted scores holds, (p,).

    Parameters
    ----------
    information
        What each instant adds to the normal matrix, (M, p, p): its scores' covariance J in white noise.
    inverse
        Inverse A of the normal matrix, (p, p). Scores of a fit have covariance J_t - J_t A J_t at an instant and
        -J_t A J_s between two.
    stretch
        Number of the stretch of every instant, (M,).
    bandwidth
        The kernel's, instants.
    together
        Instants that one matrix stands for.
    """
    size = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    size[size == 0] = 1.0
    unit = inverse / size[None]
    spread, turn = np.linalg.eigh(inverse / np.outer(size, size))
    half = size[:, None] * turn * np.sqrt(np.maximum(spread, 0.0))
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    shares = np.ones(len(inverse))
    for k in range(len(inverse)):
        moved = information @ unit[:, k]
        whole = float(np.sum(moved @ unit[:, k]))
        if not whole > 0:
            continue
        taken = KernelSum(len(inverse), (bandwidth + 1.0) / together - 1.0)
        series = np.ascontiguousarray((moved @ half).T)
        for number, (start, stop) in enumerate(zip(starts, [*starts[1:], len(stretch)], strict=True)):
            taken.feed(series[:, start:stop], number)
        shares[k] = 1.0 - float(np.trace(taken.total())) / whole
    lasting = 1.0 + LASTING * (1.0 - NARROWEST / max(bandwidth, NARROWEST))
    return np.clip(1.0 - lasting * (1.0 - shares), LEAST_LEFT, 1.0)

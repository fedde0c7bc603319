"""How surely a log decides between two effects, by the rules that a diagnosis decides by.

With a log whose noise is white once whitened, the log-likelihood by which the true effect beats its rival is normal
about half the squared separation T (the part of the difference that the rival, everything else refitted, cannot
imitate, in standard deviations of the noise), with variance T. A diagnosis names one effect alone where that exceeds
what it calls near (`diagnosis.search.forward`), and names an effect at all where it takes enough of the residual.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.search.forward import NET
from elid_cli.diagnosis.search.steps import NEAR, NEAR_SHARE, TWIN_SHARE
from elid_cli.estimation.stretches import HELD_OUT, SEARCHED

TRAINED = 1.0 - len(HELD_OUT) / SEARCHED
"""Share of a log that a search sees."""
PRICE = 8.0
"""Log-likelihood that an effect's parameters and the choice among shapes and joints cost a search, about."""
LEAST = 0.5
"""Least lead in log-likelihood whose scatter is asked for."""
LOOSE = 0.3
"""Relative uncertainty of the part of the variance that an effect takes from held-out stretches."""


@dataclass(frozen=True)
class Distance:
    """What a log of one motion shows if one hypothesis is true: by channel, its rows whitened."""

    seen: Array
    """Squared residual of the model without either, (channels,)."""
    apart: Array
    """Squared residual of the model with the rival, (channels,)."""
    itself: Array
    """Squared residual of the model with the true effect as a search sees it, (channels,): 0 but to higher orders."""
    counted: Array
    """Independent equations, (channels,)."""
    taken: float
    """Part of the variance of its rows that the effect takes away."""
    least: float
    """Part of the held-out variance that the true effect has to take in order to be named."""
    twins: bool
    """Whether the two are declared to imitate each other, which a diagnosis then says longer."""

    @property
    def sigma(self) -> float:
        """Separation in standard deviations."""
        return float(np.sqrt(max(self.apart.sum() - self.itself.sum(), 0.0)))

    @property
    def probability(self) -> float:
        """Probability that a diagnosis of the log names the true effect, and it alone."""
        named, alone = self.margins
        return float(_normal(named) * _normal(alone))

    @property
    def margins(self) -> tuple[float, float]:
        """Standard deviations by which the effect clears what it needs to be named, and to be named alone."""
        gain, lead = (_likelihood(other, self.itself, self.counted) for other in (self.seen, self.apart))
        enough = (self.taken - self.least) / (LOOSE * self.least)
        named = min((gain - NET - PRICE) / float(np.sqrt(2 * max(gain, LEAST))), enough)
        needed = max(NEAR, NEAR_SHARE * gain, (1 - TWIN_SHARE) * gain if self.twins else 0.0)
        return named, (lead - needed) / float(np.sqrt(2 * max(lead, LEAST)))

    def times(self, factor: float) -> Distance:
        """Return what a log so many times as long would show."""
        return replace(self, seen=factor * self.seen, apart=factor * self.apart, itself=factor * self.itself,
                       counted=factor * self.counted)  # fmt: skip


def _likelihood(worse: Array, better: Array, counted: Array) -> float:
    """Return the expected lead in log-likelihood where the noise's size is estimated along."""
    ratio = (counted + worse) / np.maximum(counted + better, 1e-300)
    return float(np.sum(0.5 * counted * np.log(np.maximum(ratio, 1e-300))))


def _normal(z: float) -> float:
    from math import erf, sqrt

    return 0.5 * (1.0 + erf(z / sqrt(2.0)))

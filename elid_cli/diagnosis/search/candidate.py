"""An effect that may be what a model lacks, at one joint and in its best shape, and whether data support it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from elid_cli.diagnosis.fit.gain import Gain
from elid_cli.diagnosis.fit.projection import LEAST_SHARE
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.model.effects.effect import Effect

FOLDS_LOST = 1
"""Folds in which an effect may fail to help, of those in which it acts."""
NET_UNSEEN = 40.0
"""Net gain of an effect that acts in a part of the log, which noise of a colour of its own imitates most easily."""


@dataclass(frozen=True)
class Candidate:
    """An effect at one joint with its best shape."""

    effect: Effect
    columns: ExtraColumns
    gain: Gain
    choice: float
    """Price of the search: the logarithm of how many shapes and places were looked at."""
    values: Mapping[str, float]
    plausible: bool
    shapes: int
    """Shapes that were tried."""
    forms: tuple[tuple[float, ...], ...] = ()
    """The best shape of every form: of every combination of the shapes that are a choice (an exponent, a partner)."""

    @property
    def key(self) -> tuple[str, int]:
        """Effect name and joint."""
        return self.effect.name, self.effect.joint

    @property
    def rank(self) -> tuple[bool, float]:
        """What the forms of one effect are ordered by."""
        return self.plausible, self.gain.whole - self._price(self.gain.count)

    @property
    def price(self) -> float:
        """What its parameters and the search cost."""
        return self._price(self.gain.count * self.gain.share)

    def _price(self, equations: float) -> float:
        free = self.gain.width + len(self.effect.shape)
        return 0.5 * free * float(np.log(max(equations, 2.0))) + self.choice

    @property
    def net(self) -> float:
        """Gain in log-likelihood minus the price of its parameters and of the search."""
        return self.gain.likelihood - self.price

    @property
    def most(self) -> float:
        """The most that `net` can be, whatever share of the equations is independent: in it, it is convex."""
        shares = (LEAST_SHARE, 1.0)
        return max(self.gain.whole * share - self._price(self.gain.count * share) for share in shares)

    def merit(self, share: float) -> float:
        """Net gain with `share` of the instants counted: candidates for one residual are compared at the same share.

        What a candidate leaves over tells how many instants are independent. If that is noise whose colour the sensors
        do not explain, the best candidate is the one that shows it, and must not be punished for it.
        """
        return self.gain.whole * share - self.price

    @property
    def supported(self) -> bool:
        """Whether data that did not fit it support it."""
        if self.effect.local and self.net <= NET_UNSEEN:
            return False
        alone = self.effect.local and int(self.gain.acting.sum()) < 2
        return self.plausible and (alone or validated(self.gain))

    @property
    def size(self) -> int:
        """Number of free parameters: amplitudes, and shapes that are refined."""
        return self.gain.width + sum(1 for p in self.effect.shapes if not p.fixed)


def validated(gain: Gain) -> bool:
    """Whether columns help in all but one of the folds in which they act, each predicted from the others."""
    acting = gain.acting
    won = int(np.sum(gain.folds[acting] > 0))
    return won >= max(int(acting.sum()) - FOLDS_LOST, 1) and float(np.sum(gain.folds)) > 0

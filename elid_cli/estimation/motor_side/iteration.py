"""How long a fit iterates: until it has settled, or what was asked about its cost is answered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_FAR, _FAR_FALL = 10.0, 0.3
"""Costs beyond this many times the one asked about, falling by less than that share, will not come down to it."""
_HOPELESS = 100.0
"""Steps as large as the last one that a fit would need to come down to it, from which on it is not waited for."""
_AT_ONCE = 3.0
"""A first step's foreseen cost over what is clearly above, from which on no second one is waited for."""
_REPEATED, _NEAR = 4, 0.25
"""Steps in a row that foresee more than this share of the way to what is clearly above, and settle it, too."""
_CREEP = 3
"""Steps that together must lower the cost by more than the tolerance, whether the compliances have settled or not."""


@dataclass(frozen=True)
class Iteration:
    """How a fit iterates."""

    steps: int = 12
    tolerance: float = 1e-3
    robust: bool = True
    settle: bool = False
    """Whether it goes on until the compliances have settled."""
    near: float = 0.0
    """Move of a compliance, share of it, that counts as settled in any case."""
    least: int = 2
    """Fewest steps."""
    low: float = 0.0
    """Cost that is low enough to end."""
    high: float = np.inf
    """Cost that is asked about: far above it, and falling slowly, no more is to be learnt."""
    above: float = np.inf
    """Cost clearly above it: nothing more is to be learnt where two steps in a row foresee more."""

    def decided(self, cost: float, fall: float, foreseen: Sequence[float]) -> bool:
        """Return whether a cost that fell by a share of it, to at least what is foreseen, answers what was asked.

        `foreseen` are the costs that all steps so far foresee, the last one last.
        """
        if len(foreseen) < self.least:
            return foreseen[-1] > _AT_ONCE * self.above
        above = cost > _FAR * self.high and fall < _FAR_FALL
        hopeless = (cost - self.high) * (1 - fall) > _HOPELESS * cost * fall
        near = min(foreseen[-_REPEATED:]) if len(foreseen) >= _REPEATED else 0.0
        clear = min(foreseen[-2:]) > self.above or near > self.high + _NEAR * (self.above - self.high)
        return cost < self.low or above or hopeless or clear

    def creeps(self, costs: Sequence[float]) -> bool:
        """Return whether the last of a fit's costs fell by too little together to go on for."""
        if len(costs) <= _CREEP or not np.isfinite(self.tolerance):
            return False
        return costs[-1 - _CREEP] - costs[-1] < self.tolerance * costs[-1]

"""What adding columns to a whitened problem would gain, and the judgement that only the better ones are asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.regressor import EstimationRow

if TYPE_CHECKING:
    from elid_cli.diagnosis.fit.projection import Projected
JUDGED = 16
"""Candidates that are judged at once."""


class Judgement(NamedTuple):
    """What of a gain only the better candidates are asked for."""

    share: float
    folds: Array
    energy: Array


@dataclass(frozen=True)
class Unit:
    """Columns of length one that the model does not span."""

    parts: Mapping[int, Array]
    """What they are in the channels that they act on, (d, k) by number of the channel …"""
    shared: Array
    """… and in others the basis times the negative of this, (d, r)."""
    solved: Array
    """Their fitted coefficients, (d,)."""


@dataclass(frozen=True)
class Gain:
    """What adding columns would gain."""

    whole: float
    """Gain in log-likelihood with every instant counted: what candidates for one residual are compared by."""
    coefficients: Array
    """Fitted coefficients of the columns, (d,)."""
    width: int
    """Columns that were not already explained."""
    count: int
    """Whitened equations."""
    source: tuple[Projected, Mapping[EstimationRow, Array]] | None = field(repr=False)
    """The problem and the columns, from which the judgement is computed when asked …"""
    known: Judgement | None = None
    """… or the judgement."""

    @cached_property
    def _judgement(self) -> Judgement:
        if self.known is None and self.source is not None:
            return self.source[0].judged([self.source[1]])[0]
        assert self.known is not None
        return self.known

    @property
    def share(self) -> float:
        """Share of the equations that counts as independent."""
        return self._judgement.share

    @property
    def likelihood(self) -> float:
        """Gain in log-likelihood, only instants counted that what is left over leaves independent."""
        return self.whole * self.share

    @property
    def folds(self) -> Array:
        """Reduction of the squared whitened residual per fold, predicted from the other folds, (folds,)."""
        return self._judgement.folds

    @property
    def energy(self) -> Array:
        """Share of the columns' squares per fold, (folds,): where the effect acts at all."""
        return self._judgement.energy

    @property
    def acting(self) -> NDArray[np.bool_]:
        """Folds in which the effect acts, (folds,)."""
        return self.energy > 0.01


def settled(gains: Sequence[Gain]) -> list[Gain]:
    """Return gains with everything computed, so that the problem need not be kept."""
    found = list(gains)
    for first in range(0, len(gains), JUDGED):
        todo = [(k, g.source) for k, g in enumerate(gains[first : first + JUDGED], first) if g.source is not None]
        if todo:
            judgements = todo[0][1][0].judged([source[1] for _, source in todo])
            for (k, _), judgement in zip(todo, judgements, strict=True):
                found[k] = replace(gains[k], source=None, known=judgement)
    return found

"""What other parameters of a fit may have taken up: factors on torques, wrong zeros, torques like a weight's."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.judgement import NotExcluded
from elid_cli.estimation.validation.absorbed_gains import absorbed_gains
from elid_cli.estimation.validation.absorbed_weight import absorbed_weight
from elid_cli.estimation.validation.absorbed_zeros import absorbed_zeros
from elid_cli.estimation.validation.following import FACTOR, TURN, WEIGHT, ZERO
from elid_cli.model.regressor import EstimationRow

SURER = 0.85
"""Part of the standard errors of a torque's factor or a zero of positions from which a torque like weight's is told."""


class TakenUp(NamedTuple):
    """What other parameters took up, or would without a sign."""

    off: list[tuple[str, tuple[int, ...]]]
    """What is surely there, and at which joints; the surest last."""
    moved: NDArray[np.bool_]
    """Base parameters that it moves, (b,)."""
    notes: tuple[str, ...]
    """What is told of it, in sentences."""
    bounds: tuple[NotExcluded, ...]
    """What would not show, from what moves parameters most."""


def taken_up(
    fit: DefaultFit, still: Mapping[EstimationRow, float], lacking: Container[EstimationRow], *, quiet: bool
) -> TakenUp:
    """Return what other parameters of a fit took up.

    Parameters
    ----------
    fit
        The fit, whose samples are at hand.
    still
        Residual of every row, N·m (N), up to which noise is all that is left.
    lacking
        Rows that lack something.
    quiet
        Whether noise is all that is left of every row: else what is missing may look like these.
    """
    gains, zeros = absorbed_gains(fit, still, lacking), absorbed_zeros(fit, still, lacking)
    weight = absorbed_weight(fit, still, lacking)
    told = quiet and weight.sure > SURER * max(gains.sure, zeros.sure)  # what else is missing may look like these
    off = (
        [(gains.sure, FACTOR, gains.joints), (zeros.sure, TURN if zeros.turns else ZERO, zeros.joints[:1])]
        if quiet
        else []
    )
    off += [(weight.sure, WEIGHT, weight.joints)] if told else []
    ordered = [(word, joints) for _, word, joints in sorted(off, key=lambda item: item[0])]
    notes = weight.notes if told else zeros.notes if quiet and not (gains.joints or zeros.joints) else ()
    bounds = sorted((*gains.bounds, *zeros.bounds, *weight.bounds), key=lambda item: -item.moves)
    return TakenUp(ordered, np.any([gains.moved, zeros.moved, weight.moved], axis=0), notes, tuple(bounds))

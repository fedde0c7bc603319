"""Whether the torque of one joint is off by a factor against the others': other parameters take that up.

One joint's torque enters its own equations alone, while bodies are common to several: a factor on it shows in what
these do not agree on. Frictions, rotors and first moments take up most of it, off by many of their standard errors, and
what is left drowns in the noise. Its size is asked instead, as the diagnosis does (`diagnosis.search.absorbed`).
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.judgement import NotExcluded
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.estimation.validation.size_beside import askable, bound_of, size_beside
from elid_cli.model.effects import effect_that
from elid_cli.model.regressor import EstimationRow

SURE, NOISY = 5.0, 1.4
"""Standard errors by which a gain must differ from 0, and factor on these where elastic joints have two encoders: their
noise in the columns is in no standard error."""
LEAST = 0.005
"""Gain that counts: sensors and constants of torques are hardly known better."""
AS_WELL = 0.85
"""Part of the standard errors of the surest gain from which another joint's may be the one: of two joints, either."""


class AbsorbedGains(NamedTuple):
    """Gains of torques that a fit took for other values of its parameters."""

    joints: tuple[int, ...]
    """Whose torque it is, the surest first: one of them, or several."""
    moved: NDArray[np.bool_]
    """Base parameters that they move, (b,)."""
    sure: float = 0.0
    """Standard errors by which the surest differs from 0."""
    bounds: tuple[NotExcluded, ...] = ()
    """Up to which sizes the others would not show."""


def absorbed_gains(
    fit: DefaultFit, quiet: Mapping[EstimationRow, float], lacking: Container[EstimationRow] = ()
) -> AbsorbedGains:
    """Return the gains of torques that a fit shows, each taken alone, where several joints have a logged torque.

    Parameters
    ----------
    fit
        The fit, whose samples are at hand.
    quiet
        Residual of every row, N·m, up to which noise is all that is left: what a gain must come down to. Where more is
        missing, that may look like a gain.
    lacking
        Rows that lack something. Other joints' need not come down to noise by a gain: beside what they lack, it may be.
    """
    none = AbsorbedGains((), np.zeros(fit.base.count, dtype=bool))
    # beside friction by load, whose columns hold noise and hang on the fit, 1.5 % was 19 of its errors from 0
    extras = _columns(fit) if askable(fit) else {}
    held = [item.effect for item in fit.effects.effects] if fit.effects else []
    extras = {k: extra for k, extra in extras.items() if k not in {e.joint for e in held if e.of_drive == "gain"}}
    if len(extras) < 2:  # a factor common to all scales every parameter
        return none
    least = SURE * (NOISY if fit.model.robot.elastic.any() else 1.0)
    kind = effect_that(of_drive="gain")
    found, bounds = dict[int, tuple[float, float, NDArray[np.bool_]]](), list[NotExcluded]()
    for joint, extra in extras.items():
        judged = [row for row in quiet if row.joint == joint or row not in lacking]
        asked = size_beside(fit, extra, {row: quiet[row] for row in judged})
        if asked is not None:
            found[joint] = float(asked.values[0]), asked.sure, asked.moved
            bound = bound_of(fit, kind(joint), extra, asked, least)
            if bound and asked.sure <= least and bound.up_to > LEAST:
                bounds.append(bound)
    sure = {k: item for k, item in found.items() if item[1] > least and abs(item[0]) > LEAST}
    most = max((item[1] for item in sure.values()), default=0.0)
    told = sorted((k for k, item in sure.items() if item[1] >= AS_WELL * most), key=lambda k: -sure[k][1])
    moved = np.any([none.moved, *(sure[k][2] for k in told)], axis=0)
    return AbsorbedGains(tuple(told), moved, most, tuple(bounds))


def _columns(fit: DefaultFit) -> dict[int, ExtraColumns]:
    """Return the torque that the fit predicts as a column in the rows of each joint's motor."""
    observation = fit.observation
    left = residuals(observation, fit.solution.values, fit.extras)
    present = {group.row for group in observation.groups if group.count}
    found = {}
    for k in range(fit.model.robot.n):
        whole = EstimationRow("sum", k)
        if whole not in present or whole not in left:
            continue
        predicted: Array = (observation.tau[k] - left[whole])[None]
        acted = (whole, EstimationRow("motor", k), EstimationRow("drive", k))
        found[k] = ExtraColumns("gain", {row: predicted for row in acted if row in present}, ("1",))
    return found

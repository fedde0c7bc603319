"""Stiffness and noise in the deflection: errors in variables, which standard errors do not see.

The deflection q - theta is a small difference of two measured positions. What remains of it after the other columns
of the motor row are taken off decides K; where that is not well above the encoders' noise in it, the estimate is
pulled towards 0 however small its standard error looks. A clock skew between the encoders adds a multiple of the
velocity, which viscous friction takes off along.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elid_cli.fitting import Fit
from elid_cli.model import Row
from elid_cli.reduction import full_columns

Array = NDArray[np.float64]

LARGEST_SHARE = 0.2
"""Share of the deciding deflection's energy that noise may have: K is then pulled by as much."""


def unsupported_stiffness(fit: Fit) -> dict[str, str]:
    """Return stiffness parameters that this log cannot support, with the reason."""
    refused = {}
    for k, joint in enumerate(fit.model.robot.joints):
        if not joint.elastic:
            continue
        share = noise_share(fit, k)
        if share is not None and share > LARGEST_SHARE:
            reason = f"{min(share, 1.0):.0%} of the deflection that would tell it is encoder noise in {joint.name}"
            refused[f"K{k + 1}"] = reason
    return refused


def noise_share(fit: Fit, joint: int) -> float | None:
    """Return the share of noise in the energy of the deflection that decides K of a joint; None where not known."""
    row = Row("motor", joint)
    group = next((g for g in fit.observation.groups if g.row == row and g.count), None)
    if group is None:
        return None
    index, columns = full_columns(group, fit.extras, fit.model.parameters)
    own = fit.model.index[f"K{joint + 1}"]
    place = np.flatnonzero(index == own)
    if not len(place):
        return None
    basis = set(fit.solution.basis.tolist())
    others = [k for k, column in enumerate(index) if column != own and int(column) in basis]
    deflection = columns[place[0]][group.use]
    rest = deflection
    if others:
        matrix = columns[others][:, group.use].T
        size = np.linalg.norm(matrix, axis=0)
        matrix = matrix[:, size > 0] / size[size > 0]
        rest = deflection - matrix @ np.linalg.lstsq(matrix, deflection, rcond=1e-10)[0]
    left = float(np.mean(rest**2))
    return float(deflection_noise(fit, joint) ** 2 / max(left, 1e-300))


def deflection_noise(fit: Fit, joint: int) -> float:
    """Return the standard deviation of encoder noise in the smoothed, filtered deflection, rad (m)."""
    signals = fit.signals
    raw = float(np.hypot(signals.noise.q[joint], signals.noise.theta[joint]))
    knots = float(signals.knots[joint])
    # a least-squares spline keeps one coefficient's worth of noise per knot; the filter keeps the energy of its taps
    spline = signals.dt / knots if np.isfinite(knots) and knots > 0 else 1.0
    kept = min(1.0, spline, float(np.sum(signals.filter.taps**2)))
    return raw * float(np.sqrt(kept))

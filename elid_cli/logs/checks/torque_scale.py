"""The scale of a torque, told by the spring behind the motor: tau = K (theta - q) + what follows the motor's motion."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from elid_cli._types import Array

WRONG_SCALE = 3.0
"""Factor between tau and the spring's torque by the file's stiffness that no wrong reference value explains."""
FOLLOWS = 0.95
"""|correlation| of torque and deflection above which their relation is judged."""
RELATED = 0.8
"""Correlation of what is left of both from which their slope shows the torque's scale: noise of the deflection lowers
the slope by the square of this at most."""
OWN = 0.1
"""Least part of the deflection's spread that the motor's own motion must leave for the torque's scale to show."""
SAME = 1.5
"""Factor between a spring's slope and the file's stiffness up to which both are one spring."""
BLOCKS = 8
"""Parts of a log that are left out in turn for a slope's standard error."""
SURE = 4.0
"""Standard errors by which a slope must be beyond `WRONG_SCALE`."""
LAG = 0.02
"""s; differences over this time are the speed and acceleration that the motor's friction and inertia follow."""


class Slope(NamedTuple):
    """Of a joint's torque over its deflection, beside what follows the motor's own motion; NaN: it does not show."""

    correlation: float = math.nan
    ratio: float = math.nan
    """N·m/rad (N/m)."""
    deviation: float = math.nan
    """Standard error of the ratio, from blocks left out in turn."""

    def scale(self, stiffness: float) -> float:
        """Return the ratio over a stiffness; NaN where no such shows, or where it may still be the right one."""
        scale, margin = self.ratio / stiffness, SURE * self.deviation / stiffness
        shown = self.correlation > RELATED and off(scale) in (0, off(scale + margin) * off(scale - margin) * off(scale))
        return scale if shown else math.nan


def spring_slope(theta: Array, deflection: Array, tau: Array, dt: float) -> Slope:
    """Return the slope of torque over deflection beside what follows the motor's own motion.

    Where the link's load is viscous or an inertia, the deflection follows the motor's speed or acceleration, and so do
    the motor's own friction and inertia: the torque is then many times that of the spring, in N·m all the same.

    Parameters
    ----------
    theta, deflection, tau
        Of one joint, without gaps, (N,): rad (m) and N·m (N).
    dt
        Sample time, s.
    """
    lag = max(1, round(LAG / dt))
    if len(theta) < 4 * lag + 8 or not np.isfinite(tau).all():
        return Slope()
    here = slice(lag, -lag)
    ahead, behind = theta[2 * lag :], theta[: -2 * lag]
    speed, bend = ahead - behind, ahead - 2.0 * theta[here] + behind
    own = np.column_stack([np.ones_like(speed), speed, np.sign(speed), bend])
    return slope_beside(own, deflection[here], tau[here], OWN)


def slope_beside(own: Array, x: Array, y: Array, least: float) -> Slope:
    """Return the slope of a torque y over x, (N,), beside other columns (N, c).

    It does not show where these leave less than a part `least` of the spread of x.
    """
    return slopes_beside(own, x[:, None], y, least)[0]


def slopes_beside(own: Array, several: Array, y: Array, least: float) -> list[Slope]:
    """Return the slopes of a torque y, (N,), over each of several columns, (N, k), beside others as `slope_beside`."""
    sizes = np.sqrt(np.einsum("ij,ij->j", own, own))
    own = own / sizes if sizes.all() else own[:, sizes > 0] / sizes[sizes > 0]
    both = np.column_stack([several, y])
    *alone, torque = np.ascontiguousarray((both - own @ np.linalg.lstsq(own, both, rcond=None)[0]).T)
    spreads = np.ascontiguousarray(several.T).std(axis=1)  # along memory: three times as fast
    return [_slope(x, torque, least * float(spread)) for x, spread in zip(alone, spreads, strict=True)]


def _slope(x: Array, y: Array, least: float) -> Slope:
    """Return the slope of y over x, (N,); it does not show where the rms of x is at most `least`."""
    size = math.sqrt(float(x @ x)) * math.sqrt(float(y @ y))
    if math.sqrt(float(x @ x) / x.size) <= least or not size > 0:
        return Slope()
    blocks = np.arange(BLOCKS)
    starts = blocks * (x.size // BLOCKS) + np.minimum(blocks, x.size % BLOCKS)
    products, powers = np.add.reduceat(x * y, starts), np.add.reduceat(x * x, starts)
    product, power = float(products.sum()), float(powers.sum())
    without = (product - products) / (power - powers)
    deviation = math.sqrt((BLOCKS - 1) / BLOCKS * float(np.sum((without - product / power) ** 2)))
    return Slope(product / size, product / power, deviation)


def is_spring(deflection: Array, tau: Array, own: Slope, stiffness: float) -> bool:
    """Whether deflection and torque, (N,), are those of a spring of a stiffness, N·m/rad (N/m).

    `own` is what `spring_slope` says of them. Where the deflection follows the motor's own motion alone, its whole
    torque must be large enough to bend the spring so far.
    """
    if own.correlation > RELATED:
        return 1 / SAME < own.ratio / max(stiffness, 1e-300) < SAME
    correlation = correlation_of(deflection, tau)
    return correlation > RELATED and bool(SAME * correlation * tau.std() > stiffness * deflection.std() > 0)


def off(ratio: float) -> int:
    """Return to which side a ratio is further from 1 than a wrong reference value explains; 0 where it is not."""
    return (ratio > WRONG_SCALE) - (ratio < 1 / WRONG_SCALE)


def correlation_of(deflection: Array, tau: Array) -> float:
    """Return the correlation of torque and deflection; 0 where the torque is unknown or one stands still."""
    if not np.isfinite(tau).all():
        return 0.0
    one, other = deflection - deflection.mean(), tau - tau.mean()
    size = math.sqrt(float(one @ one)) * math.sqrt(float(other @ other))
    return float(one @ other) / size if size else 0.0


def scale_of(deflection: Array, tau: Array, own: Slope, stiffness: float | None) -> float:
    """Return tau over the torque that the deflection and the robot file's stiffness mean; NaN where it does not show.

    `own` is what `spring_slope` says of them once friction and inertia are taken out.
    """
    correlation = correlation_of(deflection, tau)
    if not stiffness or correlation == 0.0:
        return math.nan
    if correlation > FOLLOWS:
        whole = correlation * float(tau.std() / deflection.std()) / stiffness
        # beside the motor's own friction and inertia the spring's torque must be as far off, to the same side
        return whole if off(whole) == 0 or off(whole) * off(own.ratio / stiffness) > 0 else math.nan
    return own.scale(stiffness)

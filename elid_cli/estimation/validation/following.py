"""Whether a residual follows the motion, and by which curves.

A residual that follows the motion is predicted, stretch by stretch, from what the other stretches show of smooth
curves over it: a joint's speed, position, load, deflection, the other joints' speeds, and the course of the log. How
much of it chance would predict is told by the same residual moved round in time against the motion: that keeps its
memory and breaks the tie. A residual that remembers as long as the torque itself does is no noise of a sensor, whatever
it follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.stretches import STRETCHES, stretch_of
from elid_cli.model.effects.rows import derivative
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import Signals

ROUNDS = 60
"""Times that a residual is moved round against the motion."""
BEYOND, LEAST = 4.0, 0.1
"""Deviations of what chance predicts, and part of the residual, beyond which it follows the motion."""
PIECES = 4
"""Pieces per fold: what changes in the course of a log is predicted from before and after."""
ALSO = 0.7
"""Part of the best group's prediction from which another group of curves is taken as possible, too."""
PACE = "pace"
"""What a residual follows that is as slow as the torque and follows no group of curves."""
LOGS = "logs"
"""What a residual follows that differs between logs which were fitted together."""
APART = "rows"
"""What a residual follows that its row's own parameters would take: rows that share them ask for other values."""
TIME, OTHERS = "time", "other joints' speed"
"""Groups that are no variable of a joint itself: much may follow them."""
DEFLECTION = "deflection alone"
"""What a residual follows that the whole joint's torque has hardly any of: no torque noise, but a fault of the
transmission or its encoders."""
FACTOR = "factor"
"""What a residual follows that holds next to nothing of a gain of its torque, which other values took up."""
ZERO = "zero"
"""The same of a zero of its positions that is off, or of a tilt of the base."""
TURN = "turn"
"""The same of positions that are off once per turn, as those of an encoder off its centre are."""
WEIGHT = "weight"
"""The same of a torque that is nearly that of a weight, as a weak spring's is."""
SLOW = 0.5
"""Part of the torque's memory from which a residual is too slow for noise."""
TAKEN = 0.3
"""Part of a residual that the row's own parameters must take, which fitted to the row alone they would."""
RIDGE = 1e-4
"""Damping of the curves' coefficients, of the strongest direction."""


@dataclass(frozen=True)
class Followed:
    """How much of a residual follows the motion."""

    share: float
    """Part of the residual's variance that the other stretches predict."""
    beyond: bool
    """Whether chance would not."""
    groups: tuple[str, ...]
    """Groups of curves that predict it, best first."""


def motion_curves(signals: Signals, joint: int, robot: Robot, load: Array) -> dict[str, Array]:
    """Return groups of curves over the motion at the fit's instants, (d, M) each, every curve of size 1 or so.

    `load` is the torque that the model predicts, (M,): the measured one holds the noise that is to be told apart.
    """
    theta, q, dtheta, dq, ddtheta = np.concatenate([_filtered(signals, part) for part in signals.segments], axis=-1)

    def unit(values: Array) -> Array:
        return values / max(float(np.quantile(np.abs(values), 0.98)), 1e-12)

    def bends(values: Array) -> list[Array]:
        """Return curves through 0, the first three of which bend near it."""
        values = unit(values)
        low = [max(float(np.quantile(np.abs(values), share)), 1e-3) for share in (0.03, 0.1, 0.3)]
        return [*(np.tanh(values / at) for at in low), values, np.abs(values) * values, values**3]

    speed, place = dtheta[joint], theta[joint]
    turn = np.pi * (place - place.min()) / max(float(np.ptp(place)), 1e-12)
    sign, size, ones = bends(speed)[0], unit(load), np.ones_like(speed)
    groups = {
        "motor speed": [*bends(speed), ones],
        "position": [np.cos(k * turn) for k in range(1, 9)] + [np.cos(k * turn) * sign for k in range(1, 4)],
        "load": [np.abs(size) * sign, size, np.abs(size), np.abs(size) * unit(speed)],
        "acceleration": bends(ddtheta[joint])[3:],
        "rate of the torque": [unit(_rate(load, signals))],
    }
    if robot.joints[joint].elastic:
        deflection = place - q[joint]
        groups["deflection"] = [*bends(deflection - deflection.mean()), unit(speed - dq[joint]), ones]
        groups["link speed"] = bends(dq[joint])
    course = np.pi * np.linspace(0.0, 1.0, len(speed))
    groups[TIME] = [np.cos(k * course) * v for k in range(1, 5) for v in (ones, sign, size)]
    others = [k for k in range(robot.n) if k != joint and not signals.still[k]]
    if others:
        groups[OTHERS] = [unit(dtheta[k]) for k in others]
    return {name: np.array(values) for name, values in groups.items()}


def _rate(load: Array, signals: Signals) -> Array:
    """Return the rate of a torque at the fit's instants, (M,), segment by segment."""
    steps = np.diff(signals.outputs)
    starts = np.flatnonzero(steps > steps.min(initial=1)) + 1
    return derivative(load, 1.0, starts.tolist())


def _filtered(signals: Signals, part: Segment) -> Array:
    """Return positions, speeds and the motors' accelerations of a segment at the fit's instants, (5, n, M)."""
    motion = signals.motion[part.start : part.stop]  # of a long log some stretches are judged
    channels = np.nan_to_num(np.stack([motion.theta, motion.q, motion.dtheta, motion.dq, motion.ddtheta]))
    return signals.filter.apply(np.ascontiguousarray(channels.transpose(0, 2, 1)), signals.margin)


def followed(residual: Array, use: NDArray[np.bool_], columns: Array, curves: Mapping[str, Array]) -> Followed:
    """Return how much of a residual follows the motion, by curves at whose cost the model's columns come first.

    Parameters
    ----------
    residual, use
        Residual at M instants, N·m (N), (M,), and which of them count, (M,).
    columns
        Columns of the model's unknowns, (d, M): what they could take of the residual is nobody's.
    curves
        Groups of curves, (k, M) each: `motion_curves`.
    """
    own = _orthonormal(columns[:, use])
    r = residual[use] - (own @ residual[use]) @ own  # rows share parameters: each alone would fit better
    fold = stretch_of(len(r), PIECES * STRETCHES) % STRETCHES
    names = list(curves)
    parts = [_free(curves[name][:, use], own) for name in names]
    shares = np.array([_predicted(part, r, fold) for part in parts])
    everything = np.concatenate(parts)
    share = max(_predicted(everything, r, fold), float(shares.max()))
    best = int(np.argmax(shares))
    moved = [_moved_round(part, r, fold) for part in (everything, parts[best])]
    beyond = any(
        value > LEAST and chance.beyond(value) for value, chance in zip((share, shares[best]), moved, strict=True)
    )
    order = np.argsort(-shares)
    also = [k for k in order.tolist() if shares[k] > ALSO * max(shares[best], 1e-12)]
    return Followed(float(share), bool(beyond), tuple(names[k] for k in also) or (names[best],))


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis of rows (d, M), (r, M)."""
    size = np.linalg.norm(columns, axis=1)
    scaled = columns[size > 0] / size[size > 0, None]
    _, values, basis = np.linalg.svd(scaled, full_matrices=False)
    if not len(values):
        return np.zeros((0, columns.shape[1]))
    return np.asarray(basis[values > 1e-9 * values[0]])


def _free(curves: Array, own: Array) -> Array:
    """Return curves without what the model's own columns explain of them, those that nothing is left of dropped."""
    left = curves - (curves @ own.T) @ own
    return np.asarray(left[np.linalg.norm(left, axis=1) > 1e-3 * np.linalg.norm(curves, axis=1)])


def _predicted(curves: Array, residual: Array, fold: NDArray[np.intp]) -> float:
    """Return the part of a residual's variance that curves predict from the other stretches."""
    if not len(curves):
        return 0.0
    return float(_shares(curves, residual[:, None], fold)[0])


def _shares(curves: Array, values: Array, fold: NDArray[np.intp]) -> Array:
    """Return the part that curves (d, M) predict of each column of `values` (M, k), stretch by stretch, (k,)."""
    gram, moment = curves @ curves.T, curves @ values
    damping = RIDGE * float(np.linalg.norm(gram, 2)) * np.eye(len(gram))
    error = np.zeros(values.shape[1])
    for number in range(STRETCHES):
        out = fold == number
        part = curves[:, out]
        fitted = np.linalg.solve(gram - part @ part.T + damping, moment - part @ values[out])
        error += np.sum((values[out] - part.T @ fitted) ** 2, axis=0)
    total = np.maximum(np.sum(values**2, axis=0), 1e-300)
    return np.asarray(1.0 - error / total)


@dataclass(frozen=True)
class _Chance:
    """What chance predicts, as logarithms of what is left: mean, deviation and least."""

    mean: float
    deviation: float
    least: float

    def beyond(self, share: float) -> bool:
        left = float(np.log(max(1.0 - share, 1e-12)))
        return left < self.mean - BEYOND * self.deviation and left < self.least


def _moved_round(curves: Array, residual: Array, fold: NDArray[np.intp]) -> _Chance:
    """Return what chance predicts of a residual: what is predicted of it moved round against the motion."""
    if not len(curves):
        return _Chance(0.0, 0.0, 0.0)
    moved = np.stack([np.roll(residual, lag) for lag in _lags(len(residual))], axis=1)
    left = np.log(1.0 - _shares(curves, moved, fold))
    return _Chance(float(left.mean()), float(left.std()), float(left.min()))


def _lags(count: int) -> list[int]:
    """Return by how many of its samples a residual is moved round, in turn."""
    lags: list[int] = np.unique(np.linspace(0.08 * count, 0.92 * count, ROUNDS).astype(int)).tolist()
    return lags


def in_bursts(residual: Array, use: NDArray[np.bool_]) -> bool:
    """Whether most of a residual lies in few instants: something that happened, and no noise."""
    power = np.sort(residual[use] ** 2)[::-1]
    return bool(power[: max(1, len(power) // 20)].sum() > 0.5 * power.sum())


def memory(residual: Array, use: NDArray[np.bool_], rate: float) -> float:
    """Return how long a residual remembers, s: the lag at which its correlation falls below 1/e."""
    values = np.where(use, residual - residual[use].mean(), 0.0)
    spectrum = np.abs(np.fft.rfft(values, 2 * len(values))) ** 2
    correlation = np.fft.irfft(spectrum)[: len(values) // 2]
    if correlation[0] <= 0:
        return 0.0
    correlation = correlation / correlation[0]
    below = np.flatnonzero(correlation < np.exp(-1.0))
    if not len(below):
        return len(correlation) / rate
    last = int(below[0])
    before, after = correlation[last - 1], correlation[last]
    return float((last - 1 + (before - np.exp(-1.0)) / (before - after)) / rate)


def apart(residual: Array, use: NDArray[np.bool_], columns: Array) -> float:
    """Return the part of a residual that the row's own parameters would take, fitted to it alone; 0 where chance would.

    Nothing is left for them in a row that has its parameters to itself. Where rows share them, friction of the link
    stands between the values that whole joint and motor side ask for, and a wrong torque between those of two joints.
    Chance is what they take of the residual moved round in time. Arguments as in `followed`.
    """
    own, values = _orthonormal(columns[:, use]), residual[use]
    power = max(float(values @ values), 1e-300)
    share = float(np.sum((own @ values) ** 2)) / power
    if share < TAKEN:
        return 0.0
    moved = np.stack([np.roll(values, lag) for lag in _lags(len(values))], axis=1)
    left = np.log(np.maximum(1.0 - np.sum((own @ moved) ** 2, axis=0) / power, 1e-12))
    chance = _Chance(float(left.mean()), float(left.std()), float(left.min()))
    return share if chance.beyond(share) else 0.0


def slow_part(residual: Array, torque: Array, use: NDArray[np.bool_], columns: Array) -> float:
    """Return the rms of what columns leave of a residual, if it remembers as long as the torque itself; else 0.

    Noise of a sensor forgets sooner. Arguments as in `followed`; `torque` is that of the row, (M,).
    """
    own, left = _orthonormal(columns[:, use]), np.zeros_like(residual)
    left[use] = residual[use] - (own @ residual[use]) @ own
    if memory(left, use, 1.0) <= SLOW * memory(torque, use, 1.0):
        return 0.0
    return float(np.sqrt(np.mean(left[use] ** 2)))

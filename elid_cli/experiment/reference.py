"""Reference trajectories: random, sampled, from and to CSV."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from elid_cli._types import Array
from elid_cli.checks import check_fields, names, number, optional
from elid_cli.errors import UsageError, check_kind
from elid_cli.files import replacing
from elid_cli.robot.ranges import range_of
from elid_cli.robot.robot import Joint, Robot

DEGREE = 5
REVOLUTE_SPEED, REVOLUTE_ACCELERATION = 2.0, 8.0
PRISMATIC_SPEED, PRISMATIC_ACCELERATION = 0.3, 2.0
"""Top speeds (rad/s, m/s) and accelerations where limits are unknown."""
_SLOWER = 1.3
"""Way-points are this much further apart, since random ones leave a joint faster between some than between others."""


class Reference(Protocol):
    """What the links shall do."""

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Return (q, q', q''), each of shape (N, n), at times t (s)."""
        ...


_RULES = {"amplitude": number(above=0), "speed": number(above=0), "interval": optional(number(above=0))}


@dataclass(frozen=True)
class ReferenceOptions:
    """How a random reference is drawn.

    `amplitude` is the share of each joint's range that way-points may fill. `speed` scales time: velocities stay
    below `speed` times, accelerations below `speed`² times the joint's limits. `interval` is the time between
    way-points in s; by default each joint has its own, at which velocity and acceleration come near their limits
    together.
    """

    amplitude: float = 0.7
    speed: float = 1.0
    interval: float | None = None

    def __post_init__(self) -> None:
        """Refuse what no motion has (UsageError)."""
        check_fields(self, _RULES)


def is_reference(where: str, value: object) -> None:
    """Refuse what neither is a reference nor says how to draw one (UsageError)."""
    if not callable(getattr(value, "evaluate", None)):
        hint = "ReferenceOptions(...) of elid_cli.experiment.reference, or what its read_reference makes of a file"
        check_kind(where, value, ReferenceOptions, hint)


@dataclass(frozen=True)
class ReferenceSpline:
    """The B-spline of one joint: knots (s) and control points (rad or m)."""

    knots: Array
    points: Array

    def evaluate(self, t: Array, derivative: int = 0) -> Array:
        """Return the spline or a derivative of it at times t inside the knots, shape (N,)."""
        from scipy.interpolate import BSpline

        return np.asarray(BSpline(self.knots, self.points, DEGREE)(t, derivative))


@dataclass(frozen=True)
class SplineReference:
    """A fifth-order B-spline per joint; at rest before its start and after its end."""

    splines: tuple[ReferenceSpline, ...]
    duration: float
    """s."""

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Return (q, q', q''), each of shape (N, n), at times t (s)."""
        at = np.clip(t, 0.0, self.duration)
        inside = ((t >= 0) & (t <= self.duration)).astype(float)
        q, dq, ddq = (np.stack([s.evaluate(at, d) for s in self.splines], axis=1) for d in range(3))
        return q, dq * inside[:, None], ddq * inside[:, None]

    def sampled(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """Return (t, q, q', q'') at `rate` samples per second, both ends included."""
        t = np.arange(round(self.duration * rate) + 1) / rate
        return (t, *self.evaluate(t))


def random_reference(
    robot: Robot, duration: float, seed: int, options: ReferenceOptions | None = None
) -> SplineReference:
    """Return a reference through random way-points within the joints' limits, at rest at both ends.

    A joint that would be too fast, or would accelerate too hard, moves less; its centre stays.

    Parameters
    ----------
    robot
        Ranges come from ``limits`` in its description, or are those of `ranges`.
    duration
        Length, s.
    seed
        The same seed gives the same motion.
    options
        Amplitude, speed and time between way-points.

    """
    options = options or ReferenceOptions()
    splines = tuple(
        _random_spline(joint, duration, np.random.default_rng([seed, 0, k]), options)
        for k, joint in enumerate(robot.joints)
    )
    return SplineReference(splines, duration)


def sampled_reference(t: Array, q: Array) -> SplineReference:
    """Return a reference through given samples (s; rad or m, shape (N, n)), starting and ending at rest.

    Raises
    ------
    UsageError
        Fewer than six samples, or times that do not increase.

    """
    if t.shape[0] < DEGREE + 1 or not np.all(np.diff(t) > 0):
        raise UsageError("a reference needs at least six samples with increasing times")
    since = t - t[0]
    return SplineReference(tuple(_through(since, column) for column in q.T), float(since[-1]))


def read_reference(path: str, robot: Robot) -> SplineReference:
    """Return the reference that a CSV file holds: columns ``t`` (s) and ``q.<joint>``, others are ignored.

    Raises
    ------
    UsageError
        No such file, a column that is missing, or something that is no number.

    """
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(stream) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        reason = problem.strerror if isinstance(problem, OSError) and problem.strerror else "no CSV file"
        raise UsageError(f"{path}: {reason.lower()}") from None
    head = [name.strip() for name in rows[0]] if rows else []
    columns = []
    for name in ("t", *(f"q.{joint}" for joint in robot.joint_names)):
        if name not in head:
            raise UsageError(f"{path}: no column {name!r}", detail=f"it has {', '.join(head) or 'none'}")
        columns.append(head.index(name))
    try:
        values = np.array([[float(row[k]) for k in columns] for row in rows[1:]]).reshape(-1, len(columns))
    except (ValueError, IndexError):
        raise UsageError(f"{path}: a row is short or holds something that is no number") from None
    if not np.isfinite(values).all():
        raise UsageError(f"{path}: a value is not finite")
    return sampled_reference(values[:, 0], values[:, 1:])


def _random_spline(
    joint: Joint, duration: float, generator: np.random.Generator, options: ReferenceOptions
) -> ReferenceSpline:
    low, high = range_of(joint)
    speed, acceleration = limits_of(joint)
    speed, acceleration = speed * options.speed, acceleration * options.speed**2
    # a harmonic motion between way-points reaches both limits when its half period is pi v / a
    interval = options.interval or _SLOWER * math.pi * speed / acceleration
    count = max(round(duration / interval) + 1, DEGREE + 2)
    points = generator.uniform(-1.0, 1.0, count)
    points[0] = points[-1] = 0.0
    unit = _softly_through(np.linspace(0.0, duration, count), points)
    fine = np.linspace(0.0, duration, 40 * count)
    q, dq, ddq = (float(np.abs(unit.evaluate(fine, d)).max()) for d in range(3))
    size = min(0.5 * (high - low) * options.amplitude / max(q, 1.0), speed / dq, acceleration / ddq)
    return ReferenceSpline(unit.knots, 0.5 * (low + high) + size * unit.points)


def _through(t: Array, points: Array) -> ReferenceSpline:
    """Return the spline through all points, with zero velocity and acceleration at both ends."""
    from scipy.interpolate import make_interp_spline

    rest: Any = [(1, 0.0), (2, 0.0)]
    spline = make_interp_spline(t, points, k=DEGREE, bc_type=(rest, rest))
    return ReferenceSpline(np.asarray(spline.t), np.asarray(spline.c))


def _softly_through(t: Array, points: Array) -> ReferenceSpline:
    """Return the spline through all points but the second and the last but one, starting and ending without a jerk.

    A jerk would make the wanted motor velocity jump, since it holds the rate of the spring's deflection.
    """
    from scipy.interpolate import BSpline

    knots = np.concatenate([np.full(DEGREE, t[0]), t, np.full(DEGREE, t[-1])])
    count = len(knots) - DEGREE - 1
    basis = BSpline(knots, np.eye(count), DEGREE)
    ends = [basis(end, d) for d in range(4) for end in (t[0], t[-1])]
    wanted = [value for d in range(4) for value in ((points[0], points[-1]) if d == 0 else (0.0, 0.0))]
    system = np.vstack([*ends, basis(t[2:-2])])
    return ReferenceSpline(knots, np.linalg.solve(system, np.concatenate([wanted, points[2:-2]])))


def limits_of(joint: Joint) -> tuple[float, float]:
    """Return the top speed and acceleration of a joint, or defaults where its limits are unknown."""
    speed, acceleration = joint.limits.velocity, joint.limits.acceleration
    default = (REVOLUTE_SPEED, REVOLUTE_ACCELERATION) if joint.revolute else (PRISMATIC_SPEED, PRISMATIC_ACCELERATION)
    return (default[0] if speed is None else speed, default[1] if acceleration is None else acceleration)


def write_trajectory(path: str | Path, joints: tuple[str, ...], t: Array, q: Array, dq: Array, ddq: Array) -> None:
    """Write columns ``t``, ``q.<joint>``, ``dq.<joint>``, ``ddq.<joint>``: s, rad (m) and its derivatives.

    Parameters
    ----------
    path
        CSV file, written whole or not at all.
    joints
        Names of the n joints.
    t, q, dq, ddq
        Times (N,) and states (N, n).

    Raises
    ------
    UsageError
        The file cannot be written, or arrays do not fit the times and the joints.

    """
    names("write_trajectory: joints", joints)
    wanted = (len(t), len(joints))
    if wrong := [name for name, values in (("q", q), ("dq", dq), ("ddq", ddq)) if np.shape(values) != wanted]:
        raise UsageError(
            f"write_trajectory: {wrong[0]} is not of shape {wanted}", hint="one row per time, one column per joint"
        )
    head = ",".join(["t", *(f"{kind}.{joint}" for kind in ("q", "dq", "ddq") for joint in joints)])
    with replacing(path) as beside, beside.open("w", encoding="utf-8", newline="\n") as stream:
        np.savetxt(stream, np.column_stack([t, q, dq, ddq]), fmt="%.10g", delimiter=",", header=head, comments="")

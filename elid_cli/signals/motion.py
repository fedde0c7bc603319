"""Motion as arrays, or as splines evaluated where asked (SplineMotion)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.signals.excerpts import in_parts
from elid_cli.signals.recording import Segment
from elid_cli.signals.splines import UniformSpline

STATES = ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")
"""Arrays of a motion: positions, velocities and accelerations of links, then of motors."""


@dataclass(frozen=True)
class Motion:
    """States of all joints at N instants, arrays of shape (N, n), rad (or m) and s.

    For a rigid joint the motor's state equals the link's. Motor states are divided by the gear ratio.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    theta: Array
    dtheta: Array
    ddtheta: Array

    @property
    def samples(self) -> int:
        """Number of instants N."""
        return int(self.q.shape[0])

    def positions(self, part: slice) -> Array:
        """Return positions of links and motors over some samples, (2, n, m)."""
        return np.stack([self.q[part].T, self.theta[part].T])

    def speeds(self, part: slice) -> Array:
        """Return velocities of motors over some samples, (n, m)."""
        return self.dtheta[part].T

    @property
    def states(self) -> tuple[Array, ...]:
        """The six arrays of `STATES`, in their order."""
        return tuple(getattr(self, name) for name in STATES)

    def changed(self, **states: Array) -> Motion:
        """Return the motion with other arrays for some states, (N, n)."""
        return Motion(self.t, *(states.get(name, values) for name, values in zip(STATES, self.states, strict=True)))

    def of_joint(self, joint: int) -> Motion:
        """Return the motion of one joint alone, (N, 1)."""
        return Motion(self.t, *(values[:, joint : joint + 1] for values in self.states))

    def __getitem__(self, index: slice | NDArray[np.intp] | NDArray[np.bool_]) -> Motion:
        return Motion(self.t[index], *(values[index] for values in self.states))


def joined_motion(parts: Sequence[Motion]) -> Motion:
    """Return motions one after the other."""
    return Motion(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("t", *STATES)))


def random_motion(n: int, elastic: NDArray[np.bool_], samples: int, seed: int = 0) -> Motion:
    """Return independent random states: links and motors move freely, as structural questions need.

    Parameters
    ----------
    n, samples
        Joints and instants.
    elastic
        Which joints have a motor state of their own, shape (n,).
    seed
        Seed of the generator; the same seed gives the same states.

    """
    generator = np.random.default_rng(seed)
    q, dq, ddq, theta, dtheta, ddtheta = generator.uniform(-np.pi, np.pi, (6, samples, n))
    theta, dtheta, ddtheta = (
        np.where(elastic, motor, link) for motor, link in ((theta, q), (dtheta, dq), (ddtheta, ddq))
    )
    return Motion(np.arange(samples, dtype=float), q, dq, ddq, theta, dtheta, ddtheta)


SIDES: tuple[Literal["link"], Literal["motor"]] = ("link", "motor")


@dataclass(frozen=True)
class SplineSegment:
    """Splines of some joints' links or motors on one segment."""

    segment: Segment
    side: Literal["link", "motor"]
    joints: NDArray[np.intp]
    spline: UniformSpline


def _made(side: int, derivative: int) -> cached_property[Array]:
    """Return one of the arrays of `STATES`, made when it is asked for."""
    return cached_property(lambda motion: motion._whole(side, derivative))


class SplineMotion(Motion):
    """A `Motion` whose arrays are made when they are asked for whole; slices are evaluated from the splines.

    Samples outside the pieces' segments are NaN. A joint at rest has one position and no velocity, exactly.

    Parameters
    ----------
    t
        Time of the samples, s, (N,).
    joints
        Number of joints n.
    pieces
        Splines that together cover every joint's link and motor on every segment.
    rest
        Positions (2, n) of links and motors that do not move; NaN where they do.
    """

    def __init__(self, t: Array, joints: int, pieces: Sequence[SplineSegment], rest: Array | None = None) -> None:
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "_joints", joints)
        object.__setattr__(self, "pieces", tuple(pieces))
        rest = np.full((2, joints), np.nan) if rest is None else rest
        object.__setattr__(self, "rest", rest)
        object.__setattr__(self, "_resting", tuple(np.flatnonzero(np.isfinite(side)).tolist() for side in rest))

    pieces: tuple[SplineSegment, ...]
    rest: Array
    _joints: int
    _resting: tuple[list[int], ...]
    """Links and motors that do not move."""

    @property
    def samples(self) -> int:
        """Number of instants N."""
        return int(self.t.shape[0])

    @property
    def segments(self) -> tuple[Segment, ...]:
        """Segments that the splines cover."""
        return tuple(dict.fromkeys(piece.segment for piece in self.pieces))

    def resting(self, rest: Array) -> SplineMotion:
        """Return the motion with joints at rest, as in `rest`."""
        return SplineMotion(self.t, self._joints, self.pieces, rest)

    def __getitem__(self, index: slice | NDArray[np.intp] | NDArray[np.bool_]) -> Motion:
        if not isinstance(index, slice):
            index = _as_slice(index)
        if not isinstance(index, slice) or (index.step or 1) < 1:
            return super().__getitem__(index)
        start, stop, step = index.indices(self.samples)
        link, motor = self.evaluated(start, stop, step=step)
        return Motion(self.t[index], *(a.T for a in link), *(a.T for a in motor))

    def positions(self, part: slice) -> Array:
        """Return positions of links and motors over some samples, (2, n, m)."""
        start, stop, step = part.indices(self.samples)
        return self.evaluated(start, stop, 1, step=step)[:, 0]

    def speeds(self, part: slice) -> Array:
        """Return velocities of motors over some samples, (n, m)."""
        start, stop, _ = part.indices(self.samples)
        return np.asarray(self.evaluated(start, stop, 2, first=1, sides=("motor",))[0, 0])

    def evaluated(
        self,
        start: int,
        stop: int,
        derivatives: int = 3,
        *,
        first: int = 0,
        step: int = 1,
        sides: tuple[Literal["link", "motor"], ...] = ("link", "motor"),
    ) -> Array:
        """Return samples start, start + step… before stop: (side, derivative, joint, instant).

        Derivatives are those from `first` to ``derivatives - 1``.
        """
        out = np.empty((len(sides), derivatives - first, self._joints, max(-(-(stop - start) // step), 0)))
        covered = 0
        found: list[tuple[int, SplineSegment, slice, Array]] = []
        for piece in self.pieces:
            if piece.side not in sides:
                continue
            begin, end = piece.segment.start, min(stop, piece.segment.stop)
            begin = start if begin <= start else begin + (start - begin) % step
            if begin < end:
                values = piece.spline.between(
                    begin - piece.segment.start, end - piece.segment.start, derivatives, step, first
                )
                place = (begin - start) // step
                found.append((sides.index(piece.side), piece, slice(place, place + values.shape[2]), values))
                covered += values.shape[2] * len(piece.joints)
        if covered < len(sides) * self._joints * out.shape[3]:
            out.fill(np.nan)
        for side, piece, here, values in found:
            target = out[side, :, :, here]
            if len(piece.joints) == self._joints:
                target[:] = values
            else:
                target[:, piece.joints] = values
        self._put_at_rest(out, sides, first)
        return out

    def _put_at_rest(self, out: Array, sides: tuple[Literal["link", "motor"], ...], first: int) -> None:
        for number, side in enumerate(sides):
            for joint in self._resting[SIDES.index(side)]:
                out[number, :, joint] = 0.0
                if first == 0:
                    out[number, 0, joint] = self.rest[SIDES.index(side), joint]

    @property
    def states(self) -> tuple[Array, ...]:
        """The six arrays of `STATES`, in their order: made together, which takes a sixth of the calls."""
        if not vars(self).keys() & set(STATES):
            whole = np.full((len(SIDES), 3, self.samples, self._joints), np.nan)
            for part in in_parts(self.segments):
                whole[:, :, part] = self.evaluated(part.start, part.stop).transpose(0, 1, 3, 2)
            vars(self).update(zip(STATES, whole.reshape(len(STATES), self.samples, self._joints), strict=True))
        return super().states

    def _whole(self, side: int, derivative: int) -> Array:
        out, sides = np.full((self.samples, self._joints), np.nan), (SIDES[side],)
        for part in in_parts(self.segments):
            out[part] = self.evaluated(part.start, part.stop, derivative + 1, first=derivative, sides=sides)[0, 0].T
        return out

    q, dq, ddq = (_made(0, derivative) for derivative in range(3))
    theta, dtheta, ddtheta = (_made(1, derivative) for derivative in range(3))


def _as_slice(index: NDArray[np.intp] | NDArray[np.bool_]) -> slice | NDArray[np.intp] | NDArray[np.bool_]:
    """Return the slice that evenly spaced, ascending sample numbers are, else themselves."""
    if index.dtype == bool or index.ndim != 1 or len(index) < 2 or index[0] < 0:
        return index
    steps = np.diff(index)
    step = int(steps[0])
    return slice(int(index[0]), int(index[-1]) + 1, step) if step > 0 and (steps == step).all() else index

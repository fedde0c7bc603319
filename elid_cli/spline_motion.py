"""Motion that is held as splines and evaluated where it is asked for, so that a long log takes little memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli.motion import Motion
from elid_cli.recording import Segment
from elid_cli.smoothing import Spline

Array = NDArray[np.float64]

STRETCH = 65536
"""Samples evaluated at a time where all are passed over."""


@dataclass(frozen=True)
class Piece:
    """Splines of some joints' links or motors on one segment."""

    segment: Segment
    side: Literal["link", "motor"]
    joints: NDArray[np.intp]
    spline: Spline


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

    def __init__(self, t: Array, joints: int, pieces: Sequence[Piece], rest: Array | None = None) -> None:
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "_joints", joints)
        object.__setattr__(self, "pieces", tuple(pieces))
        object.__setattr__(self, "rest", np.full((2, joints), np.nan) if rest is None else rest)

    pieces: tuple[Piece, ...]
    rest: Array
    _joints: int

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
        if not isinstance(index, slice) or index.step not in (None, 1):
            return super().__getitem__(index)
        start, stop, _ = index.indices(self.samples)
        link, motor = self.evaluated(start, stop)
        return Motion(self.t[start:stop], *(a.T for a in link), *(a.T for a in motor))

    def positions(self, part: slice) -> Array:
        """Return positions of links and motors over some samples, (2, n, m)."""
        start, stop, _ = part.indices(self.samples)
        return self.evaluated(start, stop, 1)[:, 0]

    def evaluated(self, start: int, stop: int, derivatives: int = 3) -> Array:
        """Return samples start…stop-1: (link or motor, derivative, joint, sample)."""
        out = np.empty((2, derivatives, self._joints, max(stop - start, 0)))
        covered = 0
        for piece in self.pieces:
            first, last = max(start, piece.segment.start), min(stop, piece.segment.stop)
            if first < last:
                covered += (last - first) * len(piece.joints)
        if covered < 2 * self._joints * (stop - start):
            out.fill(np.nan)
        for piece in self.pieces:
            first, last = max(start, piece.segment.start), min(stop, piece.segment.stop)
            if first < last:
                values = piece.spline.between(first - piece.segment.start, last - piece.segment.start, derivatives)
                side = out[0 if piece.side == "link" else 1, :, :, first - start : last - start]
                if len(piece.joints) == self._joints:
                    side[:] = values
                else:
                    side[:, piece.joints] = values
        held = np.isfinite(self.rest)
        for side, joint in zip(*np.nonzero(held), strict=True):
            out[side, 0, joint] = self.rest[side, joint]
            out[side, 1:, joint] = 0.0
        return out

    def _whole(self, side: int, derivative: int) -> Array:
        out = np.full((self.samples, self._joints), np.nan)
        for segment in self.segments:
            for start in range(segment.start, segment.stop, STRETCH):
                stop = min(start + STRETCH, segment.stop)
                out[start:stop] = self.evaluated(start, stop, derivative + 1)[side, derivative].T
        return out

    @cached_property
    def q(self) -> Array:
        """Link positions, (N, n)."""
        return self._whole(0, 0)

    @cached_property
    def dq(self) -> Array:
        """Link velocities, (N, n)."""
        return self._whole(0, 1)

    @cached_property
    def ddq(self) -> Array:
        """Link accelerations, (N, n)."""
        return self._whole(0, 2)

    @cached_property
    def theta(self) -> Array:
        """Motor positions, (N, n)."""
        return self._whole(1, 0)

    @cached_property
    def dtheta(self) -> Array:
        """Motor velocities, (N, n)."""
        return self._whole(1, 1)

    @cached_property
    def ddtheta(self) -> Array:
        """Motor accelerations, (N, n)."""
        return self._whole(1, 2)

    def plain(self) -> Motion:
        """Return the motion as arrays."""
        return Motion(self.t, self.q, self.dq, self.ddq, self.theta, self.dtheta, self.ddtheta)

"""Sensors on links whose positions nobody logged, and what they measure of the links' motion, as equations.

A sensor on the link behind joint k measures y = M v of d seconds before, and a bias. v is the link's angular velocity
(gyroscopes) or the specific force at the sensor's place r on the link (accelerometers), in the link's frame. M, (3, 3),
is its mounting rotation with its scale errors. M, bias, d and r are unknown, near what the motors' slow motion tells.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.link_vectors import AXES, LinkForces, LinkRates, LinkVectors, Slopes
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import GYRO, LINK_SENSORS, Recording

ORIENTED = AXES * AXES
MOUNTING_SPREAD = 0.05
"""Prior standard deviation of every element of M: scale errors and misalignment of small sensors, with a margin."""
DELAY_SPREAD = 5e-3
"""Prior standard deviation of a delay, s."""
APART = 0.3
"""Least part of a joint's own motion that must be apart from that of the other elastic joints to be seen."""

MISLEADS = "the equations fit better without sensors of its kind: one may saturate, or sit on another link"
"""Why sensors of a kind are left out that agree with the motors' slow motion."""


@dataclass(frozen=True)
class Kind:
    """A kind of sensor."""

    name: str
    """As in `LINK_SENSORS`."""
    vectors: type[LinkVectors]
    bias_spread: float
    """Prior standard deviation of a bias, rad/s or m/s²."""
    place_spread: float
    """Prior standard deviation of every coordinate of its place about the first estimate, m."""
    floor: float
    """Least noise of its rows in that of the torques', shares of each row's size: else a fit that is still on its way
    would follow finely measured accelerations and leave the torques'."""

    @property
    def signals(self) -> tuple[str, ...]:
        """Of its three axes in a recording."""
        return LINK_SENSORS[self.name]

    @property
    def placed(self) -> bool:
        """Whether it feels accelerations, which differ from place to place."""
        return self.vectors.placed > 0

    def joints(self, recording: Recording) -> NDArray[np.bool_]:
        """Return the joints whose links carry one, (n,)."""
        return recording.turning if self.signals == GYRO else recording.accelerated


KINDS = (
    Kind("gyroscope", LinkRates, 0.3, 0.0, 0.0),
    Kind("accelerometer", LinkForces, 0.5, 0.3, 0.1),
)


@dataclass(frozen=True)
class LinkSensors:
    """Sensors of one kind on some links, each in its own axes."""

    kind: Kind
    joints: tuple[int, ...]
    """The joints that move these links, of those that move at all, m."""
    values: Array
    """rad/s or m/s², (N, 3 m)."""
    noise: Array
    """Standard deviations of their white noise, (3 m,)."""
    mounting: Array
    """First estimate of every M, (m, 3, 3)."""
    places: Array
    """First estimate of every place, m in the link's frame, (m, 3)."""

    def part(self, part: slice) -> LinkSensors:
        """Return some of the samples."""
        return replace(self, values=self.values[part])

    def only(self, used: Sequence[int]) -> LinkSensors:
        """Return some of the sensors."""
        columns = [AXES * number + axis for number in used for axis in range(AXES)]
        chosen = list(used)
        return LinkSensors(
            self.kind, tuple(self.joints[number] for number in used), self.values[:, columns], self.noise[columns],
            self.mounting[chosen], self.places[chosen],
        )  # fmt: skip

    def axes(self, number: int) -> Array:
        """Return what one sensor measures, (N, 3)."""
        return self.values[:, AXES * number : AXES * (number + 1)]


def sensors_of(robot: Robot, recording: Recording, moving: Sequence[int]) -> tuple[LinkSensors, ...]:
    """Return the sensors of a log on links that move, one set per kind.

    One on a link that is carried through resting joints is one on the link of the nearest moving joint before them.
    """
    return tuple(_of_kind(kind, robot, recording, moving) for kind in KINDS)


def _of_kind(kind: Kind, robot: Robot, recording: Recording, moving: Sequence[int]) -> LinkSensors:
    joints, columns = [], []
    for k in np.flatnonzero(kind.joints(recording)).tolist():
        carrying = [j for j in robot.ancestors[k] if j in moving]
        if carrying:
            joints.append(list(moving).index(carrying[-1]))
            columns += [recording.signal(axis)[:, k] for axis in kind.signals]  # type: ignore[index]
    many = len(joints)
    values = np.stack(columns, axis=1) if columns else np.zeros((recording.samples, 0))
    turned, none = np.tile(np.eye(AXES), (many, 1, 1)), np.zeros((many, AXES))
    return LinkSensors(kind, tuple(joints), values, np.zeros(len(columns)), turned, none)


class Mounted(NamedTuple):
    """How m sensors are mounted."""

    mounting: Array
    """M, (m, 3, 3)."""
    bias: Array
    """rad/s or m/s², (m, 3)."""
    delay: Array
    """s, (m,)."""
    places: Array
    """m, (m, 3); (m, 0) where that is all the same."""


class Sensed:
    """The equations of the sensors of one kind.

    Unknowns of every sensor: M row by row, the bias, the delay, the place.

    Parameters
    ----------
    kind
        Which.
    robot
        The joints that move.
    joints
        Whose links carry them.
    """

    def __init__(self, kind: Kind, robot: Robot, joints: Sequence[int]) -> None:
        self.kind, self.vectors = kind, kind.vectors(robot, joints)
        self.many = len(self.vectors.joints)
        self.each = ORIENTED + AXES + 1 + self.vectors.placed
        """Unknowns of one sensor."""

    @property
    def size(self) -> int:
        """Unknowns of all."""
        return self.each * self.many

    def split(self, own: Array) -> Mounted:
        """Return what the unknowns (size,) mean."""
        turn, bias, delay, places = np.split(own.reshape(-1, self.each), np.cumsum([ORIENTED, AXES, 1]), axis=1)
        return Mounted(turn.reshape(-1, AXES, AXES), bias, delay[:, 0], places)

    def prior(self, sensors: LinkSensors) -> tuple[Array, Array]:
        """Return mean and standard deviation of the unknowns, (size,), of sensors with first estimates."""
        placed = self.vectors.placed
        mean = np.zeros((self.many, self.each))
        mean[:, :ORIENTED] = sensors.mounting.reshape(self.many, ORIENTED)
        mean[:, self.each - placed :] = sensors.places[:, :placed]
        spread = [MOUNTING_SPREAD] * ORIENTED + [self.kind.bias_spread] * AXES + [DELAY_SPREAD]
        return mean.ravel(), np.tile([*spread, *[self.kind.place_spread] * placed], self.many)

    def felt(self, motion: Sequence[Array], own: Array) -> Slopes:
        """Return what the sensors feel in their links' frames, with derivatives, of q, q', q'' (N, n) and unknowns."""
        return self.vectors.slopes(motion, self.split(own).places)

    def measured(self, felt: Slopes, own: Array, rates: tuple[Any, Any]) -> Array:
        """Return what they measure, (N, 3 m); `rates` differentiate samples once and twice."""
        mounted = self.split(own)
        seen = [
            earlier(felt.values[:, k], by, rates) @ mounted.mounting[k].T + mounted.bias[k]
            for k, by in enumerate(mounted.delay.tolist())
        ]
        return np.concatenate(seen, axis=1) if seen else np.zeros((len(felt.values), 0))

    def by_unknowns(self, felt: Slopes, own: Array, rates: tuple[Any, Any]) -> Iterator[tuple[slice, Array]]:
        """Yield, of every axis of every sensor, which of the unknowns it takes and its derivatives by them, (N, u)."""
        mounted, (first, second) = self.split(own), rates
        for k, delay in enumerate(mounted.delay.tolist()):
            seen = felt.values[:, k] @ mounted.mounting[k].T
            by_delay = -(first @ seen) + delay * (second @ seen)
            then = earlier(felt.values[:, k], delay, rates)
            field = earlier(felt.by_place[:, k].reshape(len(seen), -1), delay, rates).reshape(felt.by_place[:, k].shape)
            for axis in range(AXES):
                row = np.zeros((len(seen), self.each))
                row[:, AXES * axis : AXES * (axis + 1)] = then
                row[:, ORIENTED + axis] = 1.0
                row[:, ORIENTED + AXES] = by_delay[:, axis]
                row[:, ORIENTED + AXES + 1 :] = np.einsum("a,nap->np", mounted.mounting[k, axis], field)
                yield slice(k * self.each, (k + 1) * self.each), row

    def by_motion(self, felt: Slopes, own: Array) -> Iterator[Array]:
        """Yield the derivatives of every axis of every sensor, but for its delay, by q, q' …, (orders, N, n) each."""
        for k, mounting in enumerate(self.split(own).mounting):
            yield from np.einsum("ab,dnbj->adnj", mounting, felt.by_motion[:, :, k])


def earlier(values: Array, delay: float, rates: tuple[Any, Any]) -> Array:
    """Return values (N, k) as they were `delay` s before, to the second order of it."""
    first, second = rates
    found: Array = values - delay * (first @ values) + 0.5 * delay**2 * (second @ values)
    return found


def watched(
    sensed: Sequence[Sensed], places: Sequence[Array], elastic: NDArray[np.bool_], q: Array
) -> NDArray[np.bool_]:
    """Return which elastic joints' own motion sensors tell from that of the others, (n,).

    Parameters
    ----------
    sensed
        The sensors of every kind.
    places
        Where on the links they sit, of every kind: (m, 3), or (m, 0) where that is all the same.
    elastic
        Which joints are elastic, (n,).
    q
        Positions at some instants, (N, n).
    """
    still, rows = [q, np.zeros_like(q), np.zeros_like(q)], []
    for kind, here in zip(sensed, places, strict=True):
        # the highest derivative of the joints is what a sensor feels of fast motion
        own = kind.vectors.slopes(still, here).by_motion[-1] if kind.many else np.zeros((len(q), 0, AXES, len(elastic)))
        size = np.sqrt(np.square(own).sum(axis=(0, 2, 3), keepdims=True))
        rows.append((own / np.where(size > 0, size, 1.0)).reshape(len(q), -1, len(elastic)))
    axes = np.concatenate(rows, axis=1)
    seen = np.zeros(len(elastic), dtype=bool)
    for k in np.flatnonzero(elastic) if axes.size else ():
        others = [j for j in np.flatnonzero(elastic).tolist() if j != k]
        own = axes[:, :, k, None]
        left = own - axes[:, :, others] @ (np.linalg.pinv(axes[:, :, others]) @ own) if others else own
        length = float(np.linalg.norm(own))
        seen[k] = length > 0 and float(np.linalg.norm(left)) > APART * length
    return seen


def fewer_of(used: Sequence[LinkSensors]) -> Iterator[list[LinkSensors]]:
    """Yield fewer sensors: one kind of two, then none."""
    present = [own.kind for own in used if own.joints]
    for kept in (*((kind,) for kind in present if len(present) > 1), ()) if present else ():
        yield [own if own.kind in kept else own.only(()) for own in used]


def left_out(
    strange: Sequence[Mapping[int, str]], logged: Sequence[LinkSensors], kept: Sequence[LinkSensors]
) -> list[dict[int, str]]:
    """Return why sensors are left out, with those that the equations do not fit with."""
    return [
        dict(why) if own.joints else dict.fromkeys(range(len(whole.joints)), MISLEADS) | dict(why)
        for why, whole, own in zip(strange, logged, kept, strict=True)
    ]

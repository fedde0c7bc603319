"""Unknowns of the trajectory fit: four of every joint's drive, effects, a delay of every recording, drives of its own.

An effect that softens a joint's friction has no amplitude of its own: that is the joint's Coulomb friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.drives import Fading, Joints
from elid_cli.model.effects.effect import Effect, Parameter
from elid_cli.robot.robot import Robot

KINDS = ("inertia", "coulomb", "viscous", "offset")
"""Rotor inertia kg·m² (kg), Coulomb N·m (N), viscous friction N·m·s/rad, torque offset N·m (N) of every joint."""
PARAMETERS = ("Ja", "fs", "fv")
"""Names of the first three among a joint's parameters."""
LATEST = 0.05
"""s; most that the motion is taken to be late, or early, against the commands."""
BENDING = 2e-3
"""Part of a shape by which its variant differs: an order of 30 turns a torque's phase with every hundredth of it."""
CLOSE = 1e-6
"""Part by which a shape may be above its bound and count as being there."""
STEP = 0.05
"""Part of a value, and of the usual size where it is small, by which variants differ."""
USUAL = (3e-3, 3e-3)
"""Usual width, rad/s (m/s), and lead, s, of friction that fades in: smaller ones vary and move by parts of these."""


@dataclass(frozen=True)
class Unknowns:
    """Places in one vector z (U,): four of each of n joints, joint by joint, amplitudes, shapes, delays, departures.

    Delays are in s. Departures are by how much friction or offsets of single recordings are above their mean, one after
    the other: of all recordings but the last, which makes up for the others.
    """

    robot: Robot
    effects: tuple[Effect, ...] = ()
    """In the shapes that a fit starts from."""
    recordings: int = 1
    held: int = 0
    """How many of the effects, the first ones, keep their shapes."""
    own: tuple[tuple[int, int], ...] = ()
    """Joint and kind (of `KINDS`) of every drive parameter that is each recording's own: it changed between them."""

    spans: tuple[float, ...] = ()
    """rad (m); what every motor's angle covers, where known: bounds of shapes follow from it."""

    @property
    def drives(self) -> int:
        """Number of drive parameters, 4 n."""
        return self.robot.n * len(KINDS)

    @cached_property
    def shapes(self) -> tuple[tuple[int, int], ...]:
        """Effect, and place in its shape, of every shape that is an unknown, (S,)."""
        return tuple(
            (number, place) for number, effect in enumerate(self.effects) if number >= self.held
            for place, parameter in enumerate(effect.shapes) if not parameter.fixed
        )  # fmt: skip

    @cached_property
    def owners(self) -> NDArray[np.intp]:
        """Joint of every amplitude, then of every shape, (A + S,)."""
        amplitudes = [effect.joint for effect in self.pushing for _ in effect.amplitudes]
        return np.array([*amplitudes, *(self.effects[k].joint for k, _ in self.shapes)], dtype=np.intp)

    @cached_property
    def pushing(self) -> tuple[Effect, ...]:
        """The effects but those that soften friction, in the shapes that a fit starts from."""
        return tuple(effect for effect in self.effects if not effect.softens)

    def pushing_at(self, z: Array) -> tuple[Effect, ...]:
        """Return them in the shapes that unknowns (U,) have."""
        return tuple(effect for effect in self.effects_at(z) if not effect.softens) if self.pushing else ()

    @cached_property
    def soft(self) -> dict[int, int]:
        """Place among the effects of the one that softens a joint's friction, by joint."""
        return {effect.joint: place for place, effect in enumerate(self.effects) if effect.softens}

    def fading_of(self, z: Array) -> Fading | None:
        """Return the friction that fades in of unknowns (V, U): all that a joint has where an effect softens it."""
        if not self.soft:
            return None
        friction, width, lead = np.zeros((3, len(z), self.robot.n))
        width += 1.0
        for row, own in enumerate(z):
            effects = self.effects_at(own)
            for joint, place in self.soft.items():
                friction[row, joint] = self.joint_values(own)[joint, 1]
                width[row, joint], lead[row, joint] = effects[place].shape
        return Fading(friction, width, lead)

    @property
    def delays(self) -> slice:
        """Place of the delays of the recordings."""
        first = self.drives + len(self.owners)
        return slice(first, first + self.recordings)

    @property
    def departures(self) -> slice:
        """Place of the departures."""
        return slice(self.delays.stop, self.count)

    @cached_property
    def owned(self) -> tuple[int, ...]:
        """Places in z of the parameters that are each recording's own."""
        return tuple(len(KINDS) * joint + kind for joint, kind in self.own)

    def departures_of(self, z: Array) -> Array:
        """Return by how much every recording's drive parameters are above their mean, (R, n, 4), of unknowns (U,)."""
        found, places = np.zeros((self.recordings, self.drives)), list(self.owned)
        first = z[self.departures].reshape(len(places), self.recordings - 1).T
        found[:-1, places], found[-1, places] = first, -first.sum(axis=0)
        return found.reshape(self.recordings, self.robot.n, len(KINDS))

    def departing(self, values: Array) -> Array:
        """Return the departures, one parameter after the other, of what `departures_of` returns, (R, n, 4)."""
        found: Array = values.reshape(len(values), -1)[:-1, list(self.owned)].T.ravel()
        return found

    def as_recorded(self, joints: Joints, z: Array, source: int) -> Joints:
        """Return variants of the joints with the friction and the offsets that one recording has of its own."""
        if not self.own:
            return joints
        _, coulomb, viscous, offset = self.departures_of(z)[source].T
        soft, fading = np.isin(np.arange(self.robot.n), list(self.soft)), joints.fading
        if fading is not None:
            fading = replace(fading, friction=np.maximum(fading.friction + np.where(soft, coulomb, 0.0), 0.0))
        hard = np.maximum(joints.coulomb + np.where(soft, 0.0, coulomb), 0.0)
        return replace(
            joints, coulomb=hard, viscous=joints.viscous + viscous, offset=joints.offset + offset, fading=fading
        )

    def columns_of_departures(self, columns: Array, source: int) -> Array:
        """Return the change of a recording's positions with the departures, (N, n, D), by that with all unknowns."""
        sign = np.eye(self.recordings)[source, :-1] - (source == self.recordings - 1)
        found: Array = (columns[:, :, list(self.owned), None] * sign).reshape(*columns.shape[:2], -1)
        return found

    @property
    def amplitudes(self) -> slice:
        """Place of the amplitudes."""
        return slice(self.drives, self.delays.start - len(self.shapes))

    @property
    def count(self) -> int:
        """Number of unknowns U."""
        last: int = self.delays.stop
        return last + len(self.own) * (self.recordings - 1)

    def joint_values(self, z: Array) -> Array:
        """Return the drive parameters (n, 4) of unknowns (U,)."""
        return z[: self.drives].reshape(self.robot.n, len(KINDS))

    def amplitudes_of(self, place: int) -> slice:
        """Return the place of one effect's amplitudes in z."""
        own = self.effects[place]
        if own.softens:
            first = len(KINDS) * own.joint + 1
        else:
            before = (effect for effect in self.effects[:place] if not effect.softens)
            first = self.drives + sum(len(effect.amplitudes) for effect in before)
        return slice(first, first + len(own.amplitudes))

    def shapes_of(self, place: int) -> tuple[NDArray[np.intp], list[int]]:
        """Return the places of one effect's unknown shapes in z, and in its shape."""
        own = [k for k, (number, _) in enumerate(self.shapes) if number == place]
        return np.array(own, dtype=np.intp) + self.amplitudes.stop, [self.shapes[k][1] for k in own]

    def effects_at(self, z: Array) -> tuple[Effect, ...]:
        """Return the effects in the shapes that unknowns (U,) have."""
        found = []
        for number, effect in enumerate(self.effects):
            at, own = self.shapes_of(number)
            shape = list(effect.shape)
            for place, value in zip(own, z[at].tolist(), strict=True):
                shape[place] = value
            found.append(type(effect)(effect.joint, shape) if own else effect)
        return tuple(found)

    @cached_property
    def usual_shapes(self) -> Array:
        """Size from which a shape counts as itself, (S,): smaller ones vary and move by parts of it."""
        return np.array([USUAL[place] if self.effects[number].softens else 1e-6 for number, place in self.shapes])

    @cached_property
    def softening(self) -> NDArray[np.bool_]:
        """Which shapes are those of friction that fades in, (S,)."""
        return np.array([self.effects[number].softens for number, _ in self.shapes], dtype=bool)

    @property
    def _forms(self) -> list[Parameter]:
        return [self.effects[number].shapes[place] for number, place in self.shapes]

    def least_of(self, place: int, z: Array) -> tuple[str, ...]:
        """Return the names of one effect's shapes that unknowns (U,) have at the least that the angle covered shows."""
        at, own = self.shapes_of(place)
        effect = self.effects[place]
        low = self.bounds[0][at]
        return tuple(
            effect.shapes[k].name
            for k, value, least in zip(own, z[at].tolist(), low.tolist(), strict=True)
            if effect.shapes[k].low < least and value <= least * (1.0 + CLOSE) and self.spans
        )

    @property
    def _least_shapes(self) -> list[float]:
        found = []
        for (number, place), form in zip(self.shapes, self._forms, strict=True):
            effect = self.effects[number]
            least = effect.least(self.spans[effect.joint])[place] if self.spans else form.low
            found.append(max(min(least, effect.shape[place]), form.low))  # one that begins below it falls no further
        return found

    @cached_property
    def together(self) -> tuple[NDArray[np.intp], ...]:
        """Unknowns that vary side by side: one of every chain of joints, as chains do not move each other.

        Delays and departures do not vary: how they move the motion is known.
        """
        chain = self.chain
        of: dict[int, list[int]] = {}
        for number in range(self.delays.start):
            joint = number // len(KINDS) if number < self.drives else int(self.owners[number - self.drives])
            of.setdefault(int(chain[joint]), []).append(number)
        longest = max(map(len, of.values()))
        return tuple(np.array([own[k] for own in of.values() if len(own) > k], dtype=np.intp) for k in range(longest))

    @cached_property
    def chain(self) -> NDArray[np.intp]:
        """First joint of the chain that each joint belongs to, (n,): joints of one chain move each other."""
        return np.array([self.robot.ancestors[k][0] for k in range(self.robot.n)], dtype=np.intp)

    @cached_property
    def chains(self) -> tuple[NDArray[np.intp], ...]:
        """Joints of every chain."""
        return tuple(np.flatnonzero(self.chain == first) for first in np.unique(self.chain))

    @cached_property
    def chain_of(self) -> NDArray[np.intp]:
        """Number of the chain that each unknown belongs to, (U,); one more than all for the delays."""
        of_joint = np.empty(self.robot.n, dtype=np.intp)
        for number, joints in enumerate(self.chains):
            of_joint[joints] = number
        departing = np.repeat(of_joint[[joint for joint, _ in self.own]], self.recordings - 1)
        return np.concatenate([np.repeat(of_joint, len(KINDS)), of_joint[self.owners],
                               np.full(self.recordings, len(self.chains)), departing])  # fmt: skip

    def possible(self, z: Array) -> Array:
        """Return unknowns that mean something, the nearest to given ones, (U,)."""
        return np.clip(z, *self.bounds)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest values that mean something, (U,) each."""
        low, high = np.full(self.count, -np.inf), np.full(self.count, np.inf)
        low[0 : self.drives : len(KINDS)] = 1e-6
        low[1 : self.drives : len(KINDS)] = 0.0
        shapes = slice(self.amplitudes.stop, self.delays.start)
        low[shapes], high[shapes] = self._least_shapes, [form.high for form in self._forms]
        low[self.delays], high[self.delays] = -LATEST, LATEST
        return low, high


def steps_of(unknowns: Unknowns, z: Array, strength: Array) -> Array:
    """Return by how much each unknown differs in its variant, (U,).

    `strength` is the rms torque of each amplitude of 1, (A,).
    """
    values = unknowns.joint_values(z)
    usual = np.median(np.abs(values), axis=0)
    usual[3] = max(usual[3], 0.1 * usual[1])
    own = STEP * np.maximum(np.abs(values), np.maximum(usual, 1e-6))
    effects = STEP * max(usual[1], 1e-6) / np.maximum(strength, 1e-9)
    size = np.maximum(np.abs(z[unknowns.amplitudes.stop : unknowns.delays.start]), unknowns.usual_shapes)
    shapes = np.where(unknowns.softening, STEP, BENDING) * size
    return np.concatenate([own.ravel(), effects, shapes, np.ones(unknowns.count - unknowns.delays.start)])


def started(unknowns: Unknowns, values: Array, known: Sequence[float] = ()) -> Array:
    """Return unknowns (U,) with drive parameters (n, 4), amplitudes as far as known, shapes to start from, no delay."""
    z = np.zeros(unknowns.count)
    z[: unknowns.drives] = values.ravel()
    z[unknowns.drives : unknowns.drives + len(known)] = known
    z[unknowns.amplitudes.stop : unknowns.delays.start] = [unknowns.effects[k].shape[i] for k, i in unknowns.shapes]
    return z

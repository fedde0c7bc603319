"""Effects that a joint's motion may lack, screened by what their torque would do to it.

Near its commands a driven joint is a linear system: a torque c moves it by c filtered through
``1 / (M s² + (fv + kd) s + kp + slope)``. That filter turns the column of an effect into a column of positions, which
is fitted to the error that the simulation leaves, beside the columns of what is unknown anyway. While friction holds
the joint, nothing moves it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.held_out import DAMPING, MORE, Blocks, gain
from elid_cli.estimation.regression.normal_equations import step_of
from elid_cli.estimation.trajectory.acting import acting, can_act
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.robot.robot import Robot

FINEST = 160
"""Shapes of one effect that are tried at a joint."""
TOGETHER = 2e6
"""Numbers of each array that effects are judged by at a time."""
REFINED = (0.2, 0.1, 0.05, 0.02)
"""Parts of itself by which a shape is moved, one after the other, while that helps."""
STILL = 1e-9
"""Speed, rad/s (m/s), below which a simulated joint sticks."""
WORTH = 0.03
"""Least gain of a shape that is refined."""


@dataclass(frozen=True)
class View:
    """What screening sees of one stretch: the scene of the simulated motion, its error, and how joints respond."""

    scene: Scene
    error: Array
    """Weighted error of the positions, (N, n)."""
    weight: Array
    """Weight of every error, (N, n)."""
    columns: Array
    """Weighted change of the positions with every unknown, (N, n, U); or of one joint's with its own, (N, c)."""
    response: tuple[tuple[Array, Array], ...]
    """Filter of every joint from torque to position: numerator and denominator."""
    source: int
    turning: Array | None = None
    """Part of every joint's dry friction that acts, with its sign, (N, n); None: the sign of its velocity."""


@dataclass(frozen=True)
class Candidate:
    """An effect at a joint with what it takes from blocks that it was not fitted to."""

    effect: Effect
    gain: float
    helped: float
    """Part of the blocks that it makes better."""
    amplitudes: Array
    """Amplitudes of the linear step."""
    forms: tuple[Candidate, ...] = ()
    """The same effect with other choices among its shapes (an exponent, another joint): the best of each."""

    @property
    def price(self) -> int:
        """Number of values that it adds."""
        return len(self.effect.amplitudes) + len(self.effect.shapes)


def response_of(inertia: float, damping: float, stiffness: float, dt: float) -> tuple[Array, Array]:
    """Return the discrete filter from a torque on the model's side to the position (bilinear transform)."""
    from scipy.signal import bilinear

    found: tuple[Array, Array] = bilinear([-1.0], [max(inertia, 1e-9), damping, stiffness], fs=1.0 / dt)
    return found


def kinds_of(library: Mapping[str, type[Effect]], only: Sequence[str]) -> list[type[Effect]]:
    """Return the effects of the library that a simulated motion can hold and a search tries."""
    return [
        kind for name, kind in library.items()
        if can_act(kind) and not kind.softens and (name in only if only else kind.searched) and not kind.whole_robot
    ]  # fmt: skip


def tried_of(library: Mapping[str, type[Effect]], only: Sequence[str]) -> list[type[Effect]]:
    """Return the effects that a search by motion tries: those that it can hold, and what acts on the whole.

    That is limits, gains and integral terms of drives, the direction of gravity, zeros of encoders, and late drives.
    """
    whole = (
        kind for name, kind in library.items()
        if (kind.of_drive or kind.turns_gravity or kind.moves_zero or kind.nuisance == "delay")
        and (name in only or not only)
    )  # fmt: skip
    return [*kinds_of(library, only), *whole]


def untried_of(library: Mapping[str, type[Effect]], robot: Robot, only: Sequence[str]) -> tuple[str, ...]:
    """Return the effects that a search by torque would try at a robot, but that no simulated motion is searched for.

    What every trajectory fit estimates along, and friction that fades in, which it decides by itself, are not among
    them.
    """
    tried = {kind.name for kind in tried_of(library, only)}
    asked = [kind for name, kind in library.items() if (name in only if only else kind.searched)]
    return tuple(
        kind.name for kind in asked
        if kind.name not in tried and kind.nuisance not in ("delay", "offset") and not kind.softens
        and any(kind.applies(robot, joint) for joint in range(robot.n))
    )  # fmt: skip


def screened(
    views: Sequence[View], joint: int, kinds: Sequence[type[Effect]], present: Sequence[Effect]
) -> list[Candidate]:
    """Return the effects that may be missing at a joint, the best shape of each, best first.

    Parameters
    ----------
    views
        The stretches, with the columns of what is fitted beside each effect.
    joint
        From 0.
    kinds, present
        Effects to try, and those that the model holds.
    """
    recordings = [_Recording.of(own, joint) for own in recordings_of(views)]
    found = []
    for kind in kinds:
        every = (_best(recordings, own) for own in _forms(kind, views[0].scene, joint, present))
        forms = sorted((c for c in every if c is not None), key=lambda c: -c.gain)
        if not forms:
            continue
        best, others = forms[0], tuple(c for c in forms[1:] if c.gain > WORTH and _plausible(c, views[0].scene))
        if best.gain > WORTH:
            best = _refined(best, lambda effect: _best(recordings, [effect]))
        if _plausible(best, views[0].scene):
            found.append(replace(best, forms=others))
    return sorted(found, key=lambda c: -c.gain)


def best_of(simulated: Sequence[Candidate], measured: Sequence[Candidate]) -> list[Candidate]:
    """Return the best candidate of every effect, best first, as seen from the simulated and the measured motion.

    Along the measured motion the neighbours' errors are those of their encoders, and what a joint shares with them
    looks like effects of its own: it counts where it leaves clearly less than anything does from the simulated motion.
    """
    left, least = (1.0 - max((c.gain for c in of), default=0.0) for of in (simulated, measured))
    found: dict[str, Candidate] = {}
    for c in sorted([*simulated, *(measured if left > MORE * least else ())], key=lambda c: -c.gain):
        found.setdefault(c.effect.name, c)
    return list(found.values())


def _refined(best: Candidate, judged: Callable[[Effect], Candidate | None]) -> Candidate:
    """Return a candidate with its free shapes moved to where they take away most."""
    kind, joint = type(best.effect), best.effect.joint
    for part in REFINED:
        for place, parameter in enumerate(kind.shapes):
            if parameter.fixed:
                continue
            for factor in (1 + part, 1 - part):
                shape = list(best.effect.shape)
                shape[place] = min(max(shape[place] * factor, parameter.low), parameter.high)
                other = judged(kind(joint, shape))
                if other is not None and other.gain > best.gain:
                    best = other
    return best


def _forms(kind: type[Effect], scene: Scene, joint: int, present: Sequence[Effect]) -> list[list[Effect]]:
    """Return the shapes of an effect that are tried at a joint, those of each choice that is not refined together."""
    if not kind.applies(scene.robot, joint):
        return []
    own = [e.shape for e in present if e.name == kind.name and e.joint == joint]
    grid = kind.grid(scene, joint)
    forms: dict[tuple[float, ...], list[Effect]] = {}
    for shape in grid[:: max(1, -(-len(grid) // FINEST))]:
        if kind.distinct(scene, joint, shape, own):
            form = tuple(v for v, parameter in zip(shape, kind.shapes, strict=True) if parameter.fixed)
            forms.setdefault(form, []).append(kind(joint, shape))
    return list(forms.values())


@dataclass(frozen=True)
class _Recording:
    """The stretches of one recording, one after the other, as effects at a joint are judged in them."""

    views: Sequence[View]
    joint: int
    known: Array
    """Columns of what is fitted beside each effect, and the error, (N, c + 1)."""
    edges: NDArray[np.intp]
    plain: Blocks
    left: Array
    """Squared error of every block without an effect, (B,)."""

    @classmethod
    def of(cls, views: Sequence[View], joint: int) -> _Recording:
        columns = np.concatenate([view.columns for view in views])
        error = np.concatenate([view.error[:, joint] for view in views])
        edges = edges_of(views)
        plain = Blocks.of(columns, error, edges)
        return cls(views, joint, np.concatenate([columns, error[:, None]], axis=1), edges, plain, plain.left())

    def beside(self, effects: Sequence[Effect]) -> Blocks:
        """Return the normal equations of E effects of one kind, each alone beside what is known."""
        moved = np.concatenate([responses(effects, view, self.joint) for view in self.views])
        return self.plain.beside(self.known, moved.reshape(len(moved), len(effects), -1), self.edges)


def _best(recordings: Sequence[_Recording], effects: Sequence[Effect]) -> Candidate | None:
    """Return the effect of one kind that takes away most; None where none does anything."""
    each = max(1, int(TOGETHER / sum(len(own.known) for own in recordings)))
    parts = [_best_of_few(recordings, effects[k : k + each]) for k in range(0, len(effects), each)]
    return max((c for c in parts if c is not None), key=lambda c: c.gain, default=None)


def _best_of_few(recordings: Sequence[_Recording], effects: Sequence[Effect]) -> Candidate | None:
    count = len(effects[0].amplitudes)
    blocks = [own.beside(effects) for own in recordings]
    # an effect that does nothing, or runs away, is none
    sizes = sum(np.einsum("ebii->e", own.matrix[..., -count:, -count:]) for own in blocks)
    possible = np.flatnonzero(np.isfinite(sizes) & (sizes > 0))
    if not len(possible):
        return None
    blocks = [Blocks(own.matrix[possible], own.load[possible], own.square) for own in blocks]
    plain = np.concatenate([own.left for own in recordings])
    gains = [gain(plain, left) for left in np.concatenate([own.left() for own in blocks], axis=1)]
    best = max(range(len(gains)), key=lambda k: gains[k][0])
    # each recording has amplitudes of its own
    steps = [step_of(own.matrix[best].sum(axis=0), own.load[best].sum(axis=0), DAMPING)[-count:] for own in blocks]
    return Candidate(effects[possible[best]], *gains[best], np.median(steps, axis=0))


def responses(effects: Sequence[Effect], view: View, joint: int) -> Array:
    """Return what amplitudes of 1 of effects do to a joint's position, weighted, (N, D)."""
    speed = view.scene.motion.dtheta[:, joint]
    turning = np.sign(speed) if view.turning is None else view.turning[:, joint]
    torques = []
    for effect in effects:
        done = acting((effect,), view.scene)
        torques.append(done.push[:, :, joint] + done.grip[:, :, joint] * turning)
    sticks = np.abs(speed) < STILL
    moved: Array = moved_by(np.concatenate(torques), view.response[joint], sticks).T * view.weight[:, [joint]]
    return moved


def moved_by(torque: Array, response: tuple[Array, Array], sticks: NDArray[np.bool_]) -> Array:
    """Return how positions change by small torques, (d, N), of a joint that sticks at times (N,).

    A joint that its friction holds stays where it was, whatever little torque is added, and starts from rest.
    """
    from scipy.signal import lfilter

    top, bottom = response
    compliance = top.sum() / bottom.sum()
    moved, here = np.empty_like(torque), np.zeros(len(torque))
    edges = np.flatnonzero(np.diff(sticks)) + 1
    for a, b in pairwise([0, *edges.tolist(), len(sticks)]):
        if sticks[a]:
            moved[:, a:b] = here[:, None]
            continue
        # at rest at `here` before, as the torque would hold it that friction held
        held = here / compliance
        last = held * (top[1] + top[2]) - here * (bottom[1] + bottom[2])
        before = np.stack([last, held * top[2] - here * bottom[2]], axis=1)
        moved[:, a:b], _ = lfilter(top, bottom, torque[:, a:b], axis=-1, zi=before)
        here = moved[:, b - 1]
    return moved


def recordings_of(views: Sequence[View]) -> list[list[View]]:
    """Return the stretches of every recording.

    Friction follows the temperature: what differs between recordings is not to be taken for an effect. So each has
    values of its own, and nothing of one recording says anything of another.
    """
    return [[view for view in views if view.source == source] for source in sorted({view.source for view in views})]


def edges_of(views: Sequence[View]) -> NDArray[np.intp]:
    """Return where the blocks of all stretches, one after the other, begin."""
    from elid_cli.estimation.trajectory.block_sums import BLOCKS

    starts, first = [], 0
    for view in views:
        starts.append(first + np.linspace(0, len(view.error), BLOCKS + 1).astype(np.intp)[:-1])
        first += len(view.error)
    return np.concatenate(starts)


def _plausible(candidate: Candidate, scene: Scene) -> bool:
    effect = candidate.effect
    values = effect.named(scene, candidate.amplitudes)
    return type(effect).plausible(scene, effect.joint, values)

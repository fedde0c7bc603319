"""Normal equations of a trajectory fit: by recording, by block of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.trajectory.acting import Acting, acting, resisting, scene_along
from elid_cli.estimation.trajectory.block_sums import Equations, summed
from elid_cli.estimation.trajectory.loss import bent, size_of, usual_size, weighed
from elid_cli.estimation.trajectory.unknowns import KINDS, Unknowns, steps_of
from elid_cli.model.drives import Drives, Joints
from elid_cli.model.effects.scene import Scene
from elid_cli.model.linearised import Linearised, Local
from elid_cli.model.rollout import between, variants_of
from elid_cli.model.runs import Run

SETTLING = 0.4
"""s at the start of a stretch that do not count: the simulation starts from one noisy sample."""
REACH = 0.5
"""rad (m); a simulation farther than this from the measured motion has lost it, and is cut."""
CONSTANT = 1e-9
"""Relative change of a torque that counts as none."""
AGREEING, AGREED = 4, 2e-5
"""Times that a motion with effects is simulated until it is, rms in rad (m), the one along which they act."""
FINER = 2
"""Times that steps are shorter where what they change is looked at …"""
LEFT = 1.0 / (FINER**2 - 1)
"""… and what steps without end would change beyond that, as part of it: errors fall with the square of the steps."""
COARSEST = 5e-3
"""rad (m); a change by shorter steps that is larger is no small correction: the motion runs away."""
SMALLEST = 1e-7
"""rad (m); errors are not taken to be smaller."""
Stepped = tuple[Array, Array, Array, NDArray[np.intp]]
"""What `stepped` returns."""
NEAR = 1e-4
"""rad (m); the equations are linearised again where the motion is farther, rms, from where they were."""


@dataclass
class Tracked:
    """A stretch of a recording with the motion that its equations are linearised about."""

    run: Run
    x: Array
    v: Array
    local: Local | None = None
    measured: bool = True
    """Whether the present motion is the measured one, whose accelerations are mostly noise."""
    finer: Array | float = 0.0
    """What shorter steps change of the simulated positions, rad (m), (N, n)."""
    usual: Array | float = 1.0
    """Usual size of the error, rad (m), (n,): larger ones count less."""
    path: tuple[Array, Array] | None = None
    """The present motion at every instant of the equations; None: at the samples alone."""
    latest: tuple[Run, float, Run] | None = None
    """The run and the delay that `as_late` was last asked for, and what it is."""
    coming: Coming | None = None
    """A simulation that has been made from the present motion already."""

    @classmethod
    def of(cls, run: Run) -> Tracked:
        """Return a stretch about its measured motion."""
        return cls(run, run.near, np.gradient(run.near, run.dt, axis=0))

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Return the samples that count, (N,): the first pose's noise is no fault of the drives."""
        after: NDArray[np.bool_] = self.run.t - self.run.t[0] >= SETTLING
        return after

    @property
    def is_near(self) -> bool:
        """Whether the present motion is near the one that the equations are about."""
        if self.local is None or not (self.local.curved or self.measured):
            return False
        return bool(np.sqrt(np.mean((self.x - self.local.place[:: self.local.finer, 0]) ** 2)) <= NEAR)

    def equations(self, about: Linearised) -> Local:
        """Return the equations about a motion near the present one."""
        if self.local is None or not self.is_near:
            (x, v), dt, finer = self.everywhere, self.run.dt, self.run.finer
            self.local = about.about(x[:, None], v[:, None], None if self.measured else dt / finer, finer)
        return self.local

    @property
    def everywhere(self) -> tuple[Array, Array]:
        """The present motion and its velocities at every instant of the equations."""
        return between(self.x, self.v, self.run.dt, self.run.finer) if self.path is None else self.path


@dataclass(frozen=True)
class Coming:
    """What a simulation of a run with unknowns z (U,), from a motion x (N, m), comes to: it need not be repeated."""

    run: Run
    x: Array
    z: Array
    item: Tracked
    """The stretch about the motion that came out."""
    found: Stepped


@dataclass(frozen=True)
class Moved:
    """A stretch simulated with unknowns and their variants."""

    error: Array
    """Simulated minus measured positions, rad (m), (N, n); 0 where nothing was measured."""
    columns: Array
    """Change of the positions with every unknown, (N, n, U)."""


def simulated(
    equations: Linearised, item: Tracked, unknowns: Unknowns, z: Array, parameters: Array, *, plain: bool = False,
    rounds: int = AGREEING,
) -> Moved:  # fmt: skip
    """Simulate a stretch, and move on what its equations are linearised about; `plain`: without columns."""
    run, n = as_late(item, unknowns, z), unknowns.robot.n
    for _ in range(rounds):
        # effects act along a motion, which they move; equations are those about a motion near the one that comes out
        before = item.x
        x, v, steps, still = _first_or_next(equations, item, run, unknowns, z, parameters)
        if item.is_near and (not unknowns.pushing or np.sqrt(np.mean((item.x - before) ** 2)) < AGREED):
            break
    groups = () if plain else unknowns.together
    if groups:
        x, v, steps, still = stepped(equations, item, run, unknowns, z, parameters, groups)
    error = np.where(np.isnan(run.measured), 0.0, x[:, 0, :n] + item.finer - run.measured)
    columns = np.zeros((len(error), n, 0 if plain else unknowns.count))
    for number, group in enumerate(groups, start=1):
        change = x[:, number, :n] - x[:, 0, :n]
        for own in group:
            columns[:, _moved_by(unknowns, own), own] = change[:, _moved_by(unknowns, own)] / steps[own]
    if not plain:
        columns[:, :, unknowns.delays.start + run.source] = -v[:, 0, :n] + _late_feedback(columns, run.drives, unknowns)
        columns[:, :, unknowns.drives + still] = 0.0
        columns[:, :, unknowns.departures] = unknowns.columns_of_departures(columns, run.source)
    return Moved(error, columns)


def _first_or_next(
    equations: Linearised, item: Tracked, run: Run, unknowns: Unknowns, z: Array, parameters: Array
) -> Stepped:
    """Simulate a stretch once without variants, as `stepped`, unless that has been done."""
    coming, item.coming = item.coming, None
    if coming is None or coming.run is not run or coming.x is not item.x or coming.z is not z:
        return stepped(equations, item, run, unknowns, z, parameters, ())
    item.x, item.v, item.path = coming.item.x, coming.item.v, coming.item.path
    item.local, item.measured = coming.item.local, coming.item.measured
    return coming.found


def refine(equations: Linearised, item: Tracked, unknowns: Unknowns, z: Array, parameters: Array) -> None:
    """Note what shorter steps change of a stretch's motion: steps of 1 ms act as a delay of some hundredths of one.

    A delay is nearly viscous friction: twenty microseconds were up to a twentieth of it. The steps of a simulator that
    made the log are its own.
    """
    if item.run.drives.stepped is not None:
        item.finer = 0.0
        return
    item.equations(equations)  # which both simulations, and the next one, are by
    plain, shorter, run = replace(item), replace(item), as_late(item, unknowns, z)
    found = stepped(equations, plain, run, unknowns, z, parameters, ())
    other = stepped(equations, shorter, as_late(item, unknowns, z, FINER), unknowns, z, parameters, ())
    item.coming = Coming(run, item.x, z, plain, found)
    change = (1.0 + LEFT) * (other[0] - found[0])
    item.finer = np.where(np.abs(change) < COARSEST, change, 0.0)[:, 0, : unknowns.robot.n]


def as_late(item: Tracked, unknowns: Unknowns, z: Array, finer: int = 1) -> Run:
    """Return the run with the delay that its recording has among unknowns (U,)."""
    late = float(z[unknowns.delays][item.run.source])
    if finer == 1 and item.latest is not None and item.latest[0] is item.run and item.latest[1] == late:
        return item.latest[2]
    found = item.run.delayed(np.full(unknowns.robot.n, late), finer=finer)
    if finer == 1:  # a delay that is held stays for many simulations
        item.latest = item.run, late, found
    return found


def stepped(
    equations: Linearised, item: Tracked, run: Run, unknowns: Unknowns, z: Array, parameters: Array,
    groups: tuple[NDArray[np.intp], ...], variants: Callable[[Joints], Joints] | None = None,
) -> Stepped:  # fmt: skip
    """Simulate a stretch once: positions and velocities (N, V, m), steps of the variants, amplitudes that are constant.

    A constant torque is the offset's: an amplitude that adds nothing else stays where it is. `variants` makes others
    of the one of the unknowns.
    """
    local = item.equations(equations)
    done = _acting(unknowns, item, local, z, parameters)
    stiffness, damping = _resisting(unknowns, item, local, z, parameters)
    strength, still = np.zeros(0), np.zeros(0, dtype=np.intp)
    if done is not None and groups:
        strength = np.sqrt(np.mean((done.push + done.grip) ** 2, axis=1).sum(axis=-1))
        spread = np.ptp(done.push, axis=1).max(axis=-1)
        still = np.flatnonzero((spread <= CONSTANT * np.abs(done.push).max(axis=(1, 2))) & ~done.grip.any(axis=(1, 2)))
    steps = steps_of(unknowns, z, strength) if groups else np.zeros(0)
    joints = _variants(unknowns, z, steps, groups, done)
    joints = unknowns.as_recorded(joints, z, run.source)
    joints = joints if variants is None else variants(joints)
    if groups and joints.push is not None:
        _bend_shapes(unknowns, z, steps, groups, _scene(unknowns, item, local, parameters), joints)
    if joints.push is not None:
        place, speed = item.everywhere
        x, v = (0.5 * (part[1:] + part[:-1]) for part in (place - local.place[:, 0], speed))
        known = stiffness * x + damping * v  # of the motion before; the rest of it acts on the one that comes out
        joints = replace(joints, push=joints.push - known[:, None, None], damping=damping)
        local = replace(local, slope=local.slope + np.diag(stiffness))
    drives = run.drives
    own = drives.ki, drives.smoothing, drives.held, drives.lag, drives.since
    ki, smoothing, held, lag, since = (None if part is None else part[None] for part in own)
    alone = Drives(drives.told[:, None], drives.kp[None], drives.kd[None], drives.limit, ki, smoothing, held, lag,
                   drives.stepped, since)  # fmt: skip
    x, v = variants_of(equations, local, (run.start[0][None], run.start[1][None]), alone, joints, run.dt)
    path, x, v = (x[:, 0, 0], v[:, 0, 0]), x[:: local.finer, :, 0], v[:: local.finer, :, 0]
    kept = np.clip(x[:, 0], run.near - REACH, run.near + REACH)
    lost = kept != x[:, 0]
    item.x, item.v, item.measured = kept, np.where(lost, item.v, v[:, 0]), False
    item.path = None if lost.any() else path
    return x, v, steps, still


def _late_feedback(columns: Array, drives: Drives, unknowns: Unknowns) -> Array | float:
    """Return what a delay does beside making the motion late, rad (m) per s, (N, n), by the columns of the drives.

    Drives that hold their torque act late on what they measured, too: as less viscous friction and inertia, to first
    order.
    """
    if drives.held is None:
        return 0.0
    less = np.zeros((unknowns.robot.n, len(KINDS)))
    less[:, 0], less[:, 2] = (-np.where(drives.held > 0, gain, 0.0) for gain in (drives.kd, drives.kp))
    found: Array = columns[:, :, : unknowns.drives] @ less.ravel()
    return found


def _moved_by(unknowns: Unknowns, number: int) -> NDArray[np.intp]:
    """Return the joints that an unknown moves: those of its chain."""
    kinds = unknowns.drives // unknowns.robot.n
    joint = number // kinds if number < unknowns.drives else unknowns.owners[number - unknowns.drives]
    return np.flatnonzero(unknowns.chain == unknowns.chain[joint])


def _scene(unknowns: Unknowns, item: Tracked, local: Local, parameters: Array) -> Scene:
    (x, v), own = item.everywhere, replace(local, finer=1)
    return scene_along(unknowns.robot, x, v, own, item.run.dt / local.finer, parameters, len(x))


def _acting(unknowns: Unknowns, item: Tracked, local: Local, z: Array, parameters: Array) -> Acting | None:
    if not unknowns.pushing:
        return None
    return _between(acting(unknowns.pushing_at(z), _scene(unknowns, item, local, parameters)))


def _between(found: Acting) -> Acting:
    """Return what acts between one instant and the next."""
    return Acting(0.5 * (found.push[:, 1:] + found.push[:, :-1]), 0.5 * (found.grip[:, 1:] + found.grip[:, :-1]))


def _bend_shapes(
    unknowns: Unknowns, z: Array, steps: Array, groups: tuple[NDArray[np.intp], ...], scene: Scene, joints: Joints
) -> None:
    """Add to the variants of shapes what these change."""
    assert joints.push is not None
    assert joints.grip is not None
    here, first = unknowns.effects_at(z), unknowns.amplitudes.stop
    for number, own in enumerate(groups, start=1):
        for place in own[own >= first]:
            k, _ = unknowns.shapes[place - first]
            if here[k].softens:
                continue
            other = z.copy()
            other[place] += steps[place]
            amplitudes = z[unknowns.amplitudes_of(k)]
            push, grip = _between(acting((here[k],), scene)).total(amplitudes)
            pushed, gripped = _between(acting((unknowns.effects_at(other)[k],), scene)).total(amplitudes)
            joints.push[:, number, 0] += pushed - push
            joints.grip[:, number, 0] += gripped - grip


def _resisting(unknowns: Unknowns, item: Tracked, local: Local, z: Array, parameters: Array) -> tuple[Array, Array]:
    """Return stiffness and damping of the effects that push, (m,) each."""
    none = np.zeros(item.x.shape[1])
    places = [k for k, effect in enumerate(unknowns.effects) if not effect.holds() and not effect.softens]
    if not places:
        return none, none
    shaped = unknowns.effects_at(z)
    effects = [shaped[k] for k in places]
    amplitudes = np.concatenate([z[unknowns.amplitudes_of(k)] for k in places])
    own, dt = replace(local, finer=1), item.run.dt / local.finer

    def push(x: Array, v: Array) -> Array:
        scene = scene_along(unknowns.robot, x, v, own, dt, parameters, len(x))
        return acting(effects, scene).total(amplitudes)[0]

    return resisting(push, *item.everywhere)


def _variants(
    unknowns: Unknowns, z: Array, steps: Array, groups: tuple[NDArray[np.intp], ...], done: Acting | None
) -> Joints:
    """Return the variants of unknowns, the first as they are; a variant changes one unknown of every chain."""
    made = np.repeat(z[None], len(groups) + 1, axis=0)
    for number, own in enumerate(groups, start=1):
        made[number, own] += steps[own]
    values = np.stack([unknowns.joint_values(row) for row in made])
    inertia, coulomb, viscous, offset = (values[:, :, k] for k in range(values.shape[2]))
    fading = unknowns.fading_of(made)
    if fading is not None:
        coulomb = coulomb - fading.friction
    if done is None:
        return Joints(inertia, coulomb, viscous, offset, fading=fading)
    push, grip = done.total(made[:, unknowns.amplitudes])
    return Joints(inertia, coulomb, viscous, offset, push[:, :, None], grip[:, :, None], fading=fading)


def passed(
    equations: Linearised, tracked: list[Tracked], unknowns: Unknowns, z: Array, parameters: Array,
    columns: list[Array] | None = None, *, rounds: int = AGREEING,
) -> tuple[Equations, list[Array]]:  # fmt: skip
    """Simulate every stretch with unknowns (U,), and their variants unless `columns` of a pass before are to serve.

    Every joint's error is weighted by its size. The columns of the stretches are returned, too.
    """
    moved = [
        simulated(equations, item, unknowns, z, parameters, plain=columns is not None, rounds=rounds)
        for item in tracked
    ]
    whole = columns is None
    if columns is None:
        columns = [own.columns for own in moved]
        for item, own in zip(tracked, moved, strict=True):
            item.usual = usual_size(own.error, item.counts)
    seen = [weighed(own.error, item.usual, item.counts) for item, own in zip(tracked, moved, strict=True)]
    bend, weights = np.sqrt(bent(seen)), 1.0 / np.maximum(size_of(seen), SMALLEST)
    found = [
        summed(item.run, own, slopes, weights, bend, unknowns, whole=whole)
        for item, own, slopes in zip(tracked, seen, columns, strict=True)
    ]
    sums = {field.name: np.concatenate([getattr(item, field.name) for item in found])
            for field in fields(Equations) if field.name != "spans"}  # fmt: skip
    return Equations(**sums, spans=tuple(span for item in found for span in item.spans)), columns

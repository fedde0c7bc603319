"""Gauss-Newton on simulated motion: drive parameters, effects and delays, the bodies held at the robot file's values.

The simulated motion under the commands (output error, as in DIDIM: Gautier, Janot, Vandanjon 2013) holds no measured
position on its right-hand side: noise of the encoders, which enters both sides of least squares on a torque that was
computed from them, does not bias it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.regression.long_run import at_least, beyond_normal
from elid_cli.estimation.regression.normal_equations import jackknife, step_of, steps_without
from elid_cli.estimation.trajectory.block_sums import DAMPING, Equations
from elid_cli.estimation.trajectory.descent import descended, is_settled, is_small
from elid_cli.estimation.trajectory.memory import has_memory, without_memory
from elid_cli.estimation.trajectory.normal_equations import SMALLEST, Tracked, passed, refine
from elid_cli.estimation.trajectory.start_noise import start_covariance
from elid_cli.estimation.trajectory.unknowns import KINDS, Unknowns
from elid_cli.model.effects.effect import Effect
from elid_cli.model.linearised import Linearised
from elid_cli.signals.signals import Signals

CYCLES = 30
"""Most motions whose slopes are computed; two to five are usual."""
SOFT_CYCLES = 8
"""The same with friction that fades in: a width that the log hardly shows may go to and fro by a part of its error."""
STALLED, FALLS = 5, 1e-4
"""Cycles over which the logarithm of the errors' sizes, summed over the joints, falls by so little at most that the fit
ends: at limits of the torque, or of bounds, steps go to and fro."""
REFINED = 2
"""Cycle, from 1, from which the motion is near enough to look at what shorter steps change."""
COARSE = 3e-5
"""Part of itself to which the steps of the simulation give a value: without noise, errors are half of that …"""
PROMPT = 1e-6
"""… and time to which they give a delay, s."""
ABOVE = 3.0
"""Times the encoders' noise from which what the simulated motion leaves is more than noise."""
WEAKLY = 1e-3
"""Part of all blocks' normal equations that is added to those of one."""


@dataclass(frozen=True)
class TrajectoryFit:
    """What a trajectory fit found."""

    unknowns: Unknowns
    z: Array
    """The unknowns, (U,)."""
    covariance: Array
    """Of the unknowns, (U, U)."""
    between: Array
    """Spread between recordings beyond that, as a standard deviation, (U,); 0 of one recording."""
    alone: Array
    """Unknowns as each of R recordings alone has them, after one step from those of all, (R, U)."""
    rms: Array
    """Error of the simulated positions, rad (m), (n,)."""
    rms_before: Array
    """The same with the values that the fit started from."""
    mean_abs: Array
    """Mean size of the error in each recording, rad (m), (R, n)."""
    steps: int
    left_out: Array
    """Unknowns without each block of time in turn, (B, U)."""
    spans: tuple[tuple[int, float, float], ...]
    """Recording, first and last time of every block, s."""
    equations: Equations
    """Normal equations at the end."""
    tracked: tuple[Tracked, ...]
    """The stretches about their simulated motions."""
    apart: Array | float = 0.0
    """Standard errors of the joints' own delays beside those of the recordings, s, (n,)."""
    doubted: Array | float = 0.0
    """By how much later than here the drives of joints may act, s, (n,), negative earlier: the errors count it."""
    filters: Array | float = 0.0
    """Time constants of filters of velocity with which the motion is nearer, s, (n,): the errors count them."""
    open_filters: tuple[tuple[int, float, float], ...] = ()
    """Filters of velocity that the robot declares without a time: joint, time constant and standard error, s."""
    at_once: bool = False
    """Whether drives whose loops act all the time are clearly nearer than ones that hold their torque for a sample."""
    either: bool = False
    """Whether a simulator's steps with implicit damping of the drives explain the motion as well as explicit ones."""
    ahead: float = 0.0
    """By how much drives act before they are told without a simulator's steps that show, s: the errors count it."""
    smoother: float = 0.0
    """By how much longer the delay is with commands that change smoothly from sample to sample, s, which explain the
    motion as well: the errors count it."""
    unseen: float | None = None
    """Longest period, s, of loops that hold their torque which the motion tells from ones that act all the time no
    better than chance would; None: not looked at."""
    loops: tuple[float, ...] = ()
    """How often per sample loops that hold their torque may run as well: the errors count it."""
    shifts: tuple[Array, ...] = ()
    """By how much drive parameters are other than here for one of these reasons, (n * 4,) each."""
    held: TrajectoryFit | None = None
    """The fit with friction that holds a joint at rest, of one in which it was found to fade in at some joints."""

    @property
    def values(self) -> Array:
        """Drive parameters of every joint (`unknowns.KINDS`), (n, 4)."""
        return self.unknowns.joint_values(self.z)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects in the shapes that were found."""
        return self.unknowns.effects_at(self.z)

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Which drive parameters the motion depends on, (n, 4): on none of a joint that stays where it is."""
        own = np.diag(self.equations.matrix.sum(axis=0)) > 0
        found: NDArray[np.bool_] = own[: self.unknowns.drives].reshape(self.unknowns.robot.n, len(KINDS))
        return found

    @property
    def settled_rms(self) -> Array:
        """Error of the simulated positions over the samples that count, rad (m), (n,).

        What the noisy samples that a stretch starts from, and what acted before it, leave in its first moments is
        nothing that the model lacks.
        """
        n = self.unknowns.robot.n
        squares, count = np.zeros(n), 0
        for item in self.tracked:
            error = np.nan_to_num(item.x[:, :n] + item.finer - item.run.measured)[item.counts]
            squares, count = squares + np.sum(error**2, axis=0), count + len(error)
        found: Array = np.sqrt(squares / max(count, 1))
        return found

    def above_noise(self, signals: Signals) -> Array:
        """Return `settled_rms` in times the noise of the encoders in the signals that were fitted, (n,)."""
        noise = np.where(np.isfinite(signals.noise.theta), signals.noise.theta, signals.noise.q)
        found: Array = self.settled_rms / np.maximum(noise, SMALLEST)
        return found

    @property
    def delays(self) -> Array:
        """By how much the motion of each recording is late against its commands, s, (R,)."""
        return self.z[self.unknowns.delays]

    @property
    def joint_delays(self) -> Array:
        """By how much the motion of every joint is late against the commands of each recording, s, (R, n)."""
        extra = np.broadcast_to(self.tracked[0].run.extra, self.unknowns.robot.n)
        found: Array = self.delays[:, None] + extra
        return found

    @property
    def within(self) -> Array:
        """How far the unknowns are apart in blocks of one recording taken alone, as a standard deviation, (U,).

        Of several recordings, the root mean square. Beside noise it holds what wanders in a recording, and what a model
        that lacks something takes for other values in other poses: another recording may be as far off.
        """
        sources = np.array([source for source, _, _ in self.spans])
        own = self.equations.holding(self.unknowns.departures)  # a block is of one recording
        matrix, load = own.straight, own.load
        # a block that hardly shows an unknown leaves it where all blocks have it
        alone = np.array(
            [step_of(m + WEAKLY * matrix.sum(axis=0), g, DAMPING) for m, g in zip(matrix, load, strict=True)]
        )
        spread = [np.var(alone[sources == r], axis=0, ddof=1) for r in np.unique(sources)]
        found: Array = np.sqrt(np.mean(spread, axis=0))
        return found

    @property
    def another(self) -> Array:
        """Standard deviation by which the estimates of another recording would differ, of a fit of one, (U,).

        Both have their standard errors, and what differs between parts of a recording differs between recordings.
        """
        wide = beyond_normal(len(self.spans) - 1) * self.within
        found: Array = np.sqrt(2.0 * self.deviation**2 + wide**2)
        return found

    @property
    def deviation(self) -> Array:
        """Standard errors of the unknowns, (U,)."""
        found: Array = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return found


def fitted(
    unknowns: Unknowns, tracked: list[Tracked], z: Array, *, prompt: bool = False,
    tell: Callable[[float], None] | None = None, cycles: int = CYCLES,
) -> TrajectoryFit:  # fmt: skip
    """Fit unknowns (U,), started from z (see `decided.fit_trajectory`); `prompt`: the delays stay where they are."""
    return fitted_with_columns(unknowns, tracked, z, prompt=prompt, tell=tell, cycles=cycles)[0]


def fitted_with_columns(
    unknowns: Unknowns, tracked: list[Tracked], z: Array, *, prompt: bool = False,
    tell: Callable[[float], None] | None = None, cycles: int = CYCLES,
) -> tuple[TrajectoryFit, list[Array]]:  # fmt: skip
    """Return the fit, and how the positions of its stretches change with the unknowns, (N, n, U) each."""
    robot = unknowns.robot
    equations, parameters = Linearised(robot, without=("Ja", "fs", "fv")), robot.reference()
    z = unknowns.possible(z)
    before: Array | None = None
    still, falls = False, list[float]()
    cycles = min(cycles, SOFT_CYCLES) if unknowns.softening.any() else cycles
    for number in range(1, cycles + 1):
        if tell is not None:
            tell((number - 1) / cycles)
        for item in tracked:
            item.local = None  # a cost about this motion and one about an older one are not compared
            if number >= REFINED:
                refine(equations, item, unknowns, z, parameters)
        held = prompt or number < REFINED
        every, columns = passed(equations, tracked, unknowns, z, parameters)
        if not np.isfinite(every.rms).all():
            raise DataError("the simulated motion runs away from the measured one", hint="are the gains right?")
        before = every.rms if before is None else before
        falls.append(float(np.log(every.size).sum()))
        stalled = len(falls) > REFINED + STALLED and falls[-1] > falls[-1 - STALLED] - FALLS
        if (
            number == cycles
            or stalled
            or (number > REFINED and (still or is_settled(unknowns, z, every, prompt=prompt)))
        ):
            break
        last = z
        # with delays all chains of joints move together: at first each goes its way
        z = descended(equations, tracked, unknowns, z, (every, columns), prompt=held)
        still = is_small(z - last, every)
    assert before is not None
    final = every.holding(unknowns.delays) if prompt else every
    white = without_memory(final)
    inverse = white / max(final.spread, 1e-300)
    white += start_covariance(equations, tracked, columns, unknowns, z, final, inverse)
    covariance, between, alone, left = _spread(final, z, unknowns, white)
    if prompt:
        covariance += _unseen_delays(every, unknowns, tracked[0].run.dt)
    sources = np.array([source for source, _, _ in final.spans])
    sizes = np.array([
        final.sizes[sources == r].sum(axis=0) / final.counts[sources == r].sum() for r in np.unique(sources)
    ])  # fmt: skip
    found = TrajectoryFit(unknowns, z, covariance, between, alone, final.rms, before, sizes, number, left, final.spans,
                          final, tuple(tracked))  # fmt: skip
    return found, columns


def _unseen_delays(every: Equations, unknowns: Unknowns, dt: float) -> Array:
    """Return what delays that were held at 0 add to the covariance, (U, U), by equations that know of them.

    A log tells little of what happens within a sample: the delay is one that it could not show, and less than that.
    """
    count = len(every.counts)
    moved = steps_without(every.matrix, every.load, DAMPING)[:, unknowns.delays]
    variance = 1.0 / (1.0 / np.maximum((count - 1) * np.var(moved, axis=0), 1e-18) + 12.0 / dt**2)
    held = np.zeros(unknowns.count, dtype=bool)
    held[unknowns.delays] = True
    matrix = every.matrix.sum(axis=0)
    slopes = np.array([step_of(matrix, column, DAMPING, held) for column in matrix[:, unknowns.delays].T])
    slopes[:, unknowns.delays] = np.eye(unknowns.recordings)
    added: Array = (slopes.T * variance) @ slopes
    return added


def _spread(found: Equations, z: Array, unknowns: Unknowns, white: Array) -> tuple[Array, Array, Array, Array]:
    """Return the covariance, the spread between recordings, what each says alone, and values without each block.

    An error without memory has the covariance `white`, of its normal equations and of the start. One with a memory has
    what leaving out one block of time after the other changes, in one linear step, where that is larger. Of three
    recordings and more, the scatter of what each says alone counts where it is larger still; of two, that of
    parameters which are each one's own.
    """
    source = np.array([number for number, _, _ in found.spans])
    recordings = np.unique(source)
    steps = steps_without(found.matrix, found.load, DAMPING)
    covariance = at_least(jackknife(steps), np.diag(white)) if has_memory(found) else white
    between, alone = np.zeros(len(z)), np.repeat(z[None], len(recordings), axis=0)
    if len(recordings) > 1:
        one = found.holding(unknowns.departures)  # a recording has one value of each
        parts = [(one.straight[source == r].sum(axis=0), one.load[source == r].sum(axis=0)) for r in recordings]
        own = np.array([step_of(matrix, load, DAMPING) for matrix, load in parts])
        own[:, : unknowns.drives] += unknowns.departures_of(z)[recordings].reshape(len(recordings), -1)
        alone = alone + own
        scatter = np.var(own, axis=0, ddof=1)
        scatter[unknowns.delays] = 0.0  # each recording has its own
        between = np.sqrt(np.maximum(scatter - len(recordings) * np.diag(covariance), 0.0))
        if len(recordings) > 2:
            covariance = at_least(covariance, beyond_normal(len(recordings) - 1) ** 2 * scatter / len(recordings))
        else:
            mean = np.zeros(len(z))
            places = list(unknowns.owned)
            mean[places] = scatter[places] / len(recordings)
            covariance = at_least(covariance, mean)
    coarse = np.abs(z)
    coarse[3 : unknowns.drives : len(KINDS)] = coarse[1 : unknowns.drives : len(KINDS)]  # offsets: as the friction
    coarse[unknowns.delays] = PROMPT / COARSE
    return covariance + np.diag((COARSE * coarse) ** 2), between, alone, z + steps

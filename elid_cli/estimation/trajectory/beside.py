"""Further unknowns of a trajectory fit, such as limits of torques, by how they move its simulated positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.normal_equations import jackknife, step_of, steps_without
from elid_cli.estimation.trajectory.block_sums import BLOCKS, DAMPING, SHORT, of_parts, parts_of
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.loss import Weighed, bent, weighed
from elid_cli.estimation.trajectory.normal_equations import Tracked, simulated
from elid_cli.estimation.trajectory.softening import columns_of
from elid_cli.estimation.trajectory.unknowns import PARAMETERS
from elid_cli.model.linearised import Linearised
from elid_cli.model.runs import Run

FAR = 10.0
"""Standard errors from which a step is a large one."""
BESIDE = 2e-3
"""Part of itself by which a torque or a limit is changed to see what that does."""
FARTHEST, SETTLED = 0.1, 0.3
"""Part of itself that it moves by at most in a step, and the standard errors that do not matter."""


@dataclass(frozen=True)
class Beside:
    """L further unknowns, beside the U of a fit."""

    steps: Array
    """By how much they move, with all others, (L,) …"""
    along: Array
    """… and by how much these do, (U,)."""
    deviations: Array
    """Standard errors, by short parts of the log that are left out, (L,)."""
    spread: Array
    """Their covariance, (L, L)."""
    slopes: Array
    """By how much the others change with each, (L, U)."""
    left: Array
    """Part of every joint's squared error that the step leaves, by first order, (n,)."""

    @property
    def added(self) -> Array:
        """What their errors add to the covariance of the others, (U, U)."""
        found: Array = self.slopes.T @ self.spread @ self.slopes
        return found

    def rougher(self, deviations: Array) -> Beside:
        """Return them with a further error each, independent of all else, of standard deviations (L,)."""
        spread = self.spread + np.diag(deviations**2)
        return replace(self, spread=spread, deviations=np.sqrt(np.diag(spread)))

    @classmethod
    def of(cls, fit: TrajectoryFit, moved: Sequence[Array], held: slice = slice(0)) -> Beside:
        """Return them by how the positions of the fit's stretches change with them, (N, n, L) each.

        Unknowns of the fit that are `held` stay where they are.
        """
        own, n = fit.unknowns, fit.unknowns.robot.n
        columns, count = columns_of(fit), moved[0].shape[2]
        errors = [np.nan_to_num(item.x[:, :n] + item.finer - item.run.measured) for item in fit.tracked]
        seen = [weighed(error, item.usual, item.counts) for error, item in zip(errors, fit.tracked, strict=True)]
        bend, size = np.sqrt(bent(seen)), np.maximum(fit.equations.size, 1e-12)
        parts = BLOCKS * SHORT * len(seen)
        width = own.count + count
        matrix, load, straight = np.zeros((parts, width, width)), np.zeros((parts, width)), np.zeros((width, width))
        further = np.arange(own.count, own.count + count)
        for chain, joints in enumerate(own.chains):  # their unknowns and the delays move them, no others
            here = np.append(np.flatnonzero(np.isin(own.chain_of, (chain, len(own.chains)))), further)
            place = 0
            for part, of_own, of_further in zip(seen, columns, moved, strict=True):
                light = (part.light / size)[:, joints]
                both = np.concatenate([of_own, of_further], axis=2)[:, joints][:, :, here] * light[:, :, None]
                force = part.error[:, joints] * light
                whole = np.ix_(here, here)
                products = np.empty((BLOCKS * SHORT + 1, len(here), len(here)))
                products[0] = straight[whole]
                for numbers, rows in parts_of(np.linspace(0, len(force), BLOCKS * SHORT + 1).astype(int)):
                    plain, bending = of_parts(both, rows), of_parts(both * bend[joints, None], rows)
                    places, turned = place + numbers[:, None], plain.transpose(0, 2, 1)
                    matrix[places[..., None], here[:, None], here] += np.matmul(bending.transpose(0, 2, 1), bending)
                    load[places, here] += np.matmul(turned, force[rows].reshape(len(numbers), -1, 1))[..., 0]
                    products[1 + numbers] = np.matmul(turned, plain)
                straight[whole] = products.sum(axis=0)
                place += BLOCKS * SHORT
        shown = np.setdiff1d(np.arange(own.count), own.delays.start + np.flatnonzero(fit.delays == 0))
        shown = np.setdiff1d(shown, np.arange(own.count)[held])
        used = np.append(shown, further)
        matrix, load, first = matrix[:, used][:, :, used], load[:, used], len(shown)
        whole = matrix.sum(axis=0)
        spread = jackknife(steps_without(matrix, load, DAMPING))[first:, first:]
        slopes = np.zeros((count, own.count))
        slopes[:, shown] = [step_of(whole[:first, :first], column, DAMPING) for column in whole[:first, first:].T]
        deviations = np.sqrt(np.diag(spread))
        near, far = (step_of(m, load.sum(axis=0), DAMPING) for m in (whole, straight[np.ix_(used, used)]))
        # an error that is no noise bends as the weights alone have it, and steps by the loss would go too far
        step = near if (np.abs(near[first:]) <= FAR * deviations).all() else far
        along = np.zeros(own.count)
        along[shown] = step[:first]
        return cls(step[first:], along, deviations, spread, slopes, _left(seen, columns, moved, along, step[first:]))


def _left(
    seen: Sequence[Weighed], columns: Sequence[Array], moved: Sequence[Array], along: Array, steps: Array
) -> Array:
    """Return the part of every joint's squared error that a step of all unknowns leaves, (n,)."""
    before, after = [], []
    for part, of_own, of_further in zip(seen, columns, moved, strict=True):
        before.append(np.sum((part.error * part.light) ** 2, axis=0))
        after.append(np.sum(((part.error + of_own @ along + of_further @ steps) * part.light) ** 2, axis=0))
    found: Array = np.sum(after, axis=0) / np.maximum(np.sum(before, axis=0), 1e-300)
    return found


def moved_by_runs(fit: TrajectoryFit, changed: Sequence[Callable[[Run], Run]]) -> list[Array]:
    """Return by how much L changes of what drives a fit's stretches move their positions, rad (m), (N, n, L) each.

    The equations stay those about the fit's motion, as in the columns of its unknowns: what both move alike, such as
    a joint by its drive's gain and by its inertia, is alike at the joints that it is coupled to then.
    """
    own = fit.unknowns
    equations, parameters = Linearised(own.robot, without=PARAMETERS), own.robot.reference()

    def off(item: Tracked, run: Run) -> Array:
        return simulated(equations, replace(item, run=run), own, fit.z, parameters, plain=True, rounds=1).error

    found = []
    for item in fit.tracked:
        here = off(item, item.run)
        found.append(np.stack([off(item, change(item.run)) - here for change in changed], axis=2))
    return found

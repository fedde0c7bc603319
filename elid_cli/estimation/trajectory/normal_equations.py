"""Normal equations of a trajectory fit: by recording, by block of time, by chain of joints."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.trajectory.unknowns import KINDS, Chains, number_of, variants
from elid_cli.model.rollout import Drives, Linearised, variants_of
from elid_cli.model.runs import Run

BLOCKS = 6
"""Blocks of a recording, each of which is left out in turn for the standard errors (METHODS of leaving out blocks)."""
SETTLING = 0.4
"""s at the start of a stretch that do not count: the simulation starts from one noisy sample."""
REACH = 0.5
"""rad (m); a simulation farther than this from the measured motion has lost it, and is cut."""


@dataclass
class Tracked:
    """A stretch of a recording with the motion that its equations are linearised about."""

    run: Run
    x: Array
    v: Array


@dataclass(frozen=True)
class Equations:
    """What one pass over the recordings says, by chain: sums over blocks of J'J and J'e, and squares of e."""

    matrix: tuple[Array, ...]
    """(B, 4 s, 4 s) of every chain of s joints, weighted."""
    load: tuple[Array, ...]
    """(B, 4 s)."""
    squares: Array
    """Sum of squares of the error of every joint in every block, rad² (m²), (B, n)."""
    lighter: Array
    """The same with large errors counted less, as the fit does."""
    counts: Array
    """Samples of every block, (B,)."""
    spans: tuple[tuple[int, float, float], ...]
    """Recording, first and last time of every block, s."""

    @property
    def rms(self) -> Array:
        """Rms error of every joint, rad (m), (n,)."""
        found: Array = np.sqrt(self.squares.sum(axis=0) / self.counts.sum())
        return found

    @property
    def size(self) -> Array:
        """What the fit makes small: the same with large errors counted less, (n,)."""
        found: Array = np.sqrt(self.lighter.sum(axis=0) / self.counts.sum())
        return found


def passed(equations: Linearised, tracked: list[Tracked], values: Array, chains: Chains, weights: Array) -> Equations:
    """Simulate every stretch with unknowns (n, 4) and their variants, and move on what it is linearised about.

    `weights` are of every joint's error, 1/rad, (n,).
    """
    joints, steps = variants(values, chains)
    n = len(values)
    matrices: list[list[Array]] = [[] for _ in chains.joints]
    loads: list[list[Array]] = [[] for _ in chains.joints]
    squares, lighter, counts, spans = [], [], [], list[tuple[int, float, float]]()
    for item in tracked:
        run = item.run
        local = equations.about(item.x[:, None], item.v[:, None])
        alone = Drives(run.drives.told[:, None], run.drives.kp[None], run.drives.kd[None], run.drives.limit)
        start = run.start[0][None], run.start[1][None]
        x, v = variants_of(equations, local, start, alone, joints, run.dt)
        x, v = x[:, :, 0], v[:, :, 0]
        kept = np.clip(x[:, 0], run.near - REACH, run.near + REACH)
        item.x, item.v = kept, np.where(kept == x[:, 0], v[:, 0], item.v)
        error = np.nan_to_num(x[:, 0, :n] - run.measured)
        moved = x[:, 1:, :n] - x[:, :1, :n]
        # large errors, where a joint sticks, count little more than usual ones (Cauchy's weights)
        size = np.maximum(np.sqrt(np.mean(error**2, axis=0)), 1e-9)
        light = (1.0 + (error / size) ** 2) ** -0.5
        light[run.t - run.t[0] < SETTLING] = 0.0  # the first pose's noise is no fault of the drives
        plain, error, moved = error, error * light, moved * light[:, None]
        edges = np.linspace(0, len(error), BLOCKS + 1).astype(int)
        for a, b in pairwise(edges):
            squares.append(np.sum(plain[a:b] ** 2, axis=0))
            lighter.append(np.sum(error[a:b] ** 2, axis=0))
            spans.append((run.source, float(run.t[a]), float(run.t[b - 1])))
            counts.append(b - a)
            for number, chain in enumerate(chains.joints):
                columns = np.stack([
                    moved[a:b, number_of(place, kind) - 1][:, chain] / steps[joint, kind] * weights[chain]
                    for place, joint in enumerate(chain) for kind in range(len(KINDS))
                ], axis=-1).reshape(-1, len(chain) * len(KINDS))  # fmt: skip
                target = (error[a:b][:, chain] * weights[chain]).ravel()
                matrices[number].append(columns.T @ columns)
                loads[number].append(columns.T @ target)
    return Equations(
        tuple(map(np.array, matrices)), tuple(map(np.array, loads)),
        np.array(squares), np.array(lighter), np.array(counts), tuple(spans),
    )  # fmt: skip

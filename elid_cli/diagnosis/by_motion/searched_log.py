"""The log that searches by motion share: one search after the other, with drives that were changed in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elid_cli._types import Array, Progress
from elid_cli.diagnosis.by_motion.free_bodies import DOUBTED
from elid_cli.diagnosis.by_motion.search import Searched, search
from elid_cli.diagnosis.by_motion.together import Kind, Together
from elid_cli.estimation.trajectory.changes import Changed
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.of_drives import with_drives
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals


@dataclass(frozen=True)
class SearchedLog:
    """Signals and stretches of a log, with the drives as they are taken to be, and what may be tried."""

    signals: Signals
    runs: Sequence[Run]
    declared: tuple[Sequence[Effect], Sequence[float]]
    only: Sequence[str]
    progress: Progress | None
    asked: dict[tuple[str, int], tuple[TrajectoryFit, Changed | None]] = field(default_factory=dict, repr=False)
    """What kinds of changes were asked for beside fits of this log, by effect and fit: it takes long."""

    def ask(self, effect: type[Effect], kind: Kind, near: TrajectoryFit) -> Changed | None:
        """Return the change of a kind that a fit asks for; None where it asks for none, or is not asked alone."""
        if kind.alone is None:
            return None
        if (effect.name, id(near)) not in self.asked:
            self.asked[effect.name, id(near)] = near, kind.alone(near)  # the fit stays, so that no other has its place
        return self.asked[effect.name, id(near)][1]

    def searched(self, robot: Robot, start: Array) -> Searched:
        """Return what a search finds; one that Ctrl-C ends was not compared, and what was found before stands."""
        done = search(robot, self.runs, start, *self.declared, self.only, self.progress)
        if done.partial:
            raise KeyboardInterrupt
        return done

    def delivering(self, ratio: Array) -> SearchedLog:
        """Return the log of drives that deliver the computed torque over a ratio, (n,)."""
        right = with_drives(self.signals, np.zeros(len(ratio)), ratio)
        return replace(self, signals=right, runs=[run.delivering(ratio) for run in self.runs], asked={})

    def changed(self, asked: Together) -> tuple[SearchedLog, Searched]:
        """Return the log of drives with changes, and what a search with these finds."""
        other = replace(self, runs=asked.runs, asked={})
        return other, other.searched(asked.robot, asked.fit.values)

    def is_left(self, fit: TrajectoryFit, least: float = DOUBTED) -> bool:
        """Whether a fit leaves more than the encoders' noise at a joint."""
        return bool((fit.above_noise(self.signals) >= least).any())

    def may(self, kind: type[Effect]) -> bool:
        """Whether an effect may be tried."""
        return not self.only or kind.name in self.only

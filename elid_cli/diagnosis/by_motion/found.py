"""What a search by motion came to, with what acts on the whole robot or on its drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.search import Searched
from elid_cli.diagnosis.by_motion.torque_gains import Gains
from elid_cli.diagnosis.result import Rival
from elid_cli.estimation.trajectory.changes import Changed
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.robot.robot import Robot


@dataclass(frozen=True)
class Found:
    """What a search came to, with what acts on the whole."""

    done: Searched
    """`before` is the fit of the robot as it is described."""
    plain: TrajectoryFit
    """The fit without effects beside what acts on the whole."""
    robot: Robot
    """The robot as it is changed."""
    ratio: Array
    """What the computed torque of every joint is over the one that acts, (n,)."""
    scaled: NDArray[np.bool_]
    """Joints where that is named, (n,)."""
    changes: tuple[Changed, ...]
    """What else of the robot or of its drives is found, such as angles, delays and loads: each with those before it."""
    gains: Gains | None
    """The fit by drives of another torque at the other joints that are doubted."""
    taken: Gains | None
    """The one whose gains are named."""
    rivals: tuple[Rival, ...] = ()
    """What does as well as these."""
    shifts: tuple[Array, ...] = ()
    """By how much drive parameters are other with one of these, (n * 4,) each: the errors count it."""

    @property
    def items(self) -> int:
        """How many effects they are: of single joints one each, a load or a tilt one, gains of several joints one."""
        whole = sum(int(change.sure.sum()) if change.by.joints else 1 for change in self.changes)
        return whole + int(self.scaled.any()) + len(self.done.named)

    @property
    def rates(self) -> Array:
        """Integral over proportional gain of every joint's drive beyond what is declared, 1/s, (n,)."""
        found: Array = np.sum([np.zeros(self.robot.n), *(change.rates for change in self.changes)], axis=0)
        return found

    @property
    def filters(self) -> Array:
        """Time constant of the filter of every drive's velocity beyond what is declared, s, (n,)."""
        found: Array = np.sum([np.zeros(self.robot.n), *(change.filters for change in self.changes)], axis=0)
        return found

    @property
    def loop_gains(self) -> Array:
        """The logged kp, and kd, of every joint's drive over the one that acts, beyond what is declared, (2, n)."""
        found: Array = np.prod([np.ones((2, self.robot.n)), *(change.loop_gains for change in self.changes)], axis=0)
        return found

    @property
    def acting(self) -> Array:
        """`ratio`, with the gains that were found beside a change."""
        found: Array = np.prod([self.ratio, *(change.ratio for change in self.changes)], axis=0)
        return found

    @property
    def written(self) -> Robot:
        """The robot as it is changed, with bodies that can be built."""
        robot = self.robot
        for change in self.changes:
            robot = change.by.written(robot, change.level)
        return robot

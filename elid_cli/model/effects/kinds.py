"""Effects of special kinds: with an internal state, with a differential equation of their own, and mere curves."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect
from elid_cli.model.effects.scene import Scene

CurveRows = Literal["motor", "link", "transmission"]
"""Where a curve acts."""


class MemoryEffect(Effect):
    """An effect whose columns follow from an internal state driven by one signal (hysteresis, creep)."""

    memory: ClassVar[bool] = True

    @abstractmethod
    def drive(self, scene: Scene) -> Array:
        """Return the signal that drives the state, shape (N,)."""

    @abstractmethod
    def advance(self, state: float, previous: float, now: float) -> float:
        """Return the state after the drive moved from `previous` to `now` within one sample."""

    @abstractmethod
    def columns_of(self, scene: Scene, state: Array) -> Columns:
        """Return the columns for a history of states, shape (N,)."""

    def columns(self, scene: Scene) -> Columns:
        """Run the state through the log, from 0 at every segment's start."""
        return self.columns_of(scene, self.history(scene))

    def history(self, scene: Scene) -> Array:
        """Return the state at every instant, shape (N,)."""
        drive = self.drive(scene).tolist()
        states = np.zeros(len(drive))
        starts = set(scene.starts)
        state = 0.0
        for k in range(1, len(drive)):
            state = 0.0 if k in starts else self.advance(state, drive[k - 1], drive[k])
            states[k] = state
        return states


class CurveEffect(Effect):
    """A smooth curve that describes what is left and explains nothing: asked for (``--lookup``), never searched.

    Its shapes include ``low`` and ``high``; the heights of its parts are held near 0.
    """

    searched: ClassVar[bool] = False
    variables: ClassVar[tuple[str, ...]]
    """What a curve may run over."""

    @classmethod
    @abstractmethod
    def over(cls, scene: Scene, joint: int, variable: str, rows: CurveRows) -> Effect | None:
        """Return the curve over the range that a variable covers in this log, or None where it covers none."""

    @classmethod
    @abstractmethod
    def words(cls, values: Mapping[str, float]) -> str:
        """Return what a curve runs over and where it acts: ``velocity in the motor row``."""


class OscillatorEffect(Effect):
    """An effect with a continuous state of its own that the motion drives (a flexible mode of link or base).

    The simulator integrates `rates` together with the robot; `columns` of a log has to integrate them itself.
    """

    states: ClassVar[int] = 2
    memory: ClassVar[bool] = True

    @abstractmethod
    def rates(self, scene: Scene, state: Array) -> Array:
        """Return the state's time derivative (states, N); accelerations in `scene.motion` are valid here."""

    @abstractmethod
    def columns_of(self, scene: Scene, state: Array) -> Columns:
        """Return the columns for given states (states, N); accelerations in `scene.motion` are not valid here."""


def goes_with(one: Effect, other: Effect) -> bool:
    """Whether an effect leaves a model with another one: it is that, or the same at another joint as all have it."""
    return one is other or (other.quasi_static and type(one) is type(other))

"""A log and its division into stretches that are fitted and stretches held out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.data import SampledData
from elid_cli.estimation.regression.effect_columns import scene_of
from elid_cli.estimation.regression.known_columns import KnownColumns
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.triangles import to_triangles
from elid_cli.estimation.validation.noise_floor import PropagatedNoise, propagated
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.effects.declared import declared_effects
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.posed import Pose
from elid_cli.model.effects.shifts import Shifts, corrected
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals, noise_between_jumps


@dataclass(frozen=True)
class Log:
    """A log and its division; everything that stays the same during a search."""

    model: Regressor
    base: BaseParameters
    signals: Signals
    observation: Observation
    fold: NDArray[np.intp]
    """Fold of every instant, -1 where held out, (M,)."""
    raw: Signals
    """The signals as logged; `signals` has late channels moved to where they belong."""
    shifts: Shifts
    """By how much channels were moved."""
    seen: Shifts
    """By how much the robot file and the positions say that channels are late: they go back there without an effect."""
    level: Robot
    """The robot as described; the model's is turned by `pose`."""
    pose: Pose
    others: bool = False
    """Whether other stretches than the usual ones are held out."""

    def shifted(self, shifts: Shifts) -> Log:
        """Return the log with other shifts of its channels."""
        signals = corrected(self.raw, shifts)
        if np.any(shifts.torque):
            signals = replace(signals, moved=shifts.torque)
        return replace(self, signals=signals, observation=observe(self.model, signals), shifts=shifts)

    def seen_late(self, joint: int, skew: float) -> Log:
        """Return the log with the link encoder of a joint moved, s, as far as the positions show it to be late."""
        log = self.shifted(self.shifts.moved("link", joint, skew))
        return replace(log, seen=self.seen.moved("link", joint, skew))

    def posed(self, pose: Pose) -> Log:
        """Return the log with the model turned by another pose."""
        model = Regressor(pose.robot(self.level))
        return replace(self, model=model, base=find_base(model), observation=observe(model, self.signals), pose=pose)

    def with_noise(self, tau: Array) -> Log:
        """Return the log with other noise of its torques, (n,), N·m (N)."""
        signals, raw = (replace(one, noise=replace(one.noise, tau=tau)) for one in (self.signals, self.raw))
        return replace(self, signals=signals, raw=raw)

    @cached_property
    def training(self) -> Observation:
        """The observation with the held-out stretches masked."""
        return self.observation.only(self.fold >= 0)

    @cached_property
    def data(self) -> SampledData:
        """The training stretches as the one fit takes them."""
        return SampledData(self.model, self.signals, self.training, self.fold)

    @property
    def declared(self) -> list[Effect]:
        """The effects that the robot file declares, in the shapes that it gives."""
        plain = reweighted(to_triangles(self.training, (), self.fold), self.base.count).values[: self.model.parameters]
        scene = scene_of(self.model, self.signals, plain)
        return [item.effect for item in declared_effects(self.model.robot, scene)]

    @cached_property
    def columns(self) -> KnownColumns:
        """Columns of effects in this log, as far as they are known."""
        return KnownColumns(self.signals)

    @cached_property
    def noise(self) -> PropagatedNoise:
        """What sensor noise changes in the equations, whatever the parameters."""
        return propagated(self.model, self.signals, self.observation)

    @cached_property
    def noise_alone(self) -> PropagatedNoise:
        """The same without what the splines cut off the motion; jumps of positions count as no noise."""
        signals, recording = self.signals, self.signals.recording
        if recording is not None:
            link, motor = (
                np.fmin(noise, noise_between_jumps(channel, signals.segments, signals.dt))
                for noise, channel in ((signals.noise.q, recording.q), (signals.noise.theta, recording.theta))
            )
            signals = replace(signals, noise=replace(signals.noise, q=link, theta=motor))
        return propagated(self.model, signals, self.observation, cut=False)

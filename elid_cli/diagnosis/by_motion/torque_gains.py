"""Wrong gains in the place of effects: the motion simulated by drives whose torque is of another size.

A gain multiplies the whole computed torque of a joint, the weight that it carries among it, and near one pose a weight
of another size is a spring. How large the torque is follows from the described bodies (`load_scales`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.refits import known_of
from elid_cli.diagnosis.by_motion.relative_gains import LEAST_RATIO, RelativeGains
from elid_cli.diagnosis.by_motion.rivals import clearly_more
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.diagnosis.result import FoundEffect, Rival
from elid_cli.errors import DataError
from elid_cli.estimation.known_load import LoadScale
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.beside import BESIDE, FARTHEST, SETTLED, Beside, moved_by_runs
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.of_drives import declared_gains
from elid_cli.model.runs import Run
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

SHARPENED = 4
"""Fits by which a gain is sharpened."""
SURE = 5.0
"""Standard errors by which the motion must ask for torques of another size."""
DOUBTED = 1.2
"""Times the encoders' noise from which what the motion leaves may be a torque of another size."""
LEAST = 0.015
"""Relative difference from which a gain is looked for where the motion asks for it."""
MOST = 0.5
"""Part of the joint's squared error beyond noise that the first step to them may leave."""
LARGEST = 0.5
"""Part of itself by which a ratio is taken to be off at first."""
CHECK = "a known payload, held still in several poses, with kp and kd as the drive has them"
"""What separates a torque gain from what imitates it."""


@dataclass(frozen=True)
class Gains:
    """The fit by drives whose torques are of another size, beside what a search found."""

    ratio: Array
    """What the computed torque of every joint is over the one that acts, (n,)."""
    deviation: Array
    """Its standard errors, (n,); 0 where it is not doubted."""
    steps: Array
    """Part of itself by which the motion would have it larger, (n,)."""
    fit: TrajectoryFit

    @classmethod
    def of(
        cls, before: TrajectoryFit, after: TrajectoryFit, scales: Sequence[LoadScale], signals: Signals
    ) -> Gains | None:
        """Return it with the effects that a search took at other joints; None where it runs away, or no scale is off.

        Parameters
        ----------
        before, after
            The fits without and with the effects that were taken.
        scales
            What multiplies the torque that the bodies need, of the joints where that is surely not 1.
        signals
            The log, with the torque as it was computed.
        """
        ratio = np.ones(before.unknowns.robot.n)
        for scale in scales:
            ratio[scale.joint] = scale.ratio
        if not scales:
            return None
        found: Gains | None = None
        for _ in range(SHARPENED):
            found = cls._at(before, after, ratio, [scale.joint for scale in scales], signals)
            if found is None:
                return None
            steps, deviations = found.steps, found.deviation / found.ratio
            if (np.abs(steps) <= SETTLED * deviations).all():
                break
            ratio = found.ratio * (1.0 + np.clip(steps, -FARTHEST, FARTHEST))
        return found

    @classmethod
    def _at(
        cls, before: TrajectoryFit, after: TrajectoryFit, ratio: Array, joints: Sequence[int], signals: Signals
    ) -> Gains | None:
        """Return the fit at some ratios (n,), those of some joints to be sharpened; None where it runs away."""
        near = started_from(before.unknowns.robot, replace(signals, tau=signals.tau / ratio))
        trial = _scaled(before, after, ratio, np.where((ratio != 1.0)[:, None], near, before.values))
        if trial is None:
            return None
        beside, (deviation, steps) = Beside.of(trial, moved_by_gains(trial, joints)), np.zeros((2, len(ratio)))
        deviation[joints], steps[joints] = ratio[joints] * beside.deviations, beside.steps
        return cls(ratio, deviation, steps, trial)


def asked_by_motion(fit: TrajectoryFit, signals: Signals, scales: Sequence[LoadScale]) -> list[LoadScale]:
    """Return scales, and those of further joints that the motion which a fit leaves asks for."""
    known = {scale.joint for scale in scales}
    above = fit.above_noise(signals)
    joints = [k for k in np.flatnonzero(above >= DOUBTED).tolist() if k not in known]
    if not joints:
        return list(scales)
    beside = Beside.of(fit, moved_by_gains(fit, joints))
    return [*scales, *(
        LoadScale(joint, 1.0 + float(np.clip(step, -LARGEST, LARGEST)), deviation, 0.0)
        for joint, step, deviation in zip(joints, beside.steps.tolist(), beside.deviations.tolist(), strict=True)
        if abs(step) > max(LEAST, SURE * deviation)
        # of what is more than noise
        and beside.left[joint] * above[joint] ** 2 - 1.0 < MOST * (above[joint] ** 2 - 1.0)
    )]  # fmt: skip


def gain_rivals(
    before: TrajectoryFit, after: TrajectoryFit, gains: Gains | None, named: Sequence[Named]
) -> tuple[Rival, ...]:
    """Return torque gains that do as well as effects that a search took at their joints.

    Parameters
    ----------
    before, after
        The fits without and with the effects that were taken.
    gains
        The fit with torque gains in their place.
    named
        These effects.
    """
    if gains is None:
        return ()
    bare, mine, its = (fit.equations.lighter for fit in (before, after, gains.fit))
    names, found = before.unknowns.robot.joint_names, dict[int, Rival]()
    for item in named:
        joint = item.effect.joint
        share = 1.0 - float(its[:, joint].sum() / max(float(bare[:, joint].sum()), 1e-300))
        if gains.ratio[joint] != 1.0 and share > 0 and not clearly_more(its[:, joint], mine[:, joint]):
            value = {"gain": float(gains.ratio[joint] - 1.0)}
            found[joint] = Rival(gain_name(), names[joint], item.effect.name, share, value, CHECK)
    return tuple(found.values())


def nearer(after: TrajectoryFit, gains: Gains | None, named: Sequence[Named] = ()) -> NDArray[np.bool_]:
    """Return the joints that drives of another torque bring clearly nearer than all that a search found, (n,).

    Where that took an effect, which is more than one gain, as near is enough.
    """
    robot, taken = after.unknowns.robot, {item.effect.joint for item in named}
    kind, found = effect_that(of_drive="gain"), np.zeros(robot.n, dtype=bool)
    for joint in np.flatnonzero(gains.ratio != 1.0).tolist() if gains is not None else ():
        assert gains is not None
        mine, its = (fit.equations.lighter[:, joint] for fit in (after, gains.fit))
        as_near = joint in taken and bool(its.sum() <= mine.sum())
        found[joint] = kind.applies(robot, joint) and (as_near or clearly_more(mine, its))
    return found


def given_up(
    after: TrajectoryFit, gains: Gains | None, named: Sequence[Named], scaled: NDArray[np.bool_]
) -> tuple[Rival, ...]:
    """Return what a search took at joints whose gain stands in its place, as far as the motion tells no difference."""
    names, found = after.unknowns.robot.joint_names, list[Rival]()
    for item in named if gains is not None else ():
        assert gains is not None
        joint = item.effect.joint
        mine, its = (fit.equations.lighter[:, joint] for fit in (after, gains.fit))
        if scaled[joint] and not clearly_more(mine, its):
            found.append(Rival(item.effect.name, names[joint], gain_name(), item.gain, {}, CHECK))
    return tuple(found)


class OtherGains(RelativeGains):
    """Gains of the whole computed torque."""

    kind = effect_that(of_drive="gain")

    def ratio(self, count: int, values: Array) -> Array:
        """Return the computed torque over the one that acts, (count,)."""
        return self.over(count, values)

    def run(self, plain: Run, values: Array) -> Run:
        """Return the stretch under drives of these gains."""
        return plain.delivering(self.over(plain.measured.shape[1], values))

    def moved(self, fit: TrajectoryFit, level: Robot, values: Array) -> Sequence[Array]:
        """Return what other torques of these drives do."""
        return [part / np.maximum(1.0 + values, LEAST_RATIO) for part in moved_by_gains(fit, self.joints)]


def gains_of(robot: Robot, joints: tuple[int, ...]) -> OtherGains:
    """Return the gains of some joints' drives as numbers."""
    return OtherGains(joints, tuple(declared_gains(robot).tolist()))


def moved_by_gains(fit: TrajectoryFit, joints: Sequence[int]) -> list[Array]:
    """Return how the positions of a fit's stretches change with the torque of some joints' drives over what it is.

    rad (m), (N, n, joints) each.
    """

    def scaled(joint: int) -> Callable[[Run], Run]:
        ratio = np.where(np.arange(fit.unknowns.robot.n) == joint, 1.0 + BESIDE, 1.0)
        return lambda run: run.delivering(ratio)

    return [moved / BESIDE for moved in moved_by_runs(fit, [scaled(joint) for joint in joints])]


def found_gains(
    robot: Robot, before: TrajectoryFit, after: TrajectoryFit, gains: Gains | None, named: NDArray[np.bool_]
) -> tuple[FoundEffect, ...]:
    """Return the torque gains of some joints (n,) as effects, with what the motion comes nearer by.

    They are whole: with those that the robot declares already.
    """
    if gains is None:
        return ()
    bare, left = (fit.equations.lighter.sum(axis=0) for fit in (before, after))
    known = declared_gains(robot)
    ratio, deviation = known * gains.ratio, known * gains.deviation
    return tuple(
        FoundEffect(
            gain_name(), robot.joint_names[j],
            {"gain": float(ratio[j] - 1.0)}, {"gain": float(deviation[j])},
            float(1.0 - left[j] / max(bare[j], 1e-300)),
            f"the computed torque is {ratio[j]:.3f} times what acts: kp and kd, or all masses that the joint "
            "carries, are off by that factor",
        )
        for j in np.flatnonzero(named).tolist()
    )  # fmt: skip


def _scaled(before: TrajectoryFit, after: TrajectoryFit, ratio: Array, near: Array) -> TrajectoryFit | None:
    """Return the fit by drives whose torques are of another size (n,), with effects at the other joints only.

    It starts from drive parameters `near`, (n, 4).
    """
    own = after.unknowns
    kept = [
        k for k, effect in enumerate(after.effects)
        if k < len(before.effects) or effect.softens or ratio[effect.joint] == 1.0
    ]  # fmt: skip
    unknowns = replace(own, effects=tuple(after.effects[k] for k in kept))
    amplitudes = np.concatenate(
        [np.zeros(0), *(after.z[own.amplitudes_of(k)] for k in kept if not after.effects[k].softens)]
    )
    tracked = [replace(item, run=item.run.delivering(ratio), local=None) for item in after.tracked]
    try:
        z = known_of(before, unknowns, amplitudes)
        z[: unknowns.drives] = near.ravel()
        return fitted(unknowns, tracked, z, prompt=not before.delays.any())
    except DataError:
        return None


def gain_name() -> str:
    """Return the name of the effect that a torque of another size is."""
    return effect_that(of_drive="gain").name

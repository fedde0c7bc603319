"""Wrong gains in the place of effects: the motion simulated by drives whose torque is of another size.

A gain multiplies the whole computed torque of a joint, the weight that it carries among it, and near one pose a weight
of another size is a spring. How large the torque is follows from the described bodies (`load_scales`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.refits import QUICK, known_of
from elid_cli.diagnosis.by_motion.rivals import clearly_more
from elid_cli.diagnosis.by_motion.steps import Named
from elid_cli.diagnosis.result import Rival
from elid_cli.errors import DataError
from elid_cli.estimation.known_load import LoadScale
from elid_cli.estimation.trajectory.fit import TrajectoryFit, fitted
from elid_cli.estimation.trajectory.normal_equations import Tracked
from elid_cli.estimation.trajectory.unknowns import Unknowns
from elid_cli.model.effects import effect_that

CHECK = "a known payload, held still in several poses, with kp and kd as the drive has them"
"""What separates a torque gain from what imitates it."""


def gain_rivals(
    before: TrajectoryFit, after: TrajectoryFit, named: Sequence[Named], scales: Sequence[LoadScale]
) -> tuple[Rival, ...]:
    """Return torque gains that do as well as effects that a search took at their joints.

    Parameters
    ----------
    before, after
        The fits without and with the effects that were taken.
    named
        These effects.
    scales
        What multiplies the torque that the bodies need, of the joints where that is surely not 1.
    """
    ratio = np.ones(before.unknowns.robot.n)
    for scale in scales:
        ratio[scale.joint] = scale.ratio
    taken = [item for item in named if ratio[item.effect.joint] != 1.0]
    if not taken:
        return ()
    trial = _scaled(before, after, ratio)
    if trial is None:
        return ()
    bare, mine, its = (fit.equations.lighter for fit in (before, after, trial))
    names, found = before.unknowns.robot.joint_names, dict[int, Rival]()
    for item in taken:
        joint = item.effect.joint
        share = 1.0 - float(its[:, joint].sum() / max(float(bare[:, joint].sum()), 1e-300))
        if share > 0 and not clearly_more(its[:, joint], mine[:, joint]):
            value = {"gain": float(ratio[joint] - 1.0)}
            found[joint] = Rival(gain_name(), names[joint], item.effect.name, share, value, CHECK)
    return tuple(found.values())


def _scaled(before: TrajectoryFit, after: TrajectoryFit, ratio: Array) -> TrajectoryFit | None:
    """Return the fit by drives whose torques are of another size (n,), with effects at the other joints only."""
    own = after.unknowns
    kept = [
        k for k, effect in enumerate(after.effects)
        if k < len(before.effects) or effect.softens or ratio[effect.joint] == 1.0
    ]  # fmt: skip
    unknowns = Unknowns(own.robot, tuple(after.effects[k] for k in kept), own.recordings, own.held)
    amplitudes = np.concatenate(
        [np.zeros(0), *(after.z[own.amplitudes_of(k)] for k in kept if not after.effects[k].softens)]
    )
    tracked = [_delivering(item, ratio) for item in before.tracked]
    try:
        return fitted(
            unknowns, tracked, known_of(before, unknowns, amplitudes), prompt=not before.delays.any(), cycles=QUICK
        )
    except DataError:
        return None


def _delivering(item: Tracked, ratio: Array) -> Tracked:
    """Return a stretch whose drives deliver the computed torque over a ratio (n,)."""
    drives = item.run.drives
    less = replace(drives, told=drives.told / ratio, kp=drives.kp / ratio, kd=drives.kd / ratio)
    told = None if item.run.told is None else item.run.told / ratio
    return replace(item, run=replace(item.run, drives=less, told=told))


def gain_name() -> str:
    """Return the name of the effect that a torque of another size is."""
    return effect_that(from_model=True, place="torque").name

"""Gains of the whole torque that do as well as gains of the position's error that were found.

Where drives are told no velocity, the two differ by viscous friction alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.by_motion.found import Found
from elid_cli.diagnosis.by_motion.loop_gains import PositionGains
from elid_cli.diagnosis.by_motion.poses import effects_of
from elid_cli.diagnosis.by_motion.refits import again
from elid_cli.diagnosis.by_motion.together import clearly_nearer
from elid_cli.diagnosis.by_motion.torque_gains import gain_name
from elid_cli.diagnosis.result import Rival
from elid_cli.errors import DataError
from elid_cli.estimation.trajectory.changes import SURE, Changed
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.held_loops import negative
from elid_cli.model.effects.of_drives import TUNED


def with_gain_twins(found: Found, bare: TrajectoryFit) -> Found:
    """Return what was found with the gains of the whole torque that do as well as those of the position's error.

    Standard errors count what these make of the drives. A gain that leaves a joint less than no viscous friction, which
    it has with the other, does not do as well. `bare` is the fit of the robot as it is described.
    """
    if found.done.partial:
        return found
    known = {(rival.effect, rival.joint) for rival in found.rivals}
    tuned = [change for change in found.changes if change.by.kind.of_drive == TUNED[0]]
    every = [rival for change in tuned for rival in _twins(found, change, bare)]
    twins = [rival for rival in every if (rival.effect, rival.joint) not in known]
    shifts = [rival.drives for rival in twins[:1] if rival.drives is not None]
    return replace(found, rivals=(*found.rivals, *twins), shifts=(*found.shifts, *shifts))


def _twins(found: Found, change: Changed, bare: TrajectoryFit) -> Iterator[Rival]:
    """Yield gains of the whole torque in the place of those of the position's error, all of its joints together."""
    assert isinstance(change.by, PositionGains)
    fit, drives = found.done.after, found.done.after.unknowns.drives
    twin = _delivering(fit, change.by.over(found.robot.n, change.values))
    if twin is None or clearly_nearer(fit, twin) or (negative(twin, SURE) & ~negative(fit, SURE)).any():
        return
    for effect in effects_of(change, bare):
        yield Rival(gain_name(), effect.joint, effect.effect, effect.gain, effect.parameters, change.by.kind.record,
                    effect.std_error, drives=(twin.z - fit.z)[:drives])  # fmt: skip


def _delivering(fit: TrajectoryFit, ratio: Array) -> TrajectoryFit | None:
    """Return the fit by drives whose kd is told over a ratio (n,) as their kp is; None where it runs away."""
    tracked = [replace(item, run=item.run.tuned(np.ones(len(ratio)), ratio), local=None) for item in fit.tracked]
    try:
        return again(replace(fit, tracked=tuple(tracked)), fit.unknowns, fit.z)
    except DataError:
        return None

"""Whether a torque that is nearly that of a weight hides in the bodies' parameters: a weak spring on a link.

Over the angles of one log such a spring is nearly what another first moment would be. Nothing but noise is left then,
and first moments and masses are off by many of their standard errors. Its size is asked instead, as that of a zero is
(`absorbed_zeros`).
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.judgement import NotExcluded
from elid_cli.estimation.regression.effect_columns import extra_of, scene_of
from elid_cli.estimation.validation.size_beside import (
    MOVED,
    TAKEN_UP,
    Size,
    askable,
    bound_of,
    size_beside,
    size_in_words,
)
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import EstimationRow

SURE = 4.0
"""Standard errors by which it must differ from 0 to make a model insufficient: on 417 logs without one it differed by
3.8 at most."""
LIKELY, FAR = 3.3, 8.0
"""The same to mark what it moves, and by how many of its standard errors it must move some parameter then: few logs can
be surer of a weak spring, and 4 of those 417 had one so large."""
AS_WELL = 0.85
"""Part of the standard errors of the surest from which another joint's may be the one."""


class AbsorbedWeight(NamedTuple):
    """Torques like those of weight that a fit took for other values of its parameters."""

    joints: tuple[int, ...]
    """Where there surely is one, the surest first: one of them, or several."""
    sure: float
    """Standard errors of the surest; 0 where there is none."""
    moved: NDArray[np.bool_]
    """Base parameters that they move, (b,)."""
    notes: tuple[str, ...]
    """What there is, and how large, a sentence for every joint."""
    bounds: tuple[NotExcluded, ...] = ()
    """Up to which sizes the others would not show."""


def absorbed_weight(
    fit: DefaultFit, quiet: Mapping[EstimationRow, float], lacking: Container[EstimationRow] = ()
) -> AbsorbedWeight:
    """Return the effects like weight that a fit shows, each taken alone.

    Parameters
    ----------
    fit
        The fit, whose samples are at hand.
    quiet
        Residual of every row, N·m (N), up to which noise is all that is left.
    lacking
        Rows that lack something, and need not come down to noise by such an effect.
    """
    moved, found = np.zeros(fit.base.count, dtype=bool), list[tuple[float, Effect, Size]]()
    bounds: list[NotExcluded] = []
    if not askable(fit):
        return AbsorbedWeight((), 0.0, moved, ())
    scene, robot = scene_of(fit.model, fit.signals, fit.standard), fit.model.robot
    judged = {row: quiet[row] for row in quiet if row not in lacking}
    kinds = [kind for kind in effect_classes().values() if kind.like_weight]
    able = (kind(k) for kind in kinds for k in range(robot.n) if kind.applies(robot, k))
    for effect in (effect for effect in able if not (fit.effects and fit.effects.has(effect))):
        extra = extra_of(effect, scene, fit.signals)
        asked = size_beside(fit, extra, judged)
        if asked is not None and _seen(asked) and _can_be(effect, scene, asked):
            found.append((asked.sure, effect, asked))
        elif asked is not None and (bound := bound_of(fit, effect, extra, asked, SURE)):
            bounds.append(bound)
    most = max((sure for sure, *_ in found), default=0.0)
    found = sorted((item for item in found if item[0] >= AS_WELL * most), key=lambda item: -item[0])
    joints = dict.fromkeys(effect.joint for sure, effect, _ in found if sure > SURE)
    moved = np.any([moved, *(asked.loose > MOVED for *_, asked in found)], axis=0)
    return AbsorbedWeight(tuple(joints), most, moved, tuple(_words(fit, *item) for item in found), tuple(bounds))


def _seen(asked: Size) -> bool:
    """Whether a size is surely not 0 and moves a parameter, or is likely so and moves one far."""
    return bool(asked.moved.any()) and (asked.sure > SURE or (asked.sure > LIKELY and float(asked.shift.max()) > FAR))


def _can_be(effect: Effect, scene: Scene, asked: Size) -> bool:
    """Whether one of this size can be built."""
    errors = {p.name: float(error) for p, error in zip(effect.amplitudes, asked.errors, strict=True)}
    return effect.can_be(scene, effect.joint, effect.named(scene, asked.values), errors)


def _words(fit: DefaultFit, sure: float, effect: Effect, asked: Size) -> str:
    """Return what there is at a joint, and how large, in a sentence."""
    joint = fit.model.robot.joints[effect.joint]
    sizes = size_in_words(fit, effect, asked)
    surely = "" if sure > SURE else ", which this log alone is not sure of"
    kinds = effect_classes()
    twins = ", ".join(kinds[name].title or name.replace("_", " ") for name in kinds[effect.name].twins)
    return (
        f"a {effect.title or effect.name.replace('_', ' ')} at {joint.name} ({sizes}), or a twin of it ({twins}), "
        f"would explain this log better{surely}: {TAKEN_UP}, "
        f"and what it moves is marked; what would tell: {effect.record}"
    )

"""Whether a joint's positions have a wrong zero or are off once per turn, or the base is tilted: others take it up.

A body whose frame is turned a little has other first moments and inertias; they explain nearly all of a zero that is
off by some milliradians, and are then off by many of their standard errors. What the poses of the other joints leave of
it drowns in the noise: its size is asked instead, as that of a factor on a torque is (`absorbed_gains`). The zero of
the last joint's positions is no fault that a log shows: its body has another frame then.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.judgement import NotExcluded
from elid_cli.estimation.regression.effect_columns import extra_of, scene_of
from elid_cli.estimation.validation.size_beside import TAKEN_UP, Size, askable, bound_of, size_beside, size_in_words
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import EstimationRow

SURE, ELASTIC = 4.0, 12.0
"""Standard errors by which it must differ from 0, of rigid arms and of those with elastic joints, whose encoders'
noise in the columns is in no standard error. On 80 and 280 logs with right zeros it differed by 2.9 and 8.7 at most."""
LIKELY, ELASTIC_LIKELY, FAR = 3.0, 9.0, 8.0
"""Standard errors from which it is likely so in these arms, and by which it must move a parameter to be said then."""
OF_TURN = 5.0
"""Standard errors that an error once per turn, which has an amplitude more, must have beyond those of a zero."""


WIDE = 0.5
"""rad; range of positions from which an error once per turn is asked for: a zero and a scale are alike over less."""


class AbsorbedZeros(NamedTuple):
    """Zeros of positions that a fit took for other values of its parameters."""

    joints: tuple[int, ...]
    """Whose positions, the surest first; of a tilt of the base the first joint."""
    moved: NDArray[np.bool_]
    """Base parameters that they move, (b,)."""
    sure: float = 0.0
    """Standard errors by which the surest differs from 0."""
    notes: tuple[str, ...] = ()
    """Of each that is likely, what it may be and what it moves."""
    bounds: tuple[NotExcluded, ...] = ()
    """Up to which sizes the others would not show."""
    turns: bool = False
    """Whether it is an error once per turn that the surest joint's positions have."""


def absorbed_zeros(
    fit: DefaultFit, quiet: Mapping[EstimationRow, float], lacking: Container[EstimationRow] = ()
) -> AbsorbedZeros:
    """Return the zeros of positions, or the tilt of the base, that a fit shows to be off, each taken alone.

    Parameters
    ----------
    fit
        The fit, whose samples are at hand.
    quiet
        Residual of every row, N·m (N), up to which noise is all that is left.
    lacking
        Rows that lack something, and need not come down to noise by a zero.
    """
    moved, found = np.zeros(fit.base.count, dtype=bool), dict[int, float]()
    notes, bounds = list[str](), list[NotExcluded]()
    if not askable(fit):
        return AbsorbedZeros((), moved)
    elastic = bool(fit.model.robot.elastic.any())
    least, likely = (ELASTIC, ELASTIC_LIKELY) if elastic else (SURE, LIKELY)
    scene = scene_of(fit.model, fit.signals, fit.standard)
    judged = {row: quiet[row] for row in quiet if row not in lacking}
    for effect in (effect for effect in _asked(fit) if not (fit.effects and fit.effects.has(effect))):
        extra = extra_of(effect, scene, fit.signals)
        asked = size_beside(fit, extra, judged)
        if asked is None:
            continue
        if asked.sure > least and asked.moved.any():
            found[effect.joint] = max(asked.sure, found.get(effect.joint, 0.0))
            moved |= asked.moved
        elif asked.sure > likely and asked.moved.any() and float(asked.shift.max()) > FAR:
            moved |= asked.moved
            notes.append(_words(fit, effect, asked))
        elif bound := bound_of(fit, effect, extra, asked, least):
            bounds.append(bound)
    turns = _of_turns(fit, scene, judged, float(np.hypot(max(found.values(), default=0.0), max(OF_TURN, least))))
    surest = turns.joints or found
    joints = tuple(sorted(surest, key=lambda k: -surest[k]))
    sure, bounds = max(surest.values(), default=0.0), [*bounds, *turns.bounds]
    return AbsorbedZeros(joints, moved | turns.moved, sure, tuple(notes), tuple(bounds), bool(turns.joints))


class _Turns(NamedTuple):
    """Errors once per turn: how sure they are by joint, what they move, and up to which sizes others would not show."""

    joints: dict[int, float]
    moved: NDArray[np.bool_]
    bounds: list[NotExcluded]


def _of_turns(fit: DefaultFit, scene: Scene, judged: Mapping[EstimationRow, float], least: float) -> _Turns:
    """Return what rigid joints' positions have of an error once per turn; told are those of some standard errors."""
    kind, robot = effect_that(in_deflection="turn"), fit.model.robot
    wide = np.ptp(fit.signals.motion.q, axis=0) > WIDE
    found = _Turns({}, np.zeros(fit.base.count, dtype=bool), [])
    for effect in (kind(k) for k in range(robot.n) if kind.applies(robot, k) and wide[k]):
        if robot.joints[effect.joint].elastic or (fit.effects and fit.effects.has(effect)):
            continue
        extra = extra_of(effect, scene, fit.signals)
        asked = size_beside(fit, extra, judged)
        if asked is None:
            continue
        if asked.sure > least and asked.moved.any():
            found.joints[effect.joint] = asked.sure
            found.moved[asked.moved] = True
        elif bound := bound_of(fit, effect, extra, asked, least):
            found.bounds.append(bound)
    return found


def _words(fit: DefaultFit, effect: Effect, asked: Size) -> str:
    """Return what may be off, by how much, and what follows, in a sentence."""
    joint = fit.model.robot.joints[effect.joint].name
    what = "base may be tilted" if effect.whole_robot else f"zero of the positions of {joint} may be off"
    return (
        f"the {what} ({size_in_words(fit, effect, asked)}), which this log alone is not sure of: {TAKEN_UP}, and what "
        f"it moves is marked; what would tell: {effect.record}"
    )


def _asked(fit: DefaultFit) -> Iterator[Effect]:
    robot = fit.model.robot
    for kind in (effect_that(moves_zero=True), effect_that(turns_gravity=True)):
        joints = [0] if kind.whole_robot else [k for k in range(robot.n) if kind.applies(robot, k)]
        yield from (kind(joint) for joint in joints)

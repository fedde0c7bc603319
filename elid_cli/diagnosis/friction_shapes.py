"""Stribeck velocity and form of servo friction at a joint, and fits whose friction agrees with their own torques."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import State, fit, without
from elid_cli.estimation.refined_robot import representative
from elid_cli.estimation.regression.effect_columns import extra_of, scene_of
from elid_cli.estimation.regression.rotor_shares import with_rotors
from elid_cli.estimation.regression.scene_with_effects import with_effects
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect, Member
from elid_cli.model.effects.scene import Scene

START = 0.1
"""Stribeck velocity of members that have none, as a part of the joint's top speed."""
SLOWEST, FASTEST, PLACES = 0.003, 0.6, 16
"""Stribeck velocities that are tried first, as parts of the top speed, and how many."""
EVEN = 0.5
"""Last shape to start from: as much of the motor's torque as of the load."""
AGREED, AGREEING = 3e-4, 8
"""Change of the friction, as a part of it, below which its columns and the fit agree, and most rounds until they do."""
RESHAPED = 3
"""Times that a shape is looked for again with the torques of the fit in it."""
APART = 0.02
"""Change of the friction, as a part of it, above which they have not agreed in the end: the member is not offered."""
ALIKE = 6.0
"""Log-likelihood by which another form may explain a log worse and its values still count in the standard errors."""


def family() -> type[Effect]:
    """Return the effect that is a family of friction models."""
    return next(kind for kind in effect_classes().values() if kind.members)


def settled_at(plain: State, joint: int, member: Member, speed: float) -> tuple[State, bool]:
    """Return the model with a member at one joint, and whether its friction and its torques agree."""
    scene = scene_of_fit(plain)
    state = fit(plain.log, (*plain.effects, shaped(plain, scene, joint, member, speed)), scene)
    for _ in range(RESHAPED if member.forms else 0):  # with the friction in the torque
        scene, lean = scene_of_fit(state), grown(state)[-1].shape[-1]
        state = fit(plain.log, (*plain.effects, shaped(plain, scene, joint, member, speed, lean)), scene)
    return agreed(state)


def shaped(plain: State, scene: Scene, joint: int, member: Member, speed: float, lean: float = EVEN) -> Effect:
    """Return the member in the shape that explains most of what the plain model leaves of the search's stretches."""
    if not member.forms:
        return family()(joint, (member.shape, START * speed, 1.0, lean))
    return max(in_forms(plain, scene, joint, member, speed, lean), key=lambda found: found[1])[0]


def in_forms(
    plain: State, scene: Scene, joint: int, member: Member, speed: float, lean: float = EVEN
) -> list[tuple[Effect, float]]:
    """Return a member in each of its forms, at the best velocity, with what it gains in log-likelihood.

    Parameters
    ----------
    plain
        The model without it.
    scene
        What its columns are computed from.
    joint, member
        Where, and which.
    speed
        The joint's top speed, rad/s (m/s).
    lean
        The motor torque's part in its load.
    """
    from scipy.optimize import minimize_scalar

    kind = family()

    def effect(logarithm: float, form: float) -> Effect:
        return kind(joint, (member.shape, float(np.exp(logarithm)), form, lean))

    grid = np.log(speed) + np.linspace(np.log(SLOWEST), np.log(FASTEST), PLACES)
    step = float(grid[1] - grid[0])
    found = []
    for form in member.forms:  # between places the forms may change order

        def loss(logarithm: float, form: float = form) -> float:
            gain = plain.projected.gain(extra_of(effect(logarithm, form), scene, plain.log.signals).rows)
            return 0.0 if gain is None else -gain.whole

        place = min(grid.tolist(), key=loss)
        bounds = max(place - step, float(grid[0])), min(place + step, float(grid[-1]))
        best = minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 1e-3})
        found.append((effect(float(best.x), form), -float(best.fun)))
    return found


def polished(state: State, top: Mapping[int, float]) -> tuple[State, dict[int, Effect]]:
    """Return a model with the friction of every joint shaped beside that of all others, and what does about as well.

    The latter are other forms, by the number of the effect, that explain the log nearly as well.

    Parameters
    ----------
    state
        The model with friction of members at some joints.
    top
        Top speed of the joints by their number, rad/s (m/s).
    """
    forms = {member.shape: member for member in family().members.values()}
    others = dict[int, Effect]()
    for number, effect in enumerate(state.effects):
        member = forms.get(effect.shape[0]) if effect.members else None
        if member is None or not member.forms:
            continue
        lacking, scene = without(state, number), scene_of_fit(state)
        found = in_forms(lacking, scene, effect.joint, member, top[effect.joint], grown(state)[number].shape[-1])
        (best, gain), *less = sorted(found, key=lambda item: -item[1])
        state = fit(state.log, _with(state.effects, number, best), scene)
        if less and gain - less[0][1] < ALIKE:
            others[number] = less[0][0]
    return agreed(state)[0], others


def in_other_form(state: State, number: int, other: Effect) -> State:
    """Return a model with one of its effects in another form, as it agrees with its own torques."""
    return agreed(fit(state.log, _with(state.effects, number, other), scene_of_fit(state)))[0]


def _with(effects: Sequence[Effect], number: int, other: Effect) -> tuple[Effect, ...]:
    return (*effects[:number], other, *effects[number + 1 :])


def agreed(state: State) -> tuple[State, bool]:
    """Return the model fitted with columns from its own torques until both agree, and whether they do."""
    if not any(effect.from_model for effect in state.effects):
        return state, True
    change = np.inf
    for _ in range(AGREEING):
        before = _torque(state)
        state = fit(state.log, grown(state), scene_of_fit(state))
        after = _torque(state)
        change = float(np.linalg.norm(after - before) / np.linalg.norm(after))
        if change <= AGREED:
            break
    return state, change <= APART


def grown(state: State) -> tuple[Effect, ...]:
    """Return a model's effects with what their shapes take from their amplitudes."""
    return tuple(effect.grown(state.coefficients(k)) for k, effect in enumerate(state.effects))


def scene_of_fit(state: State) -> Scene:
    """Return what a model's effects are computed from: its own torques, those of the effects among them."""
    rotors = state.solved.rotors()
    scene = scene_of(state.log.model, state.log.signals, standard_of(state, rotors), rotors)
    return with_effects(scene, [(effect, state.coefficients(k)) for k, effect in enumerate(state.effects)])


def standard_of(state: State, rotors: Mapping[int, float]) -> Array:
    """Return the standard parameters (p,) of a fit, nearest to the robot file's, with rotors that its friction tells.

    A rotor's inertia often shows only in a sum with its body's, and its share decides what passes the gear: any other
    representative would change the load from one round to the next.
    """
    base, robot = state.log.base, state.log.model.robot
    near, told = with_rotors(robot, robot.reference(), rotors)
    return representative(base, base.transform @ state.standard, near, told)


def _torque(state: State) -> Array:
    """Return the torque of all effects in all rows, one after the other, with a last value that is never 0."""
    parts = [
        state.coefficients(k) @ columns for k, extra in enumerate(state.columns) for columns in extra.rows.values()
    ]
    return np.concatenate([*parts, [1e-9]])

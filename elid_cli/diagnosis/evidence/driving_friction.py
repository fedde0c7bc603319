"""Whether an effect leaves a joint with friction that pushes, or with parameters that no robot has.

Friction takes energy from the motion. A curve that follows the speed may fit what something else leaves so well that
the joint's friction, all parts of it together, drives the motor: then it is no friction, whatever it explains.
"""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.diagnosis.fit.state import State, without
from elid_cli.model.effects.scene import EquationRow
from elid_cli.robot.parameter import POSITIVE, StandardParameter

SURE = 3.0
"""Standard errors by which friction must push, or a parameter be below 0."""
OFTEN = 0.02
"""Part of the instants of motion at which it must."""
MOVES = 0.02
"""Part of the top speed above which a motor moves: below it the direction is not known."""
LOOKED = 2000
"""Most instants that are looked at."""


def impossible_with(state: State, number: int) -> bool:
    """Whether effect `number` is friction that pushes, or makes parameters of the model ones that no robot has."""
    effect = state.effects[number]
    if type(effect).takes_energy and _pushes(state, effect.joint):
        return True
    below = _below_zero(state)
    return bool(below) and not below <= _below_zero(without(state, number))


def _below_zero(state: State) -> frozenset[str]:
    """Return which stiffnesses, rotor inertias and friction coefficients are below 0 by more than their errors."""
    deviation = np.sqrt(np.maximum(np.diag(state.covariance), 0.0))
    place = {int(column): float(error) for column, error in zip(state.solution.basis, deviation, strict=True)}
    names, classes = state.log.model.names, state.log.base.classes
    return frozenset(
        str(name)
        for column, (name, value) in enumerate(zip(names, state.standard, strict=True))
        if name.kind in POSITIVE and classes[name] == "independent" and value < -SURE * place.get(column, np.inf)
    )


def _pushes(state: State, joint: int) -> bool:
    """Whether all friction of a joint's motor together drives it, often and by more than its error."""
    scene = state.scene
    speed = scene.motion.dtheta[:, joint]
    index = state.log.model.index
    columns = {
        index[StandardParameter("fs", joint)]: scene.direction(joint),
        index[StandardParameter("fv", joint)]: speed,
    }
    row = EquationRow("motor", joint)
    for number, effect in enumerate(state.effects):
        if type(effect).takes_energy and effect.joint == joint:
            place = state.place(number)
            columns |= dict(zip(range(place.start, place.stop), effect.columns(scene)[row], strict=True))
    where = {int(column): k for k, column in enumerate(state.solution.basis)}
    if not columns.keys() <= where.keys():
        return False  # a friction that the log does not tell from the rest
    moving = np.flatnonzero(np.abs(speed) > MOVES * float(np.max(np.abs(speed), initial=0.0)))
    looked = moving[:: max(1, len(moving) // LOOKED)]
    values: Array = np.array([column[looked] for column in columns.values()]) * np.sign(speed[looked])
    chosen = [where[column] for column in columns]
    power = np.array([state.solution.values[column] for column in columns]) @ values
    spread = np.einsum("in,ij,jn->n", values, state.covariance[np.ix_(chosen, chosen)], values)
    pushing = power < -SURE * np.sqrt(np.maximum(spread, 0.0))
    return bool(len(looked)) and float(np.mean(pushing)) > OFTEN

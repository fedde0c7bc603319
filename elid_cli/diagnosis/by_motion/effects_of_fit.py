"""The effects that a search by motion named, as a diagnosis tells them."""

from __future__ import annotations

from elid_cli.diagnosis.by_motion.other_forms import Forms
from elid_cli.diagnosis.by_motion.search import Searched
from elid_cli.diagnosis.form_errors import in_forms
from elid_cli.diagnosis.result import FoundEffect
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.found_effects import fitted_effects
from elid_cli.model.effects import effect_that
from elid_cli.robot.robot import Robot


def effects_of_fit(
    robot: Robot, fit: TrajectoryFit, done: Searched, declared: int, forms: Forms
) -> tuple[FoundEffect, ...]:
    """Return the effects that a search came to, limits first, but those that are declared."""
    values, effects = fitted_effects(robot, fit)[declared:], fit.effects[declared:]
    softer = [done.softer[effect.joint] for effect in effects if effect.softens]
    limiting = effect_that(of_drive="limit")
    (limit,) = limiting.shapes
    limits = (
        FoundEffect(limiting.name, robot.joint_names[item.joint], {limit.name: item.limit},
                    {limit.name: item.deviation}, item.gain, _of_limit(robot.torque_limits[item.joint], item.limit))
        for item in done.limits
    )  # fmt: skip
    found = [
        FoundEffect(
            effect.name,
            own.joint,
            own.parameters,
            {} if _or_less(fit, place) else own.std_error,
            gain,
            effect.summary + _or_less(fit, place),
        )
        for place, (effect, own, gain) in enumerate(
            zip(effects, values, (*softer, *(item.gain for item in done.named)), strict=True), declared
        )
    ]
    first = len(softer)
    return (*limits, *(in_forms(own, forms.told.get(k - first, ())) for k, own in enumerate(found)))


def _or_less(fit: TrajectoryFit, place: int) -> str:
    """Return what is said of an effect's shape beyond which the angle covered shows nothing."""
    names = fit.unknowns.least_of(place, fit.z)
    return (
        f", whose {names[0]} may be lower: the angle covered shows none below this one, and all its values go together"
        if names
        else ""
    )


def _of_limit(described: float, found: float) -> str:
    """Return what a limit of torque is beside that of the robot file, N·m (N)."""
    if described < found:
        return f"the drive delivers more than the {described:g} of the robot file, and no more than this"
    return effect_that(of_drive="limit").summary

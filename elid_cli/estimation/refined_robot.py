"""A robot description that holds what was found: identified parameters, effects, corrected delays."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import check_kind, in_words
from elid_cli.estimation.regression.rotor_shares import with_rotors
from elid_cli.estimation.result import Identification, Nuisance
from elid_cli.estimation.validation.verdicts import IMPOSSIBLE
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.consistency import consistency
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.posed import as_posed
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import POSITIVE, StandardParameter
from elid_cli.robot.robot import EffectSpec, Robot

ALIKE = (("m",), ("cx", "cy", "cz"), ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "Jm", "Ja"), ("fs",), ("fv",), ("K",))
"""Kinds of standard parameters by what they are: those of a group have about the same size."""
FREE = 10.0
"""By how many times the largest of its group a parameter is taken to vary that the reference does not give."""
SHOWN = 2.0
"""Standard errors by which a delay of a channel must differ from 0 to be written."""


def representative(base: BaseParameters, estimate: Array, reference: Array, kept: Collection[int] = ()) -> Array:
    """Return standard parameters (p,) that reproduce base parameters exactly and stay nearest to the reference.

    Near is relative, and what the reference does not give goes first.

    Parameters
    ----------
    base
        Base parameters of the robot.
    estimate
        Their values, (b,), or those of N sets, (N, b); NaN where refused: there the reference stands (zero where that
        is unknown). The answer is (N, p) then.
    reference
        Reference standard parameters, (p,); NaN where unknown.
    kept
        Places of those that stay the reference's: they show in sums only.
    """
    start = np.nan_to_num(reference)
    present = base.transform @ start
    wanted = np.where(np.isfinite(estimate), estimate, present)
    scale = _steps(base, reference)
    scale[list(kept)] = 0.0
    weighted = base.transform * scale
    step = scale * (np.linalg.pinv(weighted, rcond=1e-12) @ (wanted - present).T).T
    result: Array = start + step
    # one correction removes the rounding of the pseudo-inverse in the leaders
    result[..., base.leaders] += wanted - (base.transform @ result.T).T
    return result


def _steps(base: BaseParameters, reference: Array) -> Array:
    """Return how readily each standard parameter leaves the reference, (p,), in its own unit: in proportion to it.

    One that the reference does not give goes far beyond the largest of its unit that it gives: what is unknown moves,
    and not the weight of a described body.
    """
    size: Array = np.abs(np.nan_to_num(reference))
    steps: Array = np.maximum(size, 1e-3 * np.maximum(size.max(initial=0.0), 1.0))
    groups = [next(k for k, kinds in enumerate(ALIKE) if name.kind in kinds) for name in base.parameters]
    for group in set(groups):
        own = np.array(groups) == group
        steps[own & np.isnan(reference)] = max(FREE * float(size[own].max()), float(steps[own].min()))
    return steps


def identified_robot(found: Identification) -> Robot:
    """Return the robot with what was found: values nearest to its own, nuisances as effects of the measurement.

    Raises
    ------
    UsageError
        `found` is no identification.
    """
    check_kind("found", found, Identification, "identify(robot, signals) returns one")
    near = found.standard if found.estimator == "trajectory" else found.robot.reference()
    near, told = with_rotors(found.robot, near, {joint: inertia for joint, (inertia, _) in found.rotors.items()})
    standard = representative(found.base, possible_values(found), near, told)
    declared, shown = {(spec.effect, spec.joint) for spec in found.robot.effects}, _shown(found.nuisances)
    more: dict[tuple[str, str | None], EffectSpec]
    more = {
        (n.effect, n.joint): EffectSpec(n.effect, n.joint, n.parameters)
        for n in found.nuisances
        if any(n is own for own in shown) or (n.effect, n.joint) in declared
    }
    own = (EffectSpec(e.effect, e.joint, e.parameters) for e in found.effects)
    new = [*(_together(spec, more.pop((spec.effect, spec.joint), None)) for spec in own), *more.values()]
    replaced = {(spec.effect, spec.joint) for spec in new}
    kept = [spec for spec in found.robot.effects if (spec.effect, spec.joint) not in replaced]
    return refined_robot(found.robot, standard, (*kept, *new), _unknown(found))


def _shown(nuisances: Sequence[Nuisance]) -> list[Nuisance]:
    """Return the nuisances that are written: all but delays of joints that are surely no later than 0.

    Where one channel is late, delays of all are estimated, whatever they are. One within its error of 0 is written
    where it is nearer to what the others are late by. Offsets are unknowns of the fit: the other values predict with
    them, however small they are.
    """
    late = [n for n in nuisances if effect_classes()[n.effect].nuisance == "delay"]
    sure = [n for n in late if n.kept or any(abs(v) > SHOWN * n.std_error.get(k, 0.0) for k, v in n.parameters.items())]
    usual = {k: float(np.median([n.parameters[k] for n in sure])) for k in (sure[0].parameters if sure else ())}
    return [
        n for n in nuisances
        if not any(n is own for own in late) or any(n is own for own in sure)
        or all(abs(v - usual.get(k, 0.0)) < abs(v) for k, v in n.parameters.items())
    ]  # fmt: skip


def _together(declared: EffectSpec, beyond: EffectSpec | None) -> EffectSpec:
    """Return a declared effect of the measurement with what a log shows beyond it: a delay is the sum of both."""
    if beyond is None:
        return declared
    total = {name: value + beyond.parameters.get(name, 0.0) for name, value in declared.parameters.items()}
    return replace(declared, parameters=total)


def with_stiffnesses(robot: Robot, found: Identification) -> Robot:
    """Return a robot with the supported stiffnesses of joints whose links the log does not hold: those are elastic."""
    joints = list(robot.joints)
    for item in found.motor_side.joints if found.motor_side else ():
        if item.verdict == "supported":
            joint = joints[item.number]
            rotor = "Ja" if joint.gear_ratio is None else "Jm"
            known = joint.parameters.get(rotor, 0.0)
            inertia = known if known > 0 else item.rotor / (joint.gear_ratio or 1.0) ** 2
            values = {**joint.parameters, rotor: inertia, "K": item.stiffness}
            joints[item.number] = replace(joint, transmission="elastic", parameters=MappingProxyType(values))
    return replace(robot, joints=tuple(joints))


def possible_values(found: Identification) -> Array:
    """Return the base parameters (b,) of the robot that is written: none negative that no robot has negative.

    Frictions and rotor inertias that came out so beyond doubt are 0, and the others are those of the fit that knows it:
    the values nearest to the estimate in its own covariance. Negative ones that the log does not show are the
    reference's, or 0.
    """
    values: Array = found.base.transform @ found.standard
    wrong = np.array([item.reason.startswith(IMPOSSIBLE) for item in found.parameters])
    if wrong.any():
        known = np.isfinite(np.diag(found.covariance))
        pull = found.covariance[np.ix_(known, wrong)] @ np.linalg.pinv(found.covariance[np.ix_(wrong, wrong)])
        values[known] -= pull @ values[wrong]
        values[wrong] = 0.0
    for k in _negative_unseen(found):
        reference = found.parameters[k].reference
        values[k] = reference if reference > 0 else 0.0
    return values


def _negative_unseen(found: Identification) -> list[int]:
    """Return the refused base parameters whose value, there for the prediction alone, no robot has."""
    values = found.base.transform @ found.standard
    return [
        k for k, item in enumerate(found.parameters)
        if item.verdict == "refused" and item.leader.kind in POSITIVE and values[k] < 0
        and found.base.classes[item.leader] == "independent"
    ]  # fmt: skip


def _unknown(found: Identification) -> frozenset[StandardParameter]:
    """Return the stiffnesses that nobody knows: the log gives none that a robot could have, the file none at all."""
    unseen = (found.parameters[k] for k in _negative_unseen(found))
    return frozenset(item.leader for item in unseen if item.leader.kind == "K" and not item.reference > 0)


BODIES_KEPT = "Bodies are those of the file before."
_ELSEWHERE = ("Its value is not from this log", "Their values are not from this log")
_NEEDED = (
    "Its value is no estimate, only what the prediction needs",
    "Their values are no estimates, only what the prediction needs",
)
_LEFT_OUT = ("It is left out", "They are left out")
"""What becomes of a value that is not known, and of several."""


def remarks(found: Identification, *, physical: bool = False) -> tuple[str, ...]:
    """Return what a reader of a written robot must know of its values, one sentence or more each.

    `physical`: they are those of a robot that could be built.
    """
    lines = []
    if physical:
        lines.append("Identified by elid as a robot that could be built (--physical).")
    elif found.drives:
        lines.append(f"Identified by elid: the drives, by the motion under commands. {BODIES_KEPT}")
    else:
        text = (
            "Identified by elid. A log shows base parameters, sums of those below; of a sum's members, and of what no "
            "motion shows, the values are one choice of many that predict the same torques, near those of the file "
            "before."
        )
        if not could_be_built(found):
            text += " As single values they are not those of real bodies; elid identify --physical gives such."
        lines.append(text)
    unknown, unseen = _unknown(found), {found.parameters[k].leader for k in _negative_unseen(found)}
    said: dict[tuple[str, tuple[str, str]], list[str]] = {}
    for item in found.parameters:
        if item.verdict == "refused":
            kept = _ELSEWHERE if physical or item.leader in unseen else _NEEDED
            kept = _LEFT_OUT if item.leader in unknown and not physical else kept
            said.setdefault((item.reason or "this log does not show it", kept), []).append(str(item.leader))
    for (why, (one, several)), names in said.items():
        verb, fate = ("are", several) if len(names) > 1 else ("is", one)
        lines.append(f"{in_words(names)} {verb} not known: {why}. {fate}.")
    return (*lines, *(() if physical else impossible_words(found)))


def impossible_words(found: Identification) -> tuple[str, ...]:
    """Return what is done with values that no robot has: one sentence, or none."""
    wrong = [f"{item.leader} = {item.estimate:.3g}" for item in found.parameters if item.reason.startswith(IMPOSSIBLE)]
    if not wrong:
        return ()
    return (f"{', '.join(wrong)} came out negative beyond error: written as 0, the others as a fit that knows it.",)


def could_be_built(found: Identification) -> bool:
    """Return whether the written values are those of real bodies."""
    values = np.nan_to_num(identified_robot(found).reference())
    cones = consistency(found.robot, values)
    return cones.slack(values / cones.scales.sizes) >= 0


def refined_robot(
    robot: Robot,
    standard: Array,
    effects: Sequence[EffectSpec],
    unknown: Collection[StandardParameter] = (),
) -> Robot:
    """Return the robot with standard parameters (p,), but for the unknown ones, and effects in place of its own."""
    values = dict(zip(robot.parameter_names(), standard, strict=True))
    classes = find_base(Regressor(as_posed(replace(robot, effects=tuple(effects))))).classes
    joints = []
    for number, joint in enumerate(robot.joints):
        own = [p for p in values if p.joint == number and p not in unknown]
        kept = {p.kind: float(values[p]) for p in own if p.kind in joint.parameters or classes[p] != "unidentifiable"}
        joints.append(replace(joint, parameters=MappingProxyType(kept)))
    return replace(robot, joints=tuple(joints), effects=tuple(effects))

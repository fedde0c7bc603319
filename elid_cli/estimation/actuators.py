"""Parameters of the actuators as simulators' configurations name them, each with what is known of its error.

``armature``, ``friction`` (static), ``dynamic_friction``, ``viscous_friction`` and ``delay`` are the names of Isaac
Lab's actuators; MuJoCo's are ``armature``, ``frictionloss`` (the dynamic one) and ``damping``. All are seen at
the joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from elid_cli.estimation.mean_friction import MeanFriction, with_mean_friction
from elid_cli.estimation.result import Identification, Verdict
from elid_cli.estimation.validation.verdicts import REFUSED, WEAK
from elid_cli.model.effects.breakaway import breakaway
from elid_cli.model.effects.declared import resolve
from elid_cli.robot.parameter import MOTOR_PARAMETERS, StandardParameter
from elid_cli.robot.robot import EffectSpec, Robot

Quantity = Literal[
    "armature", "friction", "dynamic_friction", "viscous_friction", "transmission_stiffness", "offset", "delay"
]
UNITS: Mapping[Quantity, str] = {
    "armature": "kg·m²",
    "friction": "N·m",
    "dynamic_friction": "N·m",
    "viscous_friction": "N·m·s/rad",
    "transmission_stiffness": "N·m/rad",
    "offset": "N·m",
    "delay": "s",
}
"""What an actuator is described by, in the order of the file, with units; of sliding joints N for N·m, m for rad."""
KINDS: Mapping[Quantity, tuple[str, ...]] = {
    "armature": ("Jm", "Ja"),
    "dynamic_friction": ("fs",),
    "viscous_friction": ("fv",),
    "transmission_stiffness": ("K",),
}
SINGULAR = 1e-10
"""Part of the largest eigenvalue of a correlation matrix below which a direction is held, not estimated."""


@dataclass(frozen=True)
class Value:
    """One parameter of one actuator."""

    value: float | None
    """At the joint, SI; None where it is refused."""
    std_error: float | None
    verdict: Verdict
    why: str = ""
    """Why it is refused or weak, or what it goes with."""


@dataclass(frozen=True)
class Actuators:
    """What a log says of the actuators of a robot, and the effects that stand beside their parameters."""

    robot: Robot
    """The robot that is written, whose bodies the values go with."""
    values: Mapping[Quantity, Mapping[str, Value]]
    """Quantity -> joint -> value; a quantity that no joint has is left out."""
    effects: tuple[EffectSpec, ...]
    """Effects of the robot but offsets and delays, which are values."""
    means: tuple[MeanFriction, ...] = ()
    """What of their friction the Coulomb friction holds, N·m (N)."""

    def held_of(self, spec: EffectSpec) -> float:
        """Return what of an effect's friction the Coulomb friction holds, N·m (N)."""
        return sum(item.mean for item in self.means if item.effect == spec)


def actuators_of(found: Identification, written: Robot, means: Sequence[MeanFriction] = ()) -> Actuators:
    """Return the actuators of an identified robot.

    Parameters
    ----------
    found
        The identification, whose errors and verdicts count.
    written
        The robot with what was found.
    means
        What of its effects' friction a robot file without them holds as Coulomb friction, N·m (N).
    """
    errors = _errors_given_bodies(found)
    values = {quantity: _standard(found, written, errors, kinds) for quantity, kinds in KINDS.items()}
    values["friction"] = _static(found, written, values["dynamic_friction"], means)
    values["dynamic_friction"] |= _with_means(written, values["dynamic_friction"], means)
    values["offset"] = _of_channel(found, written, "offset")
    values["delay"] = _of_channel(found, written, "delay")
    effects = tuple(spec for spec in written.effects if resolve(written, spec)[0].nuisance not in ("offset", "delay"))
    return Actuators(written, {quantity: values[quantity] for quantity in UNITS if values[quantity]}, effects,
                     tuple(item for item in means if item.effect in effects))  # fmt: skip


def _standard(
    found: Identification, written: Robot, errors: Mapping[StandardParameter, float], kinds: tuple[str, ...]
) -> dict[str, Value]:
    """Return the values of one kind of standard parameter by joint."""
    leaders = {item.leader: item for item in found.parameters if found.base.classes[item.leader] == "independent"}
    result = {}
    for name in found.robot.parameter_names():
        if name.kind not in kinds:
            continue
        joint = written.joints[name.joint]
        scale = (joint.gear_ratio or 1.0) ** 2 if name.kind == "Jm" else 1.0
        value = joint.parameters.get(name.kind)
        if name in leaders:
            item = leaders[name]
            told = _judged(value, item.std_error, item.verdict, item.reason, scale)
        else:
            told = _given_bodies(found, name, value, errors.get(name), scale)
        result[joint.name] = told
    return result


def _judged(value: float | None, error: float, verdict: Verdict, why: str, scale: float) -> Value:
    if verdict == "refused" or value is None:
        return Value(None, None, "refused", why or "this log does not show it")
    return Value(value * scale, error * scale, verdict, why)


def _given_bodies(
    found: Identification, name: StandardParameter, value: float | None, error: float | None, scale: float
) -> Value:
    """Return the value of a parameter that a log shows only in sums with parameters of bodies."""
    if found.base.classes[name] == "unidentifiable" or name in found.hidden:
        return Value(None, None, "refused", found.hidden.get(name, "no motion shows it"))
    if error is None or value is None or not error <= REFUSED * abs(value):
        known = "" if error is None or value is None else f": {error:.2g} against {value:.2g}"
        return Value(None, None, "refused", f"the sums with the bodies that show it are not known well enough{known}")
    why = "the log shows it in sums with the bodies: value and error go with the bodies of the written robot"
    return Value(value * scale, error * scale, "weak", why)


def _errors_given_bodies(found: Identification) -> dict[StandardParameter, float]:
    """Return the standard errors of motors' parameters were the bodies exactly those of the robot file.

    With base parameters ``T_m x + T_b b`` of covariance C and known bodies b, generalised least squares gives
    ``cov(x) = (T_m' C^-1 T_m)^-1``; directions without variance were held, and tell nothing.
    """
    covariance = found.joint_covariance
    known = np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0)
    if not known.any():
        return {}
    names = [name for name in found.base.parameters if name.kind in (*MOTOR_PARAMETERS, "K")]
    places = [found.base.parameters.index(name) for name in names]
    deviation = np.sqrt(np.diag(covariance)[known])
    rows = found.base.transform[known][:, places] / deviation[:, None]
    weight = np.linalg.pinv(covariance[np.ix_(known, known)] / np.outer(deviation, deviation), SINGULAR, hermitian=True)
    size = np.sqrt(np.maximum(np.diag(rows.T @ weight @ rows), 0.0))
    seen = size > 0
    unit = np.where(seen, size, 1.0)
    shown = (rows.T @ weight @ rows / np.outer(unit, unit))[np.ix_(seen, seen)]
    spread = np.linalg.pinv(shown, SINGULAR, hermitian=True)
    errors = np.sqrt(np.maximum(np.diag(spread), 0.0)) / unit[seen]
    return {name: float(e) for name, e in zip((n for n, s in zip(names, seen, strict=True) if s), errors, strict=True)}


def _with_means(written: Robot, dynamic: Mapping[str, Value], means: Sequence[MeanFriction]) -> dict[str, Value]:
    """Return the Coulomb frictions of the joints that have effects whose mean friction they hold."""
    held, found = with_mean_friction(written, means), {}
    for name, value in dynamic.items():
        own = [item.effect.effect for item in means if item.effect.joint == name]
        if own and value.value is not None:
            total = held.joints[written.joint_names.index(name)].parameters["fs"]
            mean = f"{total - value.value:.3g}; the error is that of the rest"
            words = f"with the mean of {' and '.join(own)} along the log, {mean}"
            found[name] = replace(value, value=total, why="; ".join(word for word in (value.why, words) if word))
    return found


def _static(
    found: Identification, written: Robot, dynamic: Mapping[str, Value], means: Sequence[MeanFriction]
) -> dict[str, Value]:
    """Return the friction at rest: Coulomb's, and what effects add to it at no speed."""
    errors: dict[tuple[str, str | None], list[Mapping[str, float]]] = {}
    for item in found.effects:  # a joint may have several of one kind, in the same order
        errors.setdefault((item.effect, item.joint), []).append(item.std_error)
    result = dict(dynamic)
    for spec in written.effects:
        known_mean = [item.at_rest for item in means if item.effect == spec]
        more = known_mean[0] if known_mean else breakaway(written, spec)
        of_kind = errors.get((spec.effect, spec.joint), [])
        known = of_kind.pop(0) if of_kind else {}
        name = spec.joint or written.joint_names[0]
        if more == 0.0 or name not in result or result[name].value is None:
            continue
        before = result[name]
        own = [known[p.name] for p in resolve(written, spec)[0].amplitudes if p.name in known and p.unit != "rad"]
        assert before.value is not None
        # the two errors are correlated in a way that is not kept: their sum is a bound
        error = before.std_error + sum(own) if before.std_error is not None and own else None
        result[name] = Value(before.value + more, error, before.verdict, f"with the {spec.effect} part at no speed")
    return result


def _of_channel(found: Identification, written: Robot, nuisance: Literal["offset", "delay"]) -> dict[str, Value]:
    """Return the offset or the delay of every motor's torque; none where no motor has one."""
    errors = {(item.effect, item.joint): item.std_error for item in found.nuisances}
    result = {}
    for spec in written.effects:
        kind, joint = resolve(written, spec)
        if kind.nuisance != nuisance:
            continue
        (parameter,) = kind.amplitudes
        name = written.joint_names[joint]
        error = errors.get((spec.effect, name), {}).get(parameter.name)
        value = float(spec.parameters[parameter.name])
        result[name] = Value(value, error, "weak" if error is not None and error > WEAK * abs(value) else "supported")
    absent = Value(None, None, "refused", "this log shows none")
    return {name: result.get(name, absent) for name in written.joint_names} if result else {}

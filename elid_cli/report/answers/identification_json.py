"""JSON of an identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from elid_cli.estimation.judgement import Insufficient, JointError, RowNoise
from elid_cli.estimation.result import FittedEffect, Identification
from elid_cli.report.answers.classification import class_payload
from elid_cli.report.answers.drive_gains import gains_payload
from elid_cli.report.answers.inputs import log_payload, nuisance_payload, robot_payload
from elid_cli.report.answers.lacking import is_doubted, is_unclear
from elid_cli.report.answers.motor_side import motor_side_payload, stiffness_record
from elid_cli.report.tree import picked
from elid_cli.robot.parameter import parameter_named, place_in_order
from elid_cli.signals.recording import Recording


def _declared_payload(effects: Sequence[FittedEffect]) -> list[dict[str, Any]]:
    """Return the list ``effects`` of JSON: null in place of a value that the log does not determine."""
    return [
        {**item, "parameters": {**item["parameters"], **dict.fromkeys(effect.unshown)}}
        for item, effect in zip(nuisance_payload(effects), effects, strict=True)
    ]


def identification_payload(found: Identification, recording: Recording | None = None) -> dict[str, Any]:
    """Return the JSON object of an identification (docs/reference/json.md), without a log where that is not at hand."""
    return {
        **robot_payload(found.robot),
        **({} if recording is None else {"log": log_payload(recording)}),
        **picked(found, "estimator settings"),
        **class_payload(found.base, found),
        **picked(found, "condition rank rank_margin"),
        "base_parameters": base_payload(found),
        "covariance": covariance_payload(found),
        "error": error_payload(found.error),
        **model_payload(found.model, found.noise, found.insufficient, doubted=is_doubted(found)),
        "not_excluded": found.not_excluded,
        **motor_side_payload(found),
        "nuisances": nuisance_payload(found.nuisances),
        "effects": _declared_payload(found.effects),
        **gains_payload(found.drive_gains),
        **picked(found, "notes"),
        "warnings": [*(found.log_warnings if recording is None else recording.warnings), *found.warnings],
    }


def base_payload(found: Identification) -> list[dict[str, Any]]:
    """Return the list ``base_parameters`` of JSON, in standard order; the estimate of a refused one is null."""
    entries = _entries(found)
    return [entries[k] for k in _order(entries)]


def _order(entries: Sequence[Mapping[str, Any]]) -> list[int]:
    """Return places of entries in standard order, that of their leading parameters."""
    return sorted(range(len(entries)), key=lambda k: place_in_order(next(iter(entries[k]["terms"]))))


def _entries(found: Identification) -> list[dict[str, Any]]:
    """Return all entries: those of the fit, stiffnesses from the motor side, what the log does not show at all."""
    units: dict[str, str] = dict(zip(found.robot.parameter_names(), found.robot.parameter_units(), strict=True))
    leaders = {found.base.parameters[leader] for leader in found.base.leaders}
    side = found.motor_side.joints if found.motor_side else ()
    stiffnesses = {joint.parameter: stiffness_record(found, joint) for joint in side}
    unseen = [
        {
            "name": name, "terms": {name: 1}, "unit": units.get(name, ""), "class": "unidentifiable", "estimate": None,
            "std_error": None, "reference": _described(found, name), "relative_error": None, "verdict": "refused",
        }
        for name in found.hidden
        if name not in leaders and name not in stiffnesses
    ]  # fmt: skip
    return [
        {
            **picked(item, "name"),
            "terms": dict(found.base.terms[k]),
            **picked(item, "unit"),
            "class": found.base.classes[item.leader],
            **picked(item, "estimate std_error reference relative_error verdict bias_possible"),
        }
        for k, item in enumerate(found.parameters)
    ] + [*stiffnesses.values(), *unseen]


def _described(found: Identification, name: str) -> float | None:
    """Return the value that the robot file gives a parameter that the log does not show; None where it gives none."""
    parameter = parameter_named(name)
    if parameter is None or parameter.joint >= found.robot.n:
        return None
    value = found.robot.joints[parameter.joint].parameters.get(parameter.kind)
    return None if value is None else float(value)


def covariance_payload(found: Identification) -> list[list[float | None]]:
    """Return the matrix ``covariance`` of JSON, a row and a column for each of the listed base parameters."""
    entries = _entries(found)
    shown: list[list[float | None]] = found.joint_covariance.tolist()
    unseen: list[float | None] = [None] * (len(entries) - len(shown))
    rows = [[*row, *unseen] for row in shown] + [[None] * len(entries) for _ in unseen]
    side = found.motor_side.joints if found.motor_side else ()
    for k, joint in enumerate(side, start=len(shown)):  # found by itself: no correlation is known
        if joint.verdict != "refused":
            rows[k][k] = joint.std_error**2
    order = _order(entries)
    return [[rows[i][k] for k in order] for i in order]


def model_payload(
    model: str, noise: Sequence[RowNoise], insufficient: Sequence[Insufficient], *, doubted: bool = False
) -> dict[str, Any]:
    """Return what JSON says of the model: ``model``, ``unclear``, ``noise`` and ``insufficient``.

    `doubted`: something may be missing whatever the noise.
    """
    unclear = model == "sufficient" and (doubted or is_unclear(noise))
    return {"model": model, "unclear": unclear, "noise": noise_payload(noise), "insufficient": insufficient}


def noise_payload(noise: Sequence[RowNoise]) -> dict[str, Any]:
    """Return the object ``noise`` of JSON: by joint and row."""
    joints: dict[str, dict[str, Any]] = {}
    for item in noise:
        joints.setdefault(item.joint, {})[item.rows] = picked(item, "floor ratio correlation moment")
    return joints


def error_payload(error: Mapping[str, JointError]) -> dict[str, Any]:
    """Return an object ``error`` of JSON."""
    return {
        joint: {
            **picked(e, "rms relative spring_rms spring_relative torque_rms floor spring_floor"),
            **({} if e.sensor is None else {"sensor": e.sensor}),
        }
        for joint, e in error.items()
    }

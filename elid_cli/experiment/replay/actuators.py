"""What stands beside a robot file in a file of actuators: offsets, delays and effects, back in the robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from elid_cli.errors import UsageError
from elid_cli.estimation.mean_friction import MeanFriction, with_mean_friction
from elid_cli.files import read_text
from elid_cli.model.effects import effect_classes, effect_that
from elid_cli.model.effects.declared import check_effects
from elid_cli.robot.robot import EffectSpec, Robot

ROUNDED = 1e-9
"""N·m (N) below none that a friction is for rounding alone."""


def with_actuators(robot: Robot, path: str) -> Robot:
    """Return a robot with the offsets, delays and effects of a file of ``--write-actuators``.

    What the robot file holds itself, a spring of an MJCF, is not added again.

    Raises
    ------
    UsageError
        The file is not such a file, or names joints that the robot does not have.
    """
    import yaml

    try:
        told = yaml.safe_load(read_text(Path(path), UsageError))  # JSON is YAML
        beside = [(item, spec) for item, spec in _of_effects(told) if spec not in robot.effects]
        specs = (*_of_channels(told), *(spec for _, spec in beside))
        held = [MeanFriction(spec, -float(item.get("in_dynamic_friction", 0.0))) for item, spec in beside]
    except (yaml.YAMLError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise UsageError(
            f"{path} is not a file of actuators (JSON or YAML as --write-actuators makes it)",
            detail=_fault(error),
            hint="a robot file is given by --robot" if path.lower().endswith((".xml", ".urdf", ".mjcf")) else "",
        ) from None
    for spec in specs:
        if spec.joint not in robot.joint_names:
            raise UsageError(f"{path}: {robot.name} has no joint {spec.joint}", hint=", ".join(robot.joint_names))
    whole = with_mean_friction(robot, held)
    wrong = [joint.name for joint in whole.joints if joint.parameters.get("fs", 0.0) < -ROUNDED]
    if wrong:
        raise UsageError(
            f"{path}: {robot.name} does not hold the mean friction of {', '.join(wrong)} that this file says it does",
            hint="give the robot file of the same run",
        )
    return check_effects(replace(whole, effects=(*robot.effects, *specs)))


def _fault(error: Exception) -> str:
    """Return what is wrong where that says something to whoever has changed such a file by hand."""
    if isinstance(error, KeyError):
        return f"it has no {error.args[0]!r}, or does not know it"
    place = getattr(error, "problem_mark", None)
    if place is not None:
        return f"line {place.line + 1}: {getattr(error, 'problem', '')}"
    return str(error) if isinstance(error, ValueError) else ""


def _of_channels(told: Mapping[str, Any]) -> Iterator[EffectSpec]:
    for nuisance in ("offset", "delay"):
        kind = effect_that(nuisance=nuisance)
        for joint, value in told["actuators"].get(nuisance, {}).items():
            if value:
                yield EffectSpec(kind.name, joint, {kind.amplitudes[0].name: float(value)})


def _of_effects(told: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], EffectSpec]]:
    for item in told["effects"]:
        if not item["in_mjcf"] or effect_classes()[item["effect"]].softens:  # elid reads no softness in an MJCF
            yield item, EffectSpec(item["effect"], item["joint"], {k: float(v) for k, v in item["parameters"].items()})

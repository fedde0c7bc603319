"""Shapes with which an effect cannot be computed are refused where they are declared, not computed with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from elid_cli.errors import RobotError
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.declared import check_effects
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot

LIBRARY = effect_classes()
BOUNDS = [(name, p.name, end) for name, kind in LIBRARY.items() for p in kind.shapes if not p.of_joint
          for end in (p.low, p.high) if abs(end) < 1e300]  # fmt: skip


def declared(name: str, **values: float) -> Robot:
    parameters: Mapping[str, float] = {**LIBRARY[name].example, **values}
    joint = None if LIBRARY[name].whole_robot else "joint1"
    return replace(read_robot("planar2"), effects=(EffectSpec(name, joint, parameters),))


@pytest.mark.parametrize(("name", "parameter", "end"), BOUNDS)
def test_a_bound_itself_may_be_and_what_is_beyond_may_not(name: str, parameter: str, end: float) -> None:
    check_effects(declared(name, **{parameter: end}))
    low = next(p.low for p in LIBRARY[name].shapes if p.name == parameter)
    beyond = end - max(abs(end), 1e-9) if end == low else end + abs(end)
    with pytest.raises(RobotError, match=f"{name}: {parameter} .* cannot be") as refused:
        check_effects(declared(name, **{parameter: beyond}))
    assert refused.value.hint


@pytest.mark.parametrize("other", [0.0, 1.0, 1.5, 7.0])
def test_another_joint_is_one_that_there_is(other: float) -> None:
    with pytest.raises(RobotError, match="is no other joint") as refused:
        check_effects(declared("velocity_coupling", other=other))
    assert refused.value.hint == "one of 2"
    check_effects(declared("velocity_coupling", other=2.0))

"""Units of a mapping: one for all joints, one per joint, or by joint."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.logs.mapping.language import parse_mapping
from elid_cli.robot.robot import Joint, Robot

ROBOT = Robot("arm", (Joint("slide", type="prismatic"), Joint("elbow")))


def mapped(**spec: Any) -> np.ndarray:
    return parse_mapping({"q": {"from": "q_{i}", **spec}}, ROBOT, "--map")[0]["q"].gain(ROBOT)


@pytest.mark.parametrize("unit", [["mm", "deg"], {"slide": "mm", "elbow": "deg"}])
def test_a_unit_per_joint(unit: object) -> None:
    np.testing.assert_allclose(mapped(unit=unit), [1e-3, math.pi / 180])
    np.testing.assert_allclose(mapped(unit=unit, sign=[1, -1]), [1e-3, -math.pi / 180])


def test_a_joint_without_a_unit_is_in_si() -> None:
    np.testing.assert_allclose(mapped(unit={"elbow": "counts:4096"}), [1.0, 2 * math.pi / 4096])


@pytest.mark.parametrize(
    ("spec", "said", "hint"),
    [
        ({"unit": ["mm"]}, "1 units for 2 joints", "one per joint"),
        ({"unit": {"elbw": "deg"}}, "no joint 'elbw'", "elbow"),
        ({"unit": ["mm", "dge"]}, "unknown unit 'dge'", "deg"),
        ({"unit": ["mm", 3]}, "unit: expected text", ""),
        ({"unit": ["mm", "deg"], "unwrap": True}, "needs one unit for all joints", ""),
    ],
)
def test_wrong_units_are_one_error(spec: dict[str, Any], said: str, hint: str) -> None:
    with pytest.raises(UsageError) as refused:
        mapped(**spec)
    assert said in refused.value.message
    assert hint in (refused.value.hint or "")

"""Units of a mapping: one for all joints, one per joint, or by joint."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.logs.mapping.language import parse_mapping
from elid_cli.logs.reading import read_recording
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


@pytest.mark.parametrize(("time", "place"), [("Zeit [ms]", "Pos {i} (°)"), ("Zeit", "Pos {i}")])
def test_columns_are_named_with_their_unit_in_brackets_or_without(tmp_path: Path, time: str, place: str) -> None:
    """The time's could be named without only, and the rest then was in seconds."""
    path = tmp_path / "log.csv"
    rows = [f"{10 * k};{k / 2:.1f};{k};0.1;0.2" for k in range(400)]
    path.write_text("\n".join(["Zeit [ms];Pos 1 (°);Pos 2 (°);M1;M2", *rows]), encoding="utf-8")
    robot = Robot("arm", (Joint("shoulder", transmission="rigid"), Joint("elbow", transmission="rigid")))
    mapping = {"t": {"from": time, "unit": "ms"}, "theta": {"from": place, "unit": "deg"}, "tau": {"from": "M{i}"}}
    found = read_recording([path], robot, mapping)
    assert found.dt == pytest.approx(0.01)
    np.testing.assert_allclose(found.theta[-1], np.radians([199.5, 399.0]))

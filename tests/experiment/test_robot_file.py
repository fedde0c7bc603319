"""write_robot writes the format that the file's name says, or says why not."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli import EffectSpec, Robot, UsageError, read_robot, write_robot
from elid_cli.model.effects import effect_classes, nuisance_of

DELAY, OFFSET = (next(n for n in effect_classes() if nuisance_of(n) == kind) for kind in ("delay", "offset"))


@pytest.fixture
def plain() -> Robot:
    return replace(read_robot("planar2"), effects=())


@pytest.mark.parametrize("suffix", [".xml", ".mjcf", ".urdf", ".yaml"])
def test_a_robot_is_read_back_from_the_format_that_its_name_says(plain: Robot, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"arm{suffix}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_robot(plain, path, ["a remark"])
    text = path.read_text()
    assert "a remark" in text
    assert {".xml": "<mujoco", ".mjcf": "<mujoco", ".urdf": "<robot", ".yaml": "joints:"}[suffix] in text
    assert read_robot(path).joint_names == plain.joint_names


def test_what_a_format_cannot_hold_is_refused_or_told(plain: Robot, tmp_path: Path) -> None:
    pushed = EffectSpec(OFFSET, "joint1", {"offset": 0.1})
    with pytest.warns(UserWarning, match=f"{OFFSET} of joint1: left out"):
        write_robot(replace(plain, effects=(pushed,)), tmp_path / "arm.xml")
    assert f"{OFFSET} of joint1: left out" in (tmp_path / "arm.xml").read_text()
    late = replace(plain, effects=(EffectSpec(DELAY, "joint1", {"delay": 0.001}),))
    with pytest.raises(UsageError, match=rf"cannot hold {DELAY} of joint1(.|\n)*delays=False"):
        write_robot(late, tmp_path / "late.xml")
    assert not (tmp_path / "late.xml").exists()
    bent = replace(plain, effects=(EffectSpec("stribeck", "joint1", effect_classes()["stribeck"].example),))
    with pytest.raises(UsageError, match=r"cannot hold stribeck of joint1(.|\n)*arm\.yaml holds all"):
        write_robot(bent, tmp_path / "arm.urdf")
    with pytest.raises(UsageError, match=r"x\.foo: not a name for a robot file"):
        write_robot(plain, tmp_path / "x.foo")
    assert not (tmp_path / "x.foo").exists()

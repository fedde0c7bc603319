"""What classify refuses of a robot file, as identification does."""

from __future__ import annotations

from pathlib import Path

import pytest

from elid_cli.cli import main

ROBOT = """\
name: arm
gravity: [0, -9.81, 0]
dh: standard
joints:
  - {name: shoulder, a: 0.5, alpha: 0, d: 0, theta: 0, gear_ratio: 50, transmission: rigid}
  - {name: elbow, a: 0.3, alpha: 0, d: 0, theta: 0, gear_ratio: 50, transmission: rigid}
effects:
  - {effect: %s}
"""


@pytest.mark.parametrize(("effect", "code"), [("stribeck", 2), ("stribeck, joint: elbow", 0), ("gravity_direction", 0)])
def test_an_effect_without_its_joint_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], effect: str, code: int
) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(ROBOT % effect)
    assert main(["classify", "--robot", str(path)]) == code
    err = capsys.readouterr().err
    assert ("arm.yaml:8: effect 1: stribeck: no joint" in err) == (code == 2)
    assert ("hint: joint: shoulder" in err) == (code == 2)

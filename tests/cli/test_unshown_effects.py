"""A declared effect that a log cannot determine has no value, as a refused base parameter has none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from elid_cli.cli import main

JOINT = "a: 0.3, alpha: 0, d: 0, theta: 0, gear_ratio: 50, transmission: rigid"
ROBOT = f"""\
name: turret
gravity: [0, 0, -9.81]
dh: standard
joints:
  - {{name: pan, {JOINT}, parameters: {{m: 3, cx: -0.6, cy: 0, Izz: 0.2, Jm: 1.0e-4, fs: 2, fv: 3}}}}
  - {{name: lift, {JOINT}, parameters: {{m: 2, cx: -0.3, cy: 0, Izz: 0.1, Jm: 1.0e-4, fs: 1, fv: 1}}}}
"""
EFFECTS = "effects: [{effect: encoder_zero, joint: pan}, {effect: stribeck, joint: lift}]\n"


def test_a_zero_about_an_upright_axis_is_null(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("plain.yaml").write_text(ROBOT)
    Path("arm.yaml").write_text(ROBOT + EFFECTS)
    assert main(["simulate", "--robot", "plain.yaml", "--duration", "6", "-o", "log.csv", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["identify", "log.csv", "--robot", "arm.yaml", "--json", "--write-robot", "found.yaml"]) == 0
    zero, stribeck = json.loads(capsys.readouterr().out)["effects"]
    assert zero["parameters"] == zero["std_error"] == {"offset": None}
    assert None not in stribeck["parameters"].values()
    assert main(["identify", "log.csv", "--robot", "found.yaml"]) == 0
    assert "pan offset not shown by this log" in capsys.readouterr().out

"""A pendulum with a rigid joint, for tests of drives under commands."""

from __future__ import annotations

from elid_cli.robot.files import robot_from_text

ROBOT = robot_from_text(
    """\
name: swing
gravity: [0, -9.81, 0]
dh: standard
joints:
  - {name: j, transmission: rigid, a: 0.3, alpha: 0, d: 0, theta: 0}
""",
    "swing.yaml",
)

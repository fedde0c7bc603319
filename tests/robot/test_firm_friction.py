"""Dry friction that holds a joint, in an MJCF that is patched: MuJoCo's own fades in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from elid_cli.experiment.robot_file import write_robot
from elid_cli.robot.files import read_robot

MODEL = """<mujoco model="pair"><worldbody>
<body name="a"><joint name="one" axis="0 1 0" frictionloss="0.1" armature="0.01"/>
<inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.001"/></body>
<body name="b" pos="0 1 0"><joint name="two" axis="0 1 0" frictionloss="0.1" armature="0.01" {two}/>
<inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.001"/></body>
</worldbody></mujoco>"""


def patched(folder: Path, friction: dict[str, float], two: str = "") -> list[str]:
    """Return the lines of both joints of a model whose dry friction is another."""
    path = folder / "pair.xml"
    path.write_text(MODEL.format(two=two))
    robot = read_robot(path)
    joints = tuple(
        replace(joint, parameters={**joint.parameters, "fs": friction.get(joint.name, 0.1)}) for joint in robot.joints
    )
    write_robot(replace(robot, joints=joints), str(folder / "out.xml"))
    return [line for line in (folder / "out.xml").read_text().splitlines() if "<joint" in line]


def test_friction_that_was_found_holds_and_what_stays_is_as_it_was(tmp_path: Path) -> None:
    one, two = patched(tmp_path, {"one": 0.25})
    assert 'solreffriction="0.001 1"' in one
    assert "solreffriction" not in two


def test_a_constraint_of_the_file_stays(tmp_path: Path) -> None:
    one, two = patched(tmp_path, {"one": 0.25, "two": 0.25}, 'solreffriction="0.05 1"')
    assert 'solreffriction="0.001 1"' in one
    assert 'solreffriction="0.05 1"' in two

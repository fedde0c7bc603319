"""Robot descriptions: from a YAML, URDF or MJCF file, or by the bare name of a robot that ships with elid, and back.

`read_robot` is the only door: whatever ``--robot`` was given goes through it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from elid_cli.errors import RobotError, did_you_mean
from elid_cli.files import LARGEST, read_text, write_text
from elid_cli.robot.robot import Robot
from elid_cli.robot.schema import robot_of_yaml
from elid_cli.robot.text import fingerprint, text_of

__all__ = ["fingerprint", "read_robot", "robot_from_text", "shipped_robots", "write_robot"]

MJCF = "<mujoco"
SUFFIXES = (".yaml", ".yml", ".urdf", ".xml", ".mjcf")


def shipped_robots() -> dict[str, Path]:
    """Return the robots that ship with elid: bare name to file, sorted by name.

    They are inside the package when installed as a wheel, beside it in a source tree or an editable install.
    """
    package = Path(__file__).resolve().parents[1]
    folder = package / "robots"
    if not folder.is_dir() and (package.parent / "pyproject.toml").is_file():
        folder = package.parent / "robots"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))} if folder.is_dir() else {}


def read_robot(source: str | Path, *, beside: bool = True) -> Robot:
    """Read a robot description.

    Parameters
    ----------
    source
        The bare name of a shipped robot (``puma560``), or a path to a YAML, URDF or MJCF file.
    beside
        Whether the YAML beside a URDF or MJCF completes it.

    Raises
    ------
    RobotError
        No such robot or file, or a description that cannot be used: file, line, joint, key, nearest valid key.
    """
    if not isinstance(source, str | Path):
        raise RobotError(
            f"read_robot: a value of type {type(source).__name__} in place of a robot's name or file",
            hint=f"a path to a YAML, URDF or MJCF file, or one of {', '.join(shipped_robots())}",
        )
    if not str(source):
        raise RobotError(
            "an empty name is no robot", hint="give a robot's name, or the path of a YAML, URDF or MJCF file"
        )
    path = Path(source)
    if _bare(source):
        shipped = shipped_robots()
        if str(source) in shipped:
            path = shipped[str(source)]
        elif not path.is_file():
            raise RobotError(
                f"no robot named {str(source)!r}",
                detail=f"'{source}' is a folder here" if path.is_dir() else "",
                hint=did_you_mean(str(source), shipped) or "give the path of a YAML, URDF or MJCF file",
            )
    if path.stem in shipped_robots() and path.parent == Path() and not path.exists():
        raise RobotError(f"{path}: no such file", hint=f"did you mean '{path.stem}', the robot that ships with elid?")
    xml = path.suffix.lower() in (".urdf", ".xml", ".mjcf")
    text = read_text(path, RobotError, suffixes=SUFFIXES, most=LARGEST * 20 if xml else LARGEST)
    if _is_xml(text) or xml:
        from elid_cli.robot.beside import beside_file, robot_with

        robot = replace(_of_xml(text, str(path)), source=str(path), given=str(source))
        return robot_with(robot, beside_file(path)) if beside else robot
    return replace(robot_of_yaml(text, str(path)), given=str(source))


def robot_from_text(text: str, name: str) -> Robot:
    """Return the robot that a text describes, YAML, URDF or MJCF; `name` stands for the file in errors."""
    if _is_xml(text):
        return _of_xml(text, name)
    return robot_of_yaml(text, name)


def write_robot(robot: Robot, path: str | Path, remarks: Sequence[str] = ()) -> None:
    """Write a description of `robot` as YAML that reads back to exactly the same robot, `path` whole or not at all.

    `remarks` stand above it as comments. Other formats are those of `elid_cli.experiment.robot_file`.

    Raises
    ------
    UsageError
        The file cannot be written.
    """
    write_text(path, text_of(robot, remarks))


def _bare(source: str | Path) -> bool:
    """Whether the source is a name and not a path: no separator, none of a description's suffixes."""
    if not isinstance(source, str):
        return False
    separators = {os.sep, os.altsep or os.sep}
    return bool(source) and not any(mark in source for mark in separators) and Path(source).suffix not in SUFFIXES


def is_mjcf(path: Path) -> bool:
    """Whether a robot's XML file is an MJCF and not a URDF; False where it cannot be read."""
    return path.is_file() and MJCF in path.read_text("utf-8", "replace")


def _of_xml(text: str, name: str) -> Robot:
    """Return the robot of an XML text, whichever of the two formats it is."""
    if MJCF in text:
        from elid_cli.robot.mjcf.read import read_mjcf

        return read_mjcf(text, name)
    from elid_cli.robot.urdf.read import read_urdf

    return read_urdf(text, name)


def _is_xml(text: str) -> bool:
    return text.lstrip("\ufeff \t\r\n").startswith("<")

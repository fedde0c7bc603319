"""``--write-robot``: a robot description in the form that its file name asks for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from elid_cli.files import check_suffix, check_writable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from elid_cli.robot.robot import Robot


def check_described(path: str) -> None:
    """Refuse, before any work is done, a file that no robot can be written to (UsageError)."""
    check_suffix(Path(path), (".yaml", ".yml", ".urdf", ".xml", ".mjcf"), "a robot file")
    check_writable(Path(path))


def write_described(robot: Robot, path: str, remarks: Sequence[str] = ()) -> None:
    """Write a robot as URDF (``.urdf``), as MJCF (``.xml``, ``.mjcf``), or else as elid's own YAML.

    Effects and remarks (as comments) are part of the YAML only; MJCF names effects in a comment.

    Raises
    ------
    RobotError
        Parameters that the format cannot hold.
    UsageError
        The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".urdf":
        from elid_cli.robot.urdf.write import write_urdf

        write_urdf(robot, path)
    elif suffix in (".xml", ".mjcf"):
        from elid_cli.experiment.mjcf import write_mjcf

        write_mjcf(robot, path)
    else:
        from elid_cli.robot.files import write_robot

        write_robot(robot, path, remarks)

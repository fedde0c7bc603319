"""Robots as files of the format that their name says: elid's YAML, URDF or MJCF, and what these cannot hold."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from elid_cli.checks import names
from elid_cli.checks import path as file_name
from elid_cli.errors import UsageError
from elid_cli.files import check_target, write_text
from elid_cli.robot.files import write_robot as write_yaml

if TYPE_CHECKING:
    from elid_cli.robot.robot import EffectSpec, Robot

FOREIGN = (".urdf", ".xml", ".mjcf")
"""Suffixes of formats that hold no effects."""
WRITTEN = (".yaml", ".yml", *FOREIGN)
"""Suffixes of robot files that can be written."""


def write_robot(robot: Robot, path: str | Path, remarks: Sequence[str] = ()) -> None:
    """Write a robot to a file as its name says: ``.yaml``, ``.urdf``, or an MJCF, ``.xml`` or ``.mjcf``.

    The YAML holds all of a robot. A URDF or MJCF is a copy of the file that the robot was read from, with new numbers,
    or a new one. What it cannot hold of the joints, and offsets of the torque channels, it leaves out: a comment in it
    and a Python warning say so. Effects and delays it refuses to leave out.

    Parameters
    ----------
    robot
        What is written.
    path
        The file, written whole or not at all.
    remarks
        Sentences that stand in it as comments.

    Raises
    ------
    UsageError
        Another suffix, an effect or a delay that the format cannot hold, or a file that cannot be written.
    RobotError
        Parameters that the format cannot hold: unknown ones, or those of bodies that no robot has.
    """
    from elid_cli.signals.fitting_robot import check_robot

    check_robot(robot)
    file_name("write_robot: path", path)
    names("write_robot: remarks", remarks)
    check_target(path, WRITTEN, "a robot file")
    name = str(path)
    beyond = beyond_format(robot, name)
    _refuse_beyond(beyond, name)
    said = [*without_springs(robot, name), *stays_aside(robot, name)]
    said += [f"{named(beyond)}: left out, as this format cannot hold it"] if beyond else []
    write_described(robot, name, [*remarks, *said])
    for sentence in said:
        warnings.warn(f"{name}: {sentence}", stacklevel=2)


def _refuse_beyond(beyond: Sequence[EffectSpec], path: str) -> None:
    """Refuse to leave out effects, and delays, beside which other values were found (UsageError)."""
    from elid_cli.model.effects import nuisance_of

    whole, without = Path(path).with_suffix(".yaml"), "dataclasses.replace(robot, effects=()) leaves it out"
    if wrong := [spec for spec in beyond if nuisance_of(spec.effect) is None]:
        raise UsageError(
            f"{path}: this format cannot hold {named(wrong)}",
            detail="parameters that were found beside an effect are wrong without it",
            hint=f"{whole} holds all; {without} nevertheless",
        )
    if late := [spec for spec in beyond if nuisance_of(spec.effect) == "delay"]:
        raise UsageError(
            f"{path}: this format cannot hold {named(late)}",
            detail="of a fit of the motion under commands, the other values belong to it",
            hint=f"{whole} holds all; identify with EstimateOptions(fit='trajectory', delays=False) fits such a log "
            f"without; of a log of torques {without}",
        )


def without_springs(robot: Robot, path: str) -> list[str]:
    """Return in words the stiffnesses that the user's own MJCF, patched, cannot hold: those of its rigid joints."""
    suffix = Path(path).suffix.lower()
    if suffix not in FOREIGN or suffix == ".urdf" or not patches(robot, path):
        return []  # elid's own element of a URDF holds them
    known = [k for k, j in enumerate(robot.joints) if "K" in j.parameters and j.name not in robot.rotors]
    names = [name for name in robot.parameter_names() if name.kind == "K" and name.joint in known]
    beside = Path(robot.source).with_suffix(".elid.yaml").name
    return [f"{', '.join(names)}: the file's joints are rigid; {beside} or a .yaml holds stiffnesses"] if names else []


def stays_aside(robot: Robot, path: str) -> list[str]:
    """Return in words what the YAML beside a file said of a robot that a file of this name cannot hold."""
    suffix = Path(path).suffix.lower()
    if suffix not in FOREIGN:
        return []
    from elid_cli.robot.files import read_robot
    from elid_cli.robot.robot import Robot

    said = []
    own = Robot("", ()).gravity if suffix == ".urdf" else robot.gravity
    if suffix != ".urdf" and patches(robot, path):
        own = read_robot(robot.source, beside=False).gravity
    if robot.gravity != own:
        wanted, others = (", ".join(f"{value:g}" for value in gravity) for gravity in (robot.gravity, own))
        beside = Path(path).with_suffix(".elid.yaml").name
        said.append(f"gravity: [{wanted}]: {beside} has to hold it; without that the file means [{others}]")
    if suffix != ".urdf" and (soft := _softened(robot)):
        said.append(
            f"friction of {', '.join(soft)} fades in over a speed: solreffriction and solimpfriction hold it for "
            "MuJoCo; elid and other simulators take friction of an MJCF to hold a joint at rest"
        )
    if suffix != ".urdf" and (geared := _gears_beside(robot, path)):
        said.append(
            f"the gear ratio of {', '.join(geared)}: armature is the rotor's inertia at the joint, without its "
            "coupling to the body that carries it"
        )
    return said


def _gears_beside(robot: Robot, path: str) -> list[str]:
    """Return the joints whose gear ratio an MJCF of this name does not have: the robot's own, patched."""
    if not patches(robot, path) or all(joint.gear_ratio is None for joint in robot.joints):
        return []  # a new one has rotors
    from elid_cli.robot.files import read_robot

    own = {joint.name: joint.gear_ratio for joint in read_robot(robot.source, beside=False).joints}
    return [j.name for j in robot.joints if j.gear_ratio is not None and j.gear_ratio != own.get(j.name)]


def other_limits(robot: Robot, path: str) -> list[str]:
    """Return in words the torque limits that a written MJCF does not have: its actuators keep lower ones."""
    if Path(path).suffix.lower() not in (".xml", ".mjcf"):
        return []
    from elid_cli.robot.files import read_robot

    limits = {joint.name: joint.limits.torque for joint in read_robot(path, beside=False).joints}
    wanted = {joint.name: joint.limits.torque or 0.0 for joint in robot.joints}
    names = [name for name, limit in limits.items() if limit and limit < 0.999 * wanted.get(name, 0.0)]
    return [f"the torque limit of {', '.join(names)}: an actuator of the file has a lower one"] if names else []


def _softened(robot: Robot) -> list[str]:
    """Return the joints whose friction an MJCF softens."""
    from elid_cli.model.effects.declared import is_soft_in_mjcf

    return [spec.joint or robot.joint_names[0] for spec in robot.effects if is_soft_in_mjcf(robot, spec)]


def foreign(path: str) -> bool:
    """Whether a file of this name is of a format that holds no effects."""
    return Path(path).suffix.lower() in FOREIGN


def named(lost: Sequence[EffectSpec]) -> str:
    """Return effects in words, with their joints."""
    return ", ".join(spec.effect + (f" of {spec.joint}" if spec.joint else "") for spec in lost)


def beyond_format(robot: Robot, path: str) -> list[EffectSpec]:
    """Return the effects that a file of this name cannot hold."""
    if not foreign(path):
        return []
    if Path(path).suffix.lower() == ".urdf":
        return list(robot.effects)
    from dataclasses import replace

    from elid_cli.model.effects.declared import is_soft_in_mjcf
    from elid_cli.robot.mjcf.held import is_held

    file = robot if patches(robot, path) else replace(robot, source="")
    return [spec for spec in robot.effects if not is_held(file, spec) and not is_soft_in_mjcf(robot, spec)]


def patches(robot: Robot, path: str) -> bool:
    """Whether a file of this name is the robot's own with other numbers."""
    if not robot.source:
        return False
    from elid_cli.robot.files import is_mjcf

    return is_mjcf(Path(robot.source)) == (Path(path).suffix.lower() != ".urdf")


def write_described(robot: Robot, path: str, remarks: Sequence[str] = ()) -> None:
    """Write a robot as the file's suffix says, whatever effects it has.

    Raises
    ------
    RobotError
        Parameters that the format cannot hold.
    UsageError
        The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FOREIGN:
        write_yaml(robot, path, remarks)
    elif patches(robot, path):
        from elid_cli.experiment.mjcf_friction import soft_attributes
        from elid_cli.robot.mjcf.patch import FIRM
        from elid_cli.robot.patch import patched

        firm = dict.fromkeys(robot.joint_names, FIRM)
        further = {} if suffix == ".urdf" else firm | soft_attributes(robot)
        write_text(path, patched(robot, remarks, further, Path(path).parent))
    else:
        from elid_cli.experiment.mjcf import mjcf_text
        from elid_cli.robot.urdf.write import urdf_text
        from elid_cli.robot.xml_edit import XmlEdit

        edit = XmlEdit(urdf_text(robot) if suffix == ".urdf" else mjcf_text(robot), path)
        if remarks:
            edit.comment(" ".join(remarks))
        write_text(path, edit.text())


def not_held(robot: Robot, path: str) -> list[str]:
    """Return in sentences what a file of this name does not hold of a robot, stiffnesses and effects."""
    lost = beyond_format(robot, path)
    effects = [f"{named(lost)}: the format cannot hold it"] if lost else []
    return [*without_springs(robot, path), *effects]

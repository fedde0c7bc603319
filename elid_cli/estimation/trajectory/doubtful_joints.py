"""Joints whose fitted drives are doubtful: told to stand still, or simulated far off.

What little a joint moves that is told to stand still the others do. A motion that is far off is bent by what is
missing: errors that are computed from what is left do not know of that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import in_words
from elid_cli.estimation.result import Identification
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording

CONSTANT = 1e-6
"""rad (m) within which commands are one pose."""
FAR = 20.0
"""Times the encoders' noise from which a simulated position is far off."""


def standing(robot: Robot, recording: Recording) -> list[int]:
    """Return the joints of a robot whose commands are one pose throughout, where others are moved."""
    told = recording.commands.get("q_des")
    if told is None:
        return []
    known = [column[np.isfinite(column)] for column in told.T[: robot.n]]
    still = [bool(part.size) and float(np.ptp(part)) <= CONSTANT for part in known]
    return [] if all(still) else [k for k, one in enumerate(still) if one]


def driven(robot: Robot, recording: Recording) -> NDArray[np.bool_]:
    """Return the joints that computed torques move, (n,): what is told to stand still the others push."""
    found = recording.commanded.copy()
    found[standing(robot, recording)] = False
    return found


def with_doubtful_joints(
    found: Identification, recording: Recording | None, ratios: Mapping[str, float]
) -> Identification:
    """Return a fit to the motion whose values are known roughly, and may be biased, where the motion is no ground.

    Those of joints that are told to stand still, and of joints that are simulated far off; and of those that they are
    coupled to, where the model lacks something: a joint that creeps within its friction is simulated badly, and the
    others make up for it.

    Parameters
    ----------
    found
        The fit.
    recording
        The log.
    ratios
        Errors of the simulated positions in times the encoders' noise, by joint.
    """
    robot = found.robot
    joints = [] if recording is None else standing(robot, recording)
    far = [k for k, name in enumerate(robot.joint_names) if ratios.get(name, 0.0) >= FAR]
    if recording is None or not (joints or far):
        return found
    doubted = {*joints, *far}
    if found.model != "sufficient":
        doubted |= {k for k in range(robot.n) if any(_coupled(robot, k, joint) for joint in (*joints, *far))}
    marked = [
        replace(item, bias_possible=item.bias_possible or item.leader.joint in doubted) for item in found.parameters
    ]
    warnings = (*found.warnings, *([_words(robot, recording, joints)] if joints else []))
    settings = _roughly(found.settings, [robot.joint_names[k] for k in sorted(doubted)])
    return replace(found, parameters=tuple(marked), warnings=warnings, settings=settings)


def _roughly(settings: Mapping[str, object], joints: Sequence[str]) -> dict[str, object]:
    """Return the settings of a fit in which the drives of some joints are known roughly at best."""
    told = settings["trajectory"]
    assert isinstance(told, dict)
    drives = dict(told["joint_parameters"])
    for joint in joints:
        drives[joint] = {
            name: {**own, "verdict": "weak"} if own["verdict"] == "supported" else own
            for name, own in drives[joint].items()
        }
    return {**settings, "trajectory": {**told, "joint_parameters": drives}}


def _coupled(robot: Robot, one: int, other: int) -> bool:
    return robot.ancestors[one][0] == robot.ancestors[other][0]


def _words(robot: Robot, recording: Recording, joints: Sequence[int]) -> str:
    names = [robot.joint_names[k] for k in joints]
    position = np.where(np.isnan(recording.theta), recording.q, recording.theta)
    places = [float(np.nanmedian(position[:, k])) for k in joints]
    locks = " ".join(f"--lock {name}={place:.4g}" for name, place in zip(names, places, strict=True))
    return (
        f"{in_words(names)} {'is' if len(names) == 1 else 'are'} told to stand still: what moves there is what the "
        "other joints push, which hardly shows friction and inertia, and bends the fit of the others "
        f"({locks} goes on without)"
    )

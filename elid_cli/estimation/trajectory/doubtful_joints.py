"""Joints whose fitted drives are doubtful: told to stand still, simulated far off, or lacking something.

What little a joint moves that is told to stand still the others do. A motion that is far off is bent by what is
missing: errors that are computed from what is left do not know of that. Where the model lacks something, that is so
from the noise of the encoders on: what is missing is small beside the positions, and the values make up for it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli.errors import in_words
from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.trajectory.at_noise import NOISE
from elid_cli.estimation.validation.sufficiency import UNCLEAR
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
    """Return a fit to the motion whose values may be biased where a model lacks something, or the motion is no ground.

    The latter are those of joints that are told to stand still, and of joints that are simulated far off; they are
    known roughly at best. With each go those that it is coupled to, where the model lacks something: a joint that
    creeps within its friction is simulated badly, and the others make up for it.

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
    far = {k for k, name in enumerate(robot.joint_names) if ratios.get(name, 0.0) >= FAR}
    rough, lacking = {*joints, *far}, lacking_at(found, ratios)
    if recording is None or not (rough or lacking):
        return found
    if found.model != "sufficient":
        rough = coupled_to(robot, rough)
    biased = rough | coupled_to(robot, lacking)
    warnings = (*found.warnings, *([_words(robot, recording, joints)] if joints else []))
    settings = _doubted(found, {robot.joint_names[k] for k in rough}, {robot.joint_names[k] for k in biased})
    return replace(found, parameters=marked(found, biased), warnings=warnings, settings=settings)


def lacking_at(found: Identification, ratios: Mapping[str, float]) -> set[int]:
    """Return the joints at which a fit to the motion lacks something; none where it is sufficient, beyond doubt.

    They are those whose motion is off by more than the encoders' noise, asks for other bodies, for filters or for a
    friction below 0, or whose torque follows the motion. `ratios` as `with_doubtful_joints` has them.
    """
    if found.model == "sufficient" and all(item.ratio <= UNCLEAR for item in found.noise):
        return set()
    told = found.settings.get("trajectory")
    asked = [told.get(key, {}) for key in ("other_bodies", "velocity_filters", "negative_friction")] if isinstance(
        told, dict) else []  # fmt: skip
    names = {name for name, ratio in ratios.items() if ratio >= NOISE}.union(*asked)
    names |= {item.joint for item in found.insufficient}
    return {k for k, name in enumerate(found.robot.joint_names) if name in names}


def coupled_to(robot: Robot, joints: Collection[int]) -> set[int]:
    """Return joints with those that they are coupled to: all of their chains."""
    return {k for k in range(robot.n) if any(_coupled(robot, k, joint) for joint in joints)}


def marked(found: Identification, joints: Collection[int]) -> tuple[BaseEstimate, ...]:
    """Return the parameters of an identification, those of some joints as ones that may be biased."""
    return tuple(
        replace(item, bias_possible=item.bias_possible or item.leader.joint in joints) for item in found.parameters
    )


def _doubted(found: Identification, rough: Collection[str], biased: Collection[str]) -> dict[str, object]:
    """Return the settings of a fit in which the drives of some joints may be biased, of some known roughly at best."""
    told = found.settings["trajectory"]
    assert isinstance(told, dict)
    drives = {
        joint: {name: _doubtful(item, joint in rough) for name, item in own.items()} if joint in biased else own
        for joint, own in told["joint_parameters"].items()
    }
    return {**found.settings, "trajectory": {**told, "joint_parameters": drives}}


def _doubtful(item: Mapping[str, object], rough: bool) -> dict[str, object]:
    """Return one value of a drive as one that may be biased, known roughly at best where it is `rough`."""
    if item["verdict"] == "refused":
        return dict(item)
    weak = {"verdict": "weak"} if rough else {}
    return {**item, **weak, "bias_possible": True}


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

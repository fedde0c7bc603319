"""What a log supports: a verdict on every base parameter, and in words what a parameter that it misses would need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.facts import SignalFacts
from elid_cli.estimation.regression.triangles import Triangles
from elid_cli.estimation.result import Verdict
from elid_cli.model.base_parameters import BaseParameters
from elid_cli.robot.parameter import MOTOR_PARAMETERS, POSITIVE, StandardParameter
from elid_cli.robot.robot import Robot

WEAK = 0.3
"""Relative standard deviation above which a parameter is only weakly excited."""
REFUSED = 1.0
"""Relative standard deviation above which a value says nothing."""
LEAST_FREEDOM = 3.0
"""Independent instants beyond the parameters of a row, below which a standard error is hardly known itself."""
DOUBT = 3.0
"""Standard errors below zero from which a value that no robot has negative is impossible, and no scatter."""
BODY = "m", "Ixx", "Iyy", "Izz"
"""Parameters that no body has negative, where one stands alone."""
IMPOSSIBLE = "negative, which no robot's is"
"""What the reason of such a parameter begins with."""
TURNED = "or one of its positions has the wrong sign, or q and theta are swapped"
"""What a stiffness that is clearly negative tells of a joint's torque."""
TOO_LITTLE = "the motion excites it too little"
"""Why a parameter is weak where nothing more particular is known."""
HIDES = "hides it"
"""What a reason ends with where what the model leaves is why a parameter is weak."""
MOVES_LITTLE = "moves too little against the noise"
"""The same of a motor's parameter."""
DIFFERS = "it differs from log to log"
"""How the reason of a parameter ends that logs disagree on."""
HELD = "held at the robot file's value"
"""What the reason of a parameter begins with that was not looked for."""
TORQUE_SHARE = 0.01
"""A parameter matters on the scale at which it makes this share of a row's torque."""


def torque_scale(base: BaseParameters, triangles: Triangles) -> Array:
    """Return per base parameter the value that makes `TORQUE_SHARE` of the torque of the row it acts on most, (b,)."""
    strongest = np.zeros(len(base.parameters))
    for row in triangles.rows:
        chosen = triangles.of(row)
        torque = triangles.torque_rms(row)
        count = sum(t.count for t in chosen)
        for triangle in chosen[:1]:
            standard = triangle.index < len(base.parameters)
            squares = np.sum([(t.factor[:, :-1] ** 2).sum(axis=0) for t in chosen], axis=0)
            share = np.sqrt(squares[standard] / count) / max(torque, 1e-300)
            index = triangle.index[standard]
            strongest[index] = np.maximum(strongest[index], share)
    with np.errstate(divide="ignore"):
        return TORQUE_SHARE / strongest[base.leaders]


@dataclass(frozen=True)
class Estimates:
    """Base parameters as a fit gives them."""

    base: BaseParameters
    estimate: Array
    """(b,)."""
    deviation: Array
    """Standard errors, (b,)."""
    scale: Array
    """`torque_scale`, (b,)."""
    known: NDArray[np.bool_]
    """Which the log's rank determines, (b,)."""


def judge(
    found: Estimates, robot: Robot, facts: SignalFacts, refused: Mapping[str, str], freedom: float = np.inf
) -> tuple[tuple[Verdict, ...], dict[str, str]]:
    """Return the verdict on every base parameter and the reasons, by the leading parameter's name.

    Parameters
    ----------
    found
        What was estimated.
    robot, facts
        The robot and what moved.
    refused
        Leading parameters that other tests refuse, with the reason.
    freedom
        Degrees of freedom that a short log leaves (`standard_errors.freedom`).
    """
    base, estimate, deviation = found.base, found.estimate, found.deviation
    scale, known = found.scale, found.known
    verdicts: list[Verdict] = []
    reasons: dict[str, str] = {}
    for k, leader in enumerate(base.leaders):
        name = base.parameters[leader]
        members = [base.parameters[j] for j in np.flatnonzero(base.transform[k])]
        size = max(abs(estimate[k]), scale[k] if np.isfinite(scale[k]) else 0.0)
        stiff = name.kind == "K"
        if not known[k] or not np.isfinite(deviation[k]):
            verdicts.append("refused")
            reasons[name] = why(members, robot, facts)
        elif name in refused:
            verdicts.append("refused")
            reasons[name] = refused[name]
        elif deviation[k] > REFUSED * size or (stiff and estimate[k] < 2 * deviation[k]):
            verdicts.append("refused")
            unit = base.units[k]
            whole = f"combination with {name}, " if len(members) > 1 else ""
            error, value = (f"{float(f'{v:.2g}'):g} {unit}" for v in (deviation[k], estimate[k]))
            spread = f"{whole}standard error {error} against a value of {value}"
            turned = stiff and estimate[k] < -2 * deviation[k]
            lacking = (
                f"the torque of {robot.joint_names[name.joint]} {TURNED}" if turned else why(members, robot, facts)
            )
            reasons[name] = f"{spread}: {lacking}"
        elif impossible(base, k, estimate[k], deviation[k]):
            verdicts.append("weak")
            reasons[name] = f"{IMPOSSIBLE}: a sign or a unit is wrong, or an effect is missing"
        elif deviation[k] > WEAK * size:
            verdicts.append("weak")
            of = "what would make 1 % of the torque" if size > abs(estimate[k]) else "the value"
            share = f"standard error {100 * deviation[k] / size:.0f} % of {of}"
            reasons[name] = f"{share}: {why(members, robot, facts)}"
        elif freedom < LEAST_FREEDOM:
            verdicts.append("weak")
            reasons[name] = (
                f"the log is so short that its standard error is itself uncertain ({freedom:.1f} independent samples "
                "more than parameters)"
            )
        else:
            verdicts.append("supported")
    return tuple(verdicts), reasons


def why(members: Sequence[StandardParameter], robot: Robot, facts: SignalFacts) -> str:
    """Return in words what a log lacks for a base parameter with these standard parameters in it."""
    name = members[0]
    kind, joint = name.kind, name.joint
    label = robot.joint_names[joint]
    if not facts.torque[joint]:
        return f"{label} has no torque in this log"
    if facts.still[joint]:
        return f"{label} does not move"
    still = [robot.joint_names[k] for k in np.flatnonzero(facts.still)]
    if kind == "K":
        return f"too little torque that varies passes through the transmission of {label}"
    if kind in MOTOR_PARAMETERS:
        return f"the motor of {label} {MOVES_LITTLE}"
    if kind in ("m", "cx", "cy", "cz") and not any(robot.gravity):
        return "there is no gravity, which first moments and masses show in"
    if still:
        return f"{', '.join(still)} {'does' if len(still) == 1 else 'do'} not move"
    missing = missing_gravity(joint, robot, facts) if kind in ("m", "cx", "cy", "cz") else ""
    return missing or TOO_LITTLE


def hidden_by_rest(reason: str, label: str) -> str:
    """Return why a parameter is weak at a joint where far more than noise is left: its error grows with that."""
    cause = f"what is left at {label} {HIDES}"
    return reason.replace(TOO_LITTLE, cause).replace(f"the motor of {label} {MOVES_LITTLE}", cause)


def missing_gravity(joint: int, robot: Robot, facts: SignalFacts) -> str:
    """Return which axis of a body's frame gravity hardly turned through in this log, or an empty string."""
    size = float(np.linalg.norm(robot.gravity))
    spread = gravity_in_body(joint, robot, facts.poses).std(axis=0) / size
    poses = np.random.default_rng(0).uniform(-np.pi, np.pi, (100, robot.n))
    possible = gravity_in_body(joint, robot, poses).std(axis=0) / size
    held = [axis for axis, now, most in zip("xyz", spread, possible, strict=True) if now < 0.1 * most]
    if not held:
        return ""
    body = robot.joint_names[joint]
    return f"gravity along {' and '.join(held)} of {body}'s body hardly changes in this log: move it into other poses"


def gravity_in_body(joint: int, robot: Robot, q: Array) -> Array:
    """Return gravity in the frame of body `joint` at positions q (N, n), m/s², (N, 3)."""
    field = np.broadcast_to(np.array(robot.gravity), (len(q), 3))
    for k in robot.ancestors[joint]:
        before, after = robot.placements()[k]
        field = field @ before[:3, :3]
        if robot.joints[k].revolute:
            s, c = np.sin(q[:, k]), np.cos(q[:, k])
            x, y, z = field.T
            field = np.stack([c * x + s * y, c * y - s * x, z], axis=1)
        field = field @ after[:3, :3]
    return field


def suspicious(base: BaseParameters, estimate: Array, deviation: Array, known: NDArray[np.bool_]) -> tuple[str, ...]:
    """Return a sentence for every stiffness, mass, inertia or friction that came out negative beyond doubt."""
    return tuple(
        f"{base.parameters[leader]} came out negative ({estimate[k]:.2g} {base.units[k]}): a sign, a unit or a gear "
        "ratio is wrong, or an effect is missing from the model"
        for k, leader in enumerate(base.leaders)
        if known[k] and impossible(base, k, estimate[k], deviation[k])
    )


def impossible(base: BaseParameters, k: int, estimate: float, deviation: float) -> bool:
    """Whether base parameter `k` is a stiffness, mass, inertia or friction that came out negative beyond doubt."""
    name = base.parameters[base.leaders[k]]
    positive = name.kind in (*POSITIVE, *BODY) and base.classes[name] == "independent"
    return positive and bool(estimate < -DOUBT * deviation)


def shortfall(base: BaseParameters, rank: int, robot: Robot, facts: SignalFacts) -> str:
    """Return a sentence where the log's rank falls short of the structural one, else an empty string."""
    missing = base.count - rank
    if not missing:
        return ""
    still = [robot.joint_names[k] for k in np.flatnonzero(facts.still)]
    cause = f"{', '.join(still)} did not move" if still else "some directions of motion are missing"
    return f"this log determines {rank} of {base.count} base parameters: {cause}"

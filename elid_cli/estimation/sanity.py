"""Guards on physics: wrong signs, swapped torque channels and degrees, found by trying the other way.

What positions alone show is looked at in every log. Only where the fit is bad or a parameter came out negative is
anything else tried: a good fit has nothing to explain.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.triangles import to_triangles
from elid_cli.estimation.result import Identification
from elid_cli.estimation.trajectory.doubtful_joints import standing
from elid_cli.model.regressor import Regressor
from elid_cli.robot.parameter import POSITIVE
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion
from elid_cli.signals.signals import Signals

_LOOKED_AT = 4000
"""Samples by which positions are compared."""
BAD = 0.1
"""Relative error of a joint's torque from which the other ways are tried."""
BETTER = 1.4
"""What the other way must save: log(rms before / rms after), summed over the row groups; one joint shows in few."""
AS_WELL = 0.3
"""Difference of what two ways save up to which a log does not tell them apart."""
SIGNS = ("torque", "positions")
"""Faults that turn one joint round."""
GEARED = 5.0
"""Least gear ratio by which a torque of the wrong side is told from a wrong inertia."""
NEAR_POWER = 0.1
"""Distance from the gear ratio or its inverse within which inertias are off by it, in powers of it."""
FARTHER = 3.0
"""Times a joint's range in the robot's file that no joint moves over."""
ALIKE = 0.2
"""Share of the deflection that is left when two motors' positions are exchanged, below which they were swapped."""


def physics_warnings(fit: DefaultFit, found: Identification) -> tuple[str, ...]:
    """Return a sentence for every sign, unit or swapped channel that the log contradicts."""
    plain = channel_warnings(fit.signals, fit.model.robot)
    if plain:
        return plain
    negative = [w for w in found.warnings if "negative" in w and w.startswith(POSITIVE)]
    stand = [] if fit.signals.recording is None else standing(fit.model.robot, fit.signals.recording)
    names = fit.model.robot.joint_names
    driven = [error.relative for name, error in found.error.items() if names.index(name) not in stand]
    if not negative and max(driven, default=0.0) < BAD:
        return ()
    base = fit.base.count
    signals = replace(fit.signals, sensed=np.zeros(fit.signals.n, dtype=bool))  # by motor torque and positions alone
    observation = observe(fit.model, signals, mask=False)
    now = misfit(observation, base)
    moving = [k for k in range(fit.model.robot.n) if not fit.signals.still[k]]
    others = _others(fit, signals, observation, negative, moving)
    gains = [(now - misfit(other, base), fault) for other, fault in others]
    # positions that are too large in any unit fit better where they are made small
    gains = [
        (gain, fault) for gain, fault in gains
        if gain <= BETTER or not fault.of_one_unit(len(moving)) or _is_best(fit, signals, fault, now - gain)
    ]  # fmt: skip
    enough = max((gain for gain, _ in gains), default=0.0)
    if now - enough < len(observation.groups) * np.log(BAD):  # one fault explains all: others would only imitate it
        gains = [(gain, fault) for gain, fault in gains if gain > enough - AS_WELL]
    told = _told([(gain, fault) for gain, fault in gains if gain > BETTER], names)
    known = {joint for _, fault in told for joint in fault.joints}
    said = [(gain, fault.words) for gain, fault in told]
    positive = any(
        item.leader.kind in POSITIVE
        and item.verdict == "supported"
        and item.estimate > 0
        and item.leader.joint in moving
        for item in found.parameters
    )
    said += _by_negative_values(fit.model.robot, negative, moving, known, everywhere=not positive)
    said.sort(key=lambda item: -item[0])
    return tuple(sentence for _, sentence in said[:3])


def beyond_range(signals: Signals, robot: Robot) -> bool:
    """Whether a joint moves several times as far as it can by the robot's file: its positions are in another unit."""
    for k, joint in enumerate(robot.joints):
        low, high = joint.limits.position or (0.0, 0.0)
        for values in (signals.motion.q[:, k], signals.motion.theta[:, k]):
            known = values[np.isfinite(values)]
            if known.size and high > low and float(np.ptp(known)) > FARTHER * (high - low):
                return True
    return False


def rotor_warnings(found: Identification) -> tuple[str, ...]:
    """Return a sentence where every motor inertia is that of the robot file divided by the gear ratio, or times it."""
    robot, off = found.robot, dict[str, float]()
    for item in found.parameters:
        joint = robot.joints[item.leader.joint]
        sure = item.estimate > 0 and item.std_error < ALIKE * item.estimate and item.reference > 0
        if item.leader.kind == "Jm" and item.name == item.leader and abs(joint.gear_ratio or 0.0) >= GEARED and sure:
            off[joint.name] = float(np.log(item.estimate / item.reference) / np.log(abs(joint.gear_ratio or GEARED)))
    for power, words in ((-1, "divided by"), (1, "times")):
        if off and all(abs(value - power) < NEAR_POWER for value in off.values()):
            side = "side: motor" if power < 0 else "side: joint"
            return (
                f"the motor inertia of {in_words(list(off))} is that of the robot file {words} the gear ratio: the "
                f"torque looks as if it were of the {'motor' if power < 0 else 'joint'}'s side; if so, map tau with "
                f"{side}",
            )
    return ()


class _Fault(NamedTuple):
    """A fault of the inputs that is tried the other way."""

    kind: Literal["torque", "positions", "axis", "gear", "swap", "unit"]
    joints: tuple[int, ...]
    words: str
    factor: float = 1.0
    """By which positions are multiplied."""

    def of_one_unit(self, moving: int) -> bool:
        """Whether it is the unit of some of so many joints that move."""
        return self.kind == "unit" and len(self.joints) < moving


def _told(gains: Sequence[tuple[float, _Fault]], names: Sequence[str]) -> list[tuple[float, _Fault]]:
    """Return the faults that are told, with what it saves: of signs at one joint the one that saves most.

    Signs of the torque and of both positions of a joint are nearly the same to it; gravity and other joints tell them
    apart. A gear ratio's sign moves small terms only: it is told where nothing else saves as much.
    """
    most = max((gain for gain, _ in gains), default=0.0)
    said = []
    for gain, fault in gains:
        if fault.kind == "gear" and gain < most:
            continue
        here = {other.kind: g for g, other in gains if other.joints == fault.joints}
        either = max((here[kind] for kind in SIGNS if kind in here), default=0.0)
        if fault.kind == "axis" and gain < either + AS_WELL:
            continue
        if fault.kind in SIGNS:
            rivals = [here[kind] for kind in SIGNS if kind in here]
            if gain < either or here.get("axis", 0.0) >= either + AS_WELL:
                continue
            if any(gain - AS_WELL < g < gain for g in rivals):
                fault = fault._replace(words=_either_sign(names[fault.joints[0]]))
        said.append((gain, fault))
    return said


def _wrong_sign(name: str) -> str:
    return f"the torque of {name} looks as if its sign were wrong"


def _wrong_positions(name: str) -> str:
    return f"q and theta of {name} look as if their signs were wrong"


def _wrong_axis(name: str) -> str:
    return (
        f"q, theta and tau of {name} look as if they all had the wrong sign, or its axis in the robot file points the "
        "other way"
    )


def _either_sign(name: str) -> str:
    return f"{_wrong_sign(name)}, or those of q and theta of {name}"


def _others(
    fit: DefaultFit, signals: Signals, observation: Observation, negative: Sequence[str], moving: Sequence[int]
) -> Iterator[tuple[Observation, _Fault]]:
    """Yield what the log would be without a wrong sign, unit or exchange, and that fault."""
    robot, names = fit.model.robot, fit.model.robot.joint_names
    for k in moving if len(moving) > 1 else []:
        other = observe(fit.model, replace(signals, motion=_turned_motion(fit.signals.motion, k)), mask=False)
        yield turned(other, k), _Fault("axis", (k,), _wrong_axis(names[k]))
        # turning the others round fits as well; the joint whose own parameters are negative is the one
        if not negative or any(w.startswith(tuple(f"{kind}{k + 1} " for kind in POSITIVE)) for w in negative):
            yield turned(observation, k), _Fault("torque", (k,), _wrong_sign(names[k]))
            yield other, _Fault("positions", (k,), _wrong_positions(names[k]))
    for a, b in combinations(moving, 2):
        words = f"the torques of {names[a]} and {names[b]} look swapped"
        yield swapped(observation, a, b), _Fault("swap", (a, b), words)
    for k in moving:
        if robot.joints[k].elastic and robot.joints[k].gear_ratio and robot.parents[k] >= 0:
            other = observe(Regressor(_geared(robot, k)), signals, mask=False)
            yield other, _Fault("gear", (k,), f"gear_ratio of {names[k]} looks as if its sign were wrong")
    yield from _units(fit, signals, moving)


def _units(fit: DefaultFit, signals: Signals, moving: Sequence[int]) -> Iterator[tuple[Observation, _Fault]]:
    """Yield what the log would be with positions, of all joints or of one, from degrees or to them, and that fault."""
    n, names = fit.model.robot.n, fit.model.robot.joint_names
    for factor in (np.pi / 180, 180 / np.pi):
        for only in (None, *(moving if len(moving) > 1 else ())):
            key = "deg" if only is None else f"{{{names[only]}: deg}}"
            whose = "the positions" if only is None else f"the positions of {names[only]}"
            unit = f"degrees: map them, and velocities, with unit: {key}"
            words = f"{whose} look as if they were in {unit if factor < 1 else 'radians where degrees are declared'}"
            joints = tuple(moving) if only is None else (only,)
            factors = np.array([factor if only in (None, k) else 1.0 for k in range(n)])
            scaled = replace(signals, motion=_scaled(fit.signals.motion, factors))
            yield observe(fit.model, scaled, mask=False), _Fault("unit", joints, words, factor)


def _is_best(fit: DefaultFit, signals: Signals, fault: _Fault, left: float) -> bool:
    """Whether positions of one joint that are twice as large, or half, leave more than in the unit of a fault."""
    for size in (0.5, 2.0):
        factors = np.ones(fit.model.robot.n)
        factors[list(fault.joints)] = size * fault.factor
        other = observe(fit.model, replace(signals, motion=_scaled(fit.signals.motion, factors)), mask=False)
        if misfit(other, fit.base.count) < left:
            return False
    return True


def _by_negative_values(
    robot: Robot, negative: Sequence[str], moving: Sequence[int], known: Collection[int], *, everywhere: bool
) -> list[tuple[float, str]]:
    """Return what negative parameters say whatever else fits, with a weight, but of joints that are told already.

    `everywhere`: no friction, motor inertia or stiffness came out positive, and known.
    """
    said: list[tuple[float, str]] = []
    for k in (k for k in moving if k not in known):
        own = {kind for kind in POSITIVE if any(w.startswith(f"{kind}{k + 1} ") for w in negative)}
        name = robot.joint_names[k]
        # whatever else fits: a motor whose inertia and friction are negative is driven the other way round
        if {robot.rotor_names[k][:2], "fs", "fv"} <= own and len(negative) < 3 * len(moving):
            said.append((np.inf, _either_sign(name)))
        if own == {"K"}:
            said.append((np.inf, f"q and theta of {name} look swapped: its spring pushes the wrong way"))
    if everywhere and len(moving) and len(negative) >= len(moving) and not said and not known:
        said.append((0.0, "inertia, friction or stiffness come out negative everywhere: the torque's sign looks wrong"))
    return said


def channel_warnings(signals: Signals, robot: Robot) -> tuple[str, ...]:
    """Return a sentence for every sign or exchange that positions of links and motors show by themselves."""
    names = robot.joint_names
    moving = [
        k for k in range(robot.n) if not signals.still[k] and robot.joints[k].elastic and not signals.missing_link[k]
    ]
    step = max(1, signals.motion.samples // _LOOKED_AT)
    part = np.arange(0, signals.motion.samples, step)
    motion = signals.motion[part]
    said = [f"theta of {names[k]} moves against q: its sign looks wrong" for k in moving if _opposed(motion, k)]

    def apart(a: int, b: int) -> float:
        return float(np.nanstd(motion.q[:, a] - motion.theta[:, b]))

    for a, b in combinations(moving, 2):
        if apart(a, b) + apart(b, a) < ALIKE * (apart(a, a) + apart(b, b)):
            said.append(f"the motor positions of {names[a]} and {names[b]} look swapped")
    return tuple(said)


def misfit(observation: Observation, rank: int) -> float:
    """Return the logarithm of the row groups' residual over their torque, summed."""
    triangles = to_triangles(observation)
    solution = reweighted(triangles, rank)
    logs = []
    for row in triangles.rows:
        size = triangles.torque_rms(row)
        if size > 0:
            logs.append(np.log(max(triangles.rms(solution.values, row) / size, 1e-6)))
    return float(np.sum(logs))


def turned(observation: Observation, joint: int) -> Observation:
    """Return the observation with one joint's torque turned round."""
    tau = observation.tau.copy()
    tau[joint] *= -1
    return _with_torque(observation, tau)


def swapped(observation: Observation, a: int, b: int) -> Observation:
    """Return the observation with the torques of two joints exchanged."""
    tau = observation.tau.copy()
    tau[[a, b]] = tau[[b, a]]
    return _with_torque(observation, tau)


def _with_torque(observation: Observation, tau: Array) -> Observation:
    groups = tuple(g if g.row.kind == "link" else replace(g, target=tau[g.row.joint]) for g in observation.groups)
    return replace(observation, groups=groups, tau=tau)


def _geared(robot: Robot, joint: int) -> Robot:
    joints = list(robot.joints)
    joints[joint] = replace(joints[joint], gear_ratio=-(joints[joint].gear_ratio or 0.0))
    return replace(robot, joints=tuple(joints))


def _turned_motion(motion: Motion, joint: int) -> Motion:
    turn = np.ones(motion.q.shape[1])
    turn[joint] = -1.0
    return _scaled(motion, turn)


def _scaled(motion: Motion, factor: Array | float) -> Motion:
    return Motion(motion.t, *(factor * a for a in motion.states))


def _opposed(motion: Motion, joint: int) -> bool:
    q, theta = motion.dq[:, joint], motion.dtheta[:, joint]
    known = np.isfinite(q) & np.isfinite(theta)
    return bool(known.sum() > 10 and np.corrcoef(q[known], theta[known])[0, 1] < -0.8)

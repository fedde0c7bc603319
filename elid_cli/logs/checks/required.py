"""Missing signals refused or named; logs with and without link positions not mixed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import UsageError, in_words
from elid_cli.logs.checks.commanded import UNTOLD, at_motors, commanded_torque, gains_of
from elid_cli.logs.checks.deflection import Sensed, deflects_by
from elid_cli.logs.checks.missing_signal import MEANING, MissingSignal
from elid_cli.logs.contract import RawLog
from elid_cli.logs.mapping.language import GAINS
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.logs.mapping.resolve import RATE
from elid_cli.logs.repair.stuck import drop_stuck
from elid_cli.memory import passed, writable
from elid_cli.robot.robot import Robot
from elid_cli.signals.command_torque import rates_of
from elid_cli.signals.recording import LINK_SENSORS

NOTHING = 1e-30
"""An effort or velocity, in SI units, that is none: its square may not even be a number."""
COUNTS_AS_RIGID = "its transmission counts as rigid"
"""What a warning says of a joint whose two positions differ as its torque does."""
ZERO_IS_ABSENT = ("tau", "tau_link", "dq", "dtheta")


@dataclass
class Checked:
    """Complete signals, and what the user should know about missing ones."""

    q: Array
    theta: Array
    tau: Array
    optional: dict[str, Array]
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    computed: str = ""
    """Joints whose torque is computed from commands, in words; empty: none."""
    efforts: str = ""
    """Where the torque was read from, of which the effort of joint states is some or all; empty: as was planned."""


def check(
    signals: Mapping[str, Array], robot: Robot, plan: ReadPlan, raw: RawLog, name: str, *,
    segments: Sequence[tuple[int, int]] = (), dt: float = np.nan, strict: bool,
) -> Checked:  # fmt: skip
    """Return the signals with absent ones as NaN columns, rigid joints completed, torques computed from commands.

    `segments` are the segments of the signals, contiguous each, (start, stop), `dt` their sample time in s.

    Raises
    ------
    LogError
        If a signal that the robot needs is missing, or a gain is negative; with `strict`, also if a joint lacks one it
        could do without.
    """
    samples = max((stop for _, stop in segments), default=0)
    filled = {s: signals[s] if s in signals else np.full((samples, robot.n), np.nan) for s in ("q", "theta", "tau")}
    filled |= {s: values for s, values in signals.items() if s not in filled}
    warnings = _drop_zeros(filled, robot.joint_names)
    warnings += _drop_stuck(filled, robot)
    warnings += _drop_sensors(filled, robot)
    notes: list[str] = []
    efforts = _name_efforts(filled, robot, plan, notes)
    fault = MissingSignal(robot, plan, raw, name, tuple(warnings))
    fault.refuse_negative(signals)
    computed = _compute_torque(filled, robot, plan, segments, dt, notes) if samples else ""
    has: dict[str, NDArray[np.bool_]] = {
        s: np.isfinite(values[0]) if samples else np.zeros(robot.n, bool) for s, values in filled.items()
    }
    warnings += _deflecting(filled, robot, has, segments, dt)
    read = has["tau_link"] & ~has["tau"] if "tau_link" in has else np.zeros(robot.n, bool)
    for j, joint in enumerate(robot.joints):
        if not has["q"][j] and not has["theta"][j]:
            fault.refuse(_told_side(plan), joint.name, "no position")
        if not joint.elastic:
            _complete(filled, has, j)
        elif not has["theta"][j] and read[j]:
            filled["theta"] = writable(filled["theta"])
            filled["theta"][:, j] = filled["q"][:, j]
        elif not has["theta"][j]:
            fault.refuse("theta", joint.name, "no motor position")
    if not has["tau"].any() and not read.any():
        fault.refuse_torque(filled)
    warnings += _lacking(robot, fault, ~has["q"], ~has["tau"] & ~read, strict=strict)
    optional = {s: values for s, values in filled.items() if s not in MEANING and not np.isnan(values).all()}
    return Checked(filled["q"], filled["theta"], filled["tau"], optional, warnings, notes, computed, efforts)


def _told_side(plan: ReadPlan) -> str:
    """Return the position that words on a joint without one are of: the one that the log has, of other joints."""
    link, motor = (signal in plan.placements or signal in plan.unusable for signal in ("q", "theta"))
    return "q" if link and not motor else "theta"


def _deflecting(
    filled: Mapping[str, Array], robot: Robot, has: Mapping[str, NDArray[np.bool_]],
    segments: Sequence[tuple[int, int]], dt: float,
) -> list[str]:  # fmt: skip
    """Say which joints are declared rigid whose motor and link positions differ as their torque does."""
    said = []
    start, stop = max(segments, key=lambda part: part[1] - part[0], default=(0, 0))
    t: Array = dt * np.arange(stop - start, dtype=float)
    for j, joint in enumerate(robot.joints):
        if joint.transmission != "rigid" or not all(has[name][j] for name in ("q", "theta", "tau")):
            continue
        by = deflects_by(*(Sensed.of(t, filled[name][start:stop, j]) for name in ("q", "theta", "tau")))
        if by:
            size = f"{1e3 * by:.2g} mrad" if joint.revolute else f"{1e3 * by:.2g} mm"
            said.append(
                f"{joint.name}: {COUNTS_AS_RIGID}, but motor and link position differ by {size} (rms) "
                f"that follow the torque: declare transmission: elastic {robot.place_to_say}"
            )
    return said


def _drop_sensors(filled: dict[str, Array], robot: Robot) -> list[str]:
    """Drop sensors on links of which an axis is not in the log; say so."""
    warnings = []
    for (j, joint), (kind, axes) in product(enumerate(robot.joints), LINK_SENSORS.items()):
        lacking = [axis for axis in axes if axis not in filled or np.isnan(filled[axis][:, j]).all()]
        if 0 < len(lacking) < len(axes):
            warnings.append(f"{joint.name}: no {' and '.join(lacking)}: its {kind} is not used, as an axis is missing")
            for axis in set(axes) - set(lacking):
                filled[axis] = writable(filled[axis])
                filled[axis][:, j] = np.nan
    return warnings


def _unlinked(names: Sequence[str], elsewhere: str, *, shown: bool) -> list[str]:
    """Say what becomes of elastic joints without link position; `shown`: their motors' torque shows the stiffness."""
    counts, whose = ("its transmission counts", "its") if len(names) == 1 else ("their transmissions count", "their")
    looked = f"; elid identify looks for {whose} stiffness by theta and tau" if shown else ""
    return [f"{' '.join(names)}: no link position q: {counts} as rigid{looked}{elsewhere}"]


def _lacking(
    robot: Robot, fault: MissingSignal, unplaced: NDArray[np.bool_], untorqued: NDArray[np.bool_], *, strict: bool
) -> list[str]:
    """Say what cannot be identified of joints without link position or torque, (n,), and whose stiffness is not used.

    Raises
    ------
    LogError
        If a link position is missing that the user has mapped, or a torque that the log has of other joints; with
        `strict`, if anything is.
    """
    warnings = []
    if unplaced.any():
        lacking = [name for name, none in zip(robot.joint_names, unplaced, strict=True) if none]
        if strict or "q" in fault.plan.unusable:
            fault.refuse("q", lacking[0], "no link position")
        seen = [name for name, none in zip(robot.joint_names, unplaced & ~untorqued, strict=True) if none]
        for names in (seen, [name for name in lacking if name not in seen]):
            warnings += _unlinked(names, fault.elsewhere("q", names), shown=names is seen) if names else []
    if untorqued.any():
        lacking = [name for name, none in zip(robot.joint_names, untorqued, strict=True) if none]
        if strict:
            fault.refuse("tau", lacking[0], "no torque")
        for name in (name for name in lacking if fault.unheld("tau", name)):
            fault.refuse_unheld("tau", name)
        placement, whose = fault.plan.placements.get("tau"), "its motor" if len(lacking) == 1 else "their motors"
        where = f" in {placement.places}" if placement is not None else ""
        warnings.append(
            f"{' '.join(lacking)}: no torque tau{where}: inertia and friction of {whose} cannot be identified, nor "
            "what only motor torque shows"
        )
    idle = [joint.name for joint in robot.joints if not joint.elastic and "K" in joint.parameters]
    if idle:
        warnings.append(f"{' '.join(idle)}: the robot file's K is not used: the transmission counts as rigid")
    return warnings


def _compute_torque(
    filled: dict[str, Array], robot: Robot, plan: ReadPlan, segments: Sequence[tuple[int, int]], dt: float,
    notes: list[str],
) -> str:  # fmt: skip
    """Compute the torque of joints that have none from commands and gains; return whose, in words."""
    given = {s: np.asarray(p.spec.value) for s, p in plan.placements.items() if p.spec.value is not None}
    gains, said = gains_of(filled, given, robot, len(filled["q"]))
    filled |= gains
    if "q_des" not in filled or len(gains) < len(GAINS):
        return ""
    if (asked := plan.placements.get("dq_des")) is not None and asked.spec.source == RATE:
        filled["dq_des"] = rates_of(filled["q_des"], segments, dt)
    absent = np.isnan(filled["tau"]).all(axis=0)
    tau, more = commanded_torque(filled, gains, segments, dt, robot)
    made = absent & np.isfinite(tau).any(axis=0)
    if not made.any():
        return ""
    filled["tau"] = np.where(made, tau, filled["tau"])
    who = "" if made.all() else f" of {' '.join(np.array(robot.joint_names)[made])}"
    motors = np.array(robot.joint_names)[made & at_motors(filled, robot)]
    if motors.size:
        more.append(
            f"the drives of {in_words(motors.tolist())} are taken to have the motors' positions theta, not the links': "
            "with loops on the links, stiffnesses and inertias are wrong here"
        )
    untold = "dq_des" not in filled
    rates = "- kd dq" if untold else "+ kd (dq_des - dq)"
    notes += [
        *said,
        f"tau{who} is computed: kp (q_des - q) {rates}{' + tau_ff' * ('tau_ff' in filled)}; a torque delay "
        "is that of the commands, as the drive has its positions at once",
        *([UNTOLD] if untold and np.nan_to_num(gains["kd"]).any() else []),
        *more,
    ]
    return f"command{who}"


def _name_efforts(filled: dict[str, Array], robot: Robot, plan: ReadPlan, notes: list[str]) -> str:
    """Take the effort of joint states as the motor's torque where nothing else is logged of a joint's motor side.

    Returned is where the torque then comes from; nothing where that is as planned.
    """
    placement = plan.placements.get("tau_link")
    if placement is None or not placement.either or "tau_link" not in filled:
        return ""
    absent = [np.isnan(filled[signal]).all(axis=0) for signal in ("tau", "theta")]
    rigid = np.array([joint.transmission != "elastic" for joint in robot.joints])
    shown = ~np.isnan(filled["tau_link"]).all(axis=0)
    alone = absent[0] & absent[1] & shown
    mine, names = alone & rigid, np.array(robot.joint_names)
    if (sensed := alone & ~rigid).any():
        who, place = " ".join(names[sensed]), placement.places
        said = f"the effort of {place} is taken as the joint torque sensors' (tau_link) of {who}, declared elastic"
        notes.append(f"{said}; if it is the motors' torque, declare transmission: rigid")
    if not mine.any():
        return ""
    why, other = ", as the log holds nothing else of the motors", plan.placements.get("tau")
    twice = shown & rigid & ~absent[0] & absent[1]
    if twice.any() and other is not None and not other.told and shown.sum() > (~absent[0]).sum():
        mine, why = mine | twice, ""  # of two sources that with more joints, as for any signal
        notes.append(
            f"tau of {' '.join(names[twice])} could be read from {other.places} as well, which has fewer joints"
        )
    filled["tau"] = np.where(mine, filled["tau_link"], filled["tau"])
    filled["tau_link"] = np.where(mine, np.nan, filled["tau_link"])
    who = "" if mine.all() else f" of {' '.join(names[mine])}"
    notes.append(f"tau{who} is the effort of {placement.places}{why}")
    own = placement.places
    return f"{own}{who}, else {other.places}" if other is not None and (~absent[0] & ~mine).any() else own


def _complete(filled: dict[str, Array], has: dict[str, NDArray[np.bool_]], j: int) -> None:
    """Give a rigid joint both sides of every signal of which it has one."""
    for one, other in (("q", "theta"), ("theta", "q"), ("dq", "dtheta"), ("dtheta", "dq")):
        if one in has and has[one][j] and not (other in has and has[other][j]):
            if other not in filled:
                filled[other] = np.full_like(filled[one], np.nan)
                has[other] = np.zeros(has[one].size, bool)
            filled[other] = writable(filled[other])
            filled[other][:, j] = filled[one][:, j]
            has[other][j] = True


def _drop_zeros(filled: dict[str, Array], joints: Sequence[str]) -> list[str]:
    """Take efforts and velocities that are zero throughout as absent: drivers fill what they do not know with 0."""
    warnings = []
    for signal in ZERO_IS_ABSENT:
        values = filled.get(signal)
        if values is None:
            continue
        zero: NDArray[np.bool_] = np.ones(values.shape[1], dtype=bool)
        for block in passed(values):
            zero &= np.abs(block).max(axis=0) < NOTHING  # NaN is not
            if not zero.any():
                break
        if zero.any():
            values = filled[signal] = writable(values)
            values[:, zero] = np.nan
        if zero.any() and signal == "tau":
            who = " ".join(joint for joint, here in zip(joints, zero, strict=True) if here)
            warnings.append(f"tau of {who} is zero throughout: taken as not recorded")
    return warnings


def _drop_stuck(filled: dict[str, Array], robot: Robot) -> list[str]:
    """Take channels that never change while their joint moves as absent."""
    drop = {signal: np.zeros(robot.n, bool) for signal in MEANING}
    warnings = drop_stuck(filled, robot, drop) if filled["q"].shape[0] else []
    for signal, chosen in drop.items():
        if chosen.any():
            filled[signal] = writable(filled[signal])
            filled[signal][:, chosen] = np.nan
    return warnings


def refuse_mixed(names: Sequence[str], missing_link: NDArray[np.bool_], joints: Sequence[str]) -> None:
    """Refuse logs of which some lack the link position of an elastic joint and others do not.

    Parameters
    ----------
    names
        The logs'.
    missing_link
        Elastic joints without a link position, (logs, n).
    joints
        Names of the joints, n.

    Raises
    ------
    UsageError
        Naming the joint, and a log of either kind.
    """
    for joint in np.flatnonzero(missing_link.any(axis=0) & ~missing_link.all(axis=0))[:1]:
        less, more = names[int(np.argmax(missing_link[:, joint]))], names[int(np.argmin(missing_link[:, joint]))]
        raise UsageError(
            f"{less}: no link position of {joints[joint]}, which {more} has",
            detail="without it a transmission counts as rigid, which is another model",
            hint="identify logs with link positions, and those without, apart",
        )

"""Missing signals refused or named; logs with and without link positions not mixed."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError, nearest
from elid_cli.logs.checks.commanded import commanded_torque, gains_of
from elid_cli.logs.contract import RawLog
from elid_cli.logs.mapping.language import GAINS
from elid_cli.logs.mapping.plan import Placement, ReadPlan
from elid_cli.logs.mapping.resolve import fits
from elid_cli.logs.mapping.suggest import needed, shorter_chain, suggestion
from elid_cli.logs.repair.stuck import drop_stuck
from elid_cli.memory import passed, writable
from elid_cli.robot.robot import Robot

MEANING = {"q": "link position", "theta": "motor position", "tau": "torque"}
NOTHING = 1e-30
"""An effort or velocity, in SI units, that is none: its square may not even be a number."""
ZERO_IS_ABSENT = ("tau", "tau_link", "dq", "dtheta")
LISTED = 8
"""Channels of the log that an error names."""


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


def check(
    signals: Mapping[str, Array], robot: Robot, plan: ReadPlan, raw: RawLog, name: str, *,
    segments: Sequence[tuple[int, int]] = (), dt: float = np.nan, strict: bool,
) -> Checked:  # fmt: skip
    """Return the signals with absent ones as NaN columns, rigid joints completed, torques computed from commands.

    `segments` are the segments of the signals, contiguous each, (start, stop), `dt` their sample time in s.

    Raises
    ------
    LogError
        If a signal that the robot needs is missing; with `strict`, also if a joint lacks one it could do without.
    """
    samples = max((stop for _, stop in segments), default=0)
    filled = {s: signals[s] if s in signals else np.full((samples, robot.n), np.nan) for s in ("q", "theta", "tau")}
    filled |= {s: values for s, values in signals.items() if s not in filled}
    warnings = _drop_zeros(filled, robot.joint_names)
    warnings += _drop_stuck(filled, robot)
    notes: list[str] = []
    _name_efforts(filled, robot, plan, notes)
    computed = _compute_torque(filled, robot, plan, segments, dt, notes) if samples else ""
    has: dict[str, NDArray[np.bool_]] = {
        s: np.isfinite(values[0]) if samples else np.zeros(robot.n, bool) for s, values in filled.items()
    }
    read = has["tau_link"] & ~has["tau"] if "tau_link" in has else np.zeros(robot.n, bool)
    fault = _Fault(robot, plan, raw, name, tuple(warnings))
    for j, joint in enumerate(robot.joints):
        if not has["q"][j] and not has["theta"][j]:
            fault.refuse("theta", joint.name, "no position")
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
    return Checked(filled["q"], filled["theta"], filled["tau"], optional, warnings, notes, computed)


def _lacking(
    robot: Robot, fault: _Fault, unplaced: NDArray[np.bool_], untorqued: NDArray[np.bool_], *, strict: bool
) -> list[str]:
    """Say what cannot be identified of joints without link position or torque, (n,), and whose stiffness is not used.

    Raises
    ------
    LogError
        If a link position is missing that the user has mapped; with `strict`, if anything is.
    """
    warnings = []
    if unplaced.any():
        lacking = [name for name, none in zip(robot.joint_names, unplaced, strict=True) if none]
        if strict or "q" in fault.plan.unusable:
            fault.refuse("q", lacking[0], "no link position")
        counts = "its transmission counts" if len(lacking) == 1 else "their transmissions count"
        warnings.append(f"{' '.join(lacking)}: no link position q: {counts} as rigid")
    if untorqued.any():
        lacking = [name for name, none in zip(robot.joint_names, untorqued, strict=True) if none]
        if strict:
            fault.refuse("tau", lacking[0], "no torque")
        warnings.append(f"{' '.join(lacking)}: no torque tau: the motor side cannot be identified there")
    idle = [joint.name for joint in robot.joints if not joint.elastic and "K" in joint.parameters]
    if idle:
        warnings.append(f"{' '.join(idle)}: the robot file's K is not used: it declares the transmission rigid")
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
    absent = np.isnan(filled["tau"]).all(axis=0)
    tau, more = commanded_torque(filled, gains, segments, dt, robot)
    made = absent & np.isfinite(tau).any(axis=0)
    if not made.any():
        return ""
    filled["tau"] = np.where(made, tau, filled["tau"])
    who = "" if made.all() else f" of {' '.join(np.array(robot.joint_names)[made])}"
    notes += [
        *said,
        f"tau{who} is computed: kp (q_des - q) + kd (dq_des - dq){' + tau_ff' * ('tau_ff' in filled)}",
        *more,
    ]
    return f"command{who}"


def _name_efforts(filled: dict[str, Array], robot: Robot, plan: ReadPlan, notes: list[str]) -> None:
    """Take the effort of joint states as the motor's torque where nothing else is logged of a joint's motor side."""
    placement = plan.placements.get("tau_link")
    if placement is None or not placement.either or "tau_link" not in filled:
        return
    absent = [np.isnan(filled[signal]).all(axis=0) for signal in ("tau", "theta")]
    rigid = np.array([joint.transmission != "elastic" for joint in robot.joints])
    alone = absent[0] & absent[1] & ~np.isnan(filled["tau_link"]).all(axis=0)
    mine = alone & rigid
    if (sensed := alone & ~rigid).any():
        who, place = " ".join(np.array(robot.joint_names)[sensed]), placement.places
        said = f"the effort of {place} is taken as that of joint torque sensors (tau_link) of {who}, declared elastic"
        notes.append(f"{said}; motors' torque needs transmission: rigid")
    if mine.any():
        filled["tau"] = np.where(mine, filled["tau_link"], filled["tau"])
        filled["tau_link"] = np.where(mine, np.nan, filled["tau_link"])
        who = "" if mine.all() else f" of {' '.join(np.array(robot.joint_names)[mine])}"
        notes.append(f"tau{who} is the effort of {placement.places}, as the log holds no motor side")


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


@dataclass(frozen=True)
class _Fault:
    """Words for a missing signal: what is missing, where elid looked, what there is instead."""

    robot: Robot
    plan: ReadPlan
    raw: RawLog
    name: str
    dropped: tuple[str, ...] = ()
    """What was taken as not recorded, and why: sentences that begin with the signal and its joint."""

    def refuse(self, signal: str, joint: str, what: str) -> None:
        """Raise the LogError of one missing signal."""
        who = f" for {joint}" if joint else ""
        raise LogError(f"{self.name}: {what}{who}", detail=self._detail(signal, joint), hint=self._hint(signal, joint))

    def refuse_torque(self, filled: Mapping[str, Array]) -> None:
        """Raise the LogError of a log without any torque; where commands would make one, name what they lack."""
        lacking = [gain for gain in GAINS if gain not in filled]
        if "q_des" in filled and lacking:
            options = " ".join(
                f"--{gain} {value}" for gain, value in zip(GAINS, ("20", "0.5"), strict=True) if gain in lacking
            )
            place = self.robot.place_to_say
            raise LogError(
                f"{self.name}: no torque, and no gains {' '.join(lacking)} to compute it from q_des",
                detail="tau = kp (q_des - q) + kd (dq_des - dq) + tau_ff, gains in N·m/rad and N·m·s/rad at the joint",
                hint=f"give the drive's own, such as {options}, or control: {{kp: 20, kd: 0.5}} {place}",
            )
        self.refuse("tau", self.robot.joint_names[0] if self.robot.n == 1 else "", "no torque")

    def _detail(self, signal: str, joint: str) -> str:
        placement = self.plan.placements.get(signal)
        need = f"{self.robot.name!r} needs {signal} ({MEANING[signal]})" + (f" of {joint}" if joint else "")
        if placement is None:
            reasons = self.plan.reasons
            reason = "; ".join(dict.fromkeys(reasons[s] for s in (signal, "q") if s in reasons))
            lost = f"; {self.raw.losses[0]}" if self.raw.losses else ""
            return f"{need}; {reason + '; ' if reason else ''}{self._contents()}{lost}"
        labels = self._labels(placement)
        called = self._called(placement, joint)
        close = nearest(called, labels) if joint else None
        seen = f"which names {' '.join(labels)}" if labels else "which holds no numbers for it"
        seen += f" (nearest: {close})" if close else ""
        if called in labels or (labels and not joint):
            seen = "which is empty, NaN or zero" + (" for it" if joint else " throughout")
        if called in labels and signal != "tau":
            seen = "which is empty, NaN or never changes for it"
        why = [said for said in self.dropped if said.startswith(f"{signal} of {joint}")]
        more = f"; and {len(why) - LISTED} more" if len(why) > LISTED else ""
        told = "; " + "; ".join(why[:LISTED]) + more if why else f", {seen}"
        return f"{need}; it is read from {placement.places}{told}"

    @staticmethod
    def _called(placement: Placement | None, joint: str) -> str:
        """Return the name that a joint has in the log, by the mapping that places a signal."""
        named = placement.spec.joints if placement is not None else None
        return str(named.get(joint, joint)) if named else joint

    def _labels(self, placement: Placement) -> list[str]:
        """Return the joint names that the log has where a signal is read from."""
        sources = {pick.source for pick in placement.picks}
        labels = [label for channel in self.raw.channels if channel.source in sources for label in channel.labels]
        before, joint, after = placement.places.partition("{joint}")
        if joint:
            pattern = re.compile(f"{re.escape(before)}(.+){re.escape(after)}")
            found = (pattern.fullmatch(channel.source) for channel in self.raw.channels)
            labels += [match.group(1) for match in found if match]
        return list(dict.fromkeys(labels))

    def _contents(self) -> str:
        shown = [channel for channel in self.raw.channels if not _about(channel.field)]
        named = list(dict.fromkeys(c.address if c.width else f"{c.source} (not decoded: {c.kind})" for c in shown))
        more = f" and {len(named) - LISTED} more" if len(named) > LISTED else ""
        return f"the log holds {', '.join(named[:LISTED])}{more}" if named else "the log holds no channels"

    def _hint(self, signal: str, joint: str) -> str:
        """Return what to paste: the nearest name where a place lacks the joint, else the channel that fits best."""
        before = f"elid info {self.name}, or map it: "
        placement = self.plan.placements.get(signal)
        labels = self._labels(placement) if placement is not None else []
        called = self._called(placement, joint)
        close = nearest(called, labels) if joint and called not in labels else None
        if placement is not None and close:
            spec = placement.spec
            # a pattern fills in what is not named here; of a topic, only the joints that are named are read
            own = () if "{joint}" in placement.places else self.robot.joint_names
            names = {**{name: name for name in own if name in labels}, **(spec.joints or {}), joint: close}
            pairs = ", ".join(f"{key}: {value}" for key, value in names.items())
            field = f", field: {spec.field}" if spec.field and isinstance(spec.source, str) else ""
            source = spec.source if isinstance(spec.source, str) else placement.places
            line = f'{signal}: {{from: "{source}"{field}, joints: {{{pairs}}}}}'
            return f"{before}--map {shlex.quote(line)}"
        taken = {pick.source for pick in placement.picks} if placement is not None else set()
        free = [c for c in self.raw.channels if c.width and c.source not in taken and not _about(c.field)]
        units = getattr(self.raw, "units", {})
        wanted = (signal,) if placement is not None else needed(self.plan, self.robot, units)
        wanted = tuple(s for s in wanted if s != "t" or getattr(self.raw, "timeless", False))
        works = partial(fits, self.raw.channels, self.robot)
        lines = suggestion(free, self.robot.joint_names, wanted, works, units).splitlines()
        fitting = " ".join(f"--map {shlex.quote(line)}" for line in lines)
        held = [label for channel in free for label in channel.labels]
        if fitting and held and not any(nearest(name, held) for name in self.robot.joint_names):
            before = f"is this a log of {self.robot.name!r}? if so, map it: "
        if not fitting and signal in self.plan.mapped:  # whoever has mapped it knows how to; an example is no answer
            return f"elid info {self.name} lists what it holds"
        if not fitting:
            link, chained = shorter_chain(free, self.robot, wanted)
            maps = " ".join(f"--map {shlex.quote(line)}" for line in chained.splitlines())
            if link:
                return f"if it holds the joints that carry {link} alone, in their order: {maps} --tip {link}"
        example = signal if not (signal == "theta" and "q" in needed(self.plan, self.robot)) else "q"
        return before + (fitting or f"--map {example}=PLACE")


def _about(field: str) -> bool:
    """Whether a field of a message tells about the message and not about the robot."""
    return field.endswith(("sec", "secs")) or field.startswith("layout.")


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

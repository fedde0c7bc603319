"""Words for a signal that a robot needs and a log does not hold."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import LogError, first_of, in_words, nearest
from elid_cli.logs.contract import Channel, RawLog
from elid_cli.logs.mapping.find import ABSENT
from elid_cli.logs.mapping.joints_in_names import named_joints
from elid_cli.logs.mapping.language import GAINS
from elid_cli.logs.mapping.plan import Placement, ReadPlan
from elid_cli.logs.mapping.resolve import fits
from elid_cli.logs.mapping.suggest import completed, needed, proposal, untold
from elid_cli.robot.robot import Robot
from elid_cli.robot.yaml import inline, quoted

MEANING = {"q": "link position", "theta": "motor position", "tau": "torque"}
LISTED = 8
"""Channels of the log that an error names."""


@dataclass(frozen=True)
class MissingSignal:
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
        detail = "; ".join(filter(None, (self._other_names(signal, joint), self._detail(signal, joint))))
        raise LogError(f"{self.name}: {what}{who}", detail=detail, hint=self._hint(signal, joint))

    def _other_names(self, signal: str, joint: str) -> str:
        """Return what joints are called by the log and by the robot, where the log names others than one it lacks."""
        names = named_joints(self.raw.channels)
        if not joint or not names or self._called(self.plan.placements.get(signal), joint) in names:
            return ""
        own = first_of(self.robot.joint_names, LISTED)
        return f"the log's joints are {first_of(names, LISTED)}; those of {self.robot.name!r} are {own}"

    def refuse_negative(self, filled: Mapping[str, Array]) -> None:
        """Raise the LogError of a gain of the log that is negative: a drive with one would run away."""
        for gain in (name for name in GAINS if name in filled):
            least = np.nan_to_num(filled[gain]).min(axis=0, initial=0.0)
            for joint in np.flatnonzero(least < 0).tolist():
                raise LogError(
                    f"{self.name}: {gain} of {self.robot.joint_names[joint]} is {least[joint]:g}: it must not be "
                    "negative",
                    detail=f"it is read from {self.plan.placements[gain].places}",
                    hint=f"give the drive's own, such as --{gain} 20, or one number per joint with commas between",
                )

    def refuse_torque(self, filled: Mapping[str, Array]) -> None:
        """Raise the LogError of a log without any torque; where commands would make one, name what they lack."""
        lacking = [gain for gain in GAINS if gain not in filled]
        if "q_des" in filled and lacking:
            options = " ".join(
                f"--{gain} {value}" for gain, value in zip(GAINS, ("20", "0.5"), strict=True) if gain in lacking
            )
            place = self.robot.place_to_say
            formula = "tau = kp (q_des - q) + kd (dq_des - dq) + tau_ff, gains in N·m/rad and N·m·s/rad at the joint"
            unfit = [f"{g}: {why}" for g in lacking if (why := self.plan.reasons.get(g, "")) and ABSENT not in why]
            raise LogError(
                f"{self.name}: no torque, and no {'usable ' * bool(unfit)}gains {' '.join(lacking)} to compute it "
                "from q_des",
                detail="; ".join([*unfit, formula]),
                hint=f"give the drive's own, such as {options}, or control: {{kp: 20, kd: 0.5}} {place}",
            )
        if "q_des" in filled and (why := self._idle(filled)):
            raise LogError(
                f"{self.name}: no torque, as what the commands make is 0 throughout", detail=why,
                hint="record while the drives hold or move the robot; if the drives work otherwise, map a torque: "
                "--map tau=PLACE",
            )  # fmt: skip
        lacked = untold(self.plan)
        if lacked:
            lines, _ = self._proposal(self._free(None), ("tau",), "tau")
            place = " ".join(f"--map {shlex.quote(line)}" for line in lines)
            place = place or "--map q_des=PLACE, or --map tau=PLACE"
            raise LogError(
                f"{self.name}: no torque, and no q_des to compute it from",
                detail=f"{lacked}; {self._contents()}",
                hint=f"elid info {self.name}, or map it: {place}",
            )
        self.refuse("tau", self.robot.joint_names[0] if self.robot.n == 1 else "", "no torque")

    def _idle(self, filled: Mapping[str, Array]) -> str:
        """Return why commands and gains, which are there, make no torque; empty: for no reason that is known."""
        gains = [np.nan_to_num(filled[gain]) for gain in GAINS]
        if not any(gain.any() for gain in gains):
            return f"{' and '.join(GAINS)} are 0 throughout: the drives were off"
        position = np.where(np.isnan(filled["q"]), filled["theta"], filled["q"])
        if not np.nan_to_num(filled["q_des"] - position).any():
            moving = "nothing moves, and " if not np.nan_to_num(np.ptp(position, axis=0)).any() else ""
            return f"{moving}the positions are the commanded ones (q_des) to the last digit"
        return ""

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
        twice = self._twice(placement)
        if twice:
            seen = f"which names {' '.join(twice)} more than once"
        elif called in labels or (labels and not joint):
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

    def elsewhere(self, signal: str, joints: Sequence[str]) -> str:
        """Return words that name another channel like a signal's own, which has joints that this one lacks."""
        placement = self.plan.placements.get(signal)
        picks = placement.picks if placement is not None and placement.spec.joints is None else ()
        if line := self._in_units(signal, joints):
            return f"; for columns whose names end in a unit, map it: {line}"
        names, fields = set(self.robot.joint_names), {pick.field for pick in picks if pick.field}
        kinds = {c.kind for c in self.raw.channels if c.source in {pick.source for pick in picks}}
        for channel in self.raw.channels:
            if channel.field in fields and channel.kind in kinds and set(joints) <= set(channel.labels) & names:
                line = f"{signal}: {{from: {channel.source}, field: {channel.field}}}"
                whole = names <= set(channel.labels)
                paste = f"; if so, map it: {line}" if whole else ""
                return f"; {channel.address} names {' '.join(joints)} as well{paste}"
        return ""

    def unheld(self, signal: str, joint: str) -> bool:
        """Whether the log has a signal for other joints and no place of it for this one, without being told so."""
        placement = self.plan.placements.get(signal)
        if placement is None or placement.spec.value is not None or not placement.picks:
            return False
        spec, labels = placement.spec, self._labels(placement)
        told = isinstance(spec.source, tuple) or (
            spec.joints is not None and joint not in spec.joints and "{" not in placement.places
        )
        held = any(self.robot.joint_names.index(joint) in joints for joints in placement.joints)
        named = not labels or self._called(placement, joint) in labels
        return not told and not (held and named)

    def partial(self, signal: str) -> Iterator[str]:
        """Yield a sentence where the log has a signal for some joints only."""
        lacking = [name for name in self.robot.joint_names if self.unheld(signal, name)]
        if lacking:
            place = self.plan.placements[signal].places
            yield f"{signal} of {in_words(lacking)} is not in {place}{self.elsewhere(signal, lacking)}"

    def refuse_unheld(self, signal: str, joint: str) -> None:
        """Raise the LogError of a signal that the log has for other joints; its hint says how to do without it, too."""
        placement = self.plan.placements[signal]
        held = {j: pick.source for pick, own in zip(placement.picks, placement.joints, strict=True) for j in own}
        names = self.robot.joint_names
        if "{" in placement.places:
            places = f"[{', '.join(quoted(held[j]) if j in held else 'null' for j in range(len(names)))}]"
            line = f"from: {places}"
        else:
            labels = [name for name in names if self._called(placement, name) in self._labels(placement)]
            named = ", ".join(f"{name}: {self._called(placement, name)}" for name in labels)
            field = f", field: {placement.spec.field}" if placement.spec.field else ""
            line = f"from: {placement.spec.source}{field}, joints: {{{named}}}"
        kept = {key: value for key, value in (placement.spec.written or {}).items()}
        line += "".join(f", {key}: {inline(v)}" for key, v in kept.items() if key not in ("from", "field", "joints"))
        without = f"to do without: --map {shlex.quote(f'{signal}: {{{line}}}')}"
        raise LogError(
            f"{self.name}: no {MEANING[signal]} for {joint}",
            detail=self._detail(signal, joint), hint=f"{self._hint(signal, joint)}; {without}",
        )  # fmt: skip

    def _close(self, placement: Placement | None, joint: str, labels: Sequence[str]) -> str | None:
        """Return the name nearest to a joint's that no other joint of the robot has; None where none is near."""
        others = {self._called(placement, name) for name in self.robot.joint_names if name != joint}
        free = [label for label in labels if label not in others]
        # the only name that is left is this joint's, where all others of the robot have theirs
        only = free[0] if len(free) == 1 and others <= set(labels) and len(labels) == self.robot.n else None
        return nearest(self._called(placement, joint), free) or only

    def _twice(self, placement: Placement) -> list[str]:
        """Return the joint names that a channel gives more than one column."""
        sources = {pick.source for pick in placement.picks}
        held = [channel.labels for channel in self.raw.channels if channel.source in sources]
        return sorted({name for labels in held for name in labels if labels.count(name) > 1})

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
        return f"the log holds {first_of(named, LISTED)}" if named else "the log holds no channels"

    def _hint(self, signal: str, joint: str) -> str:
        """Return what to paste: the nearest name where a place lacks the joint, else the channel that fits best."""
        before = f"elid info {self.name}, or map it: "
        placement = self.plan.placements.get(signal)
        labels = self._labels(placement) if placement is not None else []
        called = self._called(placement, joint)
        close = self._close(placement, joint, labels) if joint and called not in labels else None
        if placement is not None and self._twice(placement):
            return f"{before}{' '.join(f'--map {shlex.quote(line)}' for line in self._by_number())}"
        if line := self._in_units(signal, [joint]):
            return f"{before}--map {shlex.quote(line)}"
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
        free = self._free(placement)
        undefined = any("does not hold its definition" in c.kind for c in self.raw.channels)
        if undefined and not free and placement is None and not self.name.endswith(".mcap"):
            return (
                f"convert it where the package of its messages is installed: ros2 bag convert -i {self.name} -o "
                "mcap.yaml (with storage_id: mcap); MCAP holds the definitions"
            )
        units = getattr(self.raw, "units", {})
        wanted = (signal,) if placement is not None else needed(self.plan, self.robot, units)
        wanted = tuple(s for s in wanted if s != "t" or getattr(self.raw, "timeless", False))
        lines, link = self._proposal(free, wanted, signal)
        fitting = " ".join(f"--map {shlex.quote(line)}" for line in lines)
        if link:
            return f"if it holds the joints that carry {link} alone, in their order: {fitting} --tip {link}"
        held = [label for channel in free for label in channel.labels]
        if fitting and held and not any(nearest(name, held) for name in self.robot.joint_names):
            before = f"is this a log of {self.robot.name!r}? if so, map it: "
        if not fitting and signal in self.plan.mapped:  # whoever has mapped it knows how to; an example is no answer
            return f"elid info {self.name} lists what it holds"
        example = signal if not (signal == "theta" and "q" in needed(self.plan, self.robot)) else "q"
        return before + (fitting or f"--map {example}=PLACE")

    def _free(self, placement: Placement | None) -> list[Channel]:
        """Return the channels that may hold what is missing: not those that a placement has."""
        taken = {pick.source for pick in placement.picks} if placement is not None else set()
        return [c for c in self.raw.channels if c.width and c.source not in taken and not _about(c.field)]

    def _proposal(self, free: Sequence[Channel], wanted: Sequence[str], signal: str) -> tuple[list[str], str]:
        """Return lines of a mapping for signals that have no place yet, and the link of a table's chain."""
        lines, link = proposal(self.raw, self.robot, free, wanted, partial(fits, self.raw.channels, self.robot))
        placed = set(self.plan.placements) - {signal}
        return [line for line in lines.splitlines() if line.partition(":")[0] not in placed], link

    def _in_units(self, signal: str, joints: Sequence[str]) -> str:
        """Return a line of a mapping by which a signal has one of these joints, whose column ends in its unit."""
        works = partial(fits, self.raw.channels, self.robot)
        lines = completed(self.plan, self.raw.channels, self.robot.joint_names, works, getattr(self.raw, "units", {}))
        line, held = lines.get(signal, ("", ()))
        return line if set(joints) & set(held) else ""

    def _by_number(self) -> Iterator[str]:
        """Yield a line of a mapping for every signal whose channel names a joint twice: its columns by number."""
        pairs = ", ".join(f"{name}: {k}" for k, name in enumerate(self.robot.joint_names))
        for signal, placement in self.plan.placements.items():
            if self._twice(placement) and isinstance(placement.spec.source, str):
                field = f", field: {placement.spec.field}" if placement.spec.field else ""
                yield f"{signal}: {{from: {placement.spec.source}{field}, joints: {{{pairs}}}}}"


def _about(field: str) -> bool:
    """Whether a field of a message tells about the message and not about the robot."""
    return field.endswith(("sec", "secs")) or field.startswith("layout.")

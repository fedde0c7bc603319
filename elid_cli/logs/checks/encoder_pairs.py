"""The straight line from q to theta of each joint: gears, units, signs and swapped joints."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.robot.robot import Robot

ALIKE = 0.98
"""Correlation above which two signals are the same motion."""
UNLIKE = 0.9
"""Correlation below which a swap is considered."""
CLOSE = 0.03
"""Relative distance at which a slope is taken for a known factor."""
BITS = 0.045
"""log2 of `1 + CLOSE`: distance at which counts per turn are taken for a power of two."""
LARGE_OFFSET = 0.02
"""rad or m; a constant theta - q above this is worth a word …"""
OF_DEFLECTION = 5.0
"""… if it is also this many times the spread of theta - q."""
OF_LOAD = 2.0
"""… and this many times what the load bends the spring by, beyond that."""
IF_SO = "if so, map it: "
"""How a mapping is proposed."""
WHOLE = 1e-3
"""Part of a turn up to which an offset is one of whole turns."""


def as_yaml(unit: str) -> str:
    """Return a unit as YAML holds it."""
    return unit if re.fullmatch(r"[\w./:]+", unit) else f'"{unit}"'


@dataclass(frozen=True)
class Pair:
    """The straight line from q to theta of one joint."""

    j: int
    name: str
    gear: float
    slope: float
    offset: float
    correlation: float
    spread: float
    """Standard deviation of theta - q."""
    revolute: bool

    @staticmethod
    def of(j: int, q: Array, theta: Array, robot: Robot) -> Pair | None:
        """Return the line of joint number `j` from its positions, (N,), rad or m; None where there is none."""
        joint = robot.joints[j]
        # a rigid joint of which only one side was measured has both sides alike
        if not (np.isfinite(q).all() and np.isfinite(theta).all()) or q.size < 3 or np.array_equal(q, theta):
            return None
        moved, turned = float(q.std()), float(theta.std())
        if moved < 1e-9 or turned < 1e-9:
            return None
        correlation = float(np.corrcoef(q, theta)[0, 1])
        slope = math.copysign(turned / moved, correlation)
        return Pair(
            j,
            joint.name,
            joint.gear_ratio or math.nan,
            slope,
            float(np.mean(theta) - np.mean(q)),
            correlation,
            float((theta - q).std()),
            joint.revolute,
        )

    @property
    def opposite(self) -> bool:
        """Whether the two positions move opposite to each other, which no division by the gear ratio mends."""
        if abs(self.correlation) < ALIKE or self.slope > 0:
            return False
        mend = self.factor()[1] if self.scaled and self.gear < 0 else None
        return mend is None or "side: motor" not in mend[1]

    def shift(self, bent: float = math.nan) -> float:
        """Return by how much, rad or m, theta's zero is off beside what the load bends the spring by; 0: not shown.

        `bent` is that deflection, rad or m, NaN where it is not known.
        """
        if abs(self.correlation) < ALIKE or not abs(self.slope - 1) <= 2 * CLOSE:
            return 0.0
        bent = bent if math.isfinite(bent) else 0.0
        least = max(LARGE_OFFSET, OF_DEFLECTION * self.spread, OF_LOAD * abs(bent))
        return self.offset - bent if abs(self.offset - bent) > least else 0.0

    def sentences(
        self, plan: ReadPlan, bent: float = math.nan, *, sprung: bool = False, mends: Mends | None = None
    ) -> Iterator[str]:
        """Yield what is suspicious about this joint.

        Parameters
        ----------
        plan
            Where positions were read from.
        bent
            rad or m by which the mean load bends its spring; NaN: not known.
        sprung
            Whether theta - q follows the torque as the robot file's spring does: then a slope near 1 is its work.
        mends
            What is wrong at all joints of the log, as a mapping mends them together; None: at this one alone.
        """
        if abs(self.correlation) < ALIKE:
            return
        where = f"{self.name}: theta"
        size = abs(self.slope)
        mends = mends or Mends.of([(self, bent)], plan, (self.name,))
        if self.opposite:
            first, second = (proposed(plan, side, mends.signs(plan, side)) for side in ("q", "theta"))
            either = f"{first} where that is q, {second.removeprefix(IF_SO)} where that is theta"
            yield f"{where} moves opposite to q: one of the two has the wrong sign; {either}"
        if abs(size - 1) > 2 * CLOSE:
            what, mend, _ = self.factor()
            if mend is None and sprung and self.slope > 0:
                return
            mapping = f"; {proposed(plan, mend[0], mends.units(plan, mend[0]))}" if mend else ""
            yield f"{where} moves {size:.4g} times as far as q: {what}{mapping}"
        elif shift := self.shift(bent):
            unit = "rad" if self.revolute else "m"
            turns = self.whole_turns(shift)
            rough = "" if turns else "; roughly, as elid diagnose tells it exactly (encoder_offset)"
            also = f" ({turns} whole turns)" if turns else ""
            known = bool(bent) and math.isfinite(bent) and not turns
            beside = f", {shift:+.3g} {unit} beside what its load bends the spring by" if known else ""
            paste = proposed(plan, "theta", mends.offsets)
            yield f"{where} is {self.offset:+.4g} {unit}{also} away from q throughout{beside}{rough}; {paste}"

    def whole_turns(self, shift: float) -> int:
        """Return the number of whole turns that a shift, rad, is; 0 where it is none."""
        turns = shift / (2 * math.pi)
        return round(turns) if self.revolute and abs(turns - round(turns)) < WHOLE else 0

    @property
    def scaled(self) -> bool:
        """Whether theta moves much farther or less than q, and with it."""
        return abs(self.correlation) >= ALIKE and abs(abs(self.slope) - 1) > 2 * CLOSE

    def factor(self) -> tuple[str, tuple[str, str] | None, float]:
        """Return the likely reason of a slope, the signal and key that would mend it, and the slope that it means."""
        gear, size = abs(self.gear), abs(self.slope)
        known = [
            (180 / math.pi, "theta looks like degrees", ("theta", "unit: deg"), True),
            (math.pi / 180, "q looks like degrees", ("q", "unit: deg"), True),
            (1 / (2 * math.pi), "theta looks like turns", ("theta", "unit: rev"), True),
            (2 * math.pi, "q looks like turns", ("q", "unit: rev"), True),
            (1000.0, "theta looks like mm", ("theta", "unit: mm"), False),
            (1e-3, "q looks like mm", ("q", "unit: mm"), False),
            (gear, "theta is not divided by the gear ratio", ("theta", "side: motor"), self.revolute),
            (1 / gear, "theta is divided by the gear ratio twice, or the gear ratio is inverted", None, self.revolute),
            (gear * 180 / math.pi, "theta looks like motor-side degrees", ("theta", "unit: deg, side: motor"), True),
            (gear / (2 * math.pi), "theta looks like motor-side turns", ("theta", "unit: rev, side: motor"), True),
        ]
        for factor, what, paste, turning in known:
            if turning == self.revolute and abs(size / factor - 1) < CLOSE and abs(factor - 1) > CLOSE:
                return what, paste, factor
        for signal, per_turn in (("theta", size * 2 * math.pi), ("q", 2 * math.pi / size)):
            bits = math.log2(per_turn) if per_turn > 0 else 0
            if per_turn > 200 and self.revolute and (abs(bits - round(bits)) < BITS or abs(per_turn / 500 % 1) < 0.01):
                whole = 2 ** round(bits) if abs(bits - round(bits)) < BITS else 500 * round(per_turn / 500)
                factor = whole / (2 * math.pi)
                mend = signal, f"unit: counts:{whole}"
                return f"{signal} looks like encoder counts", mend, factor if signal == "theta" else 1 / factor
            geared = per_turn / gear if signal == "theta" and gear > 0 else 0
            bits = math.log2(geared) if geared > 1 else 0
            if geared > 200 and self.revolute and abs(bits - round(bits)) < BITS:
                whole = 2 ** round(bits)
                mend = "theta", f"unit: counts:{whole}, side: motor"
                return "theta looks like motor-side encoder counts", mend, whole * gear / (2 * math.pi)
        return "check units and gear ratio", None, size


def swap(q: Array, theta: Array, pairs: list[Pair], robot: Robot) -> str:
    """Name a pair of joints whose theta fit each other's q far better than their own."""
    bad = [pair.j for pair in pairs if abs(pair.correlation) < UNLIKE]
    for index, a in enumerate(bad):
        for b in bad[index + 1 :]:
            crossed = [
                abs(float(np.corrcoef(q[:, a], theta[:, b])[0, 1])),
                abs(float(np.corrcoef(q[:, b], theta[:, a])[0, 1])),
            ]
            if min(crossed) > ALIKE:
                one, two = robot.joint_names[a], robot.joint_names[b]
                return (
                    f"theta of {one} and {two} look swapped: each follows the other's q; "
                    f"if so, map it with joints: {{{one}: {two}, {two}: {one}}}"
                )
    return ""


@dataclass(frozen=True)
class Mends:
    """What a mapping must say of all joints together: of one signal it has a single entry."""

    names: tuple[str, ...]
    """The robot's joints."""
    opposite: tuple[str, ...]
    """Joints whose positions move opposite to each other."""
    offsets: str
    """The mapping's key with the offsets of theta; empty: none."""
    factors: tuple[tuple[Pair, tuple[str, str] | None, float], ...]
    """Joints of which theta moves much farther or less than q, with what `Pair.factor` says of them."""
    compared: int
    """Number of joints of which both positions are known."""

    @classmethod
    def of(cls, pairs: Sequence[tuple[Pair, float]], plan: ReadPlan, names: tuple[str, ...]) -> Mends:
        """Return what pairs, each with the deflection under its mean load (`Pair.shift`), say of a robot's joints."""
        opposite = [p.name for p, _ in pairs if p.opposite]
        written = _per_joint(plan, "theta", "offset", names)
        for pair, bent in pairs:
            shift = pair.shift(bent)
            whole = 2 * math.pi * pair.whole_turns(shift)
            size = f"{whole:.6g}" if whole else f"{shift:.3g}" if math.isfinite(bent) else f"{shift:.2g}"
            written[pair.name] -= float(size) if shift else 0.0
        found = [f"{name}: {value:.6g}" for name, value in written.items() if value]
        offsets = f"offset: {{{', '.join(found)}}}" if found else ""
        factors = [(pair, *pair.factor()[1:]) for pair, _ in pairs if pair.scaled]
        return cls(names, tuple(opposite), offsets, tuple(factors), len(pairs))

    def units(self, plan: ReadPlan, signal: str) -> str:
        """Return the mapping's key that mends units and sides of a signal: one for all joints, or one per joint."""
        placement = plan.placements.get(signal)
        written = set(placement.spec.written or {}) & {"unit", "scale"} if placement is not None else set()
        own = [(pair, mend[1], slope) for pair, mend, slope in self.factors if mend is not None and mend[0] == signal]
        keys = {key for _, key, _ in own}
        if len(own) == self.compared and len(keys) == 1 and not written:
            return keys.pop()
        # a signal has one side, and what is written of it stays: what comes beside these is a factor
        scaled = {pair.name: slope for pair, key, slope in own if written or "side" in key}
        units = [f"{pair.name}: {key.removeprefix('unit: ')}" for pair, key, _ in own if pair.name not in scaled]
        factors = {name: slope if signal == "q" else 1 / slope for name, slope in scaled.items()}
        parts = [f"unit: {{{', '.join(units)}}}"] if units else []
        if scaled:
            parts.append(times(plan, signal, factors, self.names))
        return ", ".join(parts)

    def signs(self, plan: ReadPlan, signal: str) -> str:
        """Return the mapping's key that turns a signal of those joints round."""
        return turned(plan, signal, self.opposite, self.names)


def turned(plan: ReadPlan, signal: str, joints: Sequence[str], names: Sequence[str]) -> str:
    """Return the key of a mapping that turns a signal of some of the robot's joints round, beside what is written."""
    signs = _per_joint(plan, signal, "sign", names)
    signs |= {name: -signs[name] for name in joints}
    if len(set(signs.values())) == 1:
        return f"sign: {signs[names[0]]:g}"
    return f"sign: {{{', '.join(f'{name}: {sign:g}' for name, sign in signs.items() if sign != 1)}}}"


def times(plan: ReadPlan, signal: str, factors: Mapping[str, float], names: Sequence[str]) -> str:
    """Return the key of a mapping that multiplies a signal of some joints, beside the scales that are written."""
    scales = _per_joint(plan, signal, "scale", names)
    texts = {name: f"{scale * factors.get(name, 1.0):.9g}" for name, scale in scales.items()}
    if len(set(texts.values())) == 1:
        return f"scale: {texts[names[0]]}"
    return f"scale: {{{', '.join(f'{name}: {text}' for name, text in texts.items() if text != '1')}}}"


def turned_round(
    plan: ReadPlan, signal: str, joints: Sequence[str], names: Sequence[str], *, computed: bool = False
) -> str:
    """Return the words that propose to turn a signal of some joints round; of a computed torque, the commands."""
    sides = [side for side in ("q_des", "dq_des", "tau_ff") if side in plan.placements] if computed else [signal]
    asked = [proposed(plan, side, turned(plan, side, joints, names)) for side in sides]
    return " and ".join([*asked[:1], *(line.removeprefix(IF_SO) for line in asked[1:])])


def _per_joint(plan: ReadPlan, signal: str, key: str, names: Sequence[str]) -> dict[str, float]:
    """Return a number per joint as the mapping of a signal has it."""
    placement = plan.placements.get(signal)
    given = getattr(placement.spec, key) if placement is not None else {"offset": 0.0}.get(key, 1.0)
    return dict(zip(names, np.broadcast_to(given, len(names)).tolist(), strict=True))


def proposed(plan: ReadPlan, signal: str, key: str) -> str:
    """Return the words that propose a mapping: the present one of a signal with a key more, or another value of it."""
    from elid_cli.robot.yaml import inline

    placement = plan.placements.get(signal)
    effort = plan.placements.get("tau_link")
    if placement is None and signal == "tau" and effort is not None and effort.either:
        placement = effort
    place = placement.places if placement is not None else signal
    source, dot, field = place.rpartition(".") if place.startswith("/") else (place, "", "")
    words = f"from: {source}, field: {field}" if dot else f'from: "{place}"'
    written = dict(placement.spec.written or {}) if placement is not None else {}
    if isinstance(written.get("from"), list):
        words = ", ".join(f"{name}: {inline(written[name])}" for name in ("from", "field") if name in written)
    new = {"from", "field", *re.findall(r"(\w+):", re.sub(r"\{[^}]*\}", "", key))}
    kept = "".join(f", {name}: {inline(value)}" for name, value in written.items() if name not in new)
    return f"{IF_SO}{signal}: {{{words}{kept}, {key}}}"

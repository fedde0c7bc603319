"""The straight line from q to theta of each joint: gears, units, signs and swapped joints."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
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
OF_LOAD = 3.0
"""… and this many times what the joint's mean torque bends a spring of the robot file's stiffness by."""


def as_yaml(unit: str) -> str:
    """Return a unit as YAML holds it."""
    return unit if re.fullmatch(r"[\w./:]+", unit) else f'"{unit}"'


def plain(unit: str) -> str:
    """Return a unit in small letters, without signs of multiplication."""
    return re.sub(r"[\s*·.]", "", unit.lower())


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

    def sentences(self, plan: ReadPlan, bent: float = 0.0, *, sprung: bool = False) -> Iterator[str]:
        """Yield what is suspicious about this joint.

        Parameters
        ----------
        plan
            Where positions were read from.
        bent
            rad or m by which the mean load bends its spring.
        sprung
            Whether theta - q follows the torque as the robot file's spring does: then a slope near 1 is its work.
        """
        if abs(self.correlation) < ALIKE:
            return
        where = f"{self.name}: theta"
        size = abs(self.slope)
        if self.slope < 0:
            turned = proposed(plan, "theta", "sign: -1")
            yield f"{where} moves opposite to q: one of the two has the wrong sign; {turned}"
        if abs(size - 1) > 2 * CLOSE:
            what, mend = self._factor(size)
            if mend is None and sprung and self.slope > 0:
                return
            mapping = f"; {proposed(plan, *mend)}" if mend else ""
            yield f"{where} moves {size:.4g} times as far as q: {what}{mapping}"
        elif self.slope > 0 and abs(self.offset) > max(LARGE_OFFSET, OF_DEFLECTION * self.spread, OF_LOAD * abs(bent)):
            unit = "rad" if self.revolute else "m"
            turns = self.offset / (2 * math.pi)
            whole = self.revolute and abs(turns - round(turns)) < 1e-3 and round(turns) != 0
            also = f" ({round(turns)} whole turns)" if whole else ""
            paste = proposed(plan, "theta", f"offset: {{{self.name}: {-self.offset:.6g}}}")
            yield f"{where} is {self.offset:+.4g} {unit}{also} away from q throughout; {paste}"

    def _factor(self, size: float) -> tuple[str, tuple[str, str] | None]:
        """Return the likely reason of a slope and the signal and key that would mend it."""
        gear = abs(self.gear)
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
                return what, paste
        for signal, per_turn in (("theta", size * 2 * math.pi), ("q", 2 * math.pi / size)):
            bits = math.log2(per_turn) if per_turn > 0 else 0
            if per_turn > 200 and self.revolute and (abs(bits - round(bits)) < BITS or abs(per_turn / 500 % 1) < 0.01):
                whole = 2 ** round(bits) if abs(bits - round(bits)) < BITS else 500 * round(per_turn / 500)
                return f"{signal} looks like encoder counts", (signal, f"unit: counts:{whole}")
            geared = per_turn / gear if signal == "theta" and gear > 0 else 0
            bits = math.log2(geared) if geared > 1 else 0
            if geared > 200 and self.revolute and abs(bits - round(bits)) < BITS:
                return "theta looks like motor-side encoder counts", (
                    "theta",
                    f"unit: counts:{2 ** round(bits)}, side: motor",
                )
        return "check units and gear ratio", None


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


def proposed(plan: ReadPlan, signal: str, key: str) -> str:
    """Return the words that propose a mapping."""
    placement = plan.placements.get(signal)
    place = placement.places if placement is not None else signal
    source, dot, field = place.rpartition(".") if place.startswith("/") else (place, "", "")
    words = f"from: {source}, field: {field}" if dot else f'from: "{place}"'
    return f"if so, map it: {signal}: {{{words}, {key}}}"

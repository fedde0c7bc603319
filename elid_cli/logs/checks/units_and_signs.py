"""Units and signs told from theta against q, and efforts against the motion: noticed, proposed, never applied.

Behind a transmission theta and q differ by the deflection, which is small. Where the best straight line
``theta = slope · q + offset`` is far from the identity, one of the two is in another unit, sign or place.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from elid_cli._types import Array
from elid_cli.logs.checks.limits import beyond_limits
from elid_cli.logs.checks.required import Checked
from elid_cli.logs.checks.torque_scale import FOLLOWS, WRONG_SCALE, correlation_of, off, scale_of, spring_slope
from elid_cli.logs.mapping.language import UNIT_WORDS
from elid_cli.logs.mapping.resolve import ReadPlan
from elid_cli.logs.repair.align import Aligned
from elid_cli.logs.repair.stuck import frozen, limited
from elid_cli.memory import along, let_go
from elid_cli.robot.robot import Robot

LENGTHS, RATES, EFFORTS = {"rad", "m", "radian", "radians"}, {"rad/s", "m/s"}, {"nm", "n"}
SI = {"q": LENGTHS, "theta": LENGTHS, "dq": RATES, "dtheta": RATES, "tau": EFFORTS, "tau_link": EFFORTS}
"""Units, as `_plain` writes them, that need no mapping."""
SAMPLES = 50_000
"""Samples that are looked at (evenly taken)."""
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
FAR = 40.0
"""rad; robots' joints rarely turn more than six times."""
EXACTLY = 1e-3
"""Share of tau that is not proportional to the deflection below which tau is no motor torque."""
STALE = 0.5
"""Share of samples equal to the one before above which a moving signal is sampled and held."""


def suspicions(checked: Checked, aligned: Aligned, robot: Robot, plan: ReadPlan) -> list[str]:
    """Return one sentence per suspicion, with a mapping to paste where there is one."""
    step = max(1, aligned.t.size // SAMPLES)
    found: list[str] = []
    found.extend(_amperes(plan))
    start, stop = max(aligned.segments, key=lambda bounds: bounds[1] - bounds[0])
    q, theta = checked.q[start:stop], checked.theta[start:stop]
    found.extend(_wraps(q, theta, robot, plan))
    found.extend(_stale(checked, start, stop, robot))
    found.extend(frozen(q, theta, aligned.dt, robot))
    found.extend(limited(checked.tau, robot))
    whole = slice(start, min(stop, start + SAMPLES))
    sides = np.where(np.isnan(checked.q[whole]), checked.theta[whole], checked.q[whole])
    found.extend(beyond_limits(sides, checked.tau[whole], aligned.dt, robot))
    q, theta = (_thinned(values, step) for values in (checked.q, checked.theta))
    pairs = [_Pair.of(j, q[:, j], theta[:, j], robot) for j in range(robot.n)]
    tau: Array | None = None
    compared = [pair for pair in pairs if pair is not None]
    swapped = _swap(q, theta, compared, robot)
    if swapped:
        return [*found, swapped]
    if len(compared) > 1:
        tau = _thinned(checked.tau, step)
        found.extend(_swapped_torques(theta - q, tau, compared, robot))
    scales: dict[int, float] = {}
    for pair in compared:
        found.extend(pair.sentences(plan))
        if abs(pair.slope - 1) < CLOSE and robot.joints[pair.j].elastic:
            deflection = theta[:, pair.j] - q[:, pair.j]
            tau = _thinned(checked.tau, step) if tau is None else tau
            whole = slice(-(-start // step), -(-stop // step))  # differences across a gap are no motion
            own = spring_slope(theta[whole, pair.j], deflection[whole], tau[whole, pair.j], aligned.dt * step)
            found.extend(_directions(pair, deflection, tau[:, pair.j], plan))
            scales[pair.j] = scale_of(deflection, tau[:, pair.j], own, robot.joints[pair.j].parameters.get("K"))
    right = any(abs(math.log(scale)) <= math.log(WRONG_SCALE) for scale in scales.values() if scale > 0)
    for pair in compared:
        found.extend(_scale(pair, scales.get(pair.j, math.nan), robot, plan, alone=right))
    return found


def _amperes(plan: ReadPlan) -> Iterator[str]:
    """Name a torque that is read from a channel called a current without a factor."""
    placement = plan.placements.get("tau")
    if placement is None or placement.spec.unit or placement.spec.scale != 1.0:
        return
    if re.search(r"current|ampere|(^|[^a-z])amps?([^a-z]|$)", placement.places.lower()):
        yield (
            f"tau is read from {placement.places} as it is, and that is a current by its name; "
            f"{_paste(plan, 'tau', 'unit: A, scale: TORQUE_CONSTANT, side: motor')}"
        )


def written_units(units: Mapping[str, str], plan: ReadPlan) -> Iterator[str]:
    """Name signals whose columns are written to be in another unit than they are taken to be in."""
    for signal, placement in plan.placements.items():
        usual = SI.get(signal)
        found = [units[pick.source] for pick in placement.picks if pick.source in units]
        if usual and found and not placement.spec.unit and _plain(found[0]) not in usual:
            known = UNIT_WORDS.get(_plain(found[0]))
            paste = f"; {_paste(plan, signal, f'unit: {_as_yaml(known)}')}" if known else ""
            yield f"{signal} is written to be in {found[0]!r} and taken as it is{paste}"


def _as_yaml(unit: str) -> str:
    return unit if re.fullmatch(r"[\w./:]+", unit) else f'"{unit}"'


def _plain(unit: str) -> str:
    return re.sub(r"[\s*·.]", "", unit.lower())


def _thinned(values: Array, step: int) -> Array:
    """Return every `step`-th sample."""
    if step == 1:
        return values
    thinned = values[::step].copy()
    let_go(values)
    return thinned


@dataclass(frozen=True)
class _Pair:
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
    reach: float
    """Largest |q|."""

    @staticmethod
    def of(j: int, q: Array, theta: Array, robot: Robot) -> _Pair | None:
        joint = robot.joints[j]
        # a rigid joint of which only one side was measured has both sides alike
        if not (np.isfinite(q).all() and np.isfinite(theta).all()) or q.size < 3 or np.array_equal(q, theta):
            return None
        moved, turned = float(q.std()), float(theta.std())
        if moved < 1e-9 or turned < 1e-9:
            return None
        correlation = float(np.corrcoef(q, theta)[0, 1])
        slope = math.copysign(turned / moved, correlation)
        return _Pair(
            j,
            joint.name,
            joint.gear_ratio or math.nan,
            slope,
            float(np.mean(theta) - np.mean(q)),
            correlation,
            float((theta - q).std()),
            joint.revolute,
            float(np.abs(q).max()),
        )

    def sentences(self, plan: ReadPlan) -> Iterator[str]:
        """Yield what is suspicious about this joint."""
        if self.revolute and self.reach > FAR:
            yield f"{self.name}: q reaches {self.reach:.4g} rad: if it is in degrees, map it with unit: deg"
        if abs(self.correlation) < ALIKE:
            return
        where = f"{self.name}: theta"
        size = abs(self.slope)
        if self.slope < 0:
            yield f"{where} runs against q: one of them has the opposite sign; {_paste(plan, 'theta', 'sign: -1')}"
        if abs(size - 1) > 2 * CLOSE:
            what, mend = self._factor(size)
            mapping = f"; {_paste(plan, *mend)}" if mend else ""
            yield f"{where} moves {size:.4g} times as far as q: {what}{mapping}"
        elif self.slope > 0 and abs(self.offset) > max(LARGE_OFFSET, OF_DEFLECTION * self.spread):
            unit = "rad" if self.revolute else "m"
            turns = self.offset / (2 * math.pi)
            whole = self.revolute and abs(turns - round(turns)) < 1e-3 and round(turns) != 0
            also = f" ({round(turns)} whole turns)" if whole else ""
            paste = _paste(plan, "theta", f"offset: {{{self.name}: {-self.offset:.6g}}}")
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


def _paste(plan: ReadPlan, signal: str, key: str) -> str:
    """Return the words that propose a mapping."""
    placement = plan.placements.get(signal)
    place = placement.places if placement is not None else signal
    source, dot, field = place.rpartition(".") if place.startswith("/") else (place, "", "")
    words = f"from: {source}, field: {field}" if dot else f'from: "{place}"'
    return f"if so, map it: {signal}: {{{words}, {key}}}"


def _directions(pair: _Pair, deflection: Array, tau: Array, plan: ReadPlan) -> Iterator[str]:
    """Compare motor torque with deflection: tau = K (theta - q) + rotor inertia + friction."""
    correlation = correlation_of(deflection, tau)
    if correlation < -FOLLOWS:
        yield (
            f"{pair.name}: tau runs against the deflection theta - q: its sign is opposite, or q and theta are "
            f"exchanged; {_paste(plan, 'tau', 'sign: -1')}"
        )
    elif correlation**2 > 1 - EXACTLY**2:
        yield (
            f"{pair.name}: tau follows the deflection without any friction or inertia: it looks like the torque "
            "in the transmission (tau_link), not the motor's"
        )


def _scale(pair: _Pair, ratio: float, robot: Robot, plan: ReadPlan, *, alone: bool) -> Iterator[str]:
    """Name a torque that is in another unit; with `alone` other joints' are not, and its mapping scales it alone."""
    if not off(ratio):
        return
    stiffness = robot.joints[pair.j].parameters["K"]
    why = f"it is {ratio:.3g} times K (theta - q) with K = {stiffness:g} of the robot file"
    shaft = abs(math.log(pair.gear)) > math.log(WRONG_SCALE) if pair.gear > 0 else False
    if shaft and abs(ratio * pair.gear - 1) < 0.3:
        what, key, factor = "the motor's shaft torque", "side: motor", pair.gear
    elif abs(ratio / 1000 - 1) < 0.3:
        what, key, factor = "mN·m", "unit: mN.m", 1e-3
    else:
        what, factor = "a current or another unit (or the positions are in one)", 1 / ratio
        key = f"unit: A, scale: {{{pair.name}: {factor:.4g}}}"
    if alone:
        key = _rescaled(plan, pair, factor, robot)
    yield f"{pair.name}: tau looks like {what}, {why}; {_paste(plan, 'tau', key)}"


def _rescaled(plan: ReadPlan, pair: _Pair, factor: float, robot: Robot) -> str:
    """Return the keys that scale one joint's torque by a factor and leave the others as they are mapped."""
    spec = plan.placements["tau"].spec
    given = np.broadcast_to(spec.scale, robot.n) * np.where(np.arange(robot.n) == pair.j, factor, 1.0)
    scale = ", ".join(f"{n}: {v:.4g}" for n, v in zip(robot.joint_names, given, strict=True) if v != 1.0)
    kept = [f"unit: {spec.unit}"] if isinstance(spec.unit, str) and spec.unit else []
    return ", ".join([*kept, *(["side: motor"] if spec.motor_side else []), f"scale: {{{scale}}}"])


def _swapped_torques(deflection: Array, tau: Array, pairs: list[_Pair], robot: Robot) -> Iterator[str]:
    """Name pairs of elastic joints whose torques fit each other's deflection far better than their own."""
    joints = [p.j for p in pairs if robot.joints[p.j].elastic and np.isfinite(tau[:, p.j]).all() and tau[:, p.j].std()]
    joints = [j for j in joints if deflection[:, j].std() > 0]
    if len(joints) < 2:
        return
    table = np.abs(np.corrcoef(deflection[:, joints].T, tau[:, joints].T)[: len(joints), len(joints) :])
    for a in range(len(joints)):
        for b in range(a + 1, len(joints)):
            if max(table[a, a], table[b, b]) < UNLIKE and min(table[a, b], table[b, a]) > FOLLOWS:
                one, two = robot.joint_names[joints[a]], robot.joint_names[joints[b]]
                yield (
                    f"tau of {one} and {two} look swapped: each follows the other's deflection; "
                    f"if so, map it with joints: {{{one}: {two}, {two}: {one}}}"
                )


def _swap(q: Array, theta: Array, pairs: list[_Pair], robot: Robot) -> str:
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


def _wraps(q: Array, theta: Array, robot: Robot, plan: ReadPlan) -> Iterator[str]:
    """Name joints whose angle jumps by a whole turn."""
    for signal, values in (("q", q), ("theta", theta)):
        largest = _largest_steps(values)
        for j, joint in enumerate(robot.joints):
            if not joint.revolute or not largest[j] > 0.9:  # no jump by any turn
                continue
            steps = np.abs(np.diff(values[:, j]))
            usual = float(np.median(steps))
            for turn, unit in ((2 * math.pi, "±pi"), (360.0, "±180°"), (1.0, "one turn")):
                jumps = np.abs(steps - turn) < 0.05 * turn
                if jumps.any() and usual < 0.02 * turn and np.count_nonzero(jumps) < 0.05 * jumps.size:
                    if turn == 1.0 and np.nanmax(np.abs(values[:, j])) > 1.0:
                        continue
                    yield (
                        f"{joint.name}: {signal} wraps at {unit} ({np.count_nonzero(jumps)} times), its "
                        f"derivatives are wrong there; {_paste(plan, signal, 'unwrap: true')}"
                    )
                    break


def _largest_steps(values: Array) -> Array:
    """Return the largest |step| of every column, block by block."""
    largest = np.zeros(values.shape[1])
    for start in range(0, values.shape[0] - 1, SAMPLES):
        steps = np.diff(values[start : start + SAMPLES + 1], axis=0)
        largest = np.maximum(largest, along(np.maximum, np.abs(steps, out=steps)))
        let_go(values)
    return largest


def _stale(checked: Checked, start: int, stop: int, robot: Robot) -> Iterator[str]:
    """Name signals that are sampled and held: most samples repeat the one before while the joint moves."""
    for signal in ("q", "theta", "tau"):
        values = getattr(checked, signal)[start : min(stop, start + SAMPLES)]
        if values.shape[0] < 100:
            continue
        for j, name in enumerate(robot.joint_names):
            column = values[:, j]
            if np.isnan(column[0]):
                continue
            changed = np.flatnonzero(np.diff(column))
            if changed.size < 20:
                continue
            holds = np.diff(changed)
            period = float(np.median(holds))
            regular = np.count_nonzero(holds == period) > 0.8 * holds.size
            if period >= 2 and regular and changed.size < STALE * column.size * 1.05:
                yield f"{name}: {signal} changes only every {period:.0f} samples: it was sampled slower and repeated"

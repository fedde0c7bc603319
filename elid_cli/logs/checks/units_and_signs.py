"""Units and signs told from theta against q, and efforts against the motion: noticed, proposed, never applied.

Behind a transmission theta and q differ by the deflection, which is small. Where the best straight line
``theta = slope · q + offset`` is far from the identity, one of the two is in another unit, sign or place.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.logs.checks.command_scale import command_scales, command_words
from elid_cli.logs.checks.coupled_motors import coupled_motors
from elid_cli.logs.checks.encoder_pairs import IF_SO, Pair, as_yaml, proposed, swap
from elid_cli.logs.checks.known_inertias import wrong_times
from elid_cli.logs.checks.known_masses import Weighed, wrong_scales
from elid_cli.logs.checks.late_velocities import late_velocities
from elid_cli.logs.checks.limits import WRONG, beyond_limits
from elid_cli.logs.checks.position_scale import position_factor, position_words
from elid_cli.logs.checks.required import Checked
from elid_cli.logs.checks.spring_torques import Sprung, spring_suspicions
from elid_cli.logs.checks.stops import at_stops
from elid_cli.logs.mapping.language import POSITIONS, TORQUES, UNIT_WORDS, VELOCITIES, plain_unit
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.logs.mapping.suggest import TOLD, words_of
from elid_cli.logs.repair.align import Aligned
from elid_cli.logs.repair.stuck import frozen, limited
from elid_cli.memory import along, let_go
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import joints_computed

LENGTHS, RATES, EFFORTS = {"rad", "m", "radian", "radians"}, {"rad/s", "m/s"}, {"nm", "n"}
SI = dict.fromkeys(POSITIONS, LENGTHS) | dict.fromkeys(VELOCITIES, RATES) | dict.fromkeys(TORQUES, EFFORTS)
"""Units, as `plain_unit` writes them, that need no mapping."""
NOT_TORQUE = "which is no torque"
"""What is said of a torque that is in no unit of torque."""
AS_IT_IS = "and taken without conversion"
"""What is said of values that their header writes to be in another unit."""
NO_TORQUE = {"A": "A", "mA": "A", "V": "V"} | dict.fromkeys(
    ("%", "percent", "‰", "permille"), "shares of a rated torque"
)
"""Units of what stands for a torque -> what its values then are in."""
SAMPLES = 50_000
"""Samples that are looked at (evenly taken)."""
FAR = 40.0
"""rad or m: robots' joints rarely turn more than six times, and slides are shorter."""
STALE = 0.5
"""Share of samples equal to the one before above which a moving signal is sampled and held."""


def suspicions(checked: Checked, aligned: Aligned, robot: Robot, plan: ReadPlan) -> list[str]:
    """Return one sentence per suspicion, with a mapping to paste where there is one."""
    step = max(1, aligned.t.size // SAMPLES)
    found: list[str] = []
    found.extend(_amperes(plan, robot))
    found.extend(_of_motors(plan, robot))
    start, stop = max(aligned.segments, key=lambda bounds: bounds[1] - bounds[0])
    q, theta = checked.q[start:stop], checked.theta[start:stop]
    found.extend(_wraps(q, theta, robot, plan))
    found.extend(_stale(checked, start, stop, robot))
    found.extend(frozen(q, theta, aligned.dt, robot))
    # what elid computed of commands it cut itself
    computed = joints_computed(checked.computed, robot.joint_names)
    found.extend(limited(np.where(computed, np.nan, checked.tau) if np.any(computed) else checked.tau, robot))
    whole = slice(start, min(stop, start + SAMPLES))
    sides = np.where(np.isnan(checked.q[whole]), checked.theta[whole], checked.q[whole])
    far = _beyond_any(sides)
    # what another unit explains is said once
    likely = np.where(far, np.nan, sides)
    found.extend(beyond_limits(likely, checked.tau[whole], aligned.dt, robot))
    q, theta = (_thinned(values, step) for values in (checked.q, checked.theta))
    pairs = [Pair.of(j, q[:, j], theta[:, j], robot) for j in range(robot.n)]
    compared = [pair for pair in pairs if pair is not None]
    if not any(pair.opposite for pair in compared):  # else the torques would be blamed for the positions
        said, doubted = _described(checked, sides, whole, aligned.dt, robot, plan)
        found.extend(said)
        far[doubted] = False
        # a deflection in another unit says nothing of zeros and torques
        compared = [pair for pair in compared if pair.j not in doubted] or compared
    found.extend(_far(sides, far, robot))
    if checked.computed:
        shown = {name: values[whole] for name, values in checked.optional.items()}
        scaled = command_scales(shown, sides, robot)
        found.extend(command_words(scaled, robot, plan))
        if not scaled:  # else commands would be far beyond any stop
            found.extend(late_velocities(shown, sides, computed, aligned.dt, robot))
            found.extend(at_stops(shown, sides, robot))
    swapped = swap(q, theta, compared, robot)
    if swapped:
        return [*found, swapped]
    found.extend(coupled_motors(q, theta, compared, robot))
    if compared:
        sensed = checked.optional.get("tau_link")
        inner = slice(-(-start // step), -(-stop // step))  # differences across a gap are no motion
        sprung = Sprung(
            q, theta, _thinned(checked.tau, step), None if sensed is None else _thinned(sensed, step),
            inner, aligned.dt * step, computed,
        )  # fmt: skip
        found.extend(spring_suspicions(sprung, compared, robot, plan))
    return found


def _far(positions: Array, far: NDArray[np.bool_], robot: Robot) -> Iterator[str]:
    """Name the joints `far` (n,) that go farther than robots' joints do, positions (N, n)."""
    reach = np.nanmax(np.abs(positions), axis=0, initial=0.0)
    for turns, other, key in ((True, "degrees", "deg"), (False, "mm", "mm")):
        own = [k for k in np.flatnonzero(far).tolist() if robot.joints[k].revolute == turns]
        if not own:
            continue
        names = [robot.joint_names[k] for k in own]
        keys = key if far.all() and len(own) == robot.n else f"{{{', '.join(f'{name}: {key}' for name in names)}}}"
        size = f"{max(reach[own]):.4g} {robot.joints[own[0]].units[0]}"
        if len(own) == 1:
            yield f"{names[0]}: its position reaches {size}: if it is in {other}, map it with unit: {keys}"
        else:
            yield f"{in_words(names)}: positions reach {size}: if they are in {other}, map them with unit: {keys}"


def _beyond_any(positions: Array) -> NDArray[np.bool_]:
    """Return of which joints positions (N, n) go farther than robots' joints do, (n,)."""
    return np.asarray(np.nanmax(np.abs(positions), axis=0, initial=0.0) > FAR)


def _described(
    checked: Checked, positions: Array, part: slice, dt: float, robot: Robot, plan: ReadPlan
) -> tuple[list[str], list[int]]:
    """Compare torques with weight and inertia of the described bodies, by what the robot's file says of them.

    Returned are sentences, and the joints whose positions these say to be in another unit.
    """
    sensed = checked.optional.get("tau_link")
    alone = sensed is not None and np.isnan(checked.tau).all()
    signal, torque = ("tau_link", sensed) if sensed is not None and alone else ("tau", checked.tau)
    log = Weighed(positions, torque[part], dt, robot)
    wrong = position_factor(log)
    if wrong is not None:  # the torques would be blamed for the positions
        return [position_words(wrong, robot, plan)], np.flatnonzero(wrong.joints).tolist()
    computed = bool(checked.computed) and not alone
    motors = np.where(np.isnan(checked.theta[part]), positions, checked.theta[part])
    said = [*wrong_scales(log, plan, signal=signal, computed=computed), *wrong_times(log, motors, signal=signal)]
    return said, []


def _amperes(plan: ReadPlan, robot: Robot) -> Iterator[str]:
    """Name a torque that is a current or a share by its channel's name or its unit, without a factor."""
    placement = plan.placements.get("tau")
    if placement is None:
        return
    spec = placement.spec
    units = spec.unit.split(", ")
    scales = np.broadcast_to(np.asarray(spec.scale, dtype=float), robot.n).tolist()
    told = zip(units * robot.n if len(units) == 1 else units, scales, strict=False)
    bare = {NO_TORQUE[unit] for unit, scale in told if unit in NO_TORQUE and scale == 1.0}
    if bare:
        yield (
            f"tau is in {' and '.join(sorted(bare))}, {NOT_TORQUE}, as no scale to N·m is given. The parameters found "
            "from it are in that unit, too. Give scale: one number or one per joint; or record again with a known body "
            "on the robot: --payload KG@JOINT"
        )
    if spec.unit or spec.scale != 1.0:
        return
    if re.search(r"current|ampere|(^|[^a-z])amps?([^a-z]|$)", placement.places.lower()):
        yield (
            f"tau is read from {placement.places} without a factor, but its name says that it is a current, "
            f"{NOT_TORQUE}; {proposed(plan, 'tau', 'unit: A, scale: TORQUE_CONSTANT, side: motor')}"
        )


def _of_motors(plan: ReadPlan, robot: Robot) -> Iterator[str]:
    """Name a torque that is the motors' by its name, where neither gear ratios nor masses say which side it is of."""
    placement = plan.placements.get("tau")
    if placement is None or "tau" not in plan.mapped or "side" in (placement.spec.written or {}):
        return
    geared = all(joint.gear_ratio is not None for joint in robot.joints)
    weighed = any(joint.parameters.get("m", 0.0) > 0 for joint in robot.joints)
    if geared or weighed or not re.search(r"motor|rotor", placement.places.lower()):
        return
    yield (
        f"tau is read from {placement.places} as the torque at the joint, but its name says that it is the motors'; "
        f"without gear ratios and masses nothing shows whether {WRONG}. If it is the torque at the motors' shafts, "
        f"give gear_ratio {robot.place_to_say}, and side: motor in the mapping; else side: joint"
    )


def told_torques(plan: ReadPlan) -> Iterator[str]:
    """Note a torque that is by its name what the drives were asked for."""
    placement = plan.placements.get("tau")
    if placement is not None and placement.picks and TOLD & set(words_of(placement.places)):
        yield (
            f"tau is read from {placement.places}, whose name says that it is the commanded torque: where the drives "
            "gave another one, the model describes the command"
        )


def written_units(units: Mapping[str, str], plan: ReadPlan, names: Sequence[str]) -> Iterator[str]:
    """Name signals whose columns are written to be in another unit than they are taken to be in."""
    for signal, placement in plan.placements.items():
        usual = SI.get(signal)
        found = [units[pick.source] for pick in placement.picks if pick.source in units]
        odd = next((unit for unit in found if usual and plain_unit(unit) not in usual), None)
        if odd is not None and not placement.spec.unit:
            known, line = UNIT_WORDS.get(plain_unit(odd)), _unit_key(units, plan, signal, names)
            paste = f"; {proposed(plan, signal, line)}" if line else ""
            bare = f", {NOT_TORQUE}" if signal == "tau" and known in NO_TORQUE else ""
            yield f"{signal} is in {odd!r} by its header {AS_IT_IS}{bare}{paste}"


def unit_lines(units: Mapping[str, str], plan: ReadPlan, names: Sequence[str]) -> list[str]:
    """Return lines of a mapping with the units that the header writes, of signals that would be taken to be in others.

    Parameters
    ----------
    units
        By column, as the header has them.
    plan
        Where signals are read from.
    names
        The robot's joints.
    """
    keys = {signal: _unit_key(units, plan, signal, names) for signal in plan.placements}
    return [proposed(plan, signal, key).removeprefix(IF_SO) for signal, key in keys.items() if key]


def _unit_key(units: Mapping[str, str], plan: ReadPlan, signal: str, names: Sequence[str]) -> str:
    """Return the key of a mapping that says the units of a signal's columns; empty: none is known, or it is SI."""
    placement, usual = plan.placements[signal], SI.get(signal)
    written = {
        j: units.get(p.source, "") for p, own in zip(placement.picks, placement.joints, strict=True) for j in own
    }
    odd = {j: unit for j, unit in written.items() if usual and unit and plain_unit(unit) not in usual}
    if not odd or placement.spec.unit or any(plain_unit(unit) not in UNIT_WORDS for unit in odd.values()):
        return ""
    known = {names[j]: as_yaml(UNIT_WORDS[plain_unit(unit)]) for j, unit in sorted(odd.items())}
    if len(odd) == len(written) and len(set(known.values())) == 1:
        return f"unit: {next(iter(known.values()))}"
    return f"unit: {{{', '.join(f'{name}: {unit}' for name, unit in known.items())}}}"


def _thinned(values: Array, step: int) -> Array:
    """Return every `step`-th sample."""
    if step == 1:
        return values
    thinned = values[::step].copy()
    let_go(values)
    return thinned


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
                        f"speed is wrong there; {proposed(plan, signal, 'unwrap: true')}"
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
            if not 20 <= changed.size < STALE * column.size * 1.05:
                continue
            holds = np.diff(changed)
            period = float(np.median(holds))
            if period >= 2 and np.count_nonzero(holds == period) > 0.8 * holds.size:
                yield f"{name}: {signal} changes only every {period:.0f} samples: sampled at a lower rate and repeated"

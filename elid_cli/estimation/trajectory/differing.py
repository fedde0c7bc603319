"""What recordings of one machine do not agree on, and whether something changed between two of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.normal_equations import jackknife, step_of, steps_without
from elid_cli.estimation.trajectory.block_sums import DAMPING
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS

APART = 4.0
"""Standard errors of a difference of recordings beyond which they do not agree."""
LARGE, OFFSET = 0.25, 0.1
"""Part of the largest value by which recordings must differ, at least, to be worth a word; of offsets that of the
joint's Coulomb friction."""
SLIGHT, LITTLE = 0.003, 0.02
"""The same of offsets, and part of itself of friction, that are each recording's own: less bends nothing else."""
PARTED = 0.9
"""Part of the scatter that one change between two recordings must explain."""
UNITS = {"Ja": "kg·m²", "fs": "N·m", "fv": "N·m·s/rad", "offset": "N·m"}


@dataclass(frozen=True)
class Differing:
    """A parameter, or an amplitude of an effect, that recordings of one machine do not agree on."""

    name: str
    joint: str
    unit: str
    values: tuple[float, ...]
    """As each recording alone has it."""
    std_error: tuple[float, ...]
    changed_at: int | None
    """First recording after a change that parts them in two; None: they scatter, or drift."""
    of_effect: bool


def differing(fit: TrajectoryFit) -> tuple[Differing, ...]:
    """Return the parameters and amplitudes that recordings do not agree on; none of one recording."""
    own, robot = fit.unknowns, fit.unknowns.robot
    if own.recordings < 2:
        return ()
    errors, found = errors_alone(fit), []
    labels = [
        (name, name, robot.joint_names[k], UNITS[name]) for k in range(robot.n) for name in (*PARAMETERS, "offset")
    ]
    for effect in own.pushing:
        labels += [("", f"{effect.name} {p.name}", robot.joint_names[effect.joint], p.unit) for p in effect.amplitudes]
    for number, (kind, name, joint, unit) in enumerate(labels):
        values, sd = fit.alone[:, number], errors[:, number]
        least = _least(kind, values, fit.values[number // len(KINDS), 1] if kind else 0.0)
        if _are_apart(values, sd, least):
            found.append(_told(name, joint, unit, values, sd, of_effect=not kind))
    return tuple(found)


def drives_apart(fit: TrajectoryFit) -> tuple[tuple[int, int], ...]:
    """Return joint and kind of friction and offsets that recordings do not agree on, be it little worth a word.

    An inertia does not change.
    """
    if fit.unknowns.recordings < 2:
        return ()
    errors, found = errors_alone(fit), list[tuple[int, int]]()
    for joint, values in enumerate(fit.values):
        for kind in range(1, len(KINDS)):
            place = len(KINDS) * joint + kind
            least = SLIGHT * abs(float(values[1])) if KINDS[kind] == "offset" else LITTLE * abs(float(values[kind]))
            if _are_apart(fit.alone[:, place], errors[:, place], least):
                found.append((joint, kind))
    return tuple(found)


def differing_drives(fits: Sequence[TrajectoryFit]) -> tuple[Differing, ...]:
    """Return the drive parameters that fits of one recording each do not agree on."""
    robot, found = fits[0].unknowns.robot, []
    values = np.array([fit.values for fit in fits])
    errors = np.array([fit.unknowns.joint_values(fit.deviation) for fit in fits])
    for joint, name in enumerate(robot.joint_names):
        for k, kind in enumerate((*PARAMETERS, "offset")):
            own, sd = values[:, joint, k], errors[:, joint, k]
            if _are_apart(own, sd, _least(kind, own, float(values[:, joint, 1].max()))):
                found.append(_told(kind, name, UNITS[kind], own, sd, of_effect=False))
    return tuple(found)


def _least(kind: str, values: Array, coulomb: float) -> float:
    """Return by how much a value of recordings (R,) must differ to be worth a word."""
    return OFFSET * abs(coulomb) if kind == "offset" else LARGE * float(np.abs(values).max())


def _are_apart(values: Array, sd: Array, least: float) -> bool:
    """Whether values (R,) are apart by more than their errors (R,), and by so much."""
    low, high = int(np.argmin(values)), int(np.argmax(values))
    gap = float(values[high] - values[low])
    return bool(sd.min() > 0 and gap >= APART * float(np.hypot(sd[low], sd[high])) and gap >= least)


def _told(name: str, joint: str, unit: str, values: Array, sd: Array, *, of_effect: bool) -> Differing:
    return Differing(name, joint, unit, tuple(values.tolist()), tuple(sd.tolist()), _change(values), of_effect)


def errors_alone(fit: TrajectoryFit) -> Array:
    """Return the standard errors of what each recording alone has, (R, U), from leaving out its blocks of time."""
    sources = np.array([source for source, _, _ in fit.spans])
    own, found = fit.equations.holding(fit.unknowns.departures), []
    for recording in np.unique(sources):
        matrix, load = (part[sources == recording] for part in (own.matrix, own.load))
        found.append(np.sqrt(np.diag(jackknife(steps_without(matrix, load, DAMPING)))))
    return np.array(found)


def _change(values: Array) -> int | None:
    """Return the first recording after the one change that explains how values differ, or None."""
    total = float(np.sum((values - values.mean()) ** 2))
    if len(values) < 3 or total <= 0:
        return None
    left = [float(np.var(values[:k]) * k + np.var(values[k:]) * (len(values) - k)) for k in range(1, len(values))]
    best = int(np.argmin(left))
    return best + 1 if left[best] < (1 - PARTED) * total else None


def as_last(fit: TrajectoryFit, changed: tuple[Differing, ...]) -> TrajectoryFit:
    """Return the fit with joints at which an effect changed as they were in the recordings after the change."""
    own, robot = fit.unknowns, fit.unknowns.robot
    sources, z = np.array([source for source, _, _ in fit.spans]), fit.z.copy()
    equations = fit.equations.holding(own.departures)
    for item in changed:
        if item.changed_at is None or not item.of_effect:  # friction drifts; an effect that came or went stays so
            continue
        joint = robot.joint_names.index(item.joint)
        after = sources >= item.changed_at
        step = step_of(equations.straight[after].sum(axis=0), equations.load[after].sum(axis=0), DAMPING)
        places = of_joint(fit, joint)
        z[places] = fit.z[places] + step[places]
    return replace(fit, z=own.possible(z))


def of_joint(fit: TrajectoryFit, joint: int) -> NDArray[np.intp]:
    """Return the places of a joint's drive parameters and amplitudes in z."""
    kinds = len(KINDS)
    amplitudes = fit.unknowns.drives + np.flatnonzero(fit.unknowns.owners == joint)
    return np.concatenate([np.arange(kinds * joint, kinds * (joint + 1)), amplitudes])

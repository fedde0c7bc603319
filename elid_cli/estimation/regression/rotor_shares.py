"""What of a rigid joint's inertia is the rotor's, told by friction that follows the load.

Of a joint that stands first in a chain, or turns about the same axis as the one before it, motion shows rotor and
bodies together only. What the gear transmits is what the bodies need, without the rotor; so friction under load tells
the two apart, and is wrong where they are divided as it happens. A rotor of the robot file is where that begins, and
counts for as much as the log leaves open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.regression.effect_columns import FittedEffects, extra_of
from elid_cli.estimation.regression.triangles import ExtraColumns, Triangles
from elid_cli.model.effects.scene import Scene
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals

FARTHEST = 0.25
"""Share of the largest inertia by which a rotor's changes at once."""
SPREAD = 0.5
"""Standard deviation of a rotor's inertia about that of the robot file, a part of it: a reference, often 30 % off."""
_STEP = 1e-3
"""Step of the columns' differences, share of the largest inertia."""
_ROUNDING = 1e-9
"""Share of an effect's column below which a change of it is rounding."""


def rotor_columns(
    fitted: FittedEffects, signals: Signals, amplitudes: Sequence[Array]
) -> dict[int, tuple[ExtraColumns, float]]:
    """Return by joint the column of a rotor's share in the torque of fitted effects, and the inertia it is a share of.

    Parameters
    ----------
    fitted
        Effects with the scene that their columns are of. Of its `rotors`, those that no effect feels are left out.
    signals
        The log.
    amplitudes
        Fitted amplitudes of each effect, (d,).
    """
    found: dict[int, tuple[ExtraColumns, float]] = {}
    for joint in fitted.scene.rotors:
        most = _largest(fitted.scene, joint)
        rows: dict[object, Array] = {}
        for item, own, values in zip(fitted.effects, fitted.extras, amplitudes, strict=True):
            if item.effect.joint != joint or not item.effect.from_model or not most > 0:
                continue
            moved = extra_of(item.effect, _moved(fitted.scene, joint, _STEP * most), signals)
            for row, columns in own.rows.items():
                change = (values @ (moved.rows[row] - columns)) / _STEP
                if np.abs(change).max(initial=0.0) > _ROUNDING * np.abs(values @ columns).max(initial=0.0):
                    rows[row] = rows.get(row, 0.0) + change[None]
        if rows:
            found[joint] = ExtraColumns("rotor in load", rows, ("",)), most  # type: ignore[arg-type]
    return found


def rotor_prior(scene: Scene, columns: Mapping[int, tuple[ExtraColumns, float]]) -> tuple[Array, Array]:
    """Return where rotors' shares are by the robot file, and one over their spread, (k,) each; 0 where it has none.

    Parameters
    ----------
    scene
        The scene that the columns are of.
    columns
        Columns and inertias as `rotor_columns` returns them.
    """
    robot, reference = scene.robot, scene.robot.reference()
    names = robot.parameter_names()
    where, precision = np.zeros((2, len(columns)))
    for k, (joint, (_, most)) in enumerate(columns.items()):
        told = float(reference[names.index(robot.rotor_names[joint])]) * (robot.joints[joint].gear_ratio or 1.0) ** 2
        if told > 0:
            where[k], precision[k] = (told - scene.rotors[joint]) / most, most / (SPREAD * told)
    return where, precision


def with_known_rotors(triangles: Triangles, first: int, where: Array, precision: Array) -> Triangles:
    """Return triangles with what is known of rotors' shares, whose columns stand from `first` on."""
    told = np.zeros((len(where), triangles.width + 1))
    told[np.arange(len(where)), first + np.arange(len(where))] = precision
    told[:, -1] = precision * where
    own = np.zeros((0, triangles.width + 1)) if triangles.prior is None else triangles.prior
    return replace(triangles, prior=np.concatenate([own, told[precision > 0]]))


def _largest(scene: Scene, joint: int) -> float:
    """Return the inertia at a joint, kg·m² (kg), whose torque would be as large as all that its bodies need."""
    acceleration = scene.motion.ddtheta[:, joint]
    whole = scene.load[:, joint] + scene.rotors[joint] * acceleration
    return float(np.linalg.norm(whole) / max(float(np.linalg.norm(acceleration)), 1e-300))


def _moved(scene: Scene, joint: int, more: float) -> Scene:
    load = scene.load.copy()
    load[:, joint] -= more * scene.motion.ddtheta[:, joint]
    return replace(scene, load=load, cache={})


def with_rotors(robot: Robot, reference: Array, rotors: Mapping[int, float]) -> tuple[Array, list[int]]:
    """Return standard parameters (p,) with rotor inertias, kg·m² (kg) at joints, by joint, and the places of these."""
    names, found, places = robot.parameter_names(), reference.copy(), list[int]()
    for joint, inertia in rotors.items():
        places.append(names.index(robot.rotor_names[joint]))
        found[places[-1]] = inertia / (robot.joints[joint].gear_ratio or 1.0) ** 2
    return found, places

"""What effects are computed from, with effects that were found: their torques pass the transmissions, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.signals.lowpass import low_pass

AGREEING, AGREED = 12, 1e-5
"""Most rounds in which predicted torque and friction that follows it come to agree, and the change, as a part of the
torque, below which they do: a round leaves as much of the error as friction follows the motor's torque."""
PASSING = "spring", "encoder"
"""Places of effects that act through the transmission."""
ROUNDS, BAND = 4, 1.6
"""Most times that a deflection under load is found from the load that it leaves itself, and cut-off of that load,
over that of the equations."""
ON_LINKS = "link", "chain"
"""Places of effects that act on the links alone."""


def with_found(scene: Scene, effects: Sequence[tuple[Effect, Array]]) -> Scene:
    """Return the scene that knows of effects with their amplitudes (d,), and what the columns of others are made of.

    That is the torque through the transmissions that they add to the spring's, or take off it: of play, or of encoders
    that do not agree on zero; and through rigid ones what acts on the links, such as a payload or a balancing spring.
    """
    if not effects:
        return scene
    slow = [pair for pair in effects if pair[0].quasi_static]
    rest = _passed_on(scene, [pair for pair in effects if not pair[0].quasi_static])
    found, before = _with(scene, effects, rest), np.inf
    for _ in range(ROUNDS if slow else 0):
        other = _with(scene, effects, rest + _below(found, _passed_on(found, slow)))
        change = float(np.linalg.norm(other.load - found.load))
        if not change < before:  # it grows from round to round: no load settles with so much compliance
            break
        found, before = other, change
    return found


def _with(scene: Scene, effects: Sequence[tuple[Effect, Array]], added: Array) -> Scene:
    load = scene.load + added if added.any() else scene.load
    return replace(scene, load=load, found=tuple(effects), cache={})


def _passed_on(scene: Scene, effects: Sequence[tuple[Effect, Array]]) -> Array:
    """Return what effects with their amplitudes add to the torque through the transmissions, (N, n)."""
    added, rigid = np.zeros_like(scene.load), ~np.isfinite(scene.stiffness)
    for effect, linear in effects:
        if effect.place in PASSING and not rigid[effect.joint]:
            columns = effect.columns(scene)
            rows = [EquationRow(side, effect.joint) for side in ("link", "motor")]
            if set(columns) == set(rows):  # what acts on both sides passes the transmission
                added[:, effect.joint] += linear @ columns[rows[1]]
        elif effect.place in ON_LINKS and rigid.any():
            for row, values in effect.columns(scene).items():
                if row.side == "link" and rigid[row.joint]:
                    added[:, row.joint] += linear @ values
    return added


def _below(scene: Scene, torque: Array) -> Array:
    """Return torques (N, n) without what is far above the frequencies that the equations are compared at.

    There a deflection under load, found from the load that it leaves, would grow from round to round.
    """
    from scipy.signal import oaconvolve

    taps = low_pass(BAND * scene.cutoff, scene.dt, 1).taps
    if len(taps) == 1:
        return torque
    half, parts = len(taps) // 2, np.split(torque, [start for start in scene.starts if start])
    wide = (np.pad(part, ((half, half), (0, 0)), mode="edge") for part in parts)
    return np.concatenate([oaconvolve(part, taps[:, None], mode="valid", axes=0) for part in wide])


def with_effects(scene: Scene, effects: Sequence[tuple[Effect, Array]]) -> Scene:
    """Return the scene whose predicted torque holds that of effects with their amplitudes (d,), where one needs it.

    Friction that follows the motor's torque is part of that torque: a few rounds let both agree.
    """
    scene = with_found(scene, effects)
    if not any(effect.from_torque for effect, _ in effects):
        return scene
    base = scene.predicted
    for _ in range(AGREEING):
        total = base.copy()
        for effect, linear in effects:
            for row, columns in effect.columns(scene).items():
                total[:, row.joint] += linear @ columns
        change = float(np.linalg.norm(total - scene.predicted))
        scene = replace(scene, predicted=total, alone=base, cache={})
        if change <= AGREED * float(np.linalg.norm(total)):
            break
    return scene

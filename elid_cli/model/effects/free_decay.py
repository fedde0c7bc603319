"""The free decay of an oscillator that a segment starts with, as the torque that the model lacks shows it.

No log tells how an oscillator swings when a segment starts: what shook it before is not in it. The torque shows it. Its
free decay, A exp(-ζωt) cos(ωt) + B exp(-ζωt) sin(ωt), is fitted in every segment to what the model lacks, beside the
oscillator's response to the motion, whose amplitude says how much of an oscillation one of that inertia is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.rows import derivative
from elid_cli.model.effects.scene import Scene

GONE = 1e-4
"""Part of itself below which a free decay counts as over."""
FIRM = 4.0
"""Energy of a free decay over that of what is elsewhere in the torque at its frequency, from which on it is one."""
LARGEST = 3.0
"""Largest free decay, as a part of the largest response to the motion: a wrong frequency asks for more."""
SHOWN = 0.1
"""Part of free decays that motion has to show, …"""
STANDING = 0.02
"""… faster than this share of the top speed."""
_BLOCK = 64
"""Samples of an oscillator's history that are computed by one product."""


def decaying(factor: complex, driven: Array) -> Array:
    """Return y of y[k] = factor y[k - 1] + driven[k] from rest, (N,): |factor| is at most about 1.

    Blocks of samples by one product, what one hands on to the next by a loop over blocks.
    """
    powers = factor ** np.arange(_BLOCK + 1)
    count = -(-len(driven) // _BLOCK)
    blocks = np.zeros((count, _BLOCK), dtype=complex)
    blocks.reshape(-1)[: len(driven)] = driven
    lag = np.arange(_BLOCK)[None, :] - np.arange(_BLOCK)[:, None]
    blocks = blocks @ np.where(lag >= 0, powers[np.maximum(lag, 0)], 0.0)
    handed, state = np.empty(count, dtype=complex), 0j
    for k, end in enumerate(blocks[:, -1].tolist()):
        handed[k] = state
        state = end + complex(powers[_BLOCK]) * state
    blocks += handed[:, None] * powers[1:]
    return blocks.reshape(-1)[: len(driven)]


def missing_torque(scene: Scene, joint: int, others: Sequence[tuple[Effect, Array]]) -> Array:
    """Return the torque at a joint that parameters and `others`, of the effects known so far, do not explain, (N,).

    Zeros where nothing is predicted, as under commands.
    """
    known = scene.predicted if scene.alone is None else scene.alone
    if not np.any(known[:, joint]):
        return np.zeros(scene.samples)
    missing = scene.tau[:, joint] - known[:, joint]
    if scene.late is not None and scene.late[joint]:  # a swing that is logged late would start at another phase
        missing = missing - scene.late[joint] * derivative(scene.tau[:, joint], scene.dt, scene.starts)
    for effect, linear in others:
        key = ("torque", effect.name, effect.joint, effect.shape, tuple(linear.tolist()), joint)
        if key not in scene.cache:
            rows = [values for row, values in effect.columns(scene).items() if row.joint == joint]
            scene.cache[key] = np.sum([linear @ values for values in rows], axis=0) + np.zeros(scene.samples)
        missing = missing - scene.cache[key]
    return missing


def free_decay(scene: Scene, joint: int, pole: complex, response: Array, missing: Array) -> Array:
    """Return the free decays of all segments, (N,), that belong to an oscillator's response (N,) to the motion.

    Zeros where the torque is not known, does not show the oscillator at all, or shows no decay beside its noise.

    Parameters
    ----------
    scene
        The log.
    joint
        Where the oscillator acts.
    pole
        Of the oscillator, in the upper half plane, rad/s.
    response
        Torque of an oscillator of amplitude 1 whose states at the segments' starts are guessed.
    missing
        Torque that the model lacks without the oscillator, (N,) (`missing_torque`).
    """
    found = np.zeros(scene.samples)
    if not np.any(missing):
        return found
    step = complex(np.exp(pole * scene.dt))
    moves = _moves(scene, joint)
    bounds = [*sorted({0, *scene.starts}), scene.samples]
    if len(bounds) == 2 and not moves[0]:  # a log that begins at rest: nothing has been shaken yet
        return found
    decays = [_Decay.of(step, moves[start:stop], start) for start, stop in pairwise(bounds) if stop > start]
    rows = np.concatenate([missing[None], response[None], _slow(scene, joint)]) * moves
    left, shares = rows.copy(), [decay.taken(rows) for decay in decays]
    for decay, share in zip(decays, shares, strict=True):
        if share.any():
            left[:, decay.place] -= share @ decay.basis.T
        else:  # too short to tell: such a swing would bend the amplitude
            left[:, decay.place] = 0.0
    # the amplitude, with all free decays and what else the model may lack eliminated
    normal = left[1:] @ left.T
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal[:, 1:]), 1e-300))
    solution = scale * np.linalg.lstsq(normal[:, 1:] * np.outer(scale, scale), scale * normal[:, 0], rcond=1e-12)[0]
    amplitude = float(solution[0])
    if not amplitude > 0:
        return found
    noise = _elsewhere(step, left[0] - solution @ left[1:]) / float(np.mean(moves))
    most = LARGEST * float(np.max(np.abs(response)))
    for decay, share in zip(decays, shares, strict=True):
        own = share[0] - solution @ share[1:]
        energy = float(own @ own)
        if energy > FIRM * noise:
            torque = (1.0 - (FIRM * noise / energy) ** 2) / amplitude * (decay.whole @ own)
            found[decay.place] = torque * min(1.0, most / float(np.max(np.abs(torque))))
    return found


@dataclass(frozen=True)
class _Decay:
    """The free decays of one segment until they are over."""

    place: slice
    basis: Array
    """Orthonormal where the joint moves, 0 where it stands, (m, 2); (m, 0) where it hardly moves before they are."""
    whole: Array
    """The same, going on where it stands."""

    @classmethod
    def of(cls, step: complex, moves: Array, start: int) -> _Decay:
        """Return those of a segment, that begins at sample `start`, with a pole's factor of a step."""
        over = int(np.log(GONE) / np.log(abs(step))) + 1 if GONE < abs(step) < 1 - 1e-12 else len(moves)
        length = min(len(moves), max(2, over))
        turning = step ** np.arange(length)
        whole = np.stack([turning.real, turning.imag], axis=1)
        basis, factor = np.linalg.qr(whole * moves[:length, None])
        shown = length > 1 and float(np.min(np.abs(np.diag(factor)))) > SHOWN * float(np.linalg.norm(whole))
        inverse = np.linalg.inv(factor) if shown else np.zeros((2, 0))
        return cls(slice(start, start + length), basis[:, : inverse.shape[1]], whole @ inverse)

    def taken(self, rows: Array) -> Array:
        """Return the coefficients of rows (k, N) in the basis, (k, 2)."""
        return np.asarray(rows[:, self.place] @ self.basis)


def _moves(scene: Scene, joint: int) -> Array:
    """Return 1 where a joint moves, (N,), 0 where it stands or turns back: its friction there is not the model's."""

    def made() -> Array:
        speed = scene.speed(joint)
        return np.asarray(speed > STANDING * float(np.max(speed)), dtype=float)

    found: Array = scene.of_motion(("moves", joint), made)
    return found


def _slow(scene: Scene, joint: int) -> Array:
    """Return what the model's parameters, which know nothing of the oscillator, may have got wrong, (k, N)."""

    def made() -> Array:
        q, dq = scene.motion.q[:, joint], scene.motion.dq[:, joint]
        own: Sequence[Array] = (np.ones_like(q), np.cos(q), np.sin(q), dq, scene.direction(joint))
        return np.concatenate([np.stack(own), scene.motion.ddq.T])

    found: Array = scene.of_motion(("slow", joint), made)
    return found


def _elsewhere(step: complex, left: Array) -> float:
    """Return the mean energy that a free decay takes from what is left of the torque, (N,), wherever it begins."""
    square = abs(step) ** 2
    count = (1.0 - square ** len(left)) / (1.0 - square) if square < 1 else len(left)
    seen = np.abs(decaying(step, left[::-1])) ** 2
    return float(2.0 * np.mean(seen) / count)

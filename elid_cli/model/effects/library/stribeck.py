"""Stribeck friction: boundary friction that changes with speed before the full film forms (eq. 43)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter, Shapes
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene

SLOWEST = 0.015
"""Least Stribeck velocity, as a part of the top speed."""
TYPICAL = 0.1
"""Stribeck velocity to start from, as a part of the top speed."""
SURE = 2.0
"""Standard errors by which a friction curve must turn."""
SLOW, HALF, PASSES = 1.5, 0.5, 3
"""Stribeck velocities below which a motion is slow, at most this part of the top speed, and times that it must be."""


class Stribeck(Effect):
    """Friction that is higher (or lower) at low speed than Coulomb and viscous friction alone.

    One formula covers the forms in use: exponent 1 is the exponential form, f3 and f4 of eq. (43); exponent 2 the
    Gaussian one; exponent -1 is eq. (43)'s last term, f5 and velocity = 1/f6, which vanishes at standstill and
    saturates at speed. The paper's friction is two of these effects at one joint.
    """

    name = "stribeck"
    title = "Stribeck friction"
    summary = "friction that rises or falls towards zero speed"
    equation = "motor equation: amplitude sign(θ') exp(-(|θ'|/velocity)^exponent)"
    physics = (
        "At low speed the surfaces touch (boundary lubrication); as the speed rises a film forms between them and the"
        " friction drops to the Coulomb and viscous level (Stribeck 1902). Friction that falls towards zero speed has a"
        " negative amplitude: simulators that smooth its sign (tanh) or let a joint creep have it."
    )
    typical = "10-100 % of the Coulomb friction; velocity 0.01-0.3 rad/s at the joint"
    fingerprint = "motor side and whole joint, odd in velocity, within three Stribeck velocities of standstill"
    record = "slow passes through zero speed in both directions, and steady slow motion"
    place = "motor"
    takes_energy = True
    of_motor_speed = True
    usual_first = True
    acts_as = "friction"
    amplitudes = (Parameter("amplitude", "N·m", "friction beyond Coulomb and viscous, at zero speed"),)
    shapes = (
        Parameter("velocity", "rad/s", "speed over which it fades", low=1e-4),
        Parameter(
            "exponent",
            "1",
            "1 exponential, 2 Gaussian, -1 exp(-velocity/|θ'|), which vanishes at standstill; 1 when not given",
            low=-2.0,
            high=4.0,
            fixed=True,
            default=1.0,
        ),
    )
    example = {"amplitude": -0.25, "velocity": 0.1, "exponent": 1.0}

    @classmethod
    def summary_of(cls, terms: Sequence[Mapping[str, float]], errors: Sequence[Mapping[str, float]] = ()) -> str:
        """Return whether friction rises or falls towards zero speed: a term of negative exponent vanishes there.

        A sum of terms may rise and fall: that is said where it stands out of the amplitudes' errors.
        """
        slowest = min(term["velocity"] for term in terms)
        speeds = np.geomspace(0.01 * slowest, 100.0 * max(term["velocity"] for term in terms), 400)
        parts = [np.exp(-((speeds / t["velocity"]) ** t.get("exponent", 1.0))) for t in terms]
        curve = np.sum([t["amplitude"] * part for t, part in zip(terms, parts, strict=True)], axis=0)
        spread = [error.get("amplitude", 0.0) for error in errors] or [0.0] * len(terms)

        def change(one: int, other: int) -> float:
            """Return by how much friction differs between two speeds; 0 where that is within its error."""
            error = sum(s * abs(part[one] - part[other]) for s, part in zip(spread, parts, strict=True))
            size = float(curve[one] - curve[other])
            return size if abs(size) > SURE * error else 0.0

        low, high = sorted((float(curve[0]), float(curve[-1])))
        turn = int(np.argmax(np.abs(curve - np.clip(curve, low, high))))
        rest, top = change(turn, 0), change(turn, -1)
        if rest * top > 0:
            first, last = ("rises", "falls") if top > 0 else ("falls", "rises")
            return f"friction that {first} towards zero speed, and {last} again at the slowest speeds"
        whole = change(0, -1)
        if not whole:
            return "friction that changes towards zero speed: that it rises and that it falls both fit"
        return f"friction that {'rises' if whole > 0 else 'falls'} towards zero speed"

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return velocities from the slowest that the log resolves to half its top speed, in the three forms."""
        top = scene.top_speed(joint)
        if top <= 0:
            return []
        fading = [v for v in (0.01, 0.02, 0.04, 0.07, 0.12, 0.2, 0.35, 0.6) if 0.01 * top < v < 0.5 * top]
        fading = fading or [0.02 * top, 0.05 * top, 0.12 * top, 0.3 * top]  # slow or sliding joints
        rising = [v for v in fading if v <= 0.2 * top]
        return [*((v, e) for e in (1.0, 2.0) for v in fading), *((v, -1.0) for v in rising)]

    @classmethod
    def distinct(cls, scene: Scene, joint: int, shape: Sequence[float], present: Sequence[Sequence[float]]) -> bool:
        """Whether the curve has another form: one that fades and one that vanishes at standstill make eq. (43)."""
        return all((shape[1] < 0) != (other[1] < 0) for other in present)

    @classmethod
    def whole_curves(cls, scene: Scene, joint: int, shape: Sequence[float]) -> tuple[Shapes, ...]:
        """Return a term that fades, as an exponential or a Gaussian, with one that vanishes at standstill (eq. 43)."""
        start = TYPICAL * scene.top_speed(joint)
        if start <= 0:
            return ()
        pairs = [((start, exponent), (start, -1.0)) for exponent in (1.0, 2.0)]
        return tuple(pair if shape[1] > 0 else pair[::-1] for pair in pairs)

    @classmethod
    def plausible(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> bool:
        """Whether the velocity is one that a log resolves, and passes.

        Below it there is the motor's sticking only; a curve that does not fade within the speeds of the log is Coulomb
        and viscous friction. What a motion that is never that slow leaves is no friction at low speed.
        """
        speed, top = scene.speed(joint), scene.top_speed(joint)
        if not (super().plausible(scene, joint, values) and SLOWEST * top < values["velocity"] < top):
            return False
        slow = speed < min(SLOW * values["velocity"], HALF * top)
        return int(np.count_nonzero(slow[1:] & ~slow[:-1])) + int(slow[0]) >= PASSES

    def columns(self, scene: Scene) -> Columns:
        """Return the column of the amplitude in the motor row."""
        velocity, exponent = self.shape
        ratio = scene.speed(self.joint) / velocity
        if exponent < 0:
            ratio = np.maximum(ratio, 1e-12)
        return motor_row(self.joint, scene.direction(self.joint) * np.exp(-(ratio**exponent)))

"""Extended friction models of servo actuators: load, Stribeck and direction in one family with nested members.

Duclusaud, Passault, Padois and Ly, Extended Friction Models for the Physics Simulation of Servo Actuators, 2024
(arXiv 2410.08650); BAM names the members M1 to M6. M1 is Coulomb and viscous friction, which every joint has.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli._types import Array
from elid_cli.model.effects.effect import Columns, Effect, Member, Parameter
from elid_cli.model.effects.rows import motor_row
from elid_cli.model.effects.scene import Scene

STRIBECK, LOADED, BOTH, DIRECTIONAL, QUADRATIC = 2, 3, 4, 5, 6
"""Members beyond M1."""
TYPICAL = 0.1
"""Stribeck velocity to start from, as a part of the top speed."""
FORMS = (1.0, 2.0)
"""Exponents that are tried: the exponential and the Gaussian form."""
EVEN = 0.5
"""Lean that makes no difference between motor torque and load."""
PAIRS = (("motor", "external"), ("static_motor", "static_external"))
"""Amplitudes that are one in members without direction."""


class ServoFriction(Effect):
    """What a member of the family adds to Coulomb and viscous friction.

    The published load is ``|K_m tau_m - K_e tau_e|`` with the torque ``tau_e`` that acts on the joint from outside;
    here ``tau_e = -load``. With the sign of ``lean tau_m + (1 - lean) load`` it is linear in what is to be found;
    `grown` brings the lean to the amplitudes.
    """

    name = "servo_friction"
    summary = "extended servo friction: load x Stribeck x direction (M2 to M6)"
    equation = (
        "motor equation: sign(θ') (e static + |motor τ + external load| + e |static_motor τ + static_external load|"
        " + e driving load² or e driven τ²),  e = exp(-(|θ'|/velocity)^exponent),  τ = torque that the model predicts"
    )
    physics = (
        "A gear's teeth are pressed together by the torque that passes them: friction grows with it, most at rest, and"
        " differs between driving and being driven, as in worm, spur and harmonic gears."
    )
    typical = "1-20 % of the torque for each load term; velocity 0.05-0.5 rad/s at the joint"
    fingerprint = "motor side and whole joint, odd in velocity, more under load and at low speed"
    record = "slow and fast motion in both directions under different loads, lifting as well as lowering"
    place = "motor"
    either_sign = "Friction may grow or fall with a torque."
    acts_as = "friction"
    amplitudes = (
        Parameter("static", "N·m", "K_cs: friction beyond Coulomb's at zero speed", low=0.0),
        Parameter("motor", "1", "K_m: friction per motor torque; without direction K_l, of motor torque and load"),
        Parameter("external", "1", "K_e: friction per load"),
        Parameter("static_motor", "1", "K_ms: the same at zero speed; without direction K_ls"),
        Parameter("static_external", "1", "K_es: the same at zero speed"),
        Parameter("driving", "1/(N·m)", "K_eq: friction at zero speed per square of the load, while the motor drives"),
        Parameter("driven", "1/(N·m)", "K_mq: per square of the motor's torque, while the load drives"),
    )
    shapes = (
        Parameter("model", "1", "member of the family: 2 to 6", low=STRIBECK, high=QUADRATIC, fixed=True),
        Parameter("velocity", "rad/s", "speed over which the terms at zero speed fade", low=1e-4),
        Parameter("exponent", "1", "how it fades: 1 exponential, 2 Gaussian", low=0.5, high=4.0, fixed=True),
        Parameter("lean", "1", "motor/(motor + external); follows from these two", low=0.0, high=1.0, fixed=True),
    )
    example = {
        "static": 0.4, "motor": 0.08, "external": 0.02, "static_motor": 0.05, "static_external": 0.03,
        "driving": 1e-4, "driven": 2e-4, "model": 6.0, "velocity": 0.2, "exponent": 1.0, "lean": 13 / 18,
    }  # fmt: skip
    members = {
        "M2": Member("Stribeck", "Kc + Kv |v| + e Kcs", STRIBECK, FORMS),
        "M3": Member("load", "Kc + Kv |v| + Kl |τm - τe|", LOADED),
        "M4": Member("load, Stribeck", "Kc + Kv |v| + Kl |τm - τe| + e (Kcs + Kls |τm - τe|)", BOTH, FORMS),
        "M5": Member("directional", "Kc + Kv |v| + |Km τm - Ke τe| + e (Kcs + |Kms τm - Kes τe|)", DIRECTIONAL, FORMS),
        "M6": Member("quadratic", "that of M5 + e (Keq τe² driving, Kmq τm² driven)", QUADRATIC, FORMS),
    }
    searched = False
    from_model = True
    from_torque = True

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return the directional member with a usual Stribeck velocity; nothing where the joint does not move."""
        top = scene.top_speed(joint)
        return [(float(DIRECTIONAL), TYPICAL * top, 1.0, EVEN)] if top > 0 else []

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the parameters; without direction the two of a pair are equal."""
        values = super().named(scene, coefficients)
        values["lean"] = _lean(coefficients)
        if self.shape[0] < DIRECTIONAL:
            values |= {external: values[motor] for motor, external in PAIRS}
        return values

    @classmethod
    def coefficients(cls, scene: Scene, joint: int, values: Mapping[str, float]) -> tuple[Array, tuple[float, ...]]:
        """Invert `named`; amplitudes that are not given are 0, and so are those that the member does not have."""
        model = float(values["model"])
        velocity = float(values.get("velocity", 1.0) if model == LOADED else values["velocity"])
        linear = np.array([float(values.get(p.name, 0.0)) for p in cls.amplitudes])
        linear = np.where(_present(model), linear, 0.0)
        return linear, (model, velocity, float(values.get("exponent", 1.0)), _lean(linear))

    def grown(self, coefficients: Array) -> ServoFriction:
        """Return the effect that leans to motor torque or load as its amplitudes (7,) do."""
        return ServoFriction(self.joint, (*self.shape[:-1], _lean(coefficients)))

    def columns(self, scene: Scene) -> Columns:
        """Return the columns of the amplitudes in the motor row; zeros where the member does not have them."""
        model, velocity, exponent, lean = self.shape
        fades = np.exp(-((np.abs(scene.motion.dtheta[:, self.joint]) / velocity) ** exponent))
        torque, load = scene.predicted[:, self.joint], scene.load[:, self.joint]
        if model < DIRECTIONAL:
            pair = np.abs(torque + load), np.zeros_like(load)
        else:
            towards = np.sign(lean * torque + (1.0 - lean) * load)
            pair = towards * torque, towards * load
        drives = np.abs(torque) > np.abs(load)
        together = torque * load > 0
        parts = (
            fades, *pair, fades * pair[0], fades * pair[1],
            fades * load**2 * (drives & together), fades * torque**2 * (~drives & together),
        )  # fmt: skip
        direction = scene.direction(self.joint)
        present = _present(model)
        return motor_row(self.joint, *(direction * part * has for part, has in zip(parts, present, strict=True)))


def _lean(coefficients: Array) -> float:
    """Return the motor torque's part in the load terms, 0 to 1; half where there are none."""
    motor, external = (max(float(coefficients[k] + coefficients[k + 2]), 0.0) for k in (1, 2))
    return motor / (motor + external) if motor + external > 0 else EVEN


def _present(model: float) -> tuple[bool, ...]:
    """Return which amplitudes a member has, in their order."""
    stribeck, load, direction = model != LOADED, model >= LOADED, model >= DIRECTIONAL
    square = model >= QUADRATIC
    return (stribeck, load, direction, load and stribeck, direction, square, square)

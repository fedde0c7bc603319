"""A spring between a link and the one before it: counterbalance, gas spring, cable package."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import link_row
from elid_cli.model.effects.scene import Scene

REACH = np.pi
"""rad (m) from a joint's mean position within which a spring that stands for a constant torque is at rest."""
ROOM = 3.0
"""Standard errors of its stiffness that count as room for it."""


class LinkSpring(Effect):
    """A linear spring on the link's own angle."""

    name = "link_spring"
    summary = "spring on the link's angle (counterbalance, gas spring, cables)"
    equation = "link equation: stiffness q + preload"
    physics = "A counterbalance cylinder, a torsion spring or a stiff cable package pushes the link towards some angle."
    typical = "up to the whole gravity torque of one axis"
    fingerprint = "whole joint only, a function of the link's angle alone, at rest too"
    record = "the joint's full range, in slow and fast passes (a weight of the same torque would add inertia)"
    place = "link"
    like_weight = True
    either_sign = "A balancing spring beyond its dead centre pushes on."
    acts_as = "torque"
    amplitudes = (
        Parameter("stiffness", "N·m/rad", "torque per angle"),
        Parameter("preload", "N·m", "torque at q = 0; -preload/stiffness is the angle at which the spring is at rest"),
    )
    example = {"stiffness": 30.0, "preload": -12.0}
    twins = ("gravity_direction", "torque_offset")

    def columns(self, scene: Scene) -> Columns:
        """Return the columns of stiffness and preload in the link row."""
        return link_row(self.joint, scene.motion.q[:, self.joint], np.ones(scene.samples))

    @classmethod
    def can_be(cls, scene: Scene, joint: int, values: Mapping[str, float], errors: Mapping[str, float]) -> bool:
        """Return whether the stiffness may be that of a spring which is at rest within half a turn (`REACH`)."""
        torque = values["stiffness"] * float(np.mean(scene.motion.q[:, joint])) + values["preload"]
        return values["stiffness"] + ROOM * errors.get("stiffness", np.inf) > abs(torque) / REACH

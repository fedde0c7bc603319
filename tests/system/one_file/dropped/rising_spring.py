"""Rising spring: a hose that pulls the link back the harder the further it goes. An effect dropped by a test."""

from __future__ import annotations

from elid_cli.model.effects.effect import Columns, Effect, Parameter
from elid_cli.model.effects.rows import link_row
from elid_cli.model.effects.scene import Scene


class RisingSpring(Effect):
    """A spring between link and base whose torque grows with the cube of the angle."""

    name = "rising_spring"
    summary = "cable or hose that stiffens with the link's angle"
    equation = "link row: stiffness q³"
    physics = "A hose on the outside of the arm hangs loose in the middle and is pulled tight at either end."
    typical = "0.5-5 N·m/rad³"
    fingerprint = "sum row with the motor row at its floor, along the cube of the link's angle"
    record = "the whole range of the joint, both ways"
    place = "link"
    elastic_only = True
    amplitudes = (Parameter("stiffness", "N·m/rad³", "torque at 1 rad", low=0.0),)
    example = {"stiffness": 4.0}  # noqa: RUF012

    def columns(self, scene: Scene) -> Columns:
        """Return the cube of the link's angle in its row."""
        return link_row(self.joint, scene.motion.q[:, self.joint] ** 3)

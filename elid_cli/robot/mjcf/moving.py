"""A joint of an MJCF that moves, and the inertia that it moves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from elid_cli._types import Array
from elid_cli.robot.inertia import moved
from elid_cli.robot.urdf.xml import Element


@dataclass
class MovingJoint:
    """A joint that moves: where it stands in the file and in the tree, and the inertia it moves (None: unknown)."""

    name: str
    element: Element
    """With the attributes of its class."""
    origin: Array
    """4x4 pose in the frame of the joint that carries it."""
    parent: int
    body: Array | None = field(default_factory=lambda: np.zeros((4, 4)))
    owner: Element | None = None
    """The body element that carries the inertia; None of the first of several joints of one body."""
    own: Array = field(default_factory=lambda: np.zeros((4, 4)))
    """The 4x4 pseudo-inertia of that body alone, in its own frame."""
    fixed: list[Element] = field(default_factory=list)
    """The bodies that it carries without a joint in between, and that have a mass."""

    def add(self, body: Element, inertia: Array, pose: Array) -> None:
        """Add a body that it moves, of a 4x4 pseudo-inertia in its own frame, which is at a 4x4 pose in the joint's."""
        if self.owner is body:
            self.own = inertia
        elif inertia.any():
            self.fixed.append(body)
        if self.body is not None:
            self.body = self.body + moved(inertia, pose)

    @property
    def turns(self) -> bool:
        """Whether it is a hinge."""
        return self.element.attributes.get("type", "hinge") == "hinge"

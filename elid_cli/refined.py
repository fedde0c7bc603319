"""A robot description that holds what was found: the file that ``--write-robot`` writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from elid_cli.robot import EffectSpec, Robot


class Found(Protocol):
    """An effect with the values that were found."""

    @property
    def effect(self) -> str:
        """Its name."""

    @property
    def joint(self) -> str | None:
        """Its joint."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """Its parameters."""


def refined(robot: Robot, standard: NDArray[np.float64], found: Sequence[Found] = ()) -> Robot:
    """Return the robot with standard parameters (p,) and effects as found; of an effect declared before, the new one.

    Parameters
    ----------
    robot
        The robot that was identified.
    standard
        Any representative of the base parameters: predictions need nothing more.
    found
        Effects and nuisances, with their values.
    """
    values = dict(zip(robot.parameter_names(), (float(v) for v in standard), strict=True))
    joints = []
    for i, joint in enumerate(robot.joints, start=1):
        parameters = {name[: -len(str(i))]: v for name, v in values.items() if _number(name) == i}
        joints.append(replace(joint, parameters=parameters))
    new = tuple(EffectSpec(f.effect, f.joint, dict(f.parameters)) for f in found)
    replaced = {(spec.effect, spec.joint) for spec in new}
    kept = tuple(spec for spec in robot.effects if (spec.effect, spec.joint) not in replaced)
    return replace(robot, joints=tuple(joints), effects=(*kept, *new))


def _number(name: str) -> int:
    return int(name.lstrip("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"))

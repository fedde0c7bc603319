"""What is unknown beside the links' motion, and what is known of it beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.motor_side.link_sensors import LinkSensors
from elid_cli.estimation.motor_side.link_side import LinkSide
from elid_cli.estimation.motor_side.motor_log import STRIBECK_WIDTHS

DELAY_SPREAD = DAMPING_SPREAD = 1e-3
"""Prior standard deviation of the torques' common delay and of transmission damping over stiffness, s."""
LOAD_FRICTION_SPREAD = 0.15
"""Prior standard deviation of load friction's coefficient: nearly none."""
LOST_SPREAD = 3e-3
"""Prior standard deviation of a revolute joint's lost motion, rad: ten minutes of arc."""
STRIBECK_SPREAD = 0.1
"""Prior standard deviation of a Stribeck bump, share of the joint's torque."""


@dataclass(frozen=True)
class Unknowns:
    """Places of the unknowns in one vector x.

    p (bodies), then per joint J (rotor), fv, fs, offset; one delay; per joint damping over stiffness, lost motion,
    compliance c = 1/K, load friction; Stribeck bumps (bump by bump); what `Sensed` has of sensors on links; other
    friction.
    """

    link: LinkSide
    further: int = 0
    places: dict[str, NDArray[np.intp]] = field(init=False)
    size: int = field(init=False)

    def __post_init__(self) -> None:
        n = self.link.n
        sizes = {
            "p": self.link.count, "J": n, "fv": n, "fs": n, "offset": n, "delay": 1, "damping": n, "lost": n, "c": n,
            "load": n, "bumps": n * len(STRIBECK_WIDTHS), **{kind.kind.name: kind.size for kind in self.link.sensed},
            "further": self.further,
        }  # fmt: skip
        ends = np.cumsum([0, *sizes.values()])
        places = {name: np.arange(ends[k], ends[k + 1]) for k, name in enumerate(sizes)}
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "size", int(ends[-1]))

    def __getitem__(self, name: str) -> NDArray[np.intp]:
        return self.places[name]

    @property
    def of_sensors(self) -> NDArray[np.intp]:
        """Places of what is unknown of the sensors on links."""
        return np.concatenate([self.places[kind.kind.name] for kind in self.link.sensed])

    def free(self, *without: str) -> NDArray[np.bool_]:
        """Return which unknowns are free: not the named ones, and of rigid joints neither rotor nor transmission."""
        free = np.ones(self.size, dtype=bool)
        for name in without:
            free[self[name]] = False
        for name in ("J", "damping", "lost", "c"):
            free[self[name][~self.link.elastic]] = False
        return free

    def apart(self, x: Array, other: Array) -> float:
        """Return the largest logarithm of a ratio of two answers' compliances."""
        place = self["c"][self.link.elastic]
        here, there = (np.log(np.maximum(v[place], 1e-15)) for v in (x, other))
        return float(np.max(np.abs(here - there)))


@dataclass(frozen=True)
class RotorPrior:
    """What is known of the rotors' inertias as the joints see them, kg·m², (n,) each."""

    value: Array
    spread: Array


def prior_of(
    unknowns: Unknowns, rotors: RotorPrior, torque: Array, sensors: Sequence[LinkSensors]
) -> tuple[Array, Array]:
    """Return mean and standard deviation of every unknown, (size,); infinite where nothing is known.

    Parameters
    ----------
    unknowns, rotors
        What is unknown, and what is known of the rotors.
    torque
        Standard deviation of every joint's torque, (n,).
    sensors
        Sensors on links, of every kind, with first estimates.
    """
    mean, spread = np.zeros(unknowns.size), np.full(unknowns.size, np.inf)
    mean[unknowns["J"]], spread[unknowns["J"]] = rotors.value, rotors.spread
    spread[unknowns["delay"]], spread[unknowns["damping"]] = DELAY_SPREAD, DAMPING_SPREAD
    spread[unknowns["load"]] = LOAD_FRICTION_SPREAD
    turning = np.array([joint.revolute for joint in unknowns.link.robot.joints])
    spread[unknowns["lost"]] = np.where(turning, LOST_SPREAD, np.inf)
    for kind, own in zip(unknowns.link.sensed, sensors, strict=True):
        place = unknowns[kind.kind.name]
        mean[place], spread[place] = kind.prior(own)
    spread[unknowns["bumps"]] = np.tile(STRIBECK_SPREAD * torque, len(STRIBECK_WIDTHS))
    return mean, spread

"""Commanded positions in another unit than the measured ones: a drive follows its commands, and goes about as far."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import in_words
from elid_cli.logs.checks.encoder_pairs import proposed
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.robot.robot import Robot

WITHIN = 1.5
"""Factor within which commands must go as far as positions in the other unit; drives follow worse than 1 to 1."""
ALIKE = 0.7
"""Correlation of commands and positions above which a drive follows."""
TWO_UNITS = "torques that are computed from the two are wrong"
"""What the sentence says."""
LEAST = 1e-3
"""rad (m) that commands and positions must go."""


class Scaled(NamedTuple):
    """How many times as far as the position the command of a joint goes, and by which factor that is told."""

    joint: int
    factor: float
    known: float


def command_scales(signals: Mapping[str, Array], positions: Array, robot: Robot) -> list[Scaled]:
    """Return the joints whose commands are plainly in another unit than their positions.

    Parameters
    ----------
    signals
        ``q_des``, (N, n), of contiguous samples.
    positions
        At the same instants, (N, n), rad or m.
    robot
        Its joints turn, or slide.
    """
    if "q_des" not in signals:
        return []
    found = []
    for j, joint in enumerate(robot.joints):
        known = np.isfinite(signals["q_des"][:, j]) & np.isfinite(positions[:, j])
        told, own = signals["q_des"][known, j], positions[known, j]
        if told.size < 2 or min(float(np.ptp(told)), float(np.ptp(own))) < LEAST:
            continue
        factor, unit = float(np.std(told) / np.std(own)), 180 / math.pi if joint.revolute else 1000.0
        whole = next((w for w in (unit, 1 / unit) if max(factor / w, w / factor) < WITHIN), None)
        if whole is not None and np.corrcoef(told, own)[0, 1] > ALIKE:
            found.append(Scaled(j, factor, whole))
    return found


def command_words(found: list[Scaled], robot: Robot, plan: ReadPlan) -> list[str]:
    """Return a sentence for every way in which commands are in another unit, with the mapping to paste."""
    said = []
    kinds = dict.fromkeys((one.known > 1, robot.joints[one.joint].revolute) for one in found)
    for larger, revolute in kinds:
        here = [one for one in found if (one.known > 1, robot.joints[one.joint].revolute) == (larger, revolute)]
        names = [robot.joint_names[one.joint] for one in here]
        unit, usual, key = ("degrees", "rad", "deg") if revolute else ("mm", "m", "mm")
        side = "q_des" if larger else "q" if "q" in plan.placements else "theta"
        whole = len(here) == robot.n
        line = proposed(plan, side, f"unit: {key}" if whole else f"unit: {{{', '.join(f'{n}: {key}' for n in names)}}}")
        odd, other = ("commands", "positions") if larger else ("positions", "commands")
        size = float(np.median([one.factor if larger else 1 / one.factor for one in here]))
        said.append(
            f"the {odd} of {in_words(names)} go {size:.3g} times as far as the {other}, as {odd} in {unit} beside "
            f"{other} in {usual} do, and {TWO_UNITS}; {line}"
        )
    return said

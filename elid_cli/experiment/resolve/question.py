"""What a saved diagnosis leaves open: groups of effects that explain its log alike, and the noise that hides them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from elid_cli._types import Array
from elid_cli.errors import DataError, UsageError, check_kind
from elid_cli.estimation.saved_results import check_joints, saved_object
from elid_cli.model.base_parameters import find_base
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import Kind, Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import check_robot

AGAIN = "elid diagnose LOG --robot ROBOT --json > diagnosis.json"


@dataclass(frozen=True)
class Hypothesis:
    """An effect that may be what the model lacks, with its parameters as far as the last log shows them."""

    effect: str
    joint: str | None
    number: int
    """Joint number, from 0; 0 for the whole robot."""
    parameters: Mapping[str, float]
    std_error: Mapping[str, float]
    behind: float = 0.0
    """Log-likelihood by which it explains the last log worse than the named effect."""

    @property
    def kind(self) -> type[Effect]:
        """The effect's class."""
        return effect_classes()[self.effect]

    @property
    def once(self) -> bool:
        """Whether it happened at one moment of the last log, so that another log need not hold it."""
        return self.kind.local

    @property
    def name(self) -> str:
        """``stribeck joint1``."""
        return self.effect if self.joint is None else f"{self.effect} {self.joint}"


@dataclass(frozen=True)
class Group:
    """Effects of which one explains the same part of the last log, the named one first."""

    hypotheses: tuple[Hypothesis, ...]
    named: bool
    """Whether the first is an effect that the diagnosis named; else all only come near to an unexplained residual."""


@dataclass(frozen=True)
class JointNoise:
    """Noise of the filtered rows of one joint: an autoregression of its sensors' noise, and its innovations."""

    number: int
    rows: tuple[Kind, ...]
    lags: Array
    """(order, r, r)"""
    mix: Array
    """(r, r)"""
    rms: Array
    """Of what is left in the rows, N·m, (r,) …"""
    floor: Array
    """… and of what the sensors' noise alone leaves, (r,)."""


@dataclass(frozen=True)
class Question:
    """What the next experiment is to decide, and with what noise."""

    robot: Robot
    """As its log showed it: rigid where that held no motor rows."""
    base: Mapping[str, float]
    """Estimated base parameters by name, refused ones left out."""
    groups: tuple[Group, ...]
    present: tuple[Hypothesis, ...]
    """Effects that act whichever hypothesis is true: declared ones and those found beside."""
    noise: tuple[JointNoise, ...]
    rate: float
    """Instants per second of the filtered rows."""
    cutoff: float
    """Hz."""
    share: float
    """Share of their equations that count as independent."""
    files: tuple[str, ...] = field(default=())


def read_question(path: str | Path, robot: Robot) -> Question:
    """Read what a diagnosis saved with ``--json`` leaves open.

    Parameters
    ----------
    path
        The saved diagnosis.
    robot
        The robot that was diagnosed.

    Raises
    ------
    UsageError
        The file is no such diagnosis, or one of another robot.
    DataError
        The diagnosis leaves nothing open.
    """
    check_robot(robot)
    saved = saved_object(path, AGAIN)
    if saved.get("command") != "diagnose":
        raise _refused(path)
    return question_of(saved, robot, str(path))


def question_of(saved: Mapping[str, Any], robot: Robot, path: str = "diagnosis") -> Question:
    """Return what a diagnosis leaves open.

    Parameters
    ----------
    saved
        Its JSON object, as `Diagnosis.to_dict` gives it.
    robot
        The robot that was diagnosed.
    path
        What errors call the diagnosis.

    Raises
    ------
    UsageError, DataError
        See `read_question`.
    """
    check_robot(robot)
    check_kind("saved", saved, Mapping, "diagnose(robot, signals).to_dict(); read_question reads a saved one")
    if saved.get("judged_by") == "motion":
        raise UsageError(
            f"{path}: a diagnosis of a log of commands, which is judged by motion: a plan needs one judged by torque",
            hint=AGAIN.replace(" --json", " --lookup --json"),
        )
    if "joints" not in saved or "also_possible" not in saved:
        raise _refused(path)
    if "row_noise" not in saved:
        raise _refused(path, "holds no noise of its rows: an older elid wrote it")
    check_joints(saved, robot, path)
    try:
        question = _question(saved, robot)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        raise _refused(path) from None
    if not question.groups:
        named = ", ".join(h.name for h in question.present) or "nothing"
        if vague := [
            f"{r['effect']} {r['joint'] or ''}".strip() for r in saved["also_possible"] if not r["parameters"]
        ]:
            raise DataError(
                f"{path}: no motion can be planned to tell {named} from {', '.join(vague)}",
                detail="of the latter the log leaves open what it would do elsewhere: it has no values",
                hint="; ".join(dict.fromkeys(str(r["separate"]) for r in saved["also_possible"] if r.get("separate"))),
            )
        raise DataError(
            f"{path}: the diagnosis leaves nothing open",
            detail=f"it names {named}, with no rival and nothing near to what stays unexplained",
            hint="elid excite --after LOG plans a motion for parameters",
        )
    foreign = [name for name in question.base if name not in find_base(Regressor(question.robot)).names]
    if foreign:
        raise UsageError(
            f"{path}: its base parameters are not those of {robot.name!r}",
            detail=f"first unknown one: {foreign[0]}",
            hint="give the robot file that was diagnosed",
        )
    return question


def _refused(path: str | Path, why: str = "not a diagnosis of a log with torques") -> UsageError:
    return UsageError(f"{path}: {why}", hint=AGAIN)


def _question(saved: Mapping[str, Any], robot: Robot) -> Question:
    left = {(row["joint"], row["rows"]): (row["rms"], row["rms"] / row["ratio"]) for row in saved["after"]["rows"]}
    noise = tuple(_noise(item, left, robot) for item in saved["row_noise"]["joints"])
    seen = _as_logged(robot, noise)
    named = [_hypothesis(item, seen) for item in saved["effects"]]
    possible = [_rivals(first, saved["also_possible"], seen) for first in named]
    possible += _unnamed(saved["also_possible"], {h.effect for h in named}, seen)
    possible += [_near(item, seen) for item in saved["unexplained"]]
    groups = _distinct([group for group in possible if group is not None])
    asked = {h.name for group in groups if group.named for h in group.hypotheses[:1]}
    present = [*(_hypothesis(item, seen) for item in saved["declared"]), *(h for h in named if h.name not in asked)]
    return Question(
        seen,
        {str(b["name"]): float(b["estimate"]) for b in saved["base_parameters"] if b["estimate"] is not None
         and b.get("class") != "unidentifiable"},
        tuple(groups),
        tuple(present),
        noise,
        float(saved["row_noise"]["rate"]),
        float(saved["row_noise"]["cutoff"]),
        float(saved["row_noise"]["share"]),
        tuple(map(str, saved["log"]["files"])),
    )  # fmt: skip


def _noise(item: Mapping[str, Any], left: Mapping[tuple[str, str], tuple[float, float]], robot: Robot) -> JointNoise:
    lags, mix = np.array(item["lags"], dtype=float), np.array(item["mix"], dtype=float)
    rows = tuple(item["rows"])
    if mix.shape != (len(rows), len(rows)) or lags.shape[1:] != mix.shape or not np.isfinite(mix).all():
        raise ValueError("noise of rows")
    sizes = np.array([left[item["joint"], row] for row in rows], dtype=float).T
    return JointNoise(robot.joint_names.index(item["joint"]), rows, lags, mix, *sizes)


def _as_logged(robot: Robot, noise: Sequence[JointNoise]) -> Robot:
    """Return the robot as the log showed it."""
    two = np.ones(robot.n, dtype=bool)
    behind = np.zeros(robot.n, dtype=bool)
    for item in noise:
        two[item.number] = len(item.rows) > 1
        behind[item.number] = set(item.rows) == {"load", "spring"}
    return robot.stiffened(~two).read_behind(behind)


def _hypothesis(item: Mapping[str, Any], robot: Robot) -> Hypothesis:
    kind = effect_classes()[item["effect"]]
    joint = item["joint"]
    number = kind.number(robot, joint)
    values = {str(k): float(v) for k, v in item["parameters"].items()}
    errors = {str(k): float(v) for k, v in item.get("std_error", {}).items() if v is not None}
    return Hypothesis(item["effect"], joint, number, values, errors, float(item.get("behind", 0.0)))


def _rivals(first: Hypothesis, possible: Sequence[Mapping[str, Any]], robot: Robot) -> Group | None:
    """Return a named effect with what could stand in its place, or None where nothing could."""
    own = []
    for item in possible:
        rival = _hypothesis(item, robot) if item["effect"] in effect_classes() else None
        if rival is None or item["instead_of"] != first.effect or not rival.parameters:
            continue
        if (at := item.get("instead_at")) is not None:
            if at == first.joint:
                own.append(rival)
            continue
        # of one effect found at two joints each has its own rivals; its like at a third belongs to both
        if first.kind.whole_robot or rival.kind.whole_robot or rival.number == first.number or rival.kind is first.kind:
            own.append(rival)
    return Group((first, *own), named=True) if own else None


def _unnamed(possible: Sequence[Mapping[str, Any]], named: Collection[str], robot: Robot) -> list[Group | None]:
    """Return, joint by joint, what explains the same and none of which was named: an offset, say, and its twin."""
    own: dict[str | None, list[Hypothesis]] = {}
    for item in possible:
        if item["instead_of"] not in named and item["effect"] in effect_classes() and item["parameters"]:
            own.setdefault(item["joint"], []).append(_hypothesis(item, robot))
    return [Group(tuple(group), named=False) for group in own.values() if len(group) > 1]


def _near(item: Mapping[str, Any], robot: Robot) -> Group | None:
    near = [_hypothesis(n, robot) for n in item.get("nearest", ()) if n.get("parameters")]
    return Group(tuple(near), named=False) if len(near) > 1 else None


def _distinct(groups: Sequence[Group]) -> list[Group]:
    """Return the groups without those that ask again what another asks."""
    found: list[Group] = []
    asked: set[frozenset[str]] = set()
    for group in groups:
        names = frozenset(h.name for h in group.hypotheses)
        if names not in asked:
            asked.add(names)
            found.append(group)
    return found

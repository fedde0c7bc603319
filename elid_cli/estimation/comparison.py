"""Comparing saved identifications: which base parameters moved by more than their uncertainty.

Two estimates a and b with standard errors s_a and s_b of independent logs differ by z = (b - a)/sqrt(s_a² + s_b²)
standard deviations. With many parameters a few exceed two by chance; three is the default threshold.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from elid_cli.checks import check_list
from elid_cli.errors import UsageError, first_of, in_words
from elid_cli.estimation.same_joints import comparable, unlike
from elid_cli.estimation.saved_results import number_of, saved_object, told_by
from elid_cli.model.effects import effect_classes
from elid_cli.robot.parameter import StandardParameter
from elid_cli.tables import Shown

OFFSETS = ("offset", "reading offset")
"""Nuisances that are looked for in every log, and dropped where they do not show."""
ONE_ROBOT = "if it is one robot, identify both logs with one robot file; --map says what a log calls its joints"
"""What to do about results of robots whose joints have other names, where it is one robot."""
JOINTS = 6
"""Joints that a message names."""


@dataclass(frozen=True)
class Estimate:
    """One base parameter of one result; None: not given or refused."""

    value: float | None
    std_error: float | None
    unit: str
    bias_possible: bool = False
    """Whether what its model lacks may have moved it."""


@dataclass(frozen=True)
class SavedResult:
    """What a saved JSON of ``elid identify`` or ``elid diagnose`` says."""

    file: str
    robot: str
    parameters: Mapping[str, Estimate]
    error: Mapping[str, float]
    """Held-out error of each joint, relative to its torque."""
    joints: tuple[str, ...] = ()
    beside: Mapping[str, Estimate] = field(default_factory=dict)
    """What was corrected or found beside the base parameters: ``torque_offset of joint1: offset``."""
    temperature: float | None = None
    """Mean over the log and over joints, °C; None where it was not logged."""
    logs: tuple[str, ...] = ()
    """SHA-256 of its logs."""
    log_files: tuple[str, ...] = ()
    """Their names."""
    warnings: tuple[str, ...] = ()
    """What was warned of its logs and its estimates."""
    fingerprint: str = ""
    """Of what decides the equations of its robot; empty where that is not told."""


Result = SavedResult | Shown | str | Path
"""What was saved, where, or what `identify` and `diagnose` return."""


@dataclass(frozen=True)
class Change:
    """A base parameter in two results."""

    name: str
    unit: str
    before: Estimate
    after: Estimate

    @property
    def bias_possible(self) -> bool:
        """Whether what a model lacks may have moved it: then nothing need have changed."""
        return self.before.bias_possible or self.after.bias_possible

    @property
    def deviations(self) -> float:
        """How many standard deviations lie between the two; NaN where one of them is missing."""
        values = (self.before.value, self.after.value, self.before.std_error, self.after.std_error)
        a, b, sa, sb = (math.nan if v is None else v for v in values)
        spread = math.hypot(sa, sb)
        if spread == 0:
            return 0.0 if a == b else math.copysign(math.inf, b - a)
        return (b - a) / spread


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """A result compared with the first one."""

    first: SavedResult
    other: SavedResult
    changes: tuple[Change, ...]
    """Base parameters that both have, in the first's order."""
    unshared: tuple[str, ...]
    """Base parameters that only one of them has."""
    left_out: tuple[str, ...] = ()
    """Base parameters that both have of joints that are not the same: by their names, or the units of parameters."""
    beside: tuple[Change, ...] = ()
    """Offsets, delays and effects that both have; an offset that does not show in one of them is 0 there."""

    @property
    def refused(self) -> tuple[str, ...]:
        """Base parameters that both have and one of them gives no estimate of: nobody knows whether they moved."""
        return tuple(change.name for change in self.changes if math.isnan(change.deviations))

    @property
    def same(self) -> bool:
        """Whether both are the same result, to the last digit."""
        return same_estimates(self.first, self.other)

    def moved(self, sigmas: float) -> tuple[Change, ...]:
        """Return what moved by more than `sigmas` standard deviations: parameters, and what was found beside them."""
        return tuple(change for change in (*self.changes, *self.beside) if abs(change.deviations) > sigmas)


def read_result(path: str | Path) -> SavedResult:
    """Read a saved result.

    Raises
    ------
    UsageError
        No such file, not JSON, or not the JSON of a command that estimates parameters.
    """
    return result_of(saved_object(path), str(path))


def as_saved(results: Sequence[Result], where: str = "results") -> list[SavedResult]:
    """Return results in the form in which they are compared; those that no file holds are called by their number.

    Raises
    ------
    UsageError
        See `read_result`; or what is no result, `where` says whose.
    """
    check_list(where, results, "results")
    return [
        result if isinstance(result, SavedResult) else result_of(*told_by(result, k))
        for k, result in enumerate(results, start=1)
    ]


def result_of(data: Mapping[str, Any], path: str) -> SavedResult:
    """Return what the JSON object of a result says; `path` is what it is called.

    Raises
    ------
    UsageError
        It is not of a command that estimates parameters.
    """
    after = data.get("after")
    error = after.get("error") if isinstance(after, dict) else data.get("error")
    parameters = _parameters(data.get("base_parameters"), path)
    if not any(estimate.value is not None for estimate in parameters.values()):
        detail = f"it was made by elid {data.get('command')}"
        raise UsageError(f"{path}: holds no estimates", detail=detail, hint="compare results of identify or diagnose")
    joints = tuple(str(name) for name in data.get("joints", ()))
    beside = {**_beside(data), **_armatures(data, joints, parameters)}
    log = data.get("log")
    told = log if isinstance(log, dict) else {}
    return SavedResult(
        path, str(data.get("robot", "")), parameters, _relative(error), joints, beside, _temperature(data),
        _texts(told.get("sha256")), _texts(told.get("files")),
        (*_texts(told.get("warnings")), *_texts(data.get("warnings"))), str(data.get("robot_fingerprint") or ""),
    )  # fmt: skip


def _texts(value: Any) -> tuple[str, ...]:
    """Return the texts of a list; nothing of anything else."""
    return tuple(item for item in value if isinstance(item, str)) if isinstance(value, list | tuple) else ()


def _beside(data: Mapping[str, Any]) -> dict[str, Estimate]:
    """Return the nuisances and effects of a saved result; none of those that a joint has several of."""
    items = [item for key in ("nuisances", "effects") for item in data.get(key) or () if isinstance(item, dict)]
    library = effect_classes()
    counts = Counter((str(item.get("effect")), item.get("joint")) for item in items)
    found = {}
    for item in items:
        effect, joint = str(item.get("effect")), item.get("joint")
        if effect not in library or counts[effect, joint] > 1:
            continue
        values, errors = item.get("parameters") or {}, item.get("std_error") or {}
        units = {p.name: p.unit for p in library[effect].amplitudes}
        for name in units:
            value, error = number_of(values.get(name)), number_of(errors.get(name))
            if value is not None and error:
                of = f" of {joint}" if joint else ""
                found[f"{effect}{of}: {name}"] = Estimate(value, error, units[name])
    return found


def _armatures(data: Mapping[str, Any], joints: Sequence[str], parameters: Mapping[str, Any]) -> dict[str, Estimate]:
    """Return the rotor inertias of a trajectory fit, which holds bodies, that are no base parameters on their own."""
    settings = data.get("settings")
    fit = settings.get("trajectory") if isinstance(settings, dict) else None
    own = fit.get("joint_parameters") if isinstance(fit, dict) else None
    found = dict[str, Estimate]()
    for number, joint in enumerate(joints):
        drive = own.get(joint) if isinstance(own, dict) else None
        told = drive.get("Ja") if isinstance(drive, dict) else None
        name = StandardParameter("Ja", number)
        if isinstance(told, dict) and name not in parameters:
            value, error = number_of(told.get("estimate")), number_of(told.get("std_error"))
            found[name] = Estimate(value, error, "kg·m²")
    return found


def _temperature(data: Mapping[str, Any]) -> float | None:
    log = data.get("log")
    told = log.get("temperature") if isinstance(log, dict) else None
    values = [v for value in told.values() if (v := number_of(value)) is not None] if isinstance(told, dict) else []
    return math.fsum(values) / len(values) if values else None


def same_estimates(one: SavedResult, other: SavedResult) -> bool:
    """Whether two results hold the same estimates."""
    return one.parameters == other.parameters and one.beside == other.beside


class Comparisons(tuple[Comparison, ...], Shown):
    """Results compared with the first one: a tuple that prints as the tables of ``elid compare``."""

    def __repr__(self) -> str:
        return f"Comparisons(<{len(self)} x Comparison>)"


def compare(results: Sequence[Result]) -> Comparisons:
    """Compare every result with the first.

    Parameters
    ----------
    results
        Files saved with ``--json``, what `read_result` made of them, or what `identify` and `diagnose` return.

    Raises
    ------
    UsageError
        Fewer than two results, or two without a base parameter that both estimate, or of robots without a common
        joint.
    """
    check_list("compare: results", results, "results")
    if len(results) < 2:
        raise UsageError("compare: one result given, at least two are needed", hint="elid compare A.json B.json")
    first, *others = as_saved(results)
    return Comparisons(_compare(first, other) for other in others)


def _changes_beside(first: SavedResult, other: SavedResult) -> Iterator[Change]:
    """Yield what both results have beside their base parameters; an offset that does not show in one is 0 there.

    Unless its joint is none of that one's robot.
    """
    library, every = effect_classes(), {**first.beside, **other.beside}
    for name, one in every.items():
        both = [result.beside.get(name) for result in (first, other)]
        effect, _, joint = name.rpartition(": ")[0].partition(" of ")
        held = all(joint in result.joints for result in (first, other) if result.joints)
        if held and effect in library and library[effect].nuisance in OFFSETS:
            both = [Estimate(0.0, one.std_error, one.unit) if e is None else e for e in both]
        if both[0] is not None and both[1] is not None:
            yield Change(name, one.unit, both[0], both[1])


def _compare(first: SavedResult, other: SavedResult) -> Comparison:
    if unlike(first.joints, other.joints):
        raise UsageError(
            f"{other.file}: of another robot than {first.file}",
            detail=f"its joints are {first_of(other.joints, JOINTS)}; the others are {first_of(first.joints, JOINTS)}",
            hint=ONE_ROBOT,
        )
    shared = [name for name in first.parameters if name in other.parameters]
    if not shared:
        raise UsageError(
            f"{other.file}: shares no base parameter with {first.file}",
            detail=f"they are of {other.robot} and {first.robot}",
        )
    units = tuple({name: e.unit for name, e in result.parameters.items()} for result in (first, other))
    alike = comparable((first.joints, other.joints), (units[0], units[1]))
    if not alike:
        raise UsageError(
            f"{other.file}: of another robot than {first.file}",
            detail=f"no joint of {in_words(other.joints, JOINTS)} is one of {in_words(first.joints, JOINTS)}",
        )
    changes = tuple(
        Change(name, first.parameters[name].unit, first.parameters[name], other.parameters[name]) for name in alike
    )
    every = (*first.parameters, *other.parameters)
    alone = tuple(dict.fromkeys(name for name in every if name not in shared))
    apart = tuple(name for name in shared if name not in alike)
    found = Comparison(first, other, changes, alone, apart, tuple(_changes_beside(first, other)))
    if len(found.refused) == len(changes):
        what = f"{other.file}: no base parameter that it and {first.file} both estimate"
        raise UsageError(what, detail=f"not shown by one of the logs: {', '.join(found.refused[:6])}")
    return found


def _parameters(entries: Any, where: str) -> dict[str, Estimate]:
    well_formed = isinstance(entries, list) and all(isinstance(e, dict) and "name" in e for e in entries)
    if not well_formed:
        raise UsageError(f"{where}: holds no base parameters", hint="compare results of identify or diagnose")
    return {str(entry["name"]): _estimate(entry) for entry in entries}


def _estimate(entry: Mapping[str, Any]) -> Estimate:
    value, error = (number_of(entry.get(name)) for name in ("estimate", "std_error"))
    return Estimate(value, error, str(entry.get("unit", "")), entry.get("bias_possible") is True)


def _relative(error: Any) -> dict[str, float]:
    if not isinstance(error, dict):
        return {}
    found = {str(j): number_of(e.get("relative")) for j, e in error.items() if isinstance(e, dict)}
    return {joint: value for joint, value in found.items() if value is not None}

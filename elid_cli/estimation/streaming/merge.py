"""Identification from reduced logs: what was found of each, put together as if they had been read at once."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.assembly import assemble, judged, with_pull_of_noise, with_scatter, with_unseen
from elid_cli.estimation.default_fit import DefaultFit, fit_data
from elid_cli.estimation.facts import joined_facts
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.triangles import Triangles
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.estimation.smooth_commands import noted
from elid_cli.estimation.stiffness.link_equation import LinkStiffness
from elid_cli.estimation.stiffness.links import merged_stiffness
from elid_cli.estimation.streaming.between_logs import Together, together
from elid_cli.estimation.streaming.merged import MergedTriangles, TriangleData, counted, numbers_of
from elid_cli.estimation.streaming.reduced_log import ReducedLog
from elid_cli.estimation.streaming.scores import lifted
from elid_cli.estimation.stretches import STRETCHES
from elid_cli.estimation.validation.cross_validation import joint_errors
from elid_cli.estimation.validation.differing_logs import with_differing_logs
from elid_cli.estimation.validation.prediction import ByLog
from elid_cli.estimation.validation.sufficiency import judged_model
from elid_cli.logs.checks.required import refuse_mixed
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.robot import Robot
from elid_cli.robot.text import fingerprint
from elid_cli.signals.recording import Recording, Segment, notices_of, repeated, without_samples

STANDS_OUT = 2.0
"""Distance of a log from the others' mean, in units of their range, from which it is named."""
UNREAD = "the joint torque sensors (tau_link) are used where one log is identified by itself, and not in reduced logs"


def identify_reduced(
    robot: Robot, logs: Sequence[ReducedLog], options: EstimateOptions | None = None
) -> tuple[Identification, tuple[ByLog, ...]]:
    """Estimate the base parameters of a robot from reduced logs, and tell how well each log is predicted.

    Raises
    ------
    UsageError
        The logs are of another robot, or were reduced under different options.
    DataError
        The logs excite no parameter at all.
    """
    options = options or EstimateOptions()
    check_alike(robot, logs)
    whole, robot = robot, robot.stiffened(logs[0].facts.unlinked).read_behind(logs[0].facts.link_torque)
    model = Regressor(robot)
    check_columns(model, logs)
    base = find_base(model)
    data = merged_data(model, logs)
    fit = fit_data(base, data, options)
    if len(logs) > 1:
        fit = replace(fit, covariance=_together(data, logs, fit).of_few(fit.transform))
    fit, refused, found = judged(fit, options)
    said = [log.judgement for log in logs]
    fit = with_pull_of_noise(with_scatter(fit, *said), said, [log.facts.instants for log in logs])
    if fit.doubted:
        found = assemble(fit, options, refused)
    found = with_unseen(found, whole)
    if any("tau_link" in log.recording.sources and not log.facts.link_torque.all() for log in logs):
        found = replace(found, notes=(*found.notes, UNREAD))
    found = judged_model(found, *said)
    if len(logs) > 1 and (apart := _together(data, logs, fit)).disagree:
        found = replace(found, notes=(*found.notes, _disagreement(apart, logs, fit)))
        found = with_differing_logs(found, apart.moved(fit.transform), said, [log.name for log in logs])
    if options.fit == "auto" and all(log.facts.computed.all() for log in logs):
        from elid_cli.estimation.trajectory.unasked import pointed_out

        found = pointed_out(found)
    found = noted(found, logs[0].recording)
    return found, _by_log(model, logs, fit)


def merged_data(model: Regressor, logs: Sequence[ReducedLog]) -> TriangleData:
    """Return the data of reduced logs together."""
    merged = _merged(model, logs)
    facts = joined_facts([log.facts for log in logs])
    reference = model.robot.reference()
    alike = [log for log in logs if np.array_equal(log.reference, reference, equal_nan=True)]

    def by_links(joint: int) -> LinkStiffness | None:
        return merged_stiffness([s for log in alike if (s := log.links[joint])], float(facts.deflection_noise[joint]))

    def spread(solution: Solution, nuisances: Sequence[int], gliding: NDArray[np.bool_]) -> Array:
        return together(logs, merged, solution, nuisances, gliding).covariance

    slow = logs[0].options.get("min_velocity") is not None
    return TriangleData(model, facts, merged, spread, by_links, np.zeros(model.robot.n, dtype=bool), slow)


def _disagreement(found: Together, logs: Sequence[ReducedLog], fit: DefaultFit) -> str:
    """Return a sentence on logs that differ by more than their noise."""
    chances, names = found.chances(fit.transform), fit.base.names
    moved = np.flatnonzero(found.moved(fit.transform))
    first = sorted(moved, key=lambda k: float(chances[k]))
    said = (
        f"the logs disagree by more than their noise, most in {names[first[0]]}"
        f"{_others(len(first) - 1)}: their standard errors include the difference between logs"
    )
    odd = _standing_out((found.pulls @ fit.transform[:, fit.solution.basis].T)[:, first[0]])
    return said if odd is None else f"{said}; {logs[odd].name} stands out from the others"


def _others(count: int) -> str:
    return f" and {count} other{'' if count == 1 else 's'}" if count else ""


def _together(data: TriangleData, logs: Sequence[ReducedLog], fit: DefaultFit) -> Together:
    return together(logs, data.merged, fit.solution, data.numbers(fit.nuisances), _counted(fit))


def _standing_out(pulls: Array) -> int | None:
    """Return the log whose pull on a parameter, (logs,), lies beyond all others' by more than they scatter."""
    if len(pulls) < 3:
        return None
    odd = int(np.argmax(np.abs(pulls - np.median(pulls))))
    others = np.delete(pulls, odd)
    away = abs(float(pulls[odd] - others.mean()))
    return odd if away > STANDS_OUT * max(float(np.ptp(others)), 1e-300) else None


def check_alike(robot: Robot, logs: Sequence[ReducedLog]) -> None:
    """Refuse logs that cannot be merged (UsageError), and say why."""
    own = fingerprint(robot)
    for log in logs:
        if log.fingerprint != own:
            raise UsageError(
                f"{log.name}: reduced for another robot than {robot.name}",
                detail=f"fingerprint {log.fingerprint[:12]}, that of {robot.name} is {own[:12]}: joints, geometry, "
                "gravity, gears, transmissions or declared effects differ",
                hint=f"elid reduce LOG --robot {shlex.quote(robot.given or robot.name)} -o FILE.npz",
            )
    refuse_mixed([log.name for log in logs], np.array([log.facts.unlinked for log in logs]), robot.joint_names)
    behind = np.array([log.facts.link_torque for log in logs])
    for joint in np.flatnonzero(behind.any(axis=0) & ~behind.all(axis=0))[:1]:
        less = logs[int(np.argmax(behind[:, joint]))].name
        raise UsageError(
            f"{less}: only the joint torque sensor of {robot.joint_names[joint]}, where other logs hold motor torque",
            hint="identify logs with motor torques, and those without, apart",
        )
    first = logs[0]
    for log in logs[1:]:
        keys = dict.fromkeys([*first.options, *log.options])
        differing = [key for key in keys if log.options.get(key) != first.options.get(key)]
        if differing:
            told = "; ".join(
                f"{key}: {_told(first.options.get(key))} and {_told(log.options.get(key))}" for key in differing
            )
            raise UsageError(
                f"{log.name}: reduced under other options than {first.name}",
                detail=told,
                hint="reduce both with the same options",
            )


def check_columns(model: Regressor, logs: Sequence[ReducedLog]) -> None:
    """Refuse logs whose columns are not the model's (LogError), though the robot is the same: no elid wrote them."""
    own = {item.row: item.columns.tolist() for item in model.estimation.rows}
    for log in logs:
        theirs = {row: index[:-2].tolist() for row, index in log.layout}
        if theirs != own or log.recording.joints != model.robot.joint_names or len(log.reference) != model.parameters:
            raise LogError(
                f"{log.name}: damaged, or not written by this elid",
                detail=f"its columns are not those of {model.robot.name}",
                hint="run elid reduce again",
            )


def joined_recording(logs: Sequence[ReducedLog]) -> Recording:
    """Return what is known of all logs, as if they had been read at once; it holds no samples."""
    if len(logs) == 1:
        return logs[0].recording
    parts = [log.recording for log in logs]
    segments, samples, files = [], 0, 0
    for part in parts:
        segments += [Segment(s.start + samples, s.stop + samples, s.source + files) for s in part.segments]
        samples, files = samples + part.samples, files + len(part.files)
    names = tuple(file for part in parts for file in part.files)
    digests = tuple(digest for part in parts for digest in part.sha256)
    repairs, notes, warnings = (notices_of(parts, kind) for kind in ("repairs", "notes", "warnings"))
    return without_samples(
        parts[0].joints,
        parts[0].dt,
        samples,
        segments=tuple(segments),
        files=names,
        sha256=digests,
        repairs=tuple(repairs),
        notes=tuple(notes),
        warnings=(*warnings, *repeated(names, digests)),
        sources={name: place for part in reversed(parts) for name, place in part.sources.items()},
        smooth=parts[0].smooth,
    )


def _merged(model: Regressor, logs: Sequence[ReducedLog]) -> MergedTriangles:
    steady = tuple(t for log in logs for t in log.steady)
    reversing = tuple(t for log in logs for t in log.reversing)
    return MergedTriangles(model.parameters, model.robot.n, STRETCHES, steady, reversing)


def _by_log(model: Regressor, logs: Sequence[ReducedLog], fit: DefaultFit) -> tuple[ByLog, ...]:
    """Return the merged result's error on each of several logs."""
    if len(logs) < 2:
        return ()
    merged, numbers, n = _merged(model, logs[:1]), numbers_of(fit.nuisances, model.robot.n), model.robot.n
    values, _ = lifted(fit.solution, logs[0].layout, merged, numbers)
    apart = []
    for log in logs:
        triangles = Triangles(tuple(counted(log, _counted(fit))), model.parameters, 2 * n, STRETCHES)
        squares: dict[EstimationRow, Array | float] = {}
        for triangle in triangles.items:
            squares[triangle.row] = squares.get(triangle.row, 0.0) + triangle.squares(values)
        apart.append(ByLog(", ".join(log.recording.files), joint_errors(model.robot, triangles, squares)))
    return tuple(apart)


def _counted(fit: DefaultFit) -> NDArray[np.bool_]:
    """Return the joints whose reversals count in a fit to triangles, (n,)."""
    if not isinstance(fit.data, TriangleData):
        raise TypeError("not a fit to triangles")
    return fit.data.gliding


def _told(value: object) -> str:
    return "chosen from the log" if value is None else str(value)

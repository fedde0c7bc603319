"""Identification from reduced logs: what was found of each, put together as if they had been read at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.default_fit import DefaultFit
from elid_cli.estimation.identify import assemble, missing_link_named
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.nuisances import DELAY, OFFSET
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.estimation.stiffness.link_equation import LinkStiffness, with_both_regressions, with_link_stiffness
from elid_cli.estimation.stiffness.noise import stiffness_in_noise, with_pull
from elid_cli.estimation.streaming.fit import MergedFit, MergedTriangles, fit_stock
from elid_cli.estimation.streaming.links import merged_stiffness, merged_ways
from elid_cli.estimation.streaming.reduce import FOLDS
from elid_cli.estimation.streaming.reduced_log import ReducedLog, SignalFacts
from elid_cli.estimation.streaming.scores import lifted, spread_of
from elid_cli.estimation.validation.cross_validation import joint_errors
from elid_cli.estimation.validation.prediction import ByLog
from elid_cli.logs.checks.required import refuse_mixed
from elid_cli.model.base_parameters import BaseParameters, find_base
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.robot import Robot
from elid_cli.robot.text import fingerprint
from elid_cli.signals.lowpass import LowPass
from elid_cli.signals.motion import Motion
from elid_cli.signals.recording import Recording, Segment, notices_of, repeated
from elid_cli.signals.signals import Noise, Signals

UNREAD = "the joint torque sensors (tau_link) are used where one log is identified by itself, and not in reduced logs"


def identify_reduced(robot: Robot, logs: Sequence[ReducedLog]) -> tuple[Identification, tuple[ByLog, ...]]:
    """Estimate the base parameters of a robot from reduced logs, and tell how well each log is predicted.

    Raises
    ------
    UsageError
        The logs are of another robot, or were reduced under different options.
    DataError
        The logs excite no parameter at all.
    """
    check_alike(robot, logs)
    whole, robot = robot, robot.stiffened(logs[0].facts.unlinked)
    model = Regressor(robot)
    check_columns(model, logs)
    base = find_base(model)
    stock = _stock(model, logs)
    dt = max(log.facts.dt for log in logs)

    def covariance(solution: Solution, nuisances: Sequence[int], gliding: NDArray[np.bool_]) -> Array:
        return _covariance(logs, stock, solution, nuisances)

    fit = fit_stock(stock, base.count, dt, covariance)
    judged = _as_fit(model, base, logs, fit)
    noise = _mean_square([log.facts.deflection_noise for log in logs], [log.facts.instants for log in logs])
    refused = stiffness_in_noise(model, fit.triangles, fit.solution.basis, noise)
    pulled = with_pull(model, fit.triangles, judged.solution, judged.covariance, noise)
    judged = replace(judged, covariance=pulled)
    found = assemble(judged, EstimateOptions(), refused)
    found = replace(found, settings={**found.settings, **_counts(logs, fit)})
    alike = [log for log in logs if np.array_equal(log.reference, robot.reference(), equal_nan=True)]
    standard = found.standard
    found = with_both_regressions(found, lambda joint: merged_ways(model, stock, fit, standard, joint))

    def by_links(joint: int) -> LinkStiffness | None:
        return merged_stiffness([s for log in alike if (s := log.links[joint])], float(noise[joint]))

    found = with_link_stiffness(found, by_links, base.classes)
    found = missing_link_named(found, whole)
    if any("tau_link" in log.recording.sources for log in logs):
        found = replace(found, notes=(*found.notes, UNREAD))
    return found, _by_log(model, logs, fit)


def check_alike(robot: Robot, logs: Sequence[ReducedLog]) -> None:
    """Refuse logs that cannot be merged (UsageError), and say why."""
    own = fingerprint(robot)
    for log in logs:
        if log.fingerprint != own:
            raise UsageError(
                f"{log.name}: reduced for another robot than {robot.name}",
                detail=f"fingerprint {log.fingerprint[:12]}, that of {robot.name} is {own[:12]}: joints, geometry, "
                "gravity, gears, transmissions or declared effects differ",
                hint=f"elid reduce LOG --robot {robot.name} -o FILE.npz",
            )
    refuse_mixed([log.name for log in logs], np.array([log.facts.unlinked for log in logs]), robot.joint_names)
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
    empty = np.broadcast_to(np.nan, (samples, parts[0].n))
    return Recording(
        joints=parts[0].joints,
        dt=parts[0].dt,
        t=np.broadcast_to(np.nan, (samples,)),
        q=empty,
        theta=empty,
        tau=empty,
        segments=tuple(segments),
        files=names,
        sha256=digests,
        repairs=tuple(repairs),
        notes=tuple(notes),
        warnings=(*warnings, *repeated(names, digests)),
        sources={name: place for part in reversed(parts) for name, place in part.sources.items()},
    )


def _stock(model: Regressor, logs: Sequence[ReducedLog]) -> MergedTriangles:
    return MergedTriangles(
        model.parameters,
        model.robot.n,
        FOLDS,
        tuple(t for log in logs for t in log.steady),
        tuple(t for log in logs for t in log.reversing),
    )


def _covariance(
    logs: Sequence[ReducedLog], stock: MergedTriangles, solution: Solution, nuisances: Sequence[int]
) -> Array:
    """Return the covariance of a solution's basis: the logs' scores are independent of each other."""
    meat: Array = np.zeros((len(solution.basis),) * 2)
    lags = []
    for log in logs:
        _, lift = lifted(solution, log.layout, stock, nuisances)
        scores = next((s for s in log.scores if s.nuisances == tuple(nuisances)), log.scores[0])
        meat = meat + lift.T @ scores.gram @ lift
        lags.append(scores.bandwidth)
    instants = np.array([log.facts.instants for log in logs])
    return spread_of(solution, meat, int(instants.sum()), float(np.average(lags, weights=instants)))


def _as_fit(model: Regressor, base: BaseParameters, logs: Sequence[ReducedLog], fit: MergedFit) -> DefaultFit:
    """Return the fit as verdicts ask for it; its signals are a few instants that stand for the logs."""
    n = model.robot.n
    nuisances = tuple(
        ExtraColumns(
            DELAY if k < n else OFFSET, {EstimationRow("sum", k % n): np.zeros((1, 0))}, ("s" if k < n else "N·m",)
        )
        for k in fit.nuisances
    )
    nothing = np.zeros((n, 0))
    blind = np.zeros((n, 0), dtype=bool)
    observation = Observation(
        model.robot, (), model.parameters, nothing[0], np.zeros(0, dtype=np.intp), nothing, nothing, 0.0, blind, blind
    )
    return DefaultFit(
        model,
        base,
        standing_for([log.facts for log in logs], model.robot),
        observation,
        nuisances,
        None,
        fit.triangles,
        fit.solution,
        fit.covariance,
    )


def standing_for(facts: Sequence[SignalFacts], robot: Robot) -> Signals:
    """Return signals of a few instants with the poses, noise and options of the logs."""
    poses = np.concatenate([f.poses for f in facts])
    rest = np.zeros_like(poses)
    weights = [f.instants for f in facts]
    torque = np.any([f.torque for f in facts], axis=0)
    first = facts[0]
    noise = [_mean_square([f.noise[k] for f in facts], weights) for k in range(3)]
    motion = Motion(np.arange(len(poses)) / first.rate, poses, rest, rest, poses, rest, rest)
    return Signals(
        joints=robot.joint_names,
        dt=1.0 / first.rate,
        motion=motion,
        tau=np.where(torque, rest, np.nan),
        tau_link=None,
        temperature=None,
        segments=(Segment(0, len(poses)),),
        noise=Noise(*noise),
        knots=np.min([f.knots for f in facts], axis=0),
        filter=LowPass(np.ones(1), 1, first.cutoff),
        margin=0,
        min_velocity=np.max([f.min_velocity for f in facts], axis=0),
        still=np.all([f.still for f in facts], axis=0),
        velocity_used=np.array([any(f.velocity_used for f in facts)]),
    )


def _counts(logs: Sequence[ReducedLog], fit: MergedFit) -> dict[str, object]:
    known = np.sum([log.facts.known for log in logs], axis=0)
    used = np.zeros_like(known)
    for log in logs:
        for triangle in log.steady:
            used[triangle.row.joint] += triangle.count if triangle.row.kind == "sum" else 0
        for triangle in log.reversing:
            if triangle.row.kind == "sum" and fit.gliding[triangle.row.joint]:
                used[triangle.row.joint] += triangle.count
    masked = (known - used) / np.maximum(known, 1)
    return {"instants": int(sum(log.facts.instants for log in logs)), "masked": [float(share) for share in masked]}


def _by_log(model: Regressor, logs: Sequence[ReducedLog], fit: MergedFit) -> tuple[ByLog, ...]:
    """Return the merged result's error on each of several logs."""
    if len(logs) < 2:
        return ()
    values = fit.solution.values
    judged = []
    for log in logs:
        triangles = _stock(model, [log]).chosen(fit.gliding, fit.nuisances)
        squares = {row: sum(t.squares(values) for t in triangles.of(row)) for row in triangles.rows}
        judged.append(ByLog(", ".join(log.recording.files), joint_errors(model.robot, triangles, squares)))
    return tuple(judged)


def _mean_square(values: Sequence[Array], weights: Sequence[int]) -> Array:
    mean: Array = np.sqrt(np.average(np.square(values), axis=0, weights=weights))
    return mean


def _told(value: object) -> str:
    return "chosen from the log" if value is None else str(value)

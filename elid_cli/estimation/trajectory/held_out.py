"""Verdicts on what simulated motion gives, and its torque errors on blocks of time that values were found without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.regression.observation import observe
from elid_cli.estimation.result import Identification, Verdict, records
from elid_cli.estimation.validation.prediction import validate
from elid_cli.estimation.validation.verdicts import HELD, REFUSED, WEAK
from elid_cli.model.effects.posed import posed
from elid_cli.model.effects.shifts import Shifts, corrected
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals


def held_out_errors(
    left_out: Sequence[Robot], spans: Sequence[tuple[int, float, float]], signals: Signals, found: Identification
) -> dict[str, JointError]:
    """Return torque errors of every block of time, predicted by the robot that was found without it.

    Parameters
    ----------
    left_out
        Robots found without each block, (B,).
    spans
        Recording, first and last time of every block, s, (B,).
    signals
        The logs, with torques that act when they say.
    found
        What least squares say of them: the noise floors.
    """
    robot = posed(found.robot)
    observation = observe(Regressor(replace(robot, effects=())), signals)
    sources = np.array([segment.source for segment in signals.segments], dtype=np.intp)[observation.segment]
    # squared errors of sum row, of motor row, of the torque; samples of both rows
    sums = np.zeros((robot.n, 5))
    for without, (source, first, last) in zip(left_out, spans, strict=True):
        inside = (sources == source) & (observation.t >= first) & (observation.t <= last)
        judged = validate(without, signals, inside, observation=observation)
        counts = {group.row: int(np.count_nonzero(group.use & inside)) for group in observation.groups}
        for name, error in judged.error.items():
            k = robot.joint_names.index(name)
            own, motor = counts[EstimationRow("sum", k)], counts.get(EstimationRow("motor", k), 0)
            spring = 0.0 if error.spring_rms is None else error.spring_rms
            sums[k] += [error.rms**2 * own, spring**2 * motor, error.torque_rms**2 * own, own, motor]
    result = {}
    for name, (squares, squares_of_spring, torques, count, springs) in zip(
        robot.joint_names, sums.tolist(), strict=True
    ):
        if not count:
            continue
        rms, torque = float(np.sqrt(squares / count)), float(np.sqrt(torques / count))
        known = found.error.get(name)
        of_spring = float(np.sqrt(squares_of_spring / springs)) if springs else None
        result[name] = JointError(
            rms, rms / torque, of_spring, None if of_spring is None else of_spring / torque, torque,
            known.floor if known is not None else None, known.spring_floor if known is not None else None,
        )  # fmt: skip
    return result


def with_late_commands(signals: Signals, delays: Array) -> Signals:
    """Return the signals with torques of commands that act later than logged, s, (R, n), by recording and joint."""
    tau = signals.tau.copy()
    for source, late in enumerate(delays):
        own = corrected(signals, replace(Shifts.none(signals.n), torque=late)).tau
        for segment in signals.segments:
            if segment.source == source:
                tau[segment.start : segment.stop] = own[segment.start : segment.stop]
    return replace(signals, tau=tau)


def by_simulated_motion(
    found: Identification, estimate: Array, spread: Array, reference: Array,
    still: NDArray[np.bool_] | None = None, **told: Any,
) -> Identification:  # fmt: skip
    """Return the identification with base parameters (b,) and their covariance (b, b) from simulated motion.

    Parameters
    ----------
    found
        What least squares say of the same log.
    estimate, spread, reference
        Base parameters, their covariance, 0 of what is held, and reference values.
    still
        Base parameters that the motion does not depend on, (b,), as those of joints that stay where they are.
    told
        What else changes: ``notes`` are added, ``settings`` are what JSON says of the fit.
    """
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    if still is not None:
        deviation = np.where(still, np.nan, deviation)
    verdicts, reasons = verdicts_of(found, estimate, deviation)
    refused = np.array([verdict == "refused" for verdict in verdicts])
    parameters, covariance = records(found.base, estimate, spread, refused, reference, verdicts, reasons)
    told["notes"] = (*found.notes, *told["notes"])
    told["settings"] = {**found.settings, "estimator": "trajectory", "trajectory": told["settings"]}
    return replace(
        found, parameters=parameters, covariance=covariance, estimator="trajectory", **{"warnings": (), **told}
    )  # fmt: skip


def verdicts_of(found: Identification, estimate: Array, deviation: Array) -> tuple[tuple[Verdict, ...], dict[str, str]]:
    """Return verdicts on base parameters (b,) from their standard errors, and reasons by name.

    Errors are 0 of what is held, and NaN of what the motion does not depend on.
    """
    verdicts: list[Verdict] = []
    reasons: dict[str, str] = {}
    for item, value, error in zip(found.parameters, estimate, deviation, strict=True):
        if error == 0:
            verdicts.append("refused")
            reasons[item.leader] = f"{HELD} (--fit trajectory)"
        elif np.isnan(error):
            verdicts.append("refused")
            reasons[item.leader] = f"{found.robot.joint_names[item.leader.joint]} does not move"
        elif not error <= REFUSED * abs(value):
            verdicts.append("refused")
            reasons[item.leader] = f"standard error {error:.2g} against a value of {value:.2g}"
        elif error > WEAK * abs(value):
            verdicts.append("weak")
            reasons[item.leader] = f"known to {100 * error / abs(value):.0f} % only"
        else:
            verdicts.append("supported")
    return tuple(verdicts), reasons

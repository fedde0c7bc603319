"""The paper's own estimator, to compare with (section 6, eqs. 36-38).

Positions go through a causal fifth-order Butterworth filter of 20 Hz and first differences; ordinary least squares
on the 2n link and motor rows, without motor rows slower than 0.5 rad/s. The link rows have a right-hand side of 0 and
a spring that multiplies a noisy deflection, so noise biases everything: that is what the paper's Table 2 shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.errors import DataError
from elid_cli.estimation.assembly import weighed
from elid_cli.estimation.data import SampledData, Solved
from elid_cli.estimation.regression.least_squares import Solution, solve
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.triangles import Triangles, to_triangles
from elid_cli.estimation.result import EstimateOptions, Identification
from elid_cli.estimation.stretches import stretch_of
from elid_cli.estimation.validation.cross_validation import all_others, joint_errors, left_out
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.robot import Robot
from elid_cli.signals.lowpass import low_pass
from elid_cli.signals.motion import Motion
from elid_cli.signals.signals import Signals

CUTOFF = 20.0
"""Hz."""
ORDER = 5
SLOWEST = 0.5
"""Speed, rad/s, below which a motor row is not used."""
SLIDING = 0.1
"""The same for a sliding joint, of which the paper has none, as a part of its largest speed."""
_SETTLING = 0.2
"""Seconds that the causal filter takes to settle, dropped at every segment's start."""


@dataclass(frozen=True)
class RateNoise:
    """Noise added after filtering and differentiation, as the paper words it: standard deviations by signal, (n,)."""

    standard_deviation: dict[str, Array]
    seed: int = 0


def identify_paper(
    robot: Robot, signals: Signals, options: EstimateOptions, noise: RateNoise | None = None
) -> Identification:
    """Estimate by the paper's procedure.

    Raises
    ------
    DataError
        If the log is slower than the paper's filter allows, or excites nothing.
    """
    model = Regressor(robot)
    base = find_base(model)
    classical = classical_signals(signals, robot, noise)
    speed = np.abs(classical.motion.dtheta)
    revolute = np.array([joint.revolute for joint in robot.joints], dtype=bool)
    slowest = np.where(revolute, SLOWEST, SLIDING * speed.max(axis=0))
    slow = speed < slowest
    observation = _without(observe(model, classical, model.equations, mask=False), slow[classical.outputs].T)
    fold = stretch_of(observation.instants, options.folds)
    triangles = to_triangles(observation, (), fold)
    equal = dict.fromkeys(triangles.rows, 1.0)
    solution = solve(triangles, equal, rank=base.count)
    fit = Solved(base, SampledData(model, signals, observation, fold), (), None, triangles, solution)
    power = sum(t.squares(solution.values) for t in triangles.items)
    spare = max(sum(t.count for t in triangles.items) - len(solution.basis), 1)
    spread = base.transform[:, solution.basis] @ solution.inverse
    error = joint_errors(robot, *_prediction(model, signals, triangles, solution, options))
    settings = {
        "cutoff": CUTOFF,
        "rate": 1.0 / classical.dt,
        "instants": observation.instants,
        "min_velocity": slowest.tolist(),
        "estimator": "paper",
        "folds": options.folds,
    }
    found = weighed(fit, spread @ spread.T * power / spare, error, {}, lenient=True)
    return replace(found, settings=settings, estimator="paper")


def _without(observation: Observation, slow: NDArray[np.bool_]) -> Observation:
    groups = tuple(
        g if g.row.kind == "link" else replace(g, use=g.use & ~slow[g.row.joint]) for g in observation.groups
    )
    return replace(observation, groups=groups)


def classical_signals(signals: Signals, robot: Robot, noise: RateNoise | None = None) -> Signals:
    """Return the log's signals filtered by a causal Butterworth filter and differentiated, torque filtered alike."""
    from scipy.signal import butter, sosfilt, sosfilt_zi

    recording = signals.recording
    if recording is None or 2.2 * CUTOFF * recording.dt >= 1.0:
        raise DataError(f"the paper's estimator needs a log faster than {2.2 * CUTOFF:g} Hz")
    dt = recording.dt
    sections = butter(ORDER, CUTOFF, fs=1.0 / dt, output="sos")
    state = sosfilt_zi(sections)[:, :, None]

    def filtered(values: Array) -> Array:
        out = np.full_like(values, np.nan)
        for s in signals.segments:
            part = values[s.start : s.stop]
            part = np.where(np.isfinite(part), part, np.nan_to_num(part[:1]))
            out[s.start : s.stop] = sosfilt(sections, part, axis=0, zi=state * part[0])[0]
        return out

    def differences(values: Array) -> Array:
        out = np.zeros_like(values)
        out[1:] = np.diff(values, axis=0) / dt
        for s in signals.segments:
            out[s.start] = 0.0
        return out

    elastic = robot.elastic
    present = np.isfinite(recording.theta).any(axis=0)
    link = np.where(elastic | ~present, recording.q, recording.theta)
    motor = np.where(elastic | present, recording.theta, recording.q)
    q, theta = filtered(link), filtered(motor)
    states = {"q": q, "dq": differences(q), "theta": theta, "dtheta": differences(theta)}
    states["ddq"], states["ddtheta"] = differences(states["dq"]), differences(states["dtheta"])
    if noise is not None:
        generator = np.random.default_rng(noise.seed)
        for name, deviation in noise.standard_deviation.items():
            states[name] = states[name] + deviation * generator.standard_normal(q.shape)
    still = signals.still
    for name in ("dq", "ddq", "dtheta", "ddtheta"):
        states[name][:, still] = 0.0
    motion = Motion(recording.t, **states)
    return replace(
        signals,
        motion=motion,
        tau=np.where(np.isfinite(recording.tau), filtered(recording.tau), np.nan),
        filter=low_pass(float("inf"), dt, 1),
        margin=round(_SETTLING / dt),
        recording=recording,
    )


def _prediction(
    model: Regressor, signals: Signals, triangles: Triangles, solution: Solution, options: EstimateOptions
) -> tuple[Triangles, dict[EstimationRow, Array]]:
    """Return sum and motor rows, filtered as the default estimator does, and squares predicted from other folds."""
    observation = observe(model, signals, model.estimation)
    rows = to_triangles(observation, (), stretch_of(observation.instants, options.folds))
    rank = len(solution.basis)
    fits = (solve(triangles, solution.weights, others, rank).values for others in all_others(triangles.folds))
    return rows, left_out(rows, fits)

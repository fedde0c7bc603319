"""Noise of positions pulls what their second derivatives decide: by what is foretold, and the errors know of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.estimation.assembly import with_pull_of_noise
from elid_cli.estimation.cutoff import fit_best
from elid_cli.estimation.default_fit import DefaultFit, fit_data
from elid_cli.estimation.identify import identify
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.streaming.merge import merged_data
from elid_cli.estimation.streaming.reduce import reduce_each
from elid_cli.estimation.streaming.reduced_log import ReducedLog
from elid_cli.estimation.validation.column_noise import joined, pull_of
from elid_cli.estimation.validation.sufficiency import judge_model
from elid_cli.experiment.reference import ReferenceOptions
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import robot_from_text
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare

ARM = """\
name: arm
gravity: [0, -9.81, 0]
dh: modified
joints:
  - {name: shoulder, a: 0, alpha: 0, d: 0, theta: 0, gear_ratio: 100, transmission: elastic,
     parameters: {m: 9, cx: 1.89, cy: 0.108, Izz: 0.648, Jm: 1.6e-4, fs: 4, fv: 5, K: 9000}}
  - {name: elbow, a: 0.45, alpha: 0, d: 0, theta: 0, gear_ratio: 80, transmission: elastic,
     parameters: {m: 4, cx: 0.68, cy: -0.04, Izz: 0.196, Jm: 7.8e-5, fs: 1.8, fv: 2.2, K: 3500}}
"""
NOISE = 1.2e-4
"""Of the encoders, rad."""
DRAWN = 16


def test_what_noise_pulls_is_foretold() -> None:
    """Of the values that only accelerations of the first joint decide, over logs of one small motion."""
    full = robot_from_text(ARM, "arm.yaml")
    robot = replace(full, joints=tuple(replace(joint, parameters={}) for joint in full.joints))
    model = Regressor(robot)
    base, options = find_base(model), EstimateOptions()
    motion = ReferenceOptions(amplitude=0.03, interval=0.5)
    sensors = SensorOptions(torque_noise=0.02)
    exact = simulate(full, SimulationOptions(duration=15.0, rate=500.0, seed=4, reference=motion, sensors=sensors))
    truth, conditioned = base.values(full.reference()), SignalOptions(cutoff=7.0, knots=0.014)
    rng = np.random.default_rng(0)

    def fitted(noise: float) -> DefaultFit:
        q, theta = (x + noise * rng.standard_normal(x.shape) for x in (exact.q, exact.theta))
        return fit_best(model, base, prepare(replace(exact, q=q, theta=theta), robot, conditioned), options)

    def widened(fit: DefaultFit) -> DefaultFit:
        return with_pull_of_noise(fit, [judge_model(fit)])

    fits = [widened(fitted(NOISE)) for _ in range(DRAWN)]
    off = np.array([fit.transform @ fit.solution.values - truth for fit in fits])
    error, pull = off.std(axis=0) / np.sqrt(DRAWN), np.mean([fit.pull.sum(axis=1) for fit in fits], axis=0)
    leaders = [base.parameters[k] for k in base.leaders]
    decided = [leaders.index(name) for name in ("m2", "cx1", "cy1", "Jm1")]
    assert (np.abs(off.mean(axis=0) - pull) < 0.5 * np.abs(off.mean(axis=0)) + 3.0 * error)[decided].all()
    assert (np.abs(pull) > 0.3 * np.abs(off.mean(axis=0)))[decided].all()
    sizes = [np.hypot(fit.deviations(fit.covariance), np.linalg.norm(fit.pull, axis=1)) for fit in fits]
    assert np.sqrt(np.mean((off / sizes)[:, decided] ** 2)) < 1.3
    # fine encoders leave the errors as they are
    assert widened(fitted(1e-7)).pull is None


def logged(seed: int, motion: ReferenceOptions, noise: float) -> tuple[Robot, Recording, np.ndarray]:
    full = robot_from_text(ARM, "arm.yaml")
    robot = replace(full, joints=tuple(replace(joint, parameters={}) for joint in full.joints))
    sensors = SensorOptions(position_noise=noise, torque_noise=0.02)
    log = simulate(full, SimulationOptions(duration=15.0, rate=500.0, seed=seed, reference=motion, sensors=sensors))
    return robot, log, find_base(Regressor(robot)).values(full.reference())


def test_a_log_that_tells_little_does_not_spoil_a_good_one() -> None:
    robot, good, _ = logged(1, ReferenceOptions(), 1e-5)
    _, weak, _ = logged(4, ReferenceOptions(amplitude=0.02, interval=0.5), NOISE)
    reduced = [reduce_each(robot, prepare(log, robot), {})[0] for log in (good, weak)]
    model = Regressor(robot)
    base = find_base(model)

    def pulled(logs: list[ReducedLog]) -> tuple[np.ndarray, np.ndarray]:
        fit = fit_data(base, merged_data(model, logs), EstimateOptions())
        columns = joined([log.judgement.columns for log in logs if log.judgement], [log.facts.instants for log in logs])
        return np.linalg.norm(pull_of(fit, columns), axis=1), fit.deviations(fit.covariance)

    fine, coarse, both = pulled(reduced[:1]), pulled(reduced[1:]), pulled(reduced)
    assert (fine[0] / fine[1]).max() < 0.2
    assert (coarse[0] / coarse[1]).max() > 0.8
    large = coarse[0] > 0.5 * coarse[1]
    assert (both[0] < 0.1 * coarse[0])[large].all()


def test_where_noise_is_nearly_all_nothing_is_called_known() -> None:
    for seed in range(3):
        robot, log, truth = logged(seed, ReferenceOptions(amplitude=0.03, interval=0.5), 3e-3)
        found = identify(robot, prepare(log, robot))
        for item, value in zip(found.parameters, truth, strict=True):
            if item.verdict == "supported" and item.leader.kind not in ("fs", "fv", "K"):
                assert abs(item.estimate - value) < 4.0 * item.std_error

"""The output-error fit of logs with torque, on motions of the simulator, whose steps it does not share."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.estimation.output_error.march import Steps, march
from elid_cli.experiment.simulation import ControlOptions, SimulationOptions, run
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.reproduce.paper_logs import log_of, motion_of

ROBOT = read_robot("planar2")


@cache
def log(seed: int, level: float = 80.0) -> Recording:
    return log_of(motion_of(ROBOT, seed), level, seed, rates=False)[0]


def fitted(robot: Robot, recording: Recording) -> Identification:
    return identify(robot, prepare(recording, robot), EstimateOptions(fit="trajectory", guards=False))


@cache
def by_motion(seed: int) -> Identification:
    return fitted(ROBOT, log(seed))


def scores(found: Identification) -> list[float]:
    z = (found.estimate - found.reference) / found.std_error
    known: list[float] = z[np.isfinite(z)].tolist()
    return known


def test_elastic_joints_are_recovered_and_intervals_hold() -> None:
    every = []
    for seed in (1, 4):
        found = by_motion(seed)
        error = found.relative_error()
        assert np.nanmax(error) < 0.03
        assert found.normalised_mean_error() < 0.005
        every += scores(found)
    assert np.mean(np.abs(every) < 1.96) >= 0.9
    assert np.sqrt(np.mean(np.square(every))) < 1.4


def test_it_is_nearer_than_least_squares_where_only_positions_are_noisy() -> None:
    plain = identify(ROBOT, prepare(log(1), ROBOT), EstimateOptions(guards=False))
    assert by_motion(1).normalised_mean_error() < 0.5 * plain.normalised_mean_error()


def test_noise_of_the_torques_is_in_the_intervals() -> None:
    noise = 0.003 * log(1).tau.std(axis=0) * np.random.default_rng(5).standard_normal(log(1).tau.shape)
    found = fitted(ROBOT, replace(log(1), tau=log(1).tau + noise))
    assert np.sqrt(np.mean(np.square(scores(found)))) < 1.8
    quiet = by_motion(1)
    ratio = found.std_error / quiet.std_error
    assert np.nanmedian(ratio) > 2


def test_a_late_torque_and_an_offset_are_found_along() -> None:
    clean = log(1)
    late = np.stack([np.interp(clean.t + 0.004, clean.t, column) for column in clean.tau.T], axis=1)
    found = fitted(ROBOT, replace(clean, tau=late + np.array([2.0, -1.0])))
    offsets = {n.joint: n.parameters["offset"] for n in found.nuisances if n.effect == "torque_offset"}
    delays = [n.parameters["delay"] for n in found.nuisances if n.effect == "torque_delay"]
    assert offsets["joint1"] == pytest.approx(2.0, abs=0.1)
    assert offsets["joint2"] == pytest.approx(-1.0, abs=0.05)
    assert delays == pytest.approx([0.004, 0.004], abs=2e-4)


def test_rigid_joints_are_recovered() -> None:
    rigid = replace(ROBOT, joints=tuple(
        replace(j, transmission="rigid", parameters={k: v for k, v in j.parameters.items() if k != "K"})
        for j in ROBOT.joints))  # fmt: skip
    made = run(rigid, SimulationOptions(duration=8.0, seed=3, control=ControlOptions(continuous=True)))
    noise = 1e-5 * np.random.default_rng(1).standard_normal(made.recording.q.shape)
    recording = replace(made.recording, q=made.recording.q + noise, theta=made.recording.q + noise)
    found = fitted(rigid, recording)
    assert np.nanmax(found.relative_error()) < 0.03
    assert np.sqrt(np.mean(np.square(scores(found)))) < 1.8


def test_what_it_does_not_know_is_refused() -> None:
    with pytest.raises(LogError, match=r"too noisy \(.* dB\)"):
        fitted(ROBOT, log(1, 40.0))
    braked = replace(ROBOT, effects=(EffectSpec("link_viscous", "joint1", {"friction": 0.1}),))
    with pytest.raises(UsageError, match="it holds no effects"):
        fitted(braked, log(1))


def test_the_command_says_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "log.csv"
    assert main(["simulate", "--robot", "planar2", "--duration", "6", "--noise-db", "90", "-o", str(file)]) == 0
    capsys.readouterr()
    assert main(["identify", str(file), "--robot", "planar2", "--fit", "trajectory", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["estimator"] == "trajectory"
    own = told["settings"]["trajectory"]
    assert own["windows"] * own["window"] < 6
    assert max(own["position_rms"].values()) < 1e-4
    assert set(told["error"]) == {"joint1", "joint2"}
    assert told["error"]["joint1"]["spring_rms"] > 0


def test_what_least_squares_see_elsewhere_may_be_biased() -> None:
    loaded = replace(
        ROBOT, effects=(EffectSpec(effect="load_friction", joint="joint2", parameters={"coefficient": 0.05}),)
    )
    signals = prepare(log_of(motion_of(loaded, 1, 5.0), 80.0, 1, rates=False)[0], ROBOT)
    by_motion, by_torque = (identify(ROBOT, signals, EstimateOptions(fit=fit)) for fit in ("trajectory", "torque"))
    assert by_motion.model == "insufficient"
    apart = [
        abs(one.estimate - other.estimate) / float(np.hypot(one.std_error, other.std_error))
        for one, other in zip(by_motion.parameters, by_torque.parameters, strict=True)
    ]
    assert np.nanmax(apart) > 2
    for one, other, far in zip(by_motion.parameters, by_torque.parameters, apart, strict=True):
        assert one.bias_possible is (other.bias_possible or far > 2), one.name


def test_sensitivities_are_those_of_the_steps() -> None:
    generator = np.random.default_rng(0)
    count, windows, m, c = 40, 3, 2, 3
    made = generator.standard_normal((count, windows, m, m))
    mass = np.eye(m) + 0.1 * (made + np.swapaxes(made, -1, -2))
    damping, slope = (0.3 * generator.standard_normal((count, windows, m, m)) for _ in range(2))
    drive, columns = generator.standard_normal((count, windows, m)), generator.standard_normal((count, windows, m, c))
    grip = np.broadcast_to([0.3, 0.2], (count, windows, m))
    grips = np.zeros((1, 1, m, c))
    grips[..., 0, 1] = 1.0
    x, v = generator.standard_normal((2, windows, m))

    def steps(unknown: np.ndarray) -> Steps:
        return Steps(mass, damping, slope, drive - columns @ unknown, columns, grip + grips[0, 0] @ unknown, grips,
                     np.arange(m), 0.05)  # fmt: skip

    at = np.zeros(c)
    _, _, slopes = march(steps(at), x, v)
    for k in range(c):
        moved = 1e-7 * np.eye(c)[k]
        change = (march(steps(at + moved), x, v)[0] - march(steps(at - moved), x, v)[0]) / 2e-7
        np.testing.assert_allclose(slopes[..., k], change, atol=1e-5)
    for k in range(m):
        moved = np.zeros_like(v)
        moved[:, k] = 1e-7
        change = (march(steps(at), x, v + moved)[0] - march(steps(at), x, v - moved)[0]) / 2e-7
        np.testing.assert_allclose(slopes[..., c + m + k], change, atol=1e-5)
    assert (march(steps(at), x, v)[1][1:] == 0).any() or (
        np.diff(np.sign(march(steps(at), x, v)[1]), axis=0) != 0
    ).any()

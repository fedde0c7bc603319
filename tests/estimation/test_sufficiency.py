"""What identify says of a model that is not enough, on logs of the second simulator."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.estimation.judgement import Judgement
from elid_cli.estimation.validation.prediction import validate
from elid_cli.estimation.validation.sufficiency import judge_prediction
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.system.plain_arms import Laws, Sensors, World, log, random_arm
from tests.system.reproduce import inverse_logs

ROOT = Path(__file__).parents[2]


def made(
    seed: int, sensors: Sensors, law: Callable[[World], np.ndarray] | None = None, rigid: tuple[int, ...] = ()
) -> tuple[Robot, Recording]:
    arm = random_arm(np.random.default_rng(seed), 2, rigid)
    laws = Laws(motor=(law,)) if law else None
    return arm.described(), log(arm, seed=seed, duration=15.0, sensors=sensors, laws=laws)


def told(robot: Robot, recording: Recording) -> Identification:
    return identify(robot, prepare(recording, robot))


def scores(found: Identification) -> np.ndarray:
    return np.array([(p.estimate - p.reference) / p.std_error for p in found.parameters])


def stribeck(world: World) -> np.ndarray:
    extra = np.zeros_like(world.dtheta)
    speed = world.dtheta[:, 1]
    extra[:, 1] = 1.5 * world.arm.coulomb[1] * np.exp(-((speed / 0.2) ** 2)) * np.sign(speed)
    return extra


def load_friction(world: World) -> np.ndarray:
    extra = np.zeros_like(world.dtheta)
    extra[:, 1] = 0.08 * np.abs(world.spring[:, 1]) * np.sign(world.dtheta[:, 1])
    return extra


@pytest.mark.parametrize("memory", [0.0, 0.06])
def test_noise_is_no_lack_whatever_its_memory(memory: float) -> None:
    for seed in (31, 32):
        found = told(*made(seed, Sensors(bits=17, torque=0.005, memory=memory)))
        assert found.model == "sufficient"
        assert not any(p.bias_possible for p in found.parameters)
        ratio = max(item.ratio for item in found.noise)
        assert ratio > 2 if memory else ratio < 1.3
        assert np.abs(scores(found)).max() < 4


def test_a_missing_friction_curve_is_seen_and_marks_friction_only() -> None:
    found = told(*made(33, Sensors(bits=17), stribeck))
    assert found.model == "insufficient"
    assert {(item.joint, item.follows) for item in found.insufficient} <= {
        ("joint2", "motor speed"), ("joint2", "link speed"),
    }  # fmt: skip
    marked = {p.leader for p in found.parameters if p.bias_possible}
    assert "fs2" in marked
    assert marked <= {"fs2", "fv2"}
    wrong = {p.leader for p, z in zip(found.parameters, scores(found), strict=True) if abs(z) > 4}
    assert wrong <= marked  # what is not marked is right


@pytest.mark.parametrize("seed", [21, 23, 25])
def test_friction_of_a_link_stands_between_two_equations_and_is_no_noise(seed: int) -> None:
    made = inverse_logs.make(seed, 2)
    size = 0.6 * made.truth.joints[0].parameters["fs"]

    def bearing(world: inverse_logs.World) -> np.ndarray:
        extra = np.zeros_like(world.q)
        extra[:, 0] = size * np.sign(world.dq[:, 0])
        return extra

    logged = inverse_logs.log_of(made, inverse_logs.Laws(link=[bearing]))
    sensors = {"db": 90.0, "counts": 2e5, "torque": 0.003, "colour": 0.0}
    found = told(made.robot, inverse_logs.recorded(made, logged, **sensors, seed=seed))
    assert {(item.joint, item.follows) for item in found.insufficient} == {("j1", "rows")}
    marked = {p.leader for p in found.parameters if p.bias_possible}
    assert {"fs1", "fv1", "K1"} <= marked
    assert not {"fs2", "fv2", "K2", "Jm2", "m2"} & marked  # bodies behind it may rest on its torque


def test_what_the_deflection_alone_holds_is_no_noise_of_the_torque() -> None:
    made = inverse_logs.make(21, 2)
    logged = inverse_logs.log_of(made, inverse_logs.Laws())
    logged["theta"][:, 0] += 5e-5 * np.sin(37.0 * logged["theta"][:, 0])
    sensors = {"db": 90.0, "counts": 2e5, "torque": 0.003, "colour": 0.0}
    found = told(made.robot, inverse_logs.recorded(made, logged, **sensors, seed=21))
    (item,) = found.insufficient
    assert (item.joint, item.rows, item.follows) == ("j1", "motor", "deflection alone")
    assert "K1" in {p.leader for p in found.parameters if p.bias_possible}


def test_a_torque_of_the_wrong_sign_is_told_by_the_stiffness() -> None:
    robot, recording = made(39, Sensors(bits=17))
    bare = replace(robot, joints=tuple(replace(joint, parameters={}) for joint in robot.joints))
    found = told(bare, replace(recording, tau=recording.tau * np.array([1.0, -1.0])))
    (stiffness,) = (p for p in found.parameters if p.leader == "K2")
    assert stiffness.verdict == "refused"
    assert "wrong sign, or q and theta are swapped" in stiffness.reason


def test_friction_by_load_of_a_rigid_joint_is_seen() -> None:
    found = told(*made(34, Sensors(bits=17), load_friction, (0, 1)))
    assert {item.joint for item in found.insufficient} == {"joint2"}


def test_constants_of_a_torque_that_lacks_something_may_be_biased() -> None:
    """Friction that grows with the load goes into Coulomb friction, which no curve over the motion moves so far."""
    for seed in (36, 37, 38):
        found = told(*made(seed, Sensors(bits=17), load_friction))
        assert {"fs2", "fv2"} <= {p.leader for p in found.parameters if p.bias_possible}


@pytest.mark.parametrize(("delay", "rate"), [(1.5, 1000.0), (5.0, 1000.0), (20.0, 1000.0), (1.5, 200.0)])
def test_a_torque_that_acts_late_bends_nothing(delay: float, rate: float) -> None:
    found = told(*made(35, Sensors(bits=17, delay=delay, rate=rate)))
    delays = [n.parameters["delay"] for n in found.nuisances if n.effect == "torque_delay"]
    assert delays == pytest.approx([delay / rate] * 2, abs=1e-4)
    assert not any(n.bias_possible for n in found.nuisances)
    assert np.abs(scores(found)).max() < 4
    assert found.model == "sufficient"


def test_gates_know_of_an_insufficient_model(capsys: pytest.CaptureFixture[str]) -> None:
    lacking, clean = (str(ROOT / "sample_logs" / f"{name}.h5") for name in ("planar2_stribeck", "planar2"))

    def run(*arguments: str) -> tuple[int, dict[str, Any]]:
        status = main(["identify", "--robot", "planar2", "--json", *arguments])
        return status, json.loads(capsys.readouterr().out)

    status, answer = run(lacking)
    assert (status, answer["model"]) == (0, "insufficient")
    assert {p["name"] for p in answer["base_parameters"] if p["bias_possible"]} == {"fs1", "fs2", "fv1", "fv2"}
    assert set(answer["noise"]["joint1"]) == {"sum", "motor"}
    assert run(lacking, "--fail-on-insufficient")[0] == 1
    assert run(lacking, "--require-independent", "fs1")[0] == 1
    assert run(lacking, "--require-independent", "K1")[0] == 0
    assert run(clean, "--fail-on-insufficient")[0] == 0


def judged(robot: Robot, recording: Recording) -> Judgement:
    return judge_prediction(validate(robot, prepare(recording, robot)))


def test_a_described_robot_is_told_from_one_that_lacks_something() -> None:
    sensors = Sensors(bits=17, torque=0.005)
    robot, recording = made(51, sensors)
    right = judged(robot, recording)
    assert (right.model, right.misfitted) == ("sufficient", ())

    first = robot.joints[0]
    other = replace(first, parameters={**first.parameters, "fs": 1.3 * first.parameters["fs"]})
    wrong = judged(replace(robot, joints=(other, *robot.joints[1:])), recording)
    assert (wrong.model, {item.joint for item in wrong.misfitted}) == ("sufficient", {first.name})

    _, lacking = made(51, sensors, stribeck)
    said = judged(robot, lacking)
    assert (said.model, {item.joint for item in said.insufficient}) == ("insufficient", {robot.joint_names[1]})


def test_validate_says_what_the_residual_follows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(ROOT / "sample_logs" / "planar2_stribeck.h5")
    assert main(["validate", log, "--robot", "planar2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["model"] == "insufficient"
    assert all(error["floor"] < error["rms"] for error in told["error"].values())
    assert {item["joint"] for item in told["insufficient"]} == {"joint1", "joint2"}
    assert main(["validate", log, "--robot", "planar2", "--fail-on-insufficient"]) == 1
    assert "the model is insufficient: the residual of joint1" in capsys.readouterr().err


def test_the_accurate_estimate_says_of_the_model_what_the_default_says() -> None:
    robot, recording = made(52, Sensors(bits=17, torque=0.005), stribeck)
    signals = prepare(recording, robot)
    default, accurate = (identify(robot, signals, EstimateOptions(accurate=a)) for a in (False, True))
    assert default.model == accurate.model == "insufficient"
    assert [i.joint for i in default.insufficient] == [i.joint for i in accurate.insufficient]

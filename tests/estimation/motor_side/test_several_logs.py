"""Several logs of one machine: what each shows of a stiffness is put together, or said not to agree."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli import identify, prepare
from elid_cli.cli import main
from elid_cli.estimation.motor_side.result import MotorSide, MotorSideJoint
from elid_cli.estimation.motor_side.several import put_together
from elid_cli.logs import read_recording, write_recording
from elid_cli.robot.text import text_of
from tests.system.motor_arms import Case, motor_log, random_motor_arm, told_robot

CASE = Case(signal_to_noise=70.0, duration=6.0)


def joint(stiffness: float, error: float, systematic: float = 0.0) -> MotorSideJoint:
    return MotorSideJoint(
        "a", 0, "supported", stiffness, float(np.hypot(error, systematic)), systematic, antiresonance=8.0, rigid_to=3.0,
        resonance=12.0, band=20.0, gates={"error": error / stiffness},
    )  # fmt: skip


REFUSED = MotorSideJoint("a", 0, "refused", band=20.0, failed=("misfit",), reason="the model does not reach it")


def together(*joints: MotorSideJoint) -> MotorSideJoint:
    sides = [(f"{k}.h5", MotorSide((item,))) for k, item in enumerate(joints)]
    (found,) = put_together(sides, len(sides)).joints
    return found


def test_logs_that_agree_give_their_weighted_mean_and_a_smaller_error() -> None:
    found = together(joint(1000.0, 2.0), joint(1003.0, 1.0))
    assert found.stiffness == pytest.approx((1000 / 4 + 1003) / (1 / 4 + 1))
    assert found.std_error == pytest.approx((1 / 4 + 1) ** -0.5)
    assert found.says == "shown by 2 of 2 logs"
    assert [name for name, _ in found.by_log] == ["0.h5", "1.h5"]


def test_what_friction_may_hide_is_common_to_all_logs() -> None:
    found = together(joint(1000.0, 1.0, 5.0), joint(1000.0, 1.0, 5.0), joint(1000.0, 1.0, 5.0))
    assert found.systematic == pytest.approx(5.0)
    assert found.std_error == pytest.approx(np.hypot(5.0, 3**-0.5))


def test_logs_that_disagree_count_their_difference_as_an_error() -> None:
    found = together(joint(1000.0, 1.0), joint(1010.0, 1.0))
    assert found.stiffness == pytest.approx(1005.0)
    assert found.std_error == pytest.approx(5.0)  # half of the difference
    assert "disagree" in found.says


def test_a_log_without_an_answer_takes_none_away() -> None:
    found = together(REFUSED, joint(1000.0, 1.0))
    assert (found.verdict, found.stiffness, found.says) == ("supported", 1000.0, "shown by 1 of 2 logs")


def test_a_rigid_joint_in_another_log_refuses_it_where_that_log_would_have_shown_it() -> None:
    rigid = replace(REFUSED, failed=("gain",))
    found = together(joint(1000.0, 1.0), rigid)
    assert found.verdict == "refused"
    assert np.isnan([found.stiffness, found.std_error, found.rigid_to, found.resonance]).all()
    assert "1.h5 passes the antiresonance and shows a rigid joint" in found.says
    assert together(joint(1000.0, 1.0), replace(rigid, band=8.0)).verdict == "supported"


def test_no_log_that_shows_it_is_said_with_the_nearest_reason() -> None:
    found = together(replace(REFUSED, band=2.0, reason="too slow"), REFUSED)
    assert found.reason == "none of 2 logs shows it; the model does not reach it"
    found = put_together([("0.h5", MotorSide((REFUSED,)))], 9).joints[0]
    assert "none of 1 logs that were asked, of 9, shows it" in found.reason


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    arm, made = random_motor_arm(np.random.default_rng([1, 77]), 1), tmp_path_factory.mktemp("logs")
    for seed in (1, 2):
        log = replace(motor_log(arm, seed, CASE), sources={})
        write_recording(replace(log, q=np.full_like(log.q, np.nan)), made / f"{seed}.h5")
    (made / "arm.yaml").write_text(text_of(told_robot(arm, 1)))
    return made


def test_identify_asks_each_of_several_logs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = random_motor_arm(np.random.default_rng([1, 77]), 1)
    logs = [str(folder / f"{seed}.h5") for seed in (1, 2)]
    assert main(["identify", *logs, "--robot", str(folder / "arm.yaml"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["motor_side"]["joints"]["joint1"]
    assert told["verdict"] == "supported"
    assert told["stiffness"] == pytest.approx(arm.stiffness[0], rel=0.003)
    assert list(told["by_log"]) == logs
    assert told["std_error"] < min(own["std_error"] for own in told["by_log"].values())
    robot = told_robot(arm, 1)
    found = identify(robot, prepare(read_recording(logs, robot), robot))
    assert found.motor_side is not None
    assert found.motor_side.joints[0].stiffness == pytest.approx(told["stiffness"], rel=1e-6)


def test_triangles_have_no_samples_to_ask(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, stored = str(folder / "arm.yaml"), str(folder / "stored.npz")
    assert main(["reduce", str(folder / "1.h5"), "--robot", arm, "-o", stored]) == 0
    assert main(["identify", stored, "--robot", arm]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "stored triangles hold no samples: identify the log itself" in said

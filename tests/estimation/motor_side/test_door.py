"""`identify` asks the motor side where a joint is elastic and its link position is not logged."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from elid_cli import EstimateOptions, Identification, SignalOptions, identify, prepare
from elid_cli.cli import main
from elid_cli.diagnosis import DiagnoseOptions, Diagnosis, FoundEffect, diagnose
from elid_cli.diagnosis.result import Unexplained
from elid_cli.estimation.motor_side import door
from elid_cli.estimation.motor_side.hidden import hidden_joints
from elid_cli.estimation.refined_robot import identified_robot, with_stiffnesses
from elid_cli.logs import read_recording, write_recording
from elid_cli.logs.checks.required import COUNTS_AS_RIGID
from elid_cli.report.answers.elasticity_words import own_elasticity, taken_as_rigid
from elid_cli.report.answers.identification_json import identification_payload
from elid_cli.report.answers.lacking import words_of
from elid_cli.report.figures import figures_of, panels_of
from elid_cli.report.figures.drawing import Rule
from elid_cli.report.figures.input import FigureInput
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec
from elid_cli.robot.text import text_of
from elid_cli.signals.recording import Recording, Segment
from tests.system.motor_arms import Case, motor_log, random_motor_arm, told_robot
from tests.system.plain_arms import Arm

CASE = Case(signal_to_noise=70.0, duration=8.0)


def arm_of(rigid: tuple[int, ...] = ()) -> Arm:
    return random_motor_arm(np.random.default_rng([1, 77]), 1, rigid)


def identified(arm: Arm) -> Identification:
    robot, log = told_robot(arm, 1), motor_log(arm, 1, CASE)
    log = replace(log, q=np.full_like(log.q, np.nan))
    return identify(robot, prepare(log, robot))


@pytest.fixture(scope="module")
def elastic() -> Identification:
    return identified(arm_of())


def test_a_supported_stiffness_is_a_base_parameter_like_others(elastic: Identification) -> None:
    payload, true = identification_payload(elastic), float(arm_of().stiffness[0])
    (entry,) = [item for item in payload["base_parameters"] if item["name"] == "K1"]
    assert (entry["verdict"], entry["unit"]) == ("supported", "N·m/rad")
    assert entry["estimate"] == pytest.approx(true, rel=0.005)
    assert elastic.this_log["K1"] == "independent"
    assert "K1" not in elastic.reasons
    place = payload["base_parameters"].index(entry)
    assert payload["covariance"][place][place] == pytest.approx(entry["std_error"] ** 2)
    told = payload["motor_side"]["joints"]["joint1"]
    assert told["stiffness"] == entry["estimate"]
    assert told["next_motion"] is None


def test_the_other_parameters_are_fitted_below_where_rigid_joints_hold(elastic: Identification) -> None:
    assert elastic.motor_side is not None
    (joint,) = elastic.motor_side.joints
    assert elastic.settings["cutoff"] == pytest.approx(joint.rigid_to)
    assert any("those of rigid joints" in note and "fitted below it" in note for note in elastic.notes)
    assert not any("cannot be identified" in note for note in elastic.notes)


def in_errors(found: Identification) -> dict[str, float]:
    """Return how far parameters are off the truth, in their standard errors, by leader."""
    true = arm_of().described().stiffened(np.array([True]))
    off = found.estimate - found.base.values(true.reference())
    return {str(item.leader): float(off[k] / found.std_error[k]) for k, item in enumerate(found.parameters)}


def test_what_the_joint_yields_is_taken_out_of_the_other_parameters(elastic: Identification) -> None:
    off = in_errors(elastic)
    assert all(abs(value) < 3.0 for value in off.values()), off
    assert elastic.motor_side is not None
    assert elastic.motor_side.corrected
    assert not any(item.bias_possible for item in elastic.parameters)
    cutoff = elastic.settings["cutoff"]
    assert isinstance(cutoff, float)
    robot, log = told_robot(arm_of(), 1), motor_log(arm_of(), 1, CASE)
    signals = prepare(replace(log, q=np.full_like(log.q, np.nan)), robot, SignalOptions(cutoff=cutoff))
    rigid = identify(robot, signals, EstimateOptions(guards=False))  # does not ask the motor side
    assert abs(in_errors(rigid)["m1"]) > 3.0


def test_parameters_that_elasticity_bends_are_not_called_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = replace(motor_log(arm_of(), 1, CASE), sources={})
    write_recording(replace(log, q=np.full_like(log.q, np.nan)), tmp_path / "log.h5")
    (tmp_path / "arm.yaml").write_text(text_of(told_robot(arm_of(), 1)))
    ask = ["identify", str(tmp_path / "log.h5"), "--robot", str(tmp_path / "arm.yaml"), "--cutoff", "9"]
    assert main([*ask, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert not told["motor_side"]["corrected"]
    biased = {item["name"].split()[0] for item in told["base_parameters"] if item.get("bias_possible")}
    assert {"m1", "cx1", "cy1"} <= biased
    assert main(ask) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "what is missing? The elasticity of joint1, whose stiffness was found" in said
    assert "Stiffness from the motor's side: known (joint1 to " in said
    assert "Nothing that this log shows" not in said
    assert "several joints" not in said


def test_friction_that_holds_a_load_is_not_called_known() -> None:
    log = motor_log(arm_of(), 1, replace(CASE, load_friction=np.array([0.05])))
    log, robot = replace(log, q=np.full_like(log.q, np.nan)), told_robot(arm_of(), 1)
    true = float(arm_of().coulomb[0])
    found = identify(robot, prepare(log, robot))
    (fs,) = [item for item in found.parameters if str(item.leader) == "fs1"]
    far = abs(fs.estimate - true)
    assert far > 0.1 * true
    assert fs.bias_possible
    assert "Friction that grows with the load at joint1 (5 % of the load)" in words_of(found)
    declared = replace(robot, effects=(EffectSpec("load_friction", "joint1"),))
    found = identify(declared, prepare(log, declared))
    (fs,) = [item for item in found.parameters if str(item.leader) == "fs1"]
    assert abs(fs.estimate - true) < min(3 * fs.std_error, far)
    assert not fs.bias_possible
    assert "grows with the load" not in words_of(found)


@pytest.mark.parametrize("elastic", [True, False])
def test_diagnose_says_that_a_mode_may_be_the_joint_itself(elastic: bool) -> None:
    log, robot = motor_log(arm_of(), 1, CASE), told_robot(arm_of(), 1)
    log = replace(log, q=np.full_like(log.q, np.nan))
    if not elastic:
        robot = replace(robot, joints=(replace(robot.joints[0], transmission="rigid"),))
    found = diagnose(robot, prepare(log, robot), DiagnoseOptions(only=("flexible_mode",)))
    assert isinstance(found, Diagnosis)
    mode = FoundEffect("flexible_mode", "joint1", {}, {}, 0.9, "")
    assert ("the elasticity of joint1 itself" in own_elasticity(found, mode)) == elastic
    assert own_elasticity(found, replace(mode, effect="stribeck")) == ""
    # what is left where nothing was found may be that as well
    left = Unexplained("joint1", "sum", "load", 0.3, 1.0, 20.0, ())
    said = taken_as_rigid(replace(found, effects=(), unexplained=(left,)))
    assert ("The robot file has joint1 elastic" in said) == elastic
    geared = robot.joints[0].gear_ratio is not None
    assert ("The robot file has joint1 rigid; a transmission that yields" in said) == (geared and not elastic)
    line = f"joint1: {COUNTS_AS_RIGID}, but motor and link position differ"
    read = SimpleNamespace(rows_after=(), unexplained=(left,), recording=SimpleNamespace(warnings=(line,)))
    said = taken_as_rigid(cast("Diagnosis", read))
    assert said == " The transmission of joint1 yields: declared elastic, what that does is taken out."


def test_a_written_robot_is_elastic_where_the_stiffness_is_supported(elastic: Identification) -> None:
    robot = with_stiffnesses(identified_robot(elastic), elastic)
    assert robot.joints[0].elastic
    assert robot.joints[0].parameters["K"] == elastic.motor_side.joints[0].stiffness  # type: ignore[union-attr]
    assert robot.joints[0].parameters["Jm"] > 0


def test_a_refused_one_has_no_number_and_says_what_would_show_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = arm_of(rigid=(0,))
    log = replace(motor_log(arm, 1, CASE), sources={})
    write_recording(replace(log, q=np.full_like(log.q, np.nan)), tmp_path / "log.h5")
    (tmp_path / "arm.yaml").write_text(text_of(told_robot(arm, 1)))
    assert main(["identify", str(tmp_path / "log.h5"), "--robot", str(tmp_path / "arm.yaml")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "joint1 not shown – – – – –" in said
    assert "K1: not shown by this log (" in said
    assert "torque multisine" in said
    assert "Stiffness from the motor's side: not shown by this log (joint1)" in said
    assert "The robot file has joint1 elastic: what that does to the parameters is not known" in said
    assert "may be biased" in said
    assert f"elid excite --robot {tmp_path / 'arm.yaml'} -o stiffness.csv --show-stiffness joint1:" in said


def test_a_found_joint_has_a_figure_of_its_response(elastic: Identification) -> None:
    (figure,) = [item for item in figures_of(FigureInput(identified=elastic)) if item.kind == "response"]
    assert elastic.motor_side is not None
    (joint,) = elastic.motor_side.joints
    assert f"resonance {joint.resonance:.3g} Hz" in figure.caption
    (panel,) = panels_of(figure).panels
    rules = [mark.x for mark in panel.marks if isinstance(mark, Rule)]
    assert rules == [joint.rigid_to, joint.antiresonance, joint.resonance]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_long_log_with_both_positions_is_not_taken_into_memory_to_see_that(tmp_path: Path) -> None:
    samples, robot = 2_000_000, read_robot("planar2")
    values = np.memmap(tmp_path / "values", dtype=np.float64, mode="w+", shape=(samples, 2))
    values[:] = 1.0
    values.flush()
    mapped = np.memmap(tmp_path / "values", dtype=np.float64, mode="r", shape=(samples, 2)).view(np.ndarray)
    del values
    t = np.broadcast_to(0.0, (samples,))
    log = Recording(robot.joint_names, 1e-3, t, q=mapped, theta=mapped, tau=mapped, segments=(Segment(0, samples),))

    def in_memory() -> int:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("RssFile")) << 10

    before = in_memory()
    assert hidden_joints(robot, log) == []
    assert in_memory() - before < mapped.nbytes / 4


def test_a_cut_off_that_leaves_no_sample_away_from_reversals_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """So low, the filter reaches from every sample to a reversal: the fit of a log full of motion ended in an error."""
    robot = read_robot("planar2")
    log = read_recording([str(Path(__file__).parents[3] / "sample_logs" / "planar2.csv")], robot)
    signals = prepare(log, robot)
    usual = identify(robot, signals)
    monkeypatch.setattr(door, "below_resonance", lambda used, _: replace(used.refiltered(0.1), cutoff_free=False))
    found = identify(robot, signals)
    assert found.settings["cutoff"] == usual.settings["cutoff"]
    np.testing.assert_array_equal(found.standard, usual.standard)

"""Diagnosis of command logs on a plant that shares no code with elid, and on a measured quadruped."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from elid_cli import compiling
from elid_cli.cli import main
from elid_cli.diagnosis.by_motion import whole_robot
from elid_cli.diagnosis.by_motion.candidates import best_of, kinds_of, screened
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.measured import is_clean, measured_views
from elid_cli.diagnosis.by_motion.refits import grown
from elid_cli.diagnosis.by_motion.views import own_unknowns, seen_by, views_of
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import ABOVE
from elid_cli.estimation.trajectory.found_effects import fitted_effects
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.model import rollout_loops
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.library.stribeck import Stribeck
from elid_cli.signals.recording import Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, NAMES, OFFSET, VISCOUS, moved, robot, written

SCHEMA = json.loads((Path(__file__).parents[3] / "docs" / "reference" / "elid-1.schema.json").read_text("utf-8"))


def told(capsys: pytest.CaptureFixture[str], *line: str) -> dict[str, Any]:
    assert main([*line, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert not [error.message for error in Draft202012Validator(SCHEMA).iter_errors(found)]
    return found


def joint_parameters(found: dict[str, Any]) -> dict[tuple[str, str], tuple[float, float]]:
    joints = found["settings"]["trajectory"]["joint_parameters"].items()
    return {(j, k): (v["estimate"], v["std_error"]) for j, own in joints for k, v in own.items()}


def test_nothing_is_missing_from_a_clean_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = robot(tmp_path).source
    found = told(capsys, "diagnose", written(tmp_path, "clean.h5", moved(duration=5.0, sweep=0.28)), "--robot", path)
    assert found["judged_by"] == "motion"
    assert found["effects"] == []
    assert found["unexplained"] == []
    known = joint_parameters(found)
    for k, name in enumerate(NAMES):
        for kind, truth in (("Ja", ARMATURE), ("fs", COULOMB), ("fv", VISCOUS), ("offset", OFFSET)):
            value, error = known[name, kind]
            assert value == pytest.approx(truth[k], rel=0.03, abs=0.005), (name, kind)
            assert abs(value - truth[k]) < 4 * error, (name, kind)


def test_effects_that_no_motion_is_searched_for_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, log = robot(tmp_path).source, written(tmp_path, "clean.h5", moved(duration=6.0))
    for line in (("--only", "contact"), ("--only", "contact", "--only", "flexible_mode")):
        assert main(["diagnose", log, "--robot", path, *line]) == 2
        said = capsys.readouterr().err
        assert "contact" in said
        assert "link_spring" in said
        assert "--lookup" in said
    # what is asked for in part is told in part
    found = told(capsys, "diagnose", log, "--robot", path, "--only", "contact", "--only", "link_spring")
    assert found["untried"] == ["contact"]
    assert main(["diagnose", log, "--robot", path]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "No effect that was tried by motion brings the motion nearer" in said
    assert "Not tried by motion" in said
    assert "payload" in said
    assert "that elid knows" not in said


def test_wrong_gains_are_named_in_place_of_a_spring_and_a_spring_is_no_gain(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = robot(tmp_path).source
    recording = moved(3, 6.0)
    factor = np.array([1.2, 1.0, 1.0])
    wrong = replace(recording, commands={
        name: values * (factor if name in ("kp", "kd") else 1.0) for name, values in recording.commands.items()
    })  # fmt: skip
    log, refined = written(tmp_path, "gains.h5", wrong), str(tmp_path / "refined.yaml")
    found = told(capsys, "diagnose", log, "--robot", path, "--write-robot", refined)
    assert [(e["effect"], e["joint"]) for e in found["effects"]] == [("torque_gain", "one")]
    (effect,) = found["effects"]
    assert abs(effect["parameters"]["gain"] - 0.2) < 4 * effect["std_error"]["gain"]
    assert effect["std_error"]["gain"] < 0.005
    assert "kp and kd" in effect["summary"]
    assert "masses" in effect["summary"]
    assert not found["unexplained"]
    assert not [w for w in found["warnings"] if "described bodies need" in w]
    known = joint_parameters(found)
    for k, name in enumerate(NAMES):
        for kind, truth in (("Ja", ARMATURE), ("fs", COULOMB), ("fv", VISCOUS)):
            assert known[name, kind][0] == pytest.approx(truth[k], rel=0.03), (name, kind)
    # the written robot moves as the log does under the gains that are logged
    off = told(capsys, "replay", log, "--robot", refined)["error"]
    assert off["one"]["mean_abs"] < 2e-4
    said = told(capsys, "identify", log, "--robot", path)["warnings"]
    assert any("computed torque of one is 1.2" in w for w in said)
    # a clean log, and a spring, which no gain imitates
    clean = told(capsys, "identify", written(tmp_path, "clean.h5", recording), "--robot", path)
    assert not [w for w in clean["warnings"] if "described bodies need" in w]
    sprung = written(tmp_path, "spring.h5", moved(3, 6.0, push=lambda x, v, load: np.array([1.5, 0, 0]) * (x - 0.3)))
    both = ("--only", "link_spring", "--only", "torque_gain")
    found = told(capsys, "diagnose", sprung, "--robot", path, *both)
    assert {(e["effect"], e["joint"]) for e in found["effects"]} == {("link_spring", "one")}
    assert "torque_gain" not in {r["effect"] for r in found["also_possible"]}
    assert not [w for w in found["warnings"] if "described bodies need" in w]


def test_a_log_that_starts_in_motion_leaves_nothing_unexplained(tmp_path: Path) -> None:
    recording = moved(7, 7.5, delay=0.03, noise=3e-5)
    later = slice(230, None)
    count = len(recording.t[later])
    recording = replace(
        recording, t=recording.t[:count], q=recording.q[later], theta=recording.q[later], tau=recording.tau[later],
        dq=None, commands={name: values[later] for name, values in recording.commands.items()},
        segments=(Segment(0, count),),
    )  # fmt: skip
    log = written(tmp_path, "late.h5", recording)
    arm = robot_as_logged(robot(tmp_path), [log], None, {})
    signals = prepare(read_recording([log], arm), arm)
    found = diagnose_motion(arm, signals)
    # what acted before the log began, and the noise of its first samples, leave more than the noise of the encoders
    assert (found.fit_after.rms > ABOVE * 3e-5).any()
    assert not found.effects
    assert not found.unexplained


def test_missing_effects_and_a_delay_are_found_and_the_written_robot_moves_better(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stiffness = np.array([1.5, 0.0, 0.0])

    def rising(x: np.ndarray, v: np.ndarray, load: np.ndarray) -> np.ndarray:
        return np.array([0.0, 0.0, 0.12 * np.sin(3.0 * x[2])])

    def log(seed: int) -> str:
        recording = moved(seed, delay=0.006, push=lambda x, v, load: stiffness * (x - 0.1), grip=rising)
        return written(tmp_path, f"run{seed}.h5", recording)

    path, out = robot(tmp_path).source, str(tmp_path / "found.yaml")
    found = told(capsys, "diagnose", log(1), "--robot", path, "--write-robot", out)
    named = {(e["effect"], e["joint"]): e for e in found["effects"]}
    assert set(named) == {("link_spring", "one"), ("position_friction", "three")}
    spring = named["link_spring", "one"]
    assert spring["parameters"]["stiffness"] == pytest.approx(1.5, abs=4 * spring["std_error"]["stiffness"])
    assert all(error["after"] <= 1.02 * error["before"] for error in found["position"].values())
    delays = [n for n in found["nuisances"] if n["effect"] == "torque_delay"]
    assert {n["joint"] for n in delays} == set(NAMES)
    assert delays[0]["parameters"]["delay"] == pytest.approx(0.006, abs=4 * delays[0]["std_error"]["delay"])
    # on a log that was not fitted
    other = log(2)
    after = told(capsys, "replay", other, "--robot", out)["mean_abs"]
    assert main(["identify", other, "--robot", path, "--fit", "trajectory", "--write-robot", out + ".plain.yaml"]) == 0
    capsys.readouterr()
    before = told(capsys, "replay", other, "--robot", out + ".plain.yaml")["mean_abs"]
    assert after < 0.5 * before
    assert after < 5e-4


def test_what_screening_prefers_at_a_joint_does_not_hide_what_is_missing_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Friction that drifts was tried in vain, and nothing else at this joint after it."""

    def grip(_: np.ndarray, v: np.ndarray, __: np.ndarray) -> np.ndarray:
        return np.array([0.6 * COULOMB[0] * np.exp(-((v[0] / 0.1) ** 2)), 0.0, 0.0])

    log = written(tmp_path, "slow.h5", moved(1, 6.0, sweep=0.15, grip=grip))
    found = told(capsys, "diagnose", log, "--robot", robot(tmp_path).source)
    assert [(e["effect"], e["joint"]) for e in found["effects"]] == [("stribeck", "one")]
    assert found["unexplained"] == []
    # what is left where one effect is all that is tried: the report says what else was not
    assert main(["diagnose", log, "--robot", robot(tmp_path).source, "--only", "link_spring"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "More than noise is left at one" in said
    assert "play and compliance of their transmissions are not tried" in said


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("line", [("diagnose", "--only", "link_spring"), ("identify", "--fit", "trajectory")])
def test_motion_without_numba_says_before_it_begins_that_it_is_slow(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, line: tuple[str, ...],
    known: bool,
) -> None:  # fmt: skip
    path, log = robot(tmp_path).source, written(tmp_path, "clean.h5", moved(duration=1.5))
    pytest.importorskip("numba")
    rollout_loops.compiled_steps()  # kept: the work itself is not made slow here
    monkeypatch.setattr(compiling, "has_numba", lambda: known)
    assert main([line[0], log, "--robot", path, *line[1:]]) == 0
    assert ("pip install numba" in capsys.readouterr().err) is not known
    assert main([line[0], log, "--robot", path, *line[1:], "--quiet"]) == 0
    assert not capsys.readouterr().err


def test_a_shape_and_its_amplitude_are_fitted_with_joint_errors(tmp_path: Path) -> None:
    log = written(
        tmp_path, "log.h5", moved(5, 6.0, grip=lambda x, v, load: 0.25 * np.exp(-np.abs(v) / 0.15) * [0, 1, 0])
    )
    arm = robot_as_logged(robot(tmp_path), [log], None, {})
    signals = prepare(read_recording([log], arm), arm)
    assert signals.recording is not None
    runs = commanded_runs(signals.recording, arm)
    start = Stribeck(1, (0.3, 1.0))  # twice as wide as it is
    fit = grown(fit_trajectory(arm, runs, started_from(arm, signals)), [start])
    (found,) = fitted_effects(arm, fit)
    for name, truth in (("amplitude", 0.25), ("velocity", 0.15)):
        assert found.parameters[name] == pytest.approx(truth, rel=0.1), name
        assert abs(found.parameters[name] - truth) < 4 * found.std_error[name], name
    alone = fit.equations.matrix.sum(axis=0)
    at, _ = fit.unknowns.shapes_of(0)
    kept = np.setdiff1d(np.arange(fit.unknowns.count), at)
    without = np.linalg.pinv(alone[np.ix_(kept, kept)])[fit.unknowns.drives, fit.unknowns.drives]
    # a shape that is not known leaves the amplitude less certain
    assert np.linalg.pinv(alone)[fit.unknowns.drives, fit.unknowns.drives] > 2 * without


def test_what_is_large_is_seen_from_the_measured_motion(tmp_path: Path) -> None:
    log = written(tmp_path, "log.h5", moved(1, 6.0, push=lambda x, v, load: np.array([0.0, 1.2, 0.0]) * v * np.abs(v)))
    arm = robot_as_logged(robot(tmp_path), [log], None, {})
    signals = prepare(read_recording([log], arm), arm)
    assert signals.recording is not None
    fit = fit_trajectory(arm, commanded_runs(signals.recording, arm), started_from(arm, signals))
    assert fit.values[1, 1] < 0.1 * COULOMB[1]  # far from the truth: Coulomb friction is gone
    views = views_of(fit)
    measured = measured_views(fit, views)
    assert is_clean(views, measured, 1)
    kinds, unknown = kinds_of(effect_classes(), ()), own_unknowns(fit.unknowns, 1)
    simulated, seen = (screened(seen_by(of, unknown, 1), 1, kinds, ()) for of in (views, measured))
    assert "quadratic_viscous" not in {c.effect.name for c in simulated if c.gain > 0.5}
    best = best_of(simulated, seen)[0]
    assert best.effect.name == "quadratic_viscous"
    assert best.effect.shape[0] == pytest.approx(2.0, abs=0.05)
    assert best.amplitudes[0] == pytest.approx(1.2, rel=0.03)


def test_from_python_and_as_tables(tmp_path: Path) -> None:
    from elid_cli import diagnose_motion, identify, prepare, read_recording, replay

    arm = robot(tmp_path)
    log = written(tmp_path, "log.h5", moved(4, 7.5, push=lambda x, v, load: np.array([1.2, 0.0, 0.0]) * x))
    arm = robot_as_logged(arm, [log], None, {})
    recording = read_recording([log], arm)
    signals = prepare(recording, arm)
    found = diagnose_motion(arm, signals, identify(arm, signals))
    assert found.to_dict()["effects"][0]["effect"] == "link_spring"
    assert "link_spring" in str(found)
    assert "MotionDiagnosis(" in repr(found)
    again = replay(found.refined, recording)
    assert again.to_dict()["mean_abs"] == pytest.approx(again.mean_abs)
    assert again.mean_abs < 4e-4
    assert "simulated minus measured position" in str(again)


def test_a_spring_may_be_a_wrong_first_moment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = written(tmp_path, "log.h5", moved(3, push=lambda x, v, load: np.array([0.4, 0.0, 0.0]) * x))
    found = told(capsys, "diagnose", log, "--robot", robot(tmp_path).source)
    assert [(e["effect"], e["joint"]) for e in found["effects"]] == [("link_spring", "one")]
    assert ("first_moment", "one") in {(r["effect"], r["joint"]) for r in found["also_possible"]}


def test_recordings_that_do_not_agree_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs = []
    for k, stiffness in enumerate((1.5, 1.5, 0.2)):
        spring = np.array([stiffness, 0.0, 0.0])
        recording = moved(10 + k, 2.5, sweep=0.4, push=lambda x, v, load, spring=spring: spring * x)
        logs.append(written(tmp_path, f"run{k}.h5", recording))
    found = told(capsys, "diagnose", *logs, "--robot", robot(tmp_path).source, "--only", "link_spring")
    assert [(e["effect"], e["joint"]) for e in found["effects"]] == [("link_spring", "one")]
    changed = [d for d in found["differing"] if d["name"] == "link_spring stiffness"]
    assert [d["joint"] for d in changed] == ["one"]
    assert changed[0]["changed_at"] == logs[2]
    np.testing.assert_allclose(changed[0]["values"], [1.5, 1.5, 0.2], atol=0.15)
    # what is written is the machine as it was last
    assert found["effects"][0]["parameters"]["stiffness"] == pytest.approx(0.2, abs=0.15)


def test_pictures_show_the_motion_and_options_of_the_other_search_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, folder = written(tmp_path, "log.h5", moved(3, 6.0)), tmp_path / "pictures"
    line = ["diagnose", log, "--robot", robot(tmp_path).source, "--only", "link_spring", "--plot", str(folder)]
    assert main([*line, "--accurate"]) == 0
    assert "--accurate and --jobs are of the search by torques" in capsys.readouterr().err
    drawn = {path.stem for path in folder.iterdir()}
    assert {path for path in drawn if path.startswith("replayed")} == {f"replayed_{name}" for name in NAMES}
    assert {"errors", "parameters"} <= drawn


def test_what_a_linear_step_cannot_tell_the_motion_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Friction that bends with speed, and a fall at low speed, took nine tenths of the error each."""
    log = moved(7, 7.5, push=lambda x, v, load: 0.25 * v * np.abs(v) * [0, 1, 0], noise=2e-5)
    robot(tmp_path)
    found = told(capsys, "diagnose", written(tmp_path, "log.h5", log), "--robot", str(tmp_path / "pendulums.xml"))
    assert [(e["effect"], e["joint"]) for e in found["effects"]] == [("quadratic_viscous", "two")]
    assert found["effects"][0]["parameters"]["amplitude"] == pytest.approx(0.25, rel=0.05)
    assert found["also_possible"] == []


def test_another_effect_is_clearly_worse_in_every_block_or_not_at_all() -> None:
    from elid_cli.diagnosis.by_motion.rivals import clearly_more

    least = np.array([1.0, 2.0, 1.5])
    assert clearly_more(2.0 * least, least)
    assert not clearly_more(1.2 * least, least)
    assert not clearly_more(least * [0.9, 9.0, 9.0], least)


def test_a_companion_must_help_every_block() -> None:
    from elid_cli.diagnosis.by_motion.search import left_by_main
    from elid_cli.diagnosis.by_motion.steps import Named
    from elid_cli.model.effects import effect_classes

    def named(effect: str, joint: int, gain: float, helped: float = 1.0) -> Named:
        kind = effect_classes()[effect]
        return Named(kind(joint, tuple(p.low for p in kind.shapes)), gain, helped)

    main, elsewhere = named("load_friction", 1, 0.97), named("link_spring", 0, 0.999)
    for companion, dropped in (
        (named("link_viscous", 1, 0.9), False),
        (named("link_viscous", 1, 0.9, 5 / 6), True),  # not in every block
        (named("link_viscous", 2, 0.64, 5 / 6), False),  # a joint of its own
    ):
        assert left_by_main(companion, (main, elsewhere, companion)) == dropped
        assert not left_by_main(main, (main, elsewhere, companion))


def test_a_gain_and_a_spring_that_coarse_encoders_leave_alike_are_both_named(tmp_path: Path) -> None:
    arm, recording = robot(tmp_path), moved(6, 7.0, noise=1e-3)
    factor = np.array([1.0, 1.25, 1.0])
    wrong = replace(recording, commands={
        name: values * (factor if name in ("kp", "kd") else 1.0) for name, values in recording.commands.items()
    })  # fmt: skip
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, "coarse.h5", wrong)], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("torque_gain", "two")]
    (effect,) = found.effects
    assert abs(effect.parameters["gain"] - 0.25) < 4 * effect.std_error["gain"]
    assert ("link_spring", "two", "torque_gain") in {(r.effect, r.joint, r.instead_of) for r in found.also_possible}
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    truth = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
    assert np.abs((found.fit_after.values - truth) / error).max() < 4


def test_ctrl_c_after_the_first_search_keeps_what_it_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = robot(tmp_path)
    log = written(tmp_path, "tilt.h5", moved(5, 6.0, tilt=0.1))

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(whole_robot, "tilt_of", stopped)
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    assert found.partial
    assert "gravity_direction" not in {e.effect for e in found.effects}
    assert found.fit_after.values.shape == (3, 4)

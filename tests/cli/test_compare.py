"""`elid compare` on saved results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from elid_cli.estimation.comparison import Estimate, SavedResult, compare, result_of
from elid_cli.report.answers.comparison import NOTABLE, WORSE, comparison_report
from elid_cli.report.tree import Text


def result(**changes: float | None) -> dict[str, Any]:
    values = {"K1": 3000.0, "m1 - 4*Izz1": -30.8, "fv1": 0.2, "fs2": None} | changes
    return {
        "schema": "elid/1", "command": "identify", "robot": "planar2",
        "base_parameters": [
            {"name": n, "unit": "N·m", "estimate": v, "std_error": None if v is None else 0.01 * abs(v)}
            for n, v in values.items()
        ],
        "error": {"joint1": {"rms": 0.3, "relative": 0.012}},
    }  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.json").write_text(json.dumps(result()))
    (tmp_path / "same.json").write_text(json.dumps(result(K1=3040.0)))
    (tmp_path / "worn.json").write_text(json.dumps(result(K1=2500.0, fv2=1.0)))
    (tmp_path / "other.json").write_text(json.dumps(result() | {"base_parameters": [
        {"name": "Jm9", "estimate": 1.0, "std_error": 0.1}]}))  # fmt: skip
    (tmp_path / "refused.json").write_text(json.dumps(result(**dict.fromkeys(("K1", "m1 - 4*Izz1", "fv1")), fs2=1.0)))
    (tmp_path / "text.json").write_text("{\n oops")
    (tmp_path / "info.json").write_text('{"schema": "elid/1", "command": "info"}')
    (tmp_path / "foreign.json").write_text("[1, 2]")
    return tmp_path


def test_what_moved_is_named(elid, folder: Path) -> None:
    done = elid("compare", "a.json", "same.json", "worn.json", "--fail-on-change", cwd=folder)
    assert done.returncode == 1
    assert done.stderr == "error: worn.json: 1 parameter moved\n"
    against = "result 2 against result 1, 1 not shown by either"
    assert f"{against}: none of 3 parameters moved" in " ".join(done.stdout.split())  # a terminal wraps it
    row = next(line.split() for line in done.stdout.splitlines() if line.startswith("  K1"))
    assert row == ["K1", "3000", "2500", "-17", "%", "-13", "N·m"]  # 500/hypot(30, 25) = 12.8


def test_the_json_says_the_same(elid, folder: Path) -> None:
    done = elid("compare", "a.json", "worn.json", "--json", cwd=folder)
    assert done.returncode == 0
    (comparison,) = json.loads(done.stdout)["comparisons"]
    assert comparison["moved"] == ["K1"]
    assert comparison["unshared"] == ["fv2"]
    assert comparison["refused"] == ["fs2"]
    changes = {c["name"]: c["deviations"] for c in comparison["changes"]}
    assert changes["K1"] == pytest.approx(-500 / (30**2 + 25**2) ** 0.5)
    assert changes["fs2"] is None
    assert changes["fv1"] == 0.0


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (["a.json"], "at least two are needed"),
        (["a.json", "text.json"], "text.json:2: not JSON"),
        (["a.json", "foreign.json"], "foreign.json: not a result of elid"),
        (["a.json", "info.json"], "info.json: holds no base parameters"),
        (["a.json", "other.json"], "other.json: shares no base parameter with a.json"),
        (["a.json", "refused.json"], "refused.json: no base parameter that it and a.json both estimate"),
        (["a.json", "wrn.json"], "wrn.json: no such file\n  hint: did you mean 'worn.json'?"),
    ],
)
def test_wrong_files_are_one_error(elid, folder: Path, files, words) -> None:
    done = elid("compare", *files, cwd=folder)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) <= 3


def saved(file: str, robot: str = "arm", **error: float) -> SavedResult:
    return SavedResult(file, robot, {"K1": Estimate(3000.0, 30.0, "N·m")}, error)


def warned(*results: SavedResult) -> list[str]:
    """Return the warnings of a comparison."""
    sections = comparison_report(compare(results), 3.0).sections
    return [s.text for s in sections if isinstance(s, Text) and s.role == "warning"]


def test_results_of_one_robot_predicted_alike_raise_no_doubt() -> None:
    assert warned(saved("a", joint1=0.012), saved("b", joint1=0.014), saved("c", joint1=0.002)) == []


@pytest.mark.parametrize(
    "other", [saved("b", "other", joint1=0.01), saved("b", joint2=0.01), saved("b", joint1=0.01, joint2=0.01)]
)
def test_results_of_other_robots_or_joints_are_doubted(other: SavedResult) -> None:
    (line,) = warned(saved("a", joint1=0.01), other, saved("c", joint1=0.01))
    assert line.startswith(f"b is of {other.robot} and a of arm: parameters of the same name may not be the same")


@pytest.mark.parametrize(
    ("before", "after", "doubted"),
    [
        (0.01, 0.01 * WORSE * 1.05, True),
        (0.01, 0.01 * WORSE * 0.95, False),
        (0.1 * NOTABLE, 1.05 * NOTABLE, True),
        (0.1 * NOTABLE, 0.95 * NOTABLE, False),  # both predict well
        (0.2, 0.01, False),
        (0.0, 0.5, False),
    ],
)
def test_a_model_that_predicts_much_worse_is_doubted(before: float, after: float, doubted: bool) -> None:
    first, other = saved("a", joint1=before, joint2=0.01), saved("b", joint1=after, joint2=0.011)
    lines = warned(first, other)
    assert len(lines) == doubted
    assert all(line.startswith("joint1: the torque is predicted") and "times as badly in b" in line for line in lines)


def test_an_offset_that_came_is_a_change_though_the_first_result_shows_none(elid, folder: Path) -> None:
    offset = {
        "effect": "torque_offset",
        "joint": "joint1",
        "parameters": {"offset": 1.0},
        "std_error": {"offset": 0.02},
    }
    (folder / "moved.json").write_text(json.dumps(result() | {"nuisances": [offset]}))
    done = elid("compare", "a.json", "moved.json", "--json", "--fail-on-change", cwd=folder)
    assert done.returncode == 1
    (comparison,) = json.loads(done.stdout)["comparisons"]
    assert comparison["moved"] == ["torque_offset of joint1: offset"]
    (change,) = comparison["beside"]
    assert change["before"] == 0.0
    assert change["deviations"] == pytest.approx(1.0 / (0.02 * 2**0.5))
    # a joint that the first one's robot does not have shows nothing in it
    short = result_of(result() | {"joints": ["joint2"]}, "short")
    longer = result_of(result() | {"joints": ["joint2", "joint1"], "nuisances": [offset]}, "longer")
    (pair,) = compare([short, longer])
    assert pair.beside == ()
    # a delay that one of them does not show says nothing
    late = {"effect": "torque_delay", "joint": "joint1", "parameters": {"delay": 0.01}, "std_error": {"delay": 1e-4}}
    (folder / "late.json").write_text(json.dumps(result() | {"nuisances": [late]}))
    assert elid("compare", "a.json", "late.json", "--fail-on-change", cwd=folder).returncode == 0


def test_how_often_chance_makes_a_change_is_said(elid, folder: Path) -> None:
    done = elid("compare", "a.json", "same.json", cwd=folder)
    assert "by chance one of 3 that did not move does so in 0.81 % of comparisons" in " ".join(done.stdout.split())


def test_results_of_other_structures_are_doubted() -> None:
    first = saved("a", joint1=0.01)
    other = replace(saved("b", joint1=0.01), fingerprint="f2")
    assert warned(first, other) == []  # older results do not say
    (line,) = warned(replace(first, fingerprint="f1"), other)
    assert line.startswith(
        "b and a were found with robot files that differ in geometry, gears, transmissions or effects"
    )
    assert warned(replace(first, fingerprint="f2"), other) == []


def test_doubts_are_printed_as_warnings(elid, folder: Path) -> None:
    worse = result() | {"robot": "planar3", "error": {"joint1": {"rms": 9.0, "relative": 0.12}}}
    (folder / "worse.json").write_text(json.dumps(worse))
    done = elid("compare", "a.json", "worse.json", cwd=folder)
    assert done.returncode == 0
    said = " ".join(done.stdout.split())
    assert "worse.json is of planar3 and a.json of planar2" in said
    assert "joint1: the torque is predicted 10 times as badly in worse.json" in said
    assert "is of" not in elid("compare", "a.json", "same.json", cwd=folder).stdout


def robot_of(*joints: str, sliding: int = 0) -> dict[str, Any]:
    """Return a result with joints of these names; joint `sliding` is a prismatic one."""
    entries = [
        {"name": f"{kind}{k}", "unit": f"N·m{per}" if k != sliding else f"N{per}", "estimate": 2.0, "std_error": 0.01}
        for kind, per in (("fs", ""), ("K", "/rad")) for k in range(1, len(joints) + 1)
    ]  # fmt: skip
    entries.append({"name": "m2 - 4*Izz3", "unit": "kg", "estimate": 1.0, "std_error": 0.01})
    return {"schema": "elid/1", "command": "identify", "robot": "arm", "joints": joints, "base_parameters": entries}


def test_only_the_same_joints_are_compared(elid, tmp_path: Path) -> None:
    saved = {
        "arm.json": robot_of("base", "shoulder", "elbow"), "scara.json": robot_of("j1", "j2", "z", sliding=3),
        "lift.json": robot_of("base", "shoulder", "elbow", sliding=3),
        "hand.json": robot_of("base", "shoulder", "w", "v"),
        "longer.json": robot_of("base", "shoulder", "elbow", "v"),
        "right.json": robot_of("r_base", "r_shoulder", "r_elbow"),
    }  # fmt: skip
    for name, data in saved.items():
        (tmp_path / name).write_text(json.dumps(data))
    refused = elid("compare", "arm.json", "scara.json", cwd=tmp_path)
    assert refused.returncode == 2
    assert "scara.json: of another robot than arm.json" in refused.stderr
    assert "its joints are j1, j2, z; the others are base, shoulder, elbow" in refused.stderr
    for other, joint in (("lift.json", "elbow"), ("hand.json", "elbow and w")):
        (found,) = json.loads(elid("compare", "arm.json", other, "--json", cwd=tmp_path).stdout)["comparisons"]
        assert [c["name"] for c in found["changes"]] == ["fs1", "fs2", "K1", "K2"]
        assert found["left_out"] == ["fs3", "K3", "m2 - 4*Izz3"]
        said = " ".join(elid("compare", "arm.json", other, cwd=tmp_path).stdout.split())
        assert f"differ in joint 3 ({joint}): 3 parameters of the same name are left out" in said
    (found,) = json.loads(elid("compare", "arm.json", "right.json", "--json", cwd=tmp_path).stdout)["comparisons"]
    assert found["left_out"] == []  # two arms of one type
    (found,) = json.loads(elid("compare", "arm.json", "longer.json", "--json", cwd=tmp_path).stdout)["comparisons"]
    assert len(found["changes"]) == 7  # as where a joint of one of them is locked


@pytest.mark.parametrize("joints", [("shoulder", "base", "elbow"), ("base", "hip", "w", "v")])
def test_results_of_other_joints_are_refused_though_their_parameters_are_called_alike(
    elid, tmp_path: Path, joints: tuple[str, ...]
) -> None:
    (tmp_path / "arm.json").write_text(json.dumps(robot_of("base", "shoulder", "elbow")))
    (tmp_path / "other.json").write_text(json.dumps(robot_of(*joints)))
    done = elid("compare", "arm.json", "other.json", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "other.json: of another robot than arm.json" in done.stderr
    assert f"its joints are {', '.join(joints)}; the others are base, shoulder, elbow" in done.stderr
    assert "identify both logs with one robot file" in done.stderr


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_another_robot_file_with_the_same_joints_is_warned_of_in_every_form(elid, tmp_path: Path, form) -> None:
    for name, file in (("a.json", "f1"), ("b.json", "f2")):
        (tmp_path / name).write_text(json.dumps(robot_of("base", "shoulder") | {"robot_fingerprint": file}))
    done = elid("compare", "a.json", "b.json", *form, cwd=tmp_path)
    assert done.returncode == 0
    assert "warning: b.json and a.json were found with robot files that differ in geometry" in done.stderr


def test_the_same_result_is_called_so(elid, folder: Path) -> None:
    done = elid("compare", "a.json", "a.json", cwd=folder)
    assert "Nothing can: a.json is given twice." in done.stdout
    assert "not shown by one" not in done.stdout
    (folder / "copy.json").write_bytes((folder / "a.json").read_bytes())
    said = " ".join(elid("compare", "a.json", "copy.json", cwd=folder).stdout.split())
    assert "Nothing can: copy.json is the same result as a.json, to the last digit." in said
    (found,) = json.loads(elid("compare", "a.json", "copy.json", "--json", cwd=folder).stdout)["comparisons"]
    assert found["same"]


def test_a_value_that_may_be_biased_need_not_have_changed() -> None:
    before, after = result(), result(K1=2500.0, fv1=0.3)
    after["base_parameters"][0]["bias_possible"] = True
    (comparison,) = compare([result_of(before, "a.json"), result_of(after, "b.json")])
    assert {change.name: change.bias_possible for change in comparison.moved(3.0)} == {"K1": True, "fv1": False}
    report = comparison_report([comparison], 3.0)
    told = next(section for section in report.sections if section.key == "answers")
    words = dict(told.items)["what has changed?"]
    assert words.startswith("fv1 (+50 %). Perhaps also K1 (−17 %): what a model lacks may have moved it instead")
    (payload,) = report.payload["comparisons"]
    assert {c["name"]: c["bias_possible"] for c in payload["changes"]}["K1"] is True

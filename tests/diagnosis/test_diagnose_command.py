"""`elid diagnose` as a shell sees it: JSON, report, gates, the refined robot file, `validate --held-out`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from elid_cli.robot.files import write_robot
from elid_cli.robot.robot import Robot
from tests.diagnosis.diagnosis_logs import Logs, written

Place = Path
FEW = ("--only", "stribeck", "--only", "torque_offset")
CONTRACT = (
    "schema", "command", "version", "robot", "joints", "log", "counts", "classification", "this_log",
    "base_parameters", "error", "before", "after", "effects", "nuisances", "also_possible", "unexplained",
)  # fmt: skip


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory, log: Logs, robot: Robot) -> Place:
    """Return a folder with a robot file and logs in it."""
    folder = tmp_path_factory.mktemp("logs")
    write_robot(robot, folder / "arm.yaml")
    for name, effects in (("clean.h5", ()), ("stribeck.h5", ("stribeck",)), ("both.h5", ("stribeck", "load_friction"))):
        written(folder, name, log(*effects))
    return folder


@pytest.fixture(scope="session")
def answer(elid, place: Place) -> dict[str, Any]:
    """Return what JSON says of the log with Stribeck friction; leaves refined.yaml in the folder."""
    done = elid(
        "diagnose", "stribeck.h5", "--robot", "arm.yaml", *FEW, "--check", "clean.h5", "--check", "both.h5",
        "--write-robot", "refined.yaml", "--json", cwd=place,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "\033" not in done.stdout
    return json.loads(done.stdout, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


@pytest.fixture(scope="session")
def report(elid, place: Place) -> Callable[..., str]:
    """Return the text that a diagnosis prints."""

    @cache
    def text(log: str, *arguments: str, **env: str) -> str:
        done = elid("diagnose", log, "--robot", "arm.yaml", *FEW, *arguments, cwd=place, **env)
        assert (done.returncode, done.stderr) == (0, "")
        return str(done.stdout)

    return text


def test_json_keeps_the_contract(answer: dict[str, Any]) -> None:
    assert set(CONTRACT) <= set(answer)
    assert (answer["schema"], answer["command"], answer["robot"]) == ("elid/1", "diagnose", "planar2")
    (effect,) = answer["effects"]
    assert (effect["effect"], effect["joint"]) == ("stribeck", "joint1")
    assert {"parameters", "std_error", "gain"} <= set(effect)
    assert effect["std_error"]["amplitude"] > 0
    for side in ("before", "after"):
        assert set(answer[side]["error"]) == {"joint1", "joint2"}
    assert answer["error"] == answer["after"]["error"]
    assert answer["after"]["error"]["joint1"]["spring_rms"] < 0.6 * answer["before"]["error"]["joint1"]["spring_rms"]
    assert answer["after"]["normalised_mean_error"] < answer["before"]["normalised_mean_error"]
    assert len(answer["held_out"]) == 3
    entry = {e["name"]: e for e in answer["base_parameters"]}["fs1"]
    assert entry["reference"] == 6
    assert entry["estimate"] == pytest.approx(6, rel=0.02)
    assert (entry["verdict"], entry["terms"], entry["unit"]) == ("supported", {"fs1": 1}, "N·m")
    assert {n["effect"] for n in answer["nuisances"]} <= {"torque_delay"}
    assert all(abs(n["parameters"]["delay"]) <= 0.0021 for n in answer["nuisances"])
    assert answer["unexplained"] == []
    assert not answer["sufficient"]
    assert {(r["joint"], r["rows"]) for r in answer["before"]["rows"]} == {
        (joint, rows) for joint in ("joint1", "joint2") for rows in ("sum", "motor")
    }


def test_the_model_before_and_after_is_judged_on_other_logs(answer: dict[str, Any]) -> None:
    clean, both = answer["checks"]
    assert (clean["log"]["files"], both["log"]["files"]) == (["clean.h5"], ["both.h5"])
    old, new = (both[side]["error"]["joint1"]["spring_rms"] for side in ("before", "after"))
    assert new < 0.5 * old
    # without the effect in the log, a model that has it must be worse
    old, new = (clean[side]["error"]["joint1"]["spring_rms"] for side in ("before", "after"))
    assert new > old


def test_validating_the_refined_robot_gives_the_error_after(answer, elid, place: Place) -> None:
    done = elid("validate", "stribeck.h5", "--robot", "refined.yaml", "--held-out", "--json", cwd=place)
    judged = json.loads(done.stdout)["error"]
    for joint, error in answer["after"]["error"].items():
        for key in ("rms", "relative", "spring_rms", "spring_relative", "torque_rms"):
            # parameters are from identification's cut-off, the error after from the search's own fit
            assert judged[joint][key] == pytest.approx(error[key], rel=1e-2)
    whole = json.loads(elid("validate", "stribeck.h5", "--robot", "refined.yaml", "--json", cwd=place).stdout)["error"]
    assert whole["joint1"]["rms"] != judged["joint1"]["rms"]


def test_the_refined_robot_lacks_nothing_more(answer, elid, place: Place) -> None:
    done = elid("diagnose", "stribeck.h5", "--robot", "refined.yaml", *FEW, "--json", "--fail-on-effect", cwd=place)
    again = json.loads(done.stdout)
    assert (done.returncode, again["effects"]) == (0, [])
    assert again["declared"][0]["effect"] == "stribeck"
    for joint, error in answer["after"]["error"].items():
        assert again["before"]["error"][joint]["rms"] == pytest.approx(error["rms"], rel=1e-3)


def test_the_report_goes_from_the_residual_to_the_next_command(report) -> None:
    text = report("stribeck.h5", COLUMNS="80")
    order = (
        "planar2 · stribeck.h5", "can I trust it?", "what is missing?",
        "Stribeck friction at joint1", "what to record next?",
        "missing from the model", "Stribeck friction of joint1", "amplitude", "No other effect does as well",
        "error on the held-out stretches", " → good", "before: residual where the model was fitted",
        "parameters of drives and transmissions", "Without it these are biased", "how it was computed", "recorded",
        f"Next: elid diagnose stribeck.h5 --robot arm.yaml {' '.join(FEW)} --write-robot",
    )  # fmt: skip
    places = [text.find(words) for words in order]
    assert -1 not in places, order[places.index(-1)]
    assert places == sorted(places)
    assert all(len(line) <= 80 for line in text.splitlines()[:-1])


def test_a_sufficient_model_is_called_so_with_its_floor(report) -> None:
    text = report("clean.h5", "--lookup")
    assert "Nothing: only the sensors' noise is left" in " ".join(text.split())
    assert "× noise" in text
    assert "missing from the model" not in text
    assert text.splitlines()[-1].startswith("Next: elid identify clean.h5")


def test_nothing_is_lost_at_40_columns_or_in_ascii(report) -> None:
    wide = report("stribeck.h5")
    narrow = report("stribeck.h5", COLUMNS="40", NO_COLOR="1", PYTHONIOENCODING="ascii")
    assert narrow.isascii()
    assert "…" not in narrow
    assert "\033" not in narrow
    lines = [line for line in narrow.splitlines() if not line.startswith("Next:")]
    assert max(map(len, lines)) <= 40
    for word in set(re.findall(r"[a-z_]{4,}|\d+\.\d+", wide)):
        assert word in narrow, word


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (
            ("--fail-on-effect", "--max-error", "0.1%"),
            1,
            ("joint1: the model lacks stribeck", "exceeds --max-error 0.1 %"),
        ),
        (("--max-error", "50%", "--check", "clean.h5"), 0, ()),
    ],
)
def test_gates_print_the_whole_report_first(elid, place: Place, arguments, code: int, words: tuple[str, ...]) -> None:
    done = elid("diagnose", "stribeck.h5", "--robot", "arm.yaml", *FEW, *arguments, cwd=place)
    assert done.returncode == code
    assert "Next: elid diagnose" in done.stdout
    assert all(word in done.stderr for word in words), done.stderr
    assert bool(done.stderr) == bool(words)


def test_wrong_names_are_refused_before_any_work(elid, place: Place) -> None:
    done = elid("diagnose", "stribeck.h5", "--robot", "arm.yaml", "--only", "stribek", cwd=place)
    assert done.returncode == 2
    assert "stribeck" in done.stderr
    done = elid("diagnose", "stribeck.h5", "--robot", "arm.yaml", "--only", "lookup", cwd=place)
    assert done.returncode == 2
    assert "--lookup" in done.stderr
    done = elid("diagnose", "stribeck.h5", "--robot", "arm.yaml", "--check", "none.h5", cwd=place)
    assert done.returncode == 3
    assert "none.h5" in done.stderr


def test_the_same_input_gives_the_same_bytes(report) -> None:
    first, second = (report("stribeck.h5", "--json", PYTHONHASHSEED=seed) for seed in ("1", "2"))
    assert first == second

"""Motions and torques that tell little: what can be identified is, the rest is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from elid_cli.robot.files import read_robot
from elid_cli.robot.text import text_of
from tests.system.hostile.hostile import ROBOT, agrees, base, elid, one_message, refused
from tests.system.hostile.test_csv_files import saved, table

RIGID = """\
name: stiff2
gravity: [0, -9.81, 0]
dh: standard
joints:
  - {name: joint1, a: 0.5, alpha: 0, d: 0, theta: 0, gear_ratio: 1, transmission: rigid,
     parameters: {m: 21, cx: -5, cy: 0, cz: 0, Ixx: 0, Iyy: 1.25, Izz: 13.8, Ixy: 0, Ixz: 0, Iyz: 0, Jm: 2,
                  fs: 2.3, fv: 1.1}}
  - {name: joint2, a: 0.5, alpha: 0, d: 0, theta: 0, gear_ratio: 1, transmission: rigid,
     parameters: {m: 10, cx: -2.5, cy: 0, cz: 0, Ixx: 0, Iyy: 0.6, Izz: 0.86, Ixy: 0, Ixz: 0, Iyz: 0, Jm: 1,
                  fs: 1.3, fv: 0.9}}
"""
Motion = Callable[[np.ndarray], np.ndarray]


def rich(t: np.ndarray) -> np.ndarray:
    start = np.clip(t, 0, 1)
    return (
        start**3
        * (10 - 15 * start + 6 * start**2)
        * (0.8 * np.sin(2 * t) + 0.3 * np.sin(5.1 * t) + 0.1 * np.sin(8 * t))
    )


def rest(t: np.ndarray) -> np.ndarray:
    return 0 * t + 0.3


def steady(t: np.ndarray) -> np.ndarray:
    return 0.2 * np.where(t < 1, t**2 / 2, t - 0.5)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Motion, Motion], tuple[Path, Path]]:
    """Return a function that simulates a rigid arm along two motions: (log, robot file)."""
    folder = tmp_path_factory.mktemp("little")
    robot = folder / "stiff2.yaml"
    robot.write_text(RIGID)

    def make(first: Motion, second: Motion) -> tuple[Path, Path]:
        log = folder / f"{first.__name__}-{second.__name__}.csv"
        if not log.exists():
            t = np.arange(0, 10, 0.004)
            rows = np.column_stack([t, first(t), second(t)]).tolist()
            reference = folder / "reference.csv"
            reference.write_text("\n".join(["t,q.joint1,q.joint2", *(",".join(map(repr, row)) for row in rows)]) + "\n")
            arguments = ("--reference", reference, "--seed", "1", "--counts", "1250000", "--rate", "250")
            done = elid("simulate", "--robot", robot, *arguments, "-o", log)
            assert done.code == 0, done.err
            head, *lines = log.read_text().splitlines()
            values = np.array([line.split(",") for line in lines[50:-50]], dtype=float)  # without the start's jolt
            values[:, -2:] += 0.3 * np.random.default_rng(0).standard_normal((len(values), 2))
            log.write_text("\n".join([head, *(",".join(map(repr, row)) for row in values.tolist())]) + "\n")
        return log, robot

    return make


@pytest.mark.parametrize("moving", [1, 2])
def test_a_joint_that_never_moves_is_named_and_the_other_identified(made: Callable, moving: int) -> None:
    log, robot = made(*((rich, rest) if moving == 1 else (rest, rich)))
    done = elid("identify", log, "--robot", robot, "--json")
    assert done.code == 0, done.err
    held = 3 - moving
    entries = {entry["name"]: entry for entry in done.json["base_parameters"]}
    for name in (f"fs{held}", f"fv{held}"):
        assert entries[name]["verdict"] == "refused"
        assert entries[name]["estimate"] is None
        assert done.json["reasons"][name] == f"joint{held} does not move"
    assert sum(entry["verdict"] == "supported" for entry in entries.values()) >= 3
    for name, entry in entries.items():  # right within its own interval, or absent
        if entry["verdict"] == "supported":
            assert abs(entry["estimate"] - entry["reference"]) < 5 * entry["std_error"], name
    text = elid("identify", log, "--robot", robot).out
    assert f"joint{held}" in text
    assert "does not move" in text or "did not move" in text


def test_a_log_at_rest_is_refused(made: Callable, tmp_path: Path) -> None:
    log, robot = made(rest, rest)
    refused(log, "no joint moves", "joint1: ", "joint2: ", "elid excite", code=4, robot=robot)
    rows = table().rows
    rows = np.column_stack([rows[:, :1], np.tile(rows[:1, 1:], (rows.shape[0], 1))])
    from tests.logs.faults import Table

    refused(saved(tmp_path, Table(table().names, rows).text()), "no joint moves", code=4)


def test_constant_velocity_refuses_what_it_cannot_show(made: Callable) -> None:
    log, robot = made(steady, rest)
    done = elid("identify", log, "--robot", robot, "--json")
    assert done.code in (0, 4), done.err
    if done.code == 0:
        entries = {entry["name"]: entry for entry in done.json["base_parameters"]}
        assert entries["fs2"]["verdict"] == "refused"
        for name, entry in entries.items():
            if entry["verdict"] == "supported":
                assert abs(entry["estimate"] - entry["reference"]) < 8 * entry["std_error"], name


@pytest.mark.parametrize(("samples", "words"), [(1, "1 sample"), (3, "3 usable samples"), (19, "19 usable samples")])
def test_a_few_samples_are_refused(tmp_path: Path, samples: int, words: str) -> None:
    refused(saved(tmp_path, table().take(np.arange(samples)).text()), words, "20")


@pytest.mark.parametrize("samples", [20, 60, 174])
def test_a_short_log_is_refused_by_every_command(tmp_path: Path, samples: int) -> None:
    log = saved(tmp_path, table().take(np.arange(samples)).text())
    for verb in ("identify", "diagnose"):
        done = elid(verb, log, "--robot", ROBOT, "--json")
        assert done.code in (3, 4), (verb, done.err)
        assert done.out == ""
        one_message(done, "too few")


@pytest.mark.parametrize("samples", [176, 300])
def test_a_log_just_long_enough_ends_well(tmp_path: Path, samples: int) -> None:
    log = saved(tmp_path, table().take(np.arange(samples)).text())
    for verb in ("identify", "diagnose", "validate"):
        done = elid(verb, log, "--robot", ROBOT, "--json")
        assert done.code in (0, 3, 4), (verb, done.err)
        assert bool(done.out) == (done.code == 0)


def test_zero_torque_is_no_torque(tmp_path: Path) -> None:
    zero = table().with_column("tau.joint1", lambda v: v * 0).with_column("tau.joint2", lambda v: v * 0)
    refused(saved(tmp_path, zero.text()), "no torque", "zero throughout")


def test_a_saturated_torque_is_said_and_what_it_spoils_refused(tmp_path: Path) -> None:
    log = saved(tmp_path, table().with_column("tau.joint1", lambda v: np.clip(v, -60, 60)).text())
    done = elid("identify", log, "--robot", ROBOT, "--json")
    assert done.code == 0
    assert "joint1: tau is exactly 60" in done.err
    verdicts = {entry["name"]: entry["verdict"] for entry in done.json["base_parameters"]}
    assert all(verdicts[name] != "supported" for name in ("Jm1", "fs1", "fv1", "K1"))
    good = {name: value for name, value in done.estimates.items() if name in ("Jm2", "fs2", "fv2", "K2")}
    assert all(value is not None for value, _ in good.values())
    for name, (value, _) in good.items():
        assert value == pytest.approx(elid_clean(name), rel=0.01)
    diagnosed = elid("diagnose", log, "--robot", ROBOT, "--json")
    assert diagnosed.code == 0, diagnosed.err
    assert "joint1: tau is exactly 60" in diagnosed.err
    assert all(effect["joint"] != "joint2" for effect in diagnosed.json["effects"])


def elid_clean(name: str) -> float | None:
    from tests.system.hostile.hostile import clean

    return clean()[name][0]


def test_one_side_only_is_rigid_and_says_so(tmp_path: Path) -> None:
    log = saved(tmp_path, table().without("q.joint1", "q.joint2").text())
    for verb in ("identify", "diagnose"):
        done = elid(verb, log, "--robot", ROBOT, "--json")
        assert done.code == 0, done.err
        assert "no link position q: their transmissions count as rigid" in done.err
        for joint in done.json.get("motor_side", {"joints": {}})["joints"].values():
            assert (joint["stiffness"] is None) == (joint["verdict"] == "refused")
            assert joint["reason"] or joint["verdict"] == "supported"
    refused(saved(tmp_path, table().without("theta.joint1", "theta.joint2").text()), "no motor position")


def test_a_declared_effect_that_the_log_cannot_show_is_left_out_and_told(tmp_path: Path) -> None:
    log = saved(tmp_path, table().without("q.joint1", "q.joint2").text())
    robot = tmp_path / "loose.yaml"
    declared = "effects:\n  - {effect: backlash, joint: joint2, parameters: {gap: 1e-3}}\n"
    robot.write_text(text_of(read_robot(ROBOT)) + declared)
    for verb in ("identify", "validate", "diagnose"):
        done = elid(verb, log, "--robot", robot, "--json")
        assert done.code == 0, done.err
        assert done.err.count("joint2: the declared backlash is left out: it needs an elastic transmission") == 1
        assert all(error["spring_rms"] is None for error in done.json["error"].values())
    done = elid("diagnose", log, "--robot", ROBOT, "--only", "backlash")
    assert done.code == 2
    one_message(done, "--only: backlash applies to no joint", "elastic transmission")


def test_the_same_fault_of_several_logs_is_one_sentence(tmp_path: Path) -> None:
    whole = table().without("q.joint2").text().splitlines()[:1501]
    first = saved(tmp_path, "\n".join(whole), "first.csv")
    second = saved(tmp_path, "\n".join([whole[0], *whole[250:]]), "second.csv")
    said = (
        f"warning: {first}, {second}: joint2: no link position q: its transmission counts as rigid; elid identify "
        "looks for its stiffness by theta and tau"
    )
    for verb in ("identify", "validate"):
        done = elid(verb, first, second, "--robot", ROBOT, "--json")
        assert done.err.splitlines().count(said) == 1
        assert done.err.count("no link position") == 1
        assert done.json["log"]["warnings"].count(said.removeprefix("warning: ")) == 1
    done = elid("diagnose", first, "--robot", ROBOT, "--only", "stribeck", "--check", second, "--json")
    assert f"warning: {second}: joint2: no link position q" in done.err


def test_the_good_log_is_identified_throughout(tmp_path: Path) -> None:
    done = elid("identify", saved(tmp_path, table().text()), "--robot", ROBOT, "--json")
    agrees(done, 1e-9)
    assert base().samples == 3000

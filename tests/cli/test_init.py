"""`elid init`: what a URDF cannot say, asked in a terminal, written as comments in a pipe."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from elid_cli.cli import main
from elid_cli.cli.group import elid as commands
from elid_cli.robot.files import read_robot
from tests.cli.conftest import Elid

URDF = """\
<robot name="arm">
  <link name="base"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="200" velocity="5"/>
  </joint>
  <link name="upper">
    <inertial><origin xyz="0.2 0 0"/><mass value="3"/><inertia ixx=".01" iyy=".05" izz=".05" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="5"/>
  </joint>
  <link name="fore">
    <inertial><origin xyz="0.15 0 0"/><mass value="2"/><inertia ixx=".01" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  <joint name="left" type="prismatic">
    <parent link="fore"/><child link="left_tip"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.1" effort="20" velocity="1"/>
  </joint>
  <link name="left_tip"/>
  <joint name="right" type="prismatic">
    <parent link="fore"/><child link="right_tip"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.1" effort="20" velocity="1"/>
  </joint>
  <link name="right_tip"/>
</robot>
"""
GEOMETRY = """\
name: arm
gravity: [0, 0, -9.81]
dh: urdf
joints:
  - {name: shoulder, xyz: [0, 0, 0], rpy: [0, 0, 0], axis: [0, 1, 0], transmission: rigid, limits: {position: [-2, 2]},
     parameters: {m: 3, cx: .6, cy: 0, cz: 0, Ixx: .01, Iyy: .17, Izz: .17, Ixy: 0, Ixz: 0, Iyz: 0,
                  Ja: .3, fs: 1, fv: 2}}
  - {name: elbow, xyz: [.4, 0, 0], rpy: [0, 0, 0], axis: [0, 1, 0], transmission: rigid, limits: {position: [-2, 2]},
     parameters: {m: 2, cx: .3, cy: 0, cz: 0, Ixx: .01, Iyy: .065, Izz: .065, Ixy: 0, Ixz: 0, Iyz: 0,
                  Ja: .2, fs: .5, fv: 1}}
"""


@pytest.fixture(scope="module")
def logs(elid: Elid, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with logs of shoulder and elbow: link positions and torque, and in degrees under other names."""
    folder = tmp_path_factory.mktemp("logs")
    (folder / "truth.yaml").write_text(GEOMETRY)
    line = "simulate --robot truth.yaml --duration 12 --rate 250 --torque-noise 0.02 -o own.csv"
    done = elid(*line.split(), cwd=folder)
    assert done.returncode == 0, done.stderr
    own = np.genfromtxt(folder / "own.csv", delimiter=",", names=True, deletechars="")
    header = "Zeit;pos_shoulder_deg;pos_elbow_deg;Drehmoment_shoulder;Drehmoment_elbow"
    q, tau = (np.column_stack([own[f"{s}.{j}"] for j in ("shoulder", "elbow")]) for s in ("q", "tau"))
    columns = np.column_stack([own["t"], np.degrees(q), tau])
    np.savetxt(folder / "other.csv", columns, delimiter=";", header=header, comments="", fmt="%.9f")
    header = "t,q.shoulder,q.elbow,tau.shoulder,tau.elbow"
    columns = np.column_stack([own["t"], q, tau])
    np.savetxt(folder / "link.csv", columns, delimiter=",", header=header, comments="", fmt="%.9f")
    return folder


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(URDF)
    return tmp_path / "arm.urdf"


def answered(monkeypatch: pytest.MonkeyPatch, arguments: list[str], *answers: str) -> Any:
    """Run in this process as in a terminal whose user types the answers."""
    monkeypatch.setattr("elid_cli.cli.verbs.init._asks", lambda output: True)
    return CliRunner().invoke(commands, ["init", *arguments], input="".join(f"{answer}\n" for answer in answers))


def written(arm: Path) -> dict[str, Any]:
    return yaml.safe_load(arm.with_suffix(".elid.yaml").read_text("utf-8"))


def test_in_a_pipe_what_is_not_known_is_a_comment_and_nothing_else_is_needed(elid: Elid, arm: Path, logs: Path) -> None:
    done = elid("init", str(arm), str(logs / "link.csv"), "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["absent"] == ["left", "right"]
    assert said["signals"] == {"q": "q.{joint}", "tau": "tau.{joint}"}
    assert said["guesses"] == said["missing"] == []
    text = arm.with_suffix(".elid.yaml").read_text("utf-8")
    assert text.count("# gear_ratio: ?") == 4
    assert "# lock: {left: 0, right: 0}" in text
    assert list(written(arm)) == ["joints"]
    assert read_robot(arm) == read_robot(arm, beside=False)
    found = elid("identify", str(logs / "link.csv"), "--robot", str(arm), "--json")
    assert found.returncode == 0, found.stderr
    by_name = {p["name"]: p["estimate"] for p in json.loads(found.stdout)["base_parameters"]}
    assert by_name["fs1"] == pytest.approx(1.0, rel=0.02)
    assert by_name["fv2"] == pytest.approx(1.0, rel=0.02)


def test_a_guess_stays_a_comment_until_somebody_confirms_it(elid: Elid, arm: Path, logs: Path) -> None:
    done = elid("init", str(arm), str(logs / "other.csv"))
    assert done.returncode == 0, done.stderr
    assert "q: guessed from names, a comment to be checked" in " ".join(done.stdout.split())
    text = arm.with_suffix(".elid.yaml").read_text("utf-8")
    assert '#   q: {from: "pos_{joint}_deg", unit: deg}   # guessed from names: check it' in text
    assert "log" not in written(arm)
    # the comments are lines that work
    lines = [line.removeprefix("# ").removeprefix("  ") for line in text.splitlines()]
    kept = [line for line in lines if line.startswith(("t:", "q:", "tau:", "lock:"))]
    body = [f"  {line}" for line in kept if not line.startswith("lock:")]
    arm.with_suffix(".elid.yaml").write_text("\n".join([kept[0], "log:", *body]) + "\n")
    assert kept[0].startswith("lock:")
    assert elid("identify", str(logs / "other.csv"), "--robot", str(arm), "--quiet").returncode == 0


def test_a_terminal_asks_and_what_it_is_told_is_what_the_robot_then_is(
    elid: Elid, arm: Path, logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = ("nowhere", "", "0.01", "100, 50, 3", "100, 50", "rigid", "", "no such column", "", "")
    done = answered(monkeypatch, [str(arm), str(logs / "other.csv")], *answers)
    assert done.exit_code == 0, done.output
    assert "nowhere: no such link" in done.output
    assert "3 numbers for 2 joints" in done.output
    assert "the log does not hold no such column" in done.output
    entries = written(arm)
    assert entries["lock"] == {"left": 0.01, "right": 0.01}
    assert entries["joints"]["elbow"] == {"transmission": "rigid", "gear_ratio": 50.0}
    assert entries["log"]["q"] == {"from": "pos_{joint}_deg", "unit": "deg"}
    robot = read_robot(arm)
    assert [(j.name, j.gear_ratio, j.transmission) for j in robot.joints] == [
        ("shoulder", 100.0, "rigid"), ("elbow", 50.0, "rigid"),
    ]  # fmt: skip
    assert dict(robot.held) == {"left": 0.01, "right": 0.01}
    found = elid("identify", str(logs / "other.csv"), "--robot", str(arm), "--json")
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["error"]["elbow"]["relative"] < 0.02


def test_a_tip_and_signals_by_other_names_can_be_told(arm: Path, logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # tip; gears not known; as the log shows; what was found is not right: q from elsewhere, tau as it is
    answers = ("left_tip", "", "", "auto", "n", "{from: 'tau.{joint}', unit: N}", "{from: 'tau.{joint}'}", "")
    done = answered(monkeypatch, [str(arm), str(logs / "link.csv")], *answers)
    assert done.exit_code == 0, done.output
    assert "unknown unit 'N'" in done.output
    assert written(arm)["tip"] == "left_tip"
    assert written(arm)["log"]["q"] == {"from": "tau.{joint}"}
    assert dict(read_robot(arm).held) == {"right": 0.0, "left": 0.0}


def test_gains_are_asked_for_where_the_log_holds_commands_only(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    t = np.arange(500) / 100
    columns = np.column_stack([t, np.sin(t), np.cos(t), np.sin(t) + 0.1, np.cos(t)])
    log = tmp_path / "told.csv"
    np.savetxt(log, columns, delimiter=",", header="t,q.shoulder,q.elbow,q_des.shoulder,q_des.elbow", comments="")
    answers = ("", "0", "", "", "", "-1", "20, 10", "0.5")
    done = answered(monkeypatch, [str(arm), str(log)], *answers)
    assert done.exit_code == 0, done.output
    assert "gains are not negative" in done.output
    assert written(arm)["control"] == {"kp": {"shoulder": 20.0, "elbow": 10.0}, "kd": 0.5}
    assert read_robot(arm).control["kp"] == {"shoulder": 20.0, "elbow": 10.0}


def test_commands_without_gains_are_proposed_with_places_for_them(elid: Elid, arm: Path, tmp_path: Path) -> None:
    t = np.arange(500) / 100
    for log, gains in (("told.csv", {}), ("gains.csv", {"kp": 20 + 0 * t, "kd": 1 + 0 * t})):
        joints = {
            f"{s}.{joint}": np.sin(t + k) for k, joint in enumerate(("shoulder", "elbow")) for s in ("q", "q_des")
        }
        columns = {"t": t, **joints, **{f"{g}.{j}": v for g, v in gains.items() for j in ("shoulder", "elbow")}}
        header = ",".join(columns)
        np.savetxt(tmp_path / log, np.column_stack([*columns.values()]), delimiter=",", header=header, comments="")
        for verb in ("info", "init"):
            words = [log, "--robot", "arm.urdf"] if verb == "info" else ["arm.urdf", log, "--force"]
            (line,) = (x for x in elid(verb, *words, cwd=tmp_path).stdout.splitlines() if x.startswith("Next:"))
            asked = "" if gains else " --kp GAIN --kd GAIN"
            assert line == f"Next: elid identify {log} --robot arm.urdf{asked}"
    arm.with_suffix(".elid.yaml").write_text("control: {kp: 20, kd: 1}\n")
    assert "GAIN" not in elid("info", "told.csv", "--robot", "arm.urdf", cwd=tmp_path).stdout
    mapped = elid("info", "told.csv", "--robot", "arm.urdf", "--map", "kp={value: 20}", cwd=tmp_path).stdout
    assert "GAIN" not in mapped


def test_a_file_that_is_there_is_kept_without_force(elid: Elid, arm: Path) -> None:
    beside = arm.with_suffix(".elid.yaml")
    beside.write_text("gravity: [0, 0, 0]\n")
    done = elid("init", str(arm))
    assert (done.returncode, beside.read_text()) == (2, "gravity: [0, 0, 0]\n")
    assert "--force" in done.stderr
    assert elid("init", str(arm), "--force").returncode == 0
    assert "shoulder" in beside.read_text()


def test_what_cannot_be_completed_is_said(elid: Elid, arm: Path, tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(GEOMETRY)
    done = elid("init", "own.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert "is elid's own description" in done.stderr
    assert elid("init", "no.urdf", cwd=tmp_path).returncode == 2
    (tmp_path / "bad.csv").write_text("not a log")
    done = elid("init", "arm.urdf", "bad.csv", cwd=tmp_path)
    assert done.returncode == 3
    assert not arm.with_suffix(".elid.yaml").exists()
    done = elid("init", "arm.urdf", "-o", "no/where.yaml", cwd=tmp_path)
    assert done.returncode == 2
    done = elid("init", "arm.urdf", "-o", "other.yaml", cwd=tmp_path)
    assert "is read when it is called arm.elid.yaml" in done.stderr


def test_leaving_at_a_question_writes_nothing(arm: Path) -> None:
    asked = "import sys; from elid_cli.cli.verbs import init; init._asks = lambda output: True; "
    run = "from elid_cli.cli import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", asked + run, "init", str(arm)],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert not arm.with_suffix(".elid.yaml").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tip: nowhere", "arm.elid.yaml:1: tip: nowhere: no such link"),
        ("tip: base", "arm.elid.yaml:1: tip: base: no joint moves it"),
        ("lock: {left: 0, middle: 1}", "arm.elid.yaml:1: lock: no joint 'middle'"),
        ("lock: {left: much}", "arm.elid.yaml:1: lock: left: 'much' is not a number"),
        ("locked: {left: 0}", "unknown key 'locked'"),
    ],
)
def test_keys_of_the_file_are_checked(elid: Elid, arm: Path, text: str, said: str) -> None:
    arm.with_suffix(".elid.yaml").write_text(text)
    done = elid("classify", "--robot", str(arm))
    assert done.returncode == 2
    assert said in done.stderr


def test_what_the_file_holds_cannot_be_held_again(elid: Elid, arm: Path) -> None:
    arm.with_suffix(".elid.yaml").write_text("tip: left_tip\nlock: {left: 0.02}\n")
    done = elid("classify", "--robot", str(arm), "--json")
    assert json.loads(done.stdout)["joints"] == ["shoulder", "elbow"]
    assert "locked as arm.elid.yaml says: right at 0, left at 0.02" in done.stderr
    again = elid("classify", "--robot", str(arm), "--lock", "left=0")
    assert again.returncode == 2
    assert "already locked at 0.02" in again.stderr
    assert elid("classify", "--robot", str(arm), "--tip", "right_tip").returncode == 2


def test_fingers_that_stand_still_in_the_log_are_not_said_to_be_absent(elid: Elid, arm: Path, logs: Path) -> None:
    own = np.genfromtxt(logs / "link.csv", delimiter=",", names=True, deletechars="")
    columns = {name: own[name] for name in own.dtype.names}
    columns |= {f"q.{finger}": np.full(len(own), 0.02) for finger in ("left", "right")}
    columns |= {f"tau.{finger}": np.zeros(len(own)) for finger in ("left", "right")}
    log = arm.with_name("still.csv")
    np.savetxt(log, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    done = elid("init", str(arm), str(log), "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["absent"] == []
    assert "# lock: {left: 0.02, right: 0.02}   # as " in arm.with_suffix(".elid.yaml").read_text()


@pytest.mark.parametrize("log", ["run.jsonl", "run.csv.gz", "RUN.MCAP"])
def test_a_log_in_the_robots_place_is_told(tmp_path: Path, log: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / log).write_text("{}")
    assert main(["init", str(tmp_path / log), "arm.urdf"]) == 2
    assert "is a log; the robot's file comes first" in capsys.readouterr().err

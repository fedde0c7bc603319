"""Robots whose MJCF has rotors of their own, from the command line: as good as their YAML, and as MuJoCo moves them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.experiment.mjcf import mjcf_text
from elid_cli.robot.files import read_robot, robot_from_text, write_robot
from tests.robot.test_mjcf_rotors import SERIES

DRIVES = ("Jm", "Ja", "fs", "fv", "K")


def told(words: list[str], capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """Return what a command prints as JSON."""
    assert main([*words, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def drives(found: dict[str, Any]) -> dict[str, float]:
    """Return the estimates of drives and transmissions by name, 0 where the log does not show one."""
    return {
        p["name"]: p["estimate"] or 0.0 for p in found["base_parameters"] if p["name"].rstrip("0123456789") in DRIVES
    }


@pytest.mark.parametrize("name", ["planar2", "puma560"])
def test_what_was_found_serves_as_mjcf_as_it_does_as_yaml(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, xml, yaml = (str(tmp_path / file) for file in ("base.h5", "w.xml", "w.yaml"))
    options = ["--seed", "5", "--duration", "8", "--rate", "500", "--counts", "1250000"]
    assert main(["simulate", "--robot", name, *options, "-o", log]) == 0
    # a --physical set of PUMA 560: of its wrist, small motions leave bodies that no MJCF could hold
    words = ["identify", log, "--robot", name, *(["--physical"] if name == "puma560" else [])]
    capsys.readouterr()
    first = told([*words, "--write-robot", xml, "--write-robot", yaml], capsys)
    write_robot(replace(read_robot(yaml), effects=()), yaml)  # delays of its torque channels, which an MJCF cannot hold
    for verb in ("identify", "validate"):
        ours, theirs = (told([verb, log, "--robot", file], capsys) for file in (xml, yaml))
        for joint, error in theirs["error"].items():
            assert ours["error"][joint]["rms"] == pytest.approx(error["rms"], rel=1e-6)
            assert ours["error"][joint]["spring_rms"] == pytest.approx(error["spring_rms"], rel=1e-6)
        if verb == "identify":
            assert drives(ours) == pytest.approx(drives(theirs), rel=1e-8)
            assert ours["counts"]["base"] == theirs["counts"]["base"]
            for joint, error in first["error"].items():
                assert ours["error"][joint]["rms"] == pytest.approx(error["rms"], rel=1e-6)
    # patched, it is the same file with other numbers
    again = str(tmp_path / "again.xml")
    assert main(["identify", log, "--robot", xml, "--write-robot", again, *words[4:]]) == 0
    assert Path(again).read_text().count("<fixed") == read_robot(name).n
    mujoco = pytest.importorskip("mujoco")
    assert mujoco.MjModel.from_xml_path(again).ntendon == read_robot(name).n


def moved_by_mujoco(text: str, seconds: float, rate: float) -> dict[str, np.ndarray]:
    """Return a log of MuJoCo: joints and rotors as they stand in the file, torques of the rotors."""
    mujoco = pytest.importorskip("mujoco", reason="needs the wheel mujoco (extra: test)")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, finer = 1 / (20 * rate), 20
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.dof_solref[:] = (2 * model.opt.timestep, 1.0)  # friction as stiff as the step allows
    data = mujoco.MjData(model)
    names = [model.joint(k).name for k in range(model.njnt)]
    rotors = [model.joint(f"{name}_motor").id for name in ("shoulder", "elbow", "wrist")]
    turns = np.array([50.0, -30.0, 20.0])
    gains = np.array([400.0, 120.0, 12.0])
    rows: list[np.ndarray] = []
    waves = np.random.default_rng(1).uniform(0.5, 1.0, (3, 3)) * [[1], [1], [1.5]]
    for k in range(int(seconds * rate)):
        t = k / rate
        want = (waves * np.sin(np.array([1.3, 3.1, 7.7]) * t * [[1], [1.2], [1.5]]) * [1, 0.4, 0.1]).sum(axis=1)
        theta, dtheta = data.qpos[rotors] / turns, data.qvel[rotors] / turns
        data.qfrc_applied[rotors] = (gains * (want - theta) - 0.1 * gains * dtheta) / turns
        rows.append(np.concatenate([[t], data.qpos, data.qfrc_applied[rotors]]))
        for _ in range(finer):
            mujoco.mj_step(model, data)
    columns = ["t", *(f"pos.{name}" for name in names), *(f"effort.{model.joint(k).name}" for k in rotors)]
    return dict(zip(columns, np.array(rows).T, strict=True))


def test_a_log_of_mujoco_with_its_own_names_gives_what_the_file_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = moved_by_mujoco(SERIES, 20.0, 500.0)
    rows = np.stack(list(log.values()), axis=1)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(log), comments="")
    (tmp_path / "series.xml").write_text(SERIES)
    mapping = (
        'q: {from: "pos.{joint}"}\ntheta: {from: "pos.{joint}_motor", side: motor}\n'
        'tau: {from: "effort.{joint}_motor", side: motor}\n'
    )
    (tmp_path / "map.yaml").write_text(mapping)
    words = [str(tmp_path / "log.csv"), "--robot", str(tmp_path / "series.xml"), "--map", str(tmp_path / "map.yaml")]
    found = told(["identify", *words], capsys)
    for name, value in drives(found).items():
        reference = next(p["reference"] for p in found["base_parameters"] if p["name"] == name)
        assert value == pytest.approx(reference, rel=1e-3), name
    effects = {(item["effect"], item["joint"]): item["parameters"] for item in found["effects"]}
    for spec in read_robot(tmp_path / "series.xml").effects:
        assert effects.pop((spec.effect, spec.joint)) == pytest.approx(dict(spec.parameters), rel=5e-3)
    assert not effects
    assert max(error["relative"] for error in found["error"].values()) < 1e-4
    # without the motors' positions the joints count as rigid, and the links' friction as the motors'
    links = [name for name in log if not name.startswith("pos.") or not name.endswith("_motor")]
    rows = np.stack([log[name] for name in links], axis=1)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(links), comments="")
    (tmp_path / "map.yaml").write_text("\n".join(line for line in mapping.splitlines() if "theta" not in line))
    found = told(["identify", *words], capsys)
    assert {item["effect"] for item in found["effects"]} == {"link_spring"}
    assert drives(found)["fv1"] == pytest.approx(5.05, rel=0.1)


def test_a_file_with_rotors_is_replayed_by_elid_and_by_mujoco_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco", reason="needs the wheel mujoco (extra: test)")
    model, log = tmp_path / "series.xml", str(tmp_path / "log.h5")
    model.write_text(mjcf_text(robot_from_text(SERIES, "series.xml")))
    named = {"shoulder_rotor": "rotor_of_shoulder", "wrist_rotor": "spinner"}  # names are the file's own
    for old, new in named.items():
        model.write_text(model.read_text().replace(f'"{old}"', f'"{new}"'))
    assert read_robot(model).rotors["wrist"] == ("spinner", 1.0)
    assert main(["simulate", "--robot", str(model), "--seed", "3", "--duration", "4", "--rate", "500", "-o", log]) == 0
    capsys.readouterr()
    words = ["replay", log, "--robot", str(model), "--horizon", "0.5"]
    by = {engine: told([*words, "--engine", engine], capsys) for engine in ("elid", "mujoco")}
    for joint, error in by["elid"]["error"].items():
        assert error["mean_abs"] < 5e-4
        assert by["mujoco"]["error"][joint]["mean_abs"] < 5e-4
    assert by["mujoco"].get("left_out", []) == []

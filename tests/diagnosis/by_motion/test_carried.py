"""A tool that the robot file does not have, told by the motion of an arm that shares no code with elid."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion import carried
from elid_cli.diagnosis.by_motion.carried import load_by
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.trajectory.changes import Changed
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.experiment.replay.replay import replay
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording
from elid_cli.model.body_torques import gravity_torques, inertial_torques
from elid_cli.report.answers.motion_diagnosis import motion_diagnosis_payload, motion_diagnosis_report
from elid_cli.robot.files import read_robot
from elid_cli.robot.nearest_body import is_body
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

NAMES, DT, FINE = ("upper", "fore"), 0.005, 40
LENGTH, CENTRES, MASSES, INERTIAS = 0.35, (0.18, 0.15), (1.5, 0.8), (0.02, 0.008)
ARMATURE, COULOMB, VISCOUS, KP, KD = (0.02, 0.01), (0.3, 0.15), (0.25, 0.12), (60.0, 25.0), (2.0, 0.8)
TOOL, REACH = 0.3, 0.25


def described(folder: Path, first: float = 1.0) -> Robot:
    """Return the arm as its file has it, without the tool; the first body's mass off by a factor."""
    (mass, other), (centre, far), (about, own) = MASSES, CENTRES, INERTIAS
    path = folder / "arm.xml"
    path.write_text(
        '<mujoco model="arm"><worldbody><body name="one"><joint name="upper" type="hinge" axis="0 1 0"/>'
        f'<inertial pos="0 0 -{centre}" mass="{first * mass}" diaginertia="{about} {about} {about}"/>'
        f'<body name="two" pos="0 0 -{LENGTH}"><joint name="fore" type="hinge" axis="0 1 0"/>'
        f'<inertial pos="0 0 -{far}" mass="{other}" diaginertia="{own} {own} {own}"/></body></body>'
        "</worldbody></mujoco>"
    )
    return read_robot(path)


def moved(
    seed: int, tool: float, seconds: float = 6.0, zero: float = 0.0, late: float = 0.0, rate: float = 0.0
) -> Recording:
    """Return a log of the arm with a tool of some mass, integrated plainly under held commands.

    The first encoder reads positions too large by its zero, rad. The second drive is late by some seconds, and adds up
    the error at a rate, 1/s, of what its gain makes of it.
    """
    rng = np.random.default_rng(seed)
    count, h = round(seconds / DT) + 1, DT / FINE
    t, phase = DT * np.arange(count), rng.uniform(0, 2 * np.pi, (2, 3))
    waves = [(0.5, 1.7), (0.25, 4.3), (0.1, 9.1)]
    wanted = np.stack([sum(a * np.sin(w * (1 + 0.2 * k) * t + phase[k, n]) for n, (a, w) in enumerate(waves))
                       for k in range(2)], axis=1)  # fmt: skip
    mass = MASSES[1] + tool
    moment = MASSES[1] * CENTRES[1] + tool * REACH
    about = INERTIAS[1] + MASSES[1] * CENTRES[1] ** 2 + tool * REACH**2
    first = INERTIAS[0] + MASSES[0] * CENTRES[0] ** 2 + mass * LENGTH**2
    weight = (MASSES[0] * CENTRES[0] + mass * LENGTH) * 9.81

    def pulled(a: float, b: float, u: float, v: float, told: tuple[float, float]) -> tuple[float, float]:
        turn, both = LENGTH * moment * math.sin(b), 9.81 * moment * math.sin(a + b)
        x = told[0] - KP[0] * (a + zero) - KD[0] * u - VISCOUS[0] * u - COULOMB[0] * math.tanh(u / 1e-3)
        y = told[1] - KP[1] * b - KD[1] * v - VISCOUS[1] * v - COULOMB[1] * math.tanh(v / 1e-3)
        x -= weight * math.sin(a) + both - turn * (2 * u * v + v * v)
        y -= both + turn * u * u
        near = about + LENGTH * moment * math.cos(b)
        whole, last = first + 2 * near - about + ARMATURE[0], about + ARMATURE[1]
        det = whole * last - near * near
        return (last * x - near * y) / det, (whole * y - near * x) / det

    a, b, u, v = *wanted[0].tolist(), 0.0, 0.0
    q, behind, summed = np.empty((count, 2)), round(late / h), 0.0
    for k in range(count):
        q[k] = a + zero, b
        for n in range(FINE):
            second = float(wanted[max(k * FINE + n - behind, 0) // FINE, 1])
            summed += rate * KP[1] * h * (second - b - 0.5 * h * v)
            told = KP[0] * float(wanted[k, 0]), KP[1] * second + summed
            p, r = pulled(a, b, u, v, told)
            p, r = pulled(a + 0.5 * h * u, b + 0.5 * h * v, u + 0.5 * h * p, v + 0.5 * h * r, told)
            a, b = a + h * (u + 0.5 * h * p), b + h * (v + 0.5 * h * r)
            u, v = u + h * p, v + h * r
    q += 1e-4 * rng.standard_normal(q.shape)
    gains = {"kp": np.tile(KP, (count, 1)), "kd": np.tile(KD, (count, 1))}
    return Recording(NAMES, DT, t, q, q, np.full_like(q, np.nan), commands={"q_des": wanted, **gains},
                     segments=(Segment(0, count),), files=("made.h5",))  # fmt: skip


def written(folder: Path, recording: Recording) -> str:
    """Write a log and return its path."""
    write_recording(recording, folder / "log.h5")
    return str(folder / "log.h5")


def test_a_tool_is_told_in_kilograms_and_the_written_robot_carries_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, other = described(tmp_path), moved(2, TOOL, 4.0)
    log, out = written(tmp_path, moved(1, TOOL)), str(tmp_path / "found.xml")
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("payload", None)]
    (effect,) = found.effects
    truth = {"m": TOOL, "cx": 0.0, "cz": -TOOL * REACH}
    for name, value in truth.items():
        assert abs(effect.parameters[name] - value) < 4 * effect.std_error[name]
    assert effect.std_error["m"] < 0.01 * TOOL
    assert not found.unexplained
    assert not found.free_bodies
    values, error = found.fit_after.values, found.fit_after.unknowns.joint_values(found.fit_after.deviation)
    assert np.abs((values - np.stack([ARMATURE, COULOMB, VISCOUS, (0, 0)], axis=1)) / error).max() < 4
    assert replay(found.refined, other).mean_abs < 2e-4
    # a simulator gets the body with the tool
    monkeypatch.setattr("elid_cli.diagnosis.diagnose", lambda *_: found)  # what a search finds is tested above
    assert main(["diagnose", log, "--robot", arm.source, "--only", "payload", "--write-robot", out]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "a load that the file does not have" in said
    again = read_robot(out)
    assert again.joints[1].parameters["m"] == pytest.approx(MASSES[1] + TOOL, rel=0.01)
    assert replay(again, other).mean_abs < 2e-4


def test_a_tool_and_the_zero_of_an_encoder_are_found_beside_each_other(tmp_path: Path) -> None:
    """Each alone explains too little, with wrong values. Of this arm that zero is a tilt of the base as well."""
    arm, zero = described(tmp_path), 0.06
    log = written(tmp_path, moved(3, TOOL, zero=zero))
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    assert [e.effect for e in found.effects] == ["payload", "gravity_direction"]
    tool, tilt = found.effects
    for effect, name, value in ((tool, "m", TOOL), (tool, "cz", -TOOL * REACH), (tilt, "pitch", zero)):
        assert abs(effect.parameters[name] - value) < 4 * effect.std_error[name]
    assert tool.std_error["m"] < 0.02 * TOOL
    (rival,) = found.also_possible
    assert (rival.effect, rival.joint, rival.instead_of) == ("encoder_zero", "upper", "gravity_direction")
    assert rival.parameters["offset"] == pytest.approx(zero, abs=1e-3)
    assert not found.unexplained
    assert replay(found.refined, moved(4, TOOL, 4.0, zero)).mean_abs < 2e-4


def test_a_tool_and_a_wrong_gain_are_found_beside_each_other(tmp_path: Path) -> None:
    arm, gain = described(tmp_path), 0.1
    recording, factor = moved(5, TOOL), np.array([1.0, 1.0 + gain])
    told = {name: values * (factor if name in ("kp", "kd") else 1.0) for name, values in recording.commands.items()}
    log = written(tmp_path, replace(recording, commands=told))
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("payload", None), ("torque_gain", "fore")]
    tool, off = found.effects
    for effect, name, value in ((tool, "m", TOOL), (tool, "cz", -TOOL * REACH), (off, "gain", gain)):
        assert abs(effect.parameters[name] - value) < 4 * effect.std_error[name]
    assert off.std_error["gain"] < 0.1 * gain
    assert not found.unexplained
    # the written robot has the gain, and moves as the log does under the gains that are logged
    assert replay(found.refined, read_recording([log], arm)).mean_abs < 2e-4


@pytest.mark.parametrize(
    ("does", "kind", "name"), [({"late": 0.004}, "torque_delay", "delay"), ({"rate": 1.5}, "integral_action", "rate")]
)
def test_a_tool_and_what_a_drive_does_are_found_beside_each_other(
    tmp_path: Path, does: dict[str, float], kind: str, name: str
) -> None:
    arm, (truth,) = described(tmp_path), does.values()
    log = written(tmp_path, moved(7, TOOL, **does))
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("payload", None), (kind, "fore")]
    tool, of_drive = found.effects
    for effect, what, value in ((tool, "m", TOOL), (tool, "cz", -TOOL * REACH), (of_drive, name, truth)):
        assert abs(effect.parameters[what] - value) < 4 * effect.std_error[what]
    assert not found.unexplained
    assert replay(found.refined, moved(8, TOOL, 4.0, **does)).mean_abs < 2e-4


@pytest.mark.parametrize("seed", [7, 12])
def test_of_two_drives_the_late_one_is_named(tmp_path: Path, seed: int) -> None:
    """That the other is earlier by as much says the same: it was named, late by 0, or both were."""
    arm, late = described(tmp_path), 0.004
    log = written(tmp_path, moved(seed, 0.0, late=late))
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    (delay,) = found.effects
    assert (delay.effect, delay.joint) == ("torque_delay", "fore")
    assert abs(delay.parameters["delay"] - late) < 4 * delay.std_error["delay"]
    assert delay.std_error["delay"] < 1e-4
    assert not found.also_possible


def test_gains_of_two_joints_that_a_tool_leaves_alike_are_both_named(tmp_path: Path) -> None:
    """Both were named as missing, with a tool 27 errors off: one is the other's inverse with another tool."""
    arm, gain = described(tmp_path), 0.1
    recording, factor = moved(5, TOOL), np.array([1.0 + gain, 1.0])
    told = {name: values * (factor if name in ("kp", "kd") else 1.0) for name, values in recording.commands.items()}
    log = written(tmp_path, replace(recording, commands=told))
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    (named,) = (e for e in found.effects if e.effect == "torque_gain")
    (rival,) = (r for r in found.also_possible if r.effect == "torque_gain")
    gains = {named.joint: named.parameters["gain"], rival.joint: rival.parameters["gain"]}
    assert gains["upper"] == pytest.approx(gain, abs=0.01)
    assert gains["fore"] == pytest.approx(1 / (1 + gain) - 1, abs=0.01)
    # which of them it is decides the mass: both are told
    (own,) = (e for e in found.effects if e.effect == "payload")
    (other,) = rival.beside
    right, wrong = (own, other) if named.joint == "upper" else (other, own)
    assert other.effect == "payload"
    assert abs(right.parameters["m"] - TOOL) < 4 * right.std_error["m"]
    assert abs(wrong.parameters["m"] - TOOL) > 0.05
    said = f"{other.parameters['m']:.3g} kg if it is torque gain of {rival.joint}"
    sections = str(motion_diagnosis_report(found, "arm.yaml").sections)
    assert said in sections
    assert f"in place of that of {named.joint} it explains" in sections
    assert motion_diagnosis_payload(found)["also_possible"][0]["beside"][0]["parameters"]["m"] == other.parameters["m"]
    friction = replace(found, also_possible=(replace(rival, effect="stribeck"),))
    assert "the mass of the payload" not in str(motion_diagnosis_report(friction, "arm.yaml").sections)


def test_the_body_with_the_tool_is_written_as_one_that_there_may_be(tmp_path: Path) -> None:
    """Errors of its inertias broke the triangle inequality, and MuJoCo refuses such a body."""
    arm = described(tmp_path)
    by = load_by(arm)
    last = dict(arm.joints[1].parameters)
    off = {**last, "m": 1.1, "cz": -0.12 - TOOL * REACH, "Iyy": 0.05, "Ixx": 0.03, "Izz": 0.001}
    broken = replace(arm, joints=(arm.joints[0], replace(arm.joints[1], parameters=off)))
    whole = by.written(broken, arm)
    body = np.array([whole.joints[1].parameters.get(name, 0.0) for name in LINK_PARAMETERS])
    assert not is_body(np.array([off.get(name, 0.0) for name in LINK_PARAMETERS]))
    assert is_body(body)
    # what the joints feel stays
    q, dq, ddq = np.random.default_rng(2).standard_normal((3, 30, 2))
    for torques in (lambda robot: gravity_torques(robot, q), lambda robot: inertial_torques(robot, q, dq, ddq)):
        np.testing.assert_allclose(torques(whole), torques(broken), atol=1e-6)
    assert by.written(arm, arm).joints[1].parameters == {**last}


def test_a_wrong_gain_of_a_single_joint_is_told_beside_the_load_that_it_looks_like(tmp_path: Path) -> None:
    recording = plant.moved(4, 6.0)
    alone = {name: values[:, :1] for name, values in recording.commands.items()}
    alone |= {name: 1.2 * alone[name] for name in ("kp", "kd")}
    q = recording.q[:, :1]
    only = replace(recording, joints=("one",), q=q, theta=q, tau=recording.tau[:, :1], dq=None, commands=alone)
    path = tmp_path / "one.xml"
    path.write_text(
        '<mujoco model="one"><worldbody><body name="b"><joint name="one" type="hinge" axis="0 1 0"/><inertial '
        f'pos="0 0 -{plant.REACH[0]}" mass="{plant.MASS[0]}" diaginertia="0.02 0.02 0.02"/></body></worldbody></mujoco>'
    )
    arm = read_robot(path)
    found = diagnose_motion(arm, prepare(read_recording([written(tmp_path, only)], arm), arm))
    assert [e.effect for e in found.effects] == ["payload"]
    (rival,) = (r for r in found.also_possible if r.effect == "torque_gain")
    assert (rival.joint, rival.instead_of) == ("one", "payload")
    assert rival.parameters["gain"] == pytest.approx(0.2, abs=0.01)
    # the values below are those with the load
    sections = " ".join(str(motion_diagnosis_report(found, "arm.yaml").sections).split())
    size = 100 * (1 - 1 / (1 + rival.parameters["gain"]))
    words = f"If it is the gain, friction and offset below are {size:.2g} % smaller"
    assert words in sections


def test_recordings_with_and_without_a_tool_are_said_not_to_agree(tmp_path: Path) -> None:
    arm, logs = described(tmp_path), []
    for number, tool in enumerate((0.0, TOOL)):
        logs.append(str(tmp_path / f"log{number}.h5"))
        write_recording(moved(20 + number, tool, 4.0), Path(logs[-1]))
    found = diagnose_motion(arm, prepare(read_recording(logs, arm), arm), None, ("stribeck",))
    assert [one.mass for one in found.alone] == [None, pytest.approx(TOOL, abs=0.01)]
    assert all(one.mean_abs < 4e-4 for one in found.alone)
    sections = " ".join(str(motion_diagnosis_report(found, "arm.yaml").sections).split())
    assert "The recordings do not agree" in sections
    assert "log1.h5). elid diagnose of each alone tells what" in sections
    (said,) = [line for line in motion_diagnosis_payload(found)["warnings"] if "do not agree" in line]
    assert said.startswith("The recordings do not agree")
    same = diagnose_motion(arm, prepare(read_recording(logs[:1], arm), arm), None, ("stribeck",))
    assert not same.alone


def test_offsets_that_changed_between_recordings_are_told_and_no_bodies_are_blamed(tmp_path: Path) -> None:
    arm, logs, held = plant.robot(tmp_path), [], np.array([0.12, -0.08, 0.05])
    for number, own in enumerate((np.zeros(3), held)):
        logs.append(str(tmp_path / f"log{number}.h5"))
        write_recording(plant.moved(30 + number, 4.0, held=own), Path(logs[-1]))
    found = diagnose_motion(arm, prepare(read_recording(logs, arm), arm), None, ("stribeck",))
    offsets = {item.joint: item.values[1] - item.values[0] for item in found.differing if item.name == "offset"}
    assert [offsets[name] for name in plant.NAMES] == pytest.approx(-held, abs=0.01)
    assert {item.name for item in found.differing} == {"offset"}
    sections = " ".join(str(motion_diagnosis_report(found, "arm.yaml").sections).split())
    assert "The recordings do not agree on torque offset of one, two and three" in sections
    assert "Other bodies" not in sections
    assert not found.alone


def test_no_tool_is_told_where_there_is_none_and_a_wrong_mass_of_another_body_is_that_of_this_body(
    tmp_path: Path,
) -> None:
    """It was named as gains and springs."""
    log = written(tmp_path, moved(3, 0.0, 8.0))
    arm = described(tmp_path)
    assert not diagnose_motion(arm, prepare(read_recording([log], arm), arm)).effects
    arm, first = described(tmp_path, 2.0), 1.0 * MASSES[0] * CENTRES[0]
    found = diagnose_motion(arm, prepare(read_recording([log], arm), arm))
    assert [(e.effect, e.joint) for e in found.effects] == [("payload", "upper")]
    (effect,) = found.effects
    assert abs(effect.parameters["cz"] - first) < 4 * effect.std_error["cz"]
    assert effect.std_error["cz"] < 0.02 * first
    assert "this body carries a load" in effect.summary
    assert replay(found.refined, moved(4, 0.0, 4.0)).mean_abs < 2e-4


def test_a_wrong_mass_of_an_inner_body_is_told_at_the_arm_that_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two arms on one base: inner bodies of the other one are not fitted."""
    sides = [moved(3, 0.0, 5.0), moved(5, 0.0, 5.0)]
    path, file = tmp_path / "arms.xml", Path(described(tmp_path).source).read_text()
    body = file[file.index("<body") : file.index("</worldbody>")]
    mass = f'mass="{MASSES[0]}"'
    arms = [body, body.replace(mass, f'mass="{2 * MASSES[0]}"')]
    for side, names in enumerate((("upper", "fore"), ("other_upper", "other_fore"))):
        for name, other in zip(NAMES, names, strict=True):
            arms[side] = arms[side].replace(f'joint name="{name}"', f'joint name="{other}"')
        arms[side] = arms[side].replace('body name="', f'body name="{["left", "right"][side]}_')
    path.write_text(file.replace(body, "".join(arms)))
    robot = read_robot(path)
    assert mass in file
    load_at, asked = carried._load_at, list[int]()

    def counted(before: TrajectoryFit, body: int) -> Changed | None:
        asked.append(body)
        return load_at(before, body)

    monkeypatch.setattr(carried, "_load_at", counted)
    q, wanted, kp, kd = (np.concatenate(parts, axis=1) for parts in zip(*(
        (side.q, *(side.commands[name] for name in ("q_des", "kp", "kd"))) for side in sides
    ), strict=True))  # fmt: skip
    both = replace(sides[0], joints=robot.joint_names, q=q, theta=q, tau=np.full_like(q, np.nan),
                   commands={"q_des": wanted, "kp": kp, "kd": kd})  # fmt: skip
    log = written(tmp_path, both)
    found = diagnose_motion(robot, prepare(read_recording([log], robot), robot))
    assert [(e.effect, e.joint) for e in found.effects] == [("payload", "other_upper")]
    assert 2 in asked
    assert 0 not in asked
    (effect,) = found.effects
    assert abs(effect.parameters["cz"] - MASSES[0] * CENTRES[0]) < 4 * effect.std_error["cz"]


def test_of_several_arms_the_one_that_carries_is_told(tmp_path: Path) -> None:
    """Pendulums beside each other are branches of a tree: the file of one of them lacks a load off its centre line."""
    path = tmp_path / "lacking.xml"
    path.write_text(Path(plant.robot(tmp_path).source).read_text().replace(
        'pos="0 0 -0.2" mass="0.8"', 'pos="0.04 0 -0.2" mass="0.7"'
    ))  # fmt: skip
    arms = read_robot(path)
    log = plant.written(tmp_path, "log.h5", plant.moved(4, 7.0, delay=0.002))
    found = diagnose_motion(arms, prepare(read_recording([log], arms), arms))
    assert [(e.effect, e.joint) for e in found.effects] == [("payload", "two")]
    (effect,) = found.effects
    # the truth less what the file has: no joint feels the mass, or what lies along the axis
    for name, value in {"cx": -0.04 * 0.7, "cz": -0.2 * 0.8 + 0.2 * 0.7}.items():
        assert abs(effect.parameters[name] - value) < 4 * effect.std_error[name]
        assert effect.std_error[name] < 0.1 * abs(value)
    assert not found.unexplained
    assert replay(found.refined, plant.moved(9, 6.0, delay=0.002)).mean_abs < 2e-4

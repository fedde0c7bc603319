"""Sensors on links without position sensors: their equations, their mounting, and the stiffness that they show."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from elid_cli._types import Array
from elid_cli.cli import main
from elid_cli.estimation.motor_side import mounting
from elid_cli.estimation.motor_side.by_unknowns import by_unknowns
from elid_cli.estimation.motor_side.estimate import motor_side
from elid_cli.estimation.motor_side.link_sensors import KINDS, MISLEADS, Kind, LinkSensors, Sensed, sensors_of, watched
from elid_cli.estimation.motor_side.motor_log import Samples
from elid_cli.estimation.motor_side.result import LinkSensor, MotorSide, MotorSideJoint
from elid_cli.estimation.motor_side.setting import Setting
from elid_cli.estimation.motor_side.several import put_together
from elid_cli.estimation.motor_side.stretch import stretch_of
from elid_cli.logs import write_recording
from elid_cli.model.link_vectors import LinkForces, LinkRates, LinkVectors
from elid_cli.report.answers.motor_side import sensor_sections
from elid_cli.robot.files import read_robot, write_robot
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import ACCEL, GYRO
from tests.estimation.motor_side.test_pieces import problem_of, setting_of
from tests.system.motor_arms import Case, motor_log, random_motor_arm, told_robot
from tests.system.plain_arms import Arm

SLOW = Case(kind="smooth", signal_to_noise=70.0)
"""Motion that ends far below the antiresonances."""


def frames(robot: Robot, q: Array) -> list[Array]:
    """Return the placements (4, 4) of every link's frame in the base's, by the joints' placements alone."""
    found: list[Array] = []
    for k, (joint, (before, after)) in enumerate(zip(robot.joints, robot.placements(), strict=True)):
        c, s = (np.cos(q[k]), np.sin(q[k])) if joint.revolute else (1.0, 0.0)
        moved = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0 if joint.revolute else q[k]], [0, 0, 0, 1]])
        own = before @ moved @ after
        found.append(found[robot.parents[k]] @ own if robot.parents[k] >= 0 else own)
    return found


def test_rates_of_links_are_those_of_their_rotations() -> None:
    """By differences of the rotation matrices: Rᵀ dR/dt = [ω]×."""
    robot = read_robot("puma560")
    q, dq = np.random.default_rng(5).uniform(-1, 1, (2, robot.n))
    joints, step = (1, 4, 5), 1e-6
    found = LinkRates(robot, joints).values((q[None], dq[None]))[0]
    ahead, behind, here = (frames(robot, q + sign * step * dq) for sign in (1, -1, 0))
    for rate, k in zip(found, joints, strict=True):
        cross = (here[k].T @ (ahead[k] - behind[k]))[:3, :3] / (2 * step)
        assert rate == pytest.approx([cross[2, 1], cross[0, 2], cross[1, 0]], abs=1e-8)


def test_forces_on_links_are_those_of_their_places() -> None:
    """By second differences of where the places are: Rᵀ (d²p/dt² - g)."""
    robot = read_robot("puma560")
    generator = np.random.default_rng(7)
    q, dq, ddq = generator.uniform(-1, 1, (3, robot.n))
    joints, places, step = (1, 4, 5), generator.uniform(-0.2, 0.2, (3, 3)), 1e-3
    found = LinkForces(robot, joints).values((q[None], dq[None], ddq[None]), places)[0]
    ahead, behind, here = (frames(robot, q + t * dq + 0.5 * t * t * ddq) for t in (step, -step, 0.0))
    for force, k, place in zip(found, joints, places, strict=True):
        there, before, now = (poses[k] @ np.r_[place, 1.0] for poses in (ahead, behind, here))
        acceleration = ((there - 2 * now + before) / step**2)[:3]
        assert force == pytest.approx(here[k][:3, :3].T @ (acceleration - robot.gravity), abs=1e-5)


@pytest.mark.parametrize("kind", [LinkRates, LinkForces])
def test_slopes_of_vectors_are_those_of_differences(kind: type[LinkVectors]) -> None:
    robot = read_robot("puma560")
    generator = np.random.default_rng(6)
    state, places = generator.uniform(-1, 1, (kind.orders, robot.n)), generator.uniform(-0.2, 0.2, (2, 3))
    vectors = kind(robot, (2, 5))
    slopes = vectors.slopes(state[:, None], places)

    def moved(step: Array, apart: Array) -> Array:
        pair = [vectors.values((state + sign * step)[:, None], places + sign * apart)[0] for sign in (1, -1)]
        return np.asarray((pair[0] - pair[1]) / 2e-6)

    for order in range(kind.orders):
        for joint in range(robot.n):
            step = np.zeros_like(state)
            step[order, joint] = 1e-6
            assert slopes.by_motion[order, 0, :, :, joint] == pytest.approx(moved(step, 0 * places), abs=1e-7)
    assert slopes.by_place.shape == (1, 2, 3, kind.placed)
    for axis in range(kind.placed):
        apart = np.zeros_like(places)
        apart[:, axis] = 1e-6
        assert slopes.by_place[0, :, :, axis] == pytest.approx(moved(0 * state, apart), abs=1e-7)


def test_what_sensors_measure_follows_their_mounting_bias_delay_and_place() -> None:
    setting = setting_of(random_motor_arm(np.random.default_rng([47, 77]), 3))
    problem, x, coefficients = problem_of(setting)
    now = problem.model(coefficients, x)
    slopes = by_unknowns(problem, now, x, problem.friction_slopes(now, x))[1]
    places = problem.unknowns.of_sensors.tolist()
    assert len(places) == 2 * 13 + 2 * 16
    for place in places:
        step = np.zeros_like(x)
        step[place] = 1e-6
        ahead, back = (problem.residual(coefficients, x + sign * step)[1] for sign in (1, -1))
        moved = (back - ahead) * problem.tau_noise / 2e-6
        assert slopes[:, :, place] == pytest.approx(moved, abs=1e-6 * max(1.0, np.abs(moved).max()))


def test_knots_follow_what_sensors_feel_beyond_the_motors_motion() -> None:
    """Links ring where the motors' positions show nothing; a spline that cannot bends the stiffness."""
    setting = setting_of(random_motor_arm(np.random.default_rng([47, 77]), 3))
    gyros, accelerometers = setting.samples.sensors
    t = setting.samples.t
    still = replace(accelerometers, values=0.02 * np.random.default_rng(1).standard_normal(accelerometers.values.shape))
    ringing = replace(still, values=still.values + np.sin(2 * np.pi * 63.0 * t)[:, None])
    none = sensors_of(told_robot(arm_of(2), 2), motor_log(arm_of(2), 2, SLOW), range(2))

    def set_by(*sensors: LinkSensors) -> Setting:
        return Setting(replace(setting.samples, sensors=sensors), setting.link, setting.rotors)

    alone, felt = set_by(*none), set_by(gyros, ringing)
    assert alone.band == alone.bands.max()
    assert alone.spacing == pytest.approx(np.clip(0.2 / alone.band, 0.003, 0.012))
    assert felt.band == pytest.approx(63.0, abs=1.5)
    assert set_by(gyros, still).spacing == pytest.approx(max(0.1 / set_by(gyros, still).band, 0.003))
    assert felt.cutoff == pytest.approx(1.2 * felt.band)


def test_a_stretch_ends_where_a_sensor_has_a_gap() -> None:
    arm = random_motor_arm(np.random.default_rng([47, 77]), 2)
    log, robot = motor_log(arm, 47, Case(duration=6.0, accelerometers=(1,))), told_robot(arm, 47)
    log.accel["accel_y"][2000:2100, 1] = np.nan
    samples = stretch_of(log, np.arange(2), sensors_of(robot, log, range(2)))
    assert isinstance(samples, Samples)
    assert samples.t[0] == log.t[2100]


def arm_of(seed: int) -> Arm:
    return random_motor_arm(np.random.default_rng([seed, 77]), 2)


def said(seed: int, case: Case, **changed: Array) -> MotorSide:
    arm = arm_of(seed)
    log = motor_log(arm, seed, case)
    gyro = log.gyro | {axis: values for axis, values in changed.items() if axis in GYRO}
    accel = log.accel | {axis: values for axis, values in changed.items() if axis in ACCEL}
    found = motor_side(told_robot(arm, seed), replace(log, gyro=gyro, accel=accel), np.zeros(2, dtype=bool))
    assert found is not None
    return found


@cache
def said_alone(seed: int) -> MotorSide:
    return said(seed, SLOW)


@pytest.mark.parametrize(("kind", "seed"), [("gyros", 2), ("accelerometers", 5)])
def test_sensors_show_stiffnesses_that_the_motors_do_not(kind: str, seed: int) -> None:
    assert any(joint.verdict != "supported" for joint in said_alone(seed).joints)
    together = said(seed, replace(SLOW, **{kind: (0, 1)}))
    for joint in together.joints:
        assert joint.verdict == "supported"
        true = arm_of(seed).stiffness[joint.number]
        assert joint.stiffness == pytest.approx(true, rel=0.004)
        assert abs(joint.stiffness - true) < 4 * joint.std_error
    assert [sensor.reason for sensor in together.sensors] == ["", ""]
    for sensor in together.sensors:
        turn = np.array(sensor.mounting)
        seen = turn[:, [2]] if kind == "gyros" else turn[:, :2]  # a planar arm turns about z, and moves across it
        assert seen.T @ seen == pytest.approx(np.eye(seen.shape[1]), abs=0.08)
        assert sensor.delay == pytest.approx(2e-3, abs=2e-4)
        assert len(sensor.bias) == 3
        assert max(map(abs, sensor.bias)) < 0.2
        assert len(sensor.place) == (3 if kind == "accelerometers" else 0)


@pytest.mark.parametrize(
    ("kind", "signals", "reason"),
    [("gyros", GYRO, "does not turn as its link does"), ("accelerometers", ACCEL, "does not feel what its link does")],
)
def test_a_sensor_of_another_link_is_left_out_and_said(kind: str, signals: tuple[str, ...], reason: str) -> None:
    case = replace(SLOW, **{kind: (0, 1)})
    log = motor_log(arm_of(2), 2, case)
    swapped = {axis: np.asarray(log.signal(axis))[:, ::-1] for axis in signals}
    found, alone = said(2, case, **swapped), said_alone(2)
    assert all(reason in sensor.reason for sensor in found.sensors)
    assert len(found.sensors) == 2
    assert [joint.stiffness for joint in found.joints] == pytest.approx(
        [j.stiffness for j in alone.joints], nan_ok=True
    )


def test_a_sensor_that_misleads_costs_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Accelerometers of other links that pass the first check: the fit without them stands, and the report says so."""
    case = replace(SLOW, accelerometers=(0, 1), gyros=(0, 1))
    log = motor_log(arm_of(2), 2, case)
    swapped = {axis: np.asarray(log.signal(axis))[:, ::-1] for axis in ACCEL}
    monkeypatch.setattr(mounting, "UNLIKE", np.inf)
    monkeypatch.setattr(mounting, "MOST_BIAS", np.inf)
    found = said(2, case, **swapped)
    assert {(sensor.kind, sensor.reason) for sensor in found.sensors} == {
        ("gyroscope", ""),
        ("accelerometer", MISLEADS),
    }
    for joint in found.joints:
        assert joint.stiffness == pytest.approx(arm_of(2).stiffness[joint.number], rel=0.004)


def test_about_a_vertical_axis_a_wrong_unit_is_told_by_the_weight() -> None:
    robot = Robot("turret", (Joint("turn"),), gravity=(0.0, 0.0, -9.81))
    t = np.arange(0.0, 6.0, 0.002)
    theta = np.sin(2.5 * t)[:, None]
    motion = theta, 2.5 * np.cos(2.5 * t)[:, None], -6.25 * np.sin(2.5 * t)[:, None]
    felt = LinkForces(robot, (0,)).values(motion, np.array([[0.05, 0.02, 0.0]]))[:, 0]
    for unit, used in ((1.0, 1), (1 / 9.80665, 0)):
        logged = LinkSensors(KINDS[1], (0,), unit * felt, np.zeros(3), np.eye(3)[None], np.zeros((1, 3)))
        found, refused = mounting.mounted(logged, robot, theta, 0.002)
        assert (len(found.joints), len(refused)) == (used, 1 - used)
    assert re.search(r"feels 0\.1\d? times as much", refused[0])


def test_a_gyroscope_on_a_link_that_slides_is_said_to_be_on_one() -> None:
    robot = Robot("slide", (Joint("slide", "prismatic"),))
    t = np.arange(0.0, 6.0, 0.002)
    noise = 1e-3 * np.random.default_rng(3).standard_normal((len(t), 3))
    logged = LinkSensors(KINDS[0], (0,), noise, np.zeros(3), np.eye(3)[None], np.zeros((1, 3)))
    found, refused = mounting.mounted(logged, robot, np.sin(t)[:, None], 0.002)
    assert found.joints == ()
    assert refused == {0: "its link does not turn"}


def test_several_logs_tell_which_of_them_used_a_sensor() -> None:
    good = LinkSensor("accelerometer", "joint1", "", bias=(0.1, 0.0, 0.0))
    bad = LinkSensor("accelerometer", "joint1", "it saturates")
    joint = MotorSideJoint("joint1", 0, "refused", reason="no motion")
    sides = [("one.h5", MotorSide((joint,), sensors=(good,))), ("two.h5", MotorSide((joint,), sensors=(bad,)))]
    for logs in (sides, sides[::-1]):
        told = put_together(logs, 2)
        assert [(sensor.reason, sensor.bias) for sensor in told.sensors] == [
            ("", (0.1, 0.0, 0.0)), ("two.h5: it saturates", ()),
        ]  # fmt: skip
        assert told.source == "motor position and torque and from accelerometers"
        shown = sensor_sections(told.sensors)
        assert [text.key for text in shown] == ["accelerometer_joint1", "accelerometer_joint1_2"]
        assert "two.h5: it saturates" in shown[1].text


def test_an_accelerometer_that_counts_in_g_is_said_to_feel_a_tenth() -> None:
    case = replace(SLOW, accelerometers=(0,))
    log = motor_log(arm_of(2), 2, case)
    found = said(2, case, **{axis: np.asarray(log.signal(axis)) / 9.80665 for axis in ACCEL})
    assert re.search(r"it feels 0\.1\d? times as much", found.sensors[0].reason)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: str(kind.name))
def test_one_sensor_tells_joints_apart_only_where_their_motions_differ(kind: Kind) -> None:
    planar, both, still = told_robot(arm_of(2), 2), np.ones(2, dtype=bool), np.zeros((1, 2))

    def seen(robot: Robot, joints: tuple[int, ...], elastic: Array, q: Array) -> list[bool]:
        return watched([Sensed(kind, robot, joints)], [np.zeros((len(joints), 3))], elastic, q).tolist()

    # the stretched arm's end is moved along one line by both joints, and turned about one axis
    assert seen(planar, (1,), both, still) == [False, False]
    assert seen(planar, (0,), both, still) == [True, False]
    assert seen(planar, (0, 1), both, still) == [True, True]
    assert seen(planar, (), both, still) == [False, False]
    robot = read_robot("puma560")
    assert seen(robot, (1,), np.arange(6) < 2, np.full((1, 6), 0.3))[:2] == [True, True]


def test_joints_that_move_a_sensor_almost_alike_are_not_told_apart() -> None:
    """The end of two links: their motions of it are as far apart as the second link's direction is from the whole's."""
    robot = told_robot(arm_of(2), 2)
    first, second = (joint.a for joint in robot.joints)
    bent = np.linspace(0.0, 1.2, 100001)
    apart = np.sin(np.arctan2(first * np.sin(bent), second + first * np.cos(bent)))
    both, sensed = np.ones(2, dtype=bool), [Sensed(KINDS[1], robot, (1,))]
    for share, told in ((0.28, False), (0.32, True)):
        q = np.array([[0.4, np.interp(share, apart, bent)]])
        assert watched(sensed, [np.zeros((1, 3))], both, q).tolist() == [told, told]


def test_only_rows_of_accelerometers_have_a_least_noise() -> None:
    """As a share of their own size; gyroscopes' do not lead a fit astray that is on its way."""
    setting = setting_of(random_motor_arm(np.random.default_rng([47, 77]), 3))
    log, many = setting.log, 3 * len(setting.samples.sensors[0].joints)
    size = np.std(log.sensed, axis=0)
    np.testing.assert_array_equal(log.sensed_size[:many], 0.0)
    np.testing.assert_allclose(log.sensed_size[many:], 0.1 * size[many:])


def test_without_sensors_nothing_is_added() -> None:
    robot = told_robot(arm_of(2), 2)
    log = motor_log(arm_of(2), 2, SLOW)
    for own in sensors_of(robot, log, range(2)):
        none = Sensed(own.kind, robot, own.joints)
        assert none.size == 0
        assert none.prior(own)[0].size == 0


@pytest.mark.parametrize(
    ("kind", "name", "unit"), [("gyros", "gyroscope", "mrad/s"), ("accelerometers", "accelerometer", "m/s²")]
)
def test_the_report_and_json_say_what_was_found_of_a_sensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, name: str, unit: str
) -> None:
    """From a file with a topic of its own, as a program writes it."""
    arm = random_motor_arm(np.random.default_rng([21, 77]), 1)
    write_robot(told_robot(arm, 21), tmp_path / "arm.yaml")
    write_recording(motor_log(arm, 21, replace(SLOW, **{kind: (0,)})), tmp_path / "log.mcap")
    line = ["identify", str(tmp_path / "log.mcap"), "--robot", str(tmp_path / "arm.yaml")]
    assert main(line) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"from motor position and torque and from {name}s" in text
    assert f"{name} behind joint1: used, its mounting found" in text
    assert re.search(rf" {unit}, (1\.\d|2|2\.\d) ms late", text)
    assert main([*line, "--json"]) == 0
    payload = json.loads(capsys.readouterr().out)
    (sensor,) = payload["motor_side"][f"{name}s"]
    assert sensor["joint"] == "joint1"
    assert sensor["reason"] == ""
    axis = 2 if kind == "gyros" else 0
    assert np.linalg.norm(np.array(sensor["mounting"])[:, axis]) == pytest.approx(1.0, abs=0.04)
    assert ("place" in sensor) == (kind == "accelerometers")
    schema = json.loads((Path(__file__).parents[3] / "docs/reference/elid-1.schema.json").read_text("utf-8"))
    own = {"$defs": schema["$defs"], "$ref": "#/$defs/motor_side"}
    Draft202012Validator(own).validate(payload["motor_side"])

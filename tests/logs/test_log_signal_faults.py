"""Missing, empty and wrong signals: refused by name, or read with a warning; never a quietly wrong number."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elid_cli.errors import LogError, UsageError
from elid_cli.logs import read_map_options, read_recording
from elid_cli.logs.checks.encoder_pairs import Pair
from elid_cli.logs.mapping.plan import ReadPlan
from elid_cli.robot.robot import Joint, Robot
from tests.logs.faults import table
from tests.logs.made_logs import GEARS, JOINTS, ROBOT, like, read, recording, same, written
from tests.logs.mcap_made import canonical

BASE = recording(600)
GOOD = table(BASE)
NAN = np.full_like(BASE.q, np.nan)


def refused(path: Path, **options: object) -> LogError:
    with pytest.raises(LogError) as caught:
        read(path, **options)
    assert caught.value.exit_code == 3
    assert caught.value.hint
    return caught.value


@pytest.mark.parametrize("absent", ["empty", "zero", "nan"])
@pytest.mark.parametrize("suffix", [".csv", ".h5", ".mcap"])
def test_no_torque_at_all_is_refused(tmp_path: Path, absent: str, suffix: str) -> None:
    tau = NAN if absent != "zero" else np.zeros_like(BASE.tau)
    error = refused(written(tmp_path, f"log{suffix}", like(BASE, tau=tau)))
    assert "no torque" in error.message
    assert "map it: --map tau=" in error.hint
    assert "tau" in error.detail


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_the_hint_of_a_missing_joint_is_a_mapping_of_the_nearest_name_that_works(tmp_path: Path, suffix: str) -> None:
    """Not of the log's first column, which is another joint's; for every signal in turn, until the log can be read."""
    path = written(tmp_path, f"log{suffix}", BASE)
    robot = replace(ROBOT, joints=(*ROBOT.joints[:2], replace(ROBOT.joints[2], name="wrists")))
    mapping: dict[str, Any] = {}
    for _ in range(3):
        with pytest.raises(LogError) as caught:
            read_recording([path], robot, mapping=mapping, strict=True)
        mapping.update(read_map_options(shlex.split(caught.value.hint.partition("map it: ")[2])[1::2]))
    assert set(mapping) == {"theta", "q", "tau"}
    assert all(spec["joints"]["wrists"] == "wrist" for spec in mapping.values())
    found = read_recording([path], robot, mapping=mapping, strict=True)
    np.testing.assert_allclose(found.theta[:, 2], BASE.theta[:, 2], atol=1e-9)


@pytest.mark.parametrize(
    "given",
    [
        {"tau": {"from": "/arm/motors.current"}},  # the example of the hint without a mapping
        {"tau": {"from": "torque_a"}},  # the column whose name fits best, of one joint of three
        {"tau": {"from": "tau{i}"}},  # placed, but holds nothing
        {"tau": {"from": "tau{i}", "joints": {"shoulder": 1, "elbow": 2, "wrist": 3}}},
    ],
)
def test_a_mapping_that_failed_is_not_what_the_hint_proposes(tmp_path: Path, given: dict[str, Any]) -> None:
    zero = table(like(BASE, tau=np.zeros_like(BASE.tau)))
    names = {f"tau__{joint}": f"tau{k + 1}" for k, joint in enumerate(JOINTS)}
    log = zero.renamed(**names)
    path = replace(log, names=(*log.names, "torque_a"), rows=np.hstack([log.rows, BASE.tau[:, :1]])).save(
        tmp_path / "log.csv"
    )
    error = refused(path, mapping=given)
    assert given["tau"]["from"] not in error.hint, error.hint
    assert "log.csv" in error.hint


def test_the_name_that_a_mapping_gives_an_empty_joint_is_not_proposed_again(tmp_path: Path) -> None:
    robot = replace(ROBOT, joints=(*ROBOT.joints[:2], replace(ROBOT.joints[2], name="wrists")))
    theta = BASE.theta.copy()
    theta[:, 2] = np.nan
    path = written(tmp_path, "log.mcap", like(BASE, theta=theta))
    names = {"shoulder": "shoulder", "elbow": "elbow", "wrists": "wrist"}
    given = {signal: {"from": topic, "joints": names} for signal, topic in
             (("q", "/joint_states"), ("theta", "/motor_states"), ("tau", "/motor_states"))}  # fmt: skip
    with pytest.raises(LogError) as caught:
        read_recording([path], robot, mapping=given)
    assert "no motor position for wrists" in caught.value.message
    assert "which is empty, NaN or never changes for it" in caught.value.detail
    assert "wrists: wrist" not in caught.value.hint


@pytest.mark.parametrize("option", ["tau: {from: 'torque{i}', sign: -1}", "tau={from: 'torque{i}', sign: -1}"])
def test_the_line_that_a_hint_gives_is_a_value_of_map(option: str) -> None:
    assert read_map_options([option]) == {"tau": {"from": "torque{i}", "sign": -1}}
    assert read_map_options(["tau={joint}_torque"]) == {"tau": {"from": "{joint}_torque"}}
    with pytest.raises(UsageError, match="quote patterns"):
        read_map_options(["tau: {from: {joint}_torque}"])


def test_a_missing_joint_lists_the_names_seen_and_the_nearest(tmp_path: Path) -> None:
    robot = Robot("arm", (Joint("shoulder"), Joint("elbow"), Joint("wrist1")))
    for suffix in (".mcap", ".csv", ".h5"):
        path = written(tmp_path, f"log{suffix}", BASE)
        with pytest.raises(LogError) as caught:
            read_recording([path], robot)
        assert "for wrist1" in caught.value.message
        assert "wrist" in caught.value.detail.replace("wrist1", "")


def test_an_elastic_joint_without_motor_position_is_refused(tmp_path: Path) -> None:
    theta = BASE.theta.copy()
    theta[:, 1] = np.nan
    error = refused(written(tmp_path, "log.mcap", like(BASE, theta=theta)))
    assert "no motor position for elbow" in error.message


def test_one_side_only_is_read_with_a_warning(tmp_path: Path) -> None:
    q = BASE.q.copy()
    q[:, 2] = np.nan
    for suffix in (".csv", ".h5", ".mcap"):
        path = written(tmp_path, f"log{suffix}", like(BASE, q=q))
        got = read(path)
        assert np.isnan(got.q[:, 2]).all()
        assert np.array_equal(got.theta, BASE.theta)
        assert any("wrist" in text and "transmission counts as rigid" in text for text in got.warnings)
        assert "link position" in refused(path, strict=True).message


def test_a_joint_without_torque_is_read_with_a_warning(tmp_path: Path) -> None:
    tau = BASE.tau.copy()
    tau[:, 0] = 0.0
    got = read(written(tmp_path, "log.csv", like(BASE, tau=tau)))
    assert np.isnan(got.tau[:, 0]).all()
    assert np.array_equal(got.tau[:, 1:], BASE.tau[:, 1:])
    assert any("zero throughout" in text for text in got.warnings)
    refused(tmp_path / "log.csv", strict=True)


@pytest.mark.parametrize(("value", "said"), [(0.0, "is zero throughout"), (2.5, "is 2.5 throughout while it moves")])
def test_torques_that_say_nothing_are_refused_with_the_reason(tmp_path: Path, value: float, said: str) -> None:
    error = refused(written(tmp_path, "log.csv", like(BASE, tau=np.full_like(BASE.tau, value))))
    assert error.message.endswith("no torque")
    assert said in (error.detail or "")


def test_zero_velocities_and_link_torques_count_as_absent(tmp_path: Path) -> None:
    zero = np.zeros_like(BASE.q)
    got = read(written(tmp_path, "log.mcap", like(BASE, dq=zero, dtheta=zero, tau_link=zero)))
    assert got.dq is got.dtheta is got.tau_link is None
    assert got.warnings == ()


def test_effort_on_joint_states_is_the_link_torque(tmp_path: Path) -> None:
    got = read(written(tmp_path, "log.mcap", like(BASE, tau_link=0.9 * BASE.tau)))
    assert got.tau_link is not None
    assert np.array_equal(got.tau_link, 0.9 * BASE.tau)


def test_infinite_values_count_as_missing(tmp_path: Path) -> None:
    tau = BASE.tau.copy()
    tau[100, 1] = np.inf
    got = read(written(tmp_path, "log.h5", like(BASE, tau=tau)))
    assert np.isfinite(got.tau).all()
    same(got, BASE, 1e-3)
    assert any("tau of elbow: 1 of 600" in text for text in got.repairs)


# mappings


def mapped(tmp_path: Path, raw: dict, spec: dict | str, signal: str = "theta") -> np.ndarray:
    broken = GOOD.with_column("theta.elbow", raw["change"]) if "change" in raw else GOOD
    got = read(broken.save(tmp_path / "log.csv"), mapping={signal: spec})
    return getattr(got, signal)


@pytest.mark.parametrize(
    ("factor", "spec"),
    [
        (180 / np.pi, {"unit": "deg"}),
        (1 / (2 * np.pi), {"unit": "rev"}),
        (4096 / (2 * np.pi), {"unit": "counts:4096"}),
        (-1.0, {"sign": -1}),
        (2.0, {"scale": 0.5}),
    ],
)
def test_units_scales_and_signs(tmp_path: Path, factor: float, spec: dict) -> None:
    broken = GOOD
    for joint in JOINTS:
        broken = broken.with_column(f"theta.{joint}", lambda x: x * factor)
    got = read(broken.save(tmp_path / "log.csv"), mapping={"theta": {"from": "theta.{joint}", **spec}})
    assert np.abs(got.theta - BASE.theta).max() < 1e-12


def test_motor_side_values_use_the_gear_ratio(tmp_path: Path) -> None:
    broken = GOOD
    for joint, gear in zip(JOINTS, GEARS, strict=True):
        broken = broken.with_column(f"theta.{joint}", lambda x, gear=gear: x * gear)
        broken = broken.with_column(f"tau.{joint}", lambda x, gear=gear: x / gear / 0.115)
    mapping = {
        "theta": {"from": "theta.{joint}", "side": "motor"},
        "tau": {"from": "tau.{joint}", "unit": "A", "scale": [0.115] * 3, "side": "motor"},
    }
    same(read(broken.save(tmp_path / "log.csv"), mapping=mapping), BASE, 1e-12)


def test_offsets_per_joint_and_a_deflection_sensor(tmp_path: Path) -> None:
    broken = GOOD
    for joint in JOINTS:
        j = JOINTS.index(joint)
        broken = broken.with_column(f"q.{joint}", lambda x, j=j: BASE.q[:, j] - BASE.theta[:, j])
    broken = broken.with_column("theta.wrist", lambda x: x + 0.5)
    mapping = {
        "theta": {"from": "theta.{joint}", "offset": {"wrist": -0.5}},
        "q": {"from": "q.{joint}", "add": "theta"},
    }
    same(read(broken.save(tmp_path / "log.csv"), mapping=mapping), BASE, 1e-12)


def test_names_by_number_list_and_short_form(tmp_path: Path) -> None:
    broken = GOOD.renamed(q__shoulder="pos1", q__elbow="pos2", q__wrist="pos3")
    path = broken.save(tmp_path / "log.csv")
    for spec in (
        "pos{i}",
        ["pos1", "pos2", "pos3"],
        {"from": "pos{joint}", "joints": dict(zip(JOINTS, (1, 2, 3), strict=True))},
    ):
        same(read(path, mapping={"q": spec}), BASE)
    same(read(path, mapping=read_map_options(["q=pos{i}"])), BASE)


def test_the_robots_own_mapping_is_enough(tmp_path: Path) -> None:
    robot = Robot("arm", ROBOT.joints, log={"q": {"from": "pos{i}"}})
    broken = GOOD.renamed(q__shoulder="pos1", q__elbow="pos2", q__wrist="pos3")
    same(read_recording([broken.save(tmp_path / "log.csv")], robot), BASE)


def test_a_mapping_that_does_not_fit_falls_back_and_says_so(tmp_path: Path) -> None:
    robot = Robot("arm", ROBOT.joints, log={"q": {"from": "/arm/js", "unit": "deg"}, "t": {"from": "stamp"}})
    for suffix in (".csv", ".h5", ".mcap"):
        got = read_recording([written(tmp_path, f"log{suffix}", BASE)], robot)
        same(got, BASE)
        assert any("does not fit this log" in text and "log block of arm" in text for text in got.repairs)
    got = read(tmp_path / "log.mcap", mapping={"tau": "/motor_stats.effort"})
    same(got, BASE)
    assert any("nearest: '/motor_states'" in text for text in got.repairs)
    refused(tmp_path / "log.mcap", mapping={"tau": "/motor_stats.effort"}, strict=True)


def test_a_pattern_that_fits_some_joints_is_fine_for_rigid_ones(tmp_path: Path) -> None:
    robot = Robot("arm", (*ROBOT.joints[:2], Joint("wrist", transmission="rigid")), log={"q": "q{i}_rad"})
    broken = GOOD.renamed(q__shoulder="q1_rad", q__elbow="q2_rad").without("q.wrist")
    got = read_recording([broken.save(tmp_path / "log.csv")], robot)
    assert np.array_equal(got.q[:, :2], BASE.q[:, :2])
    assert np.array_equal(got.q[:, 2], BASE.theta[:, 2])


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"thetta": "x"}, "did you mean 'theta'"),
        ({"q": {"form": "x"}}, "did you mean 'from'"),
        ({"q": {"from": "x", "unit": "degrees"}}, "did you mean 'deg'"),
        ({"q": {"from": "x", "unit": "counts"}}, "counts:4096"),
        ({"q": {"from": "x", "side": "moter"}}, "did you mean 'motor'"),
        ({"q": {"from": "x", "joints": {"elbo": "a"}}}, "did you mean 'elbow'"),
        ({"q": {"from": "x", "scale": [1, 2]}}, "2 numbers for 3 joints"),
        ({"q": {"from": "x", "scale": float("nan")}}, "finite number"),
        ({"q": {"from": "x", "add": "thet"}}, "did you mean 'theta'"),
        ({"q": {"from": ["a", "b"]}}, "2 places for 3 joints"),
        ({"q": {}}, "no 'from'"),
        ({"q": 3}, "expected {from"),
        ({"t": {"from": "x", "unit": "sec"}}, "did you mean"),
    ],
)
def test_errors_in_mappings_name_the_key_and_the_nearest(tmp_path: Path, mapping: dict, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        read(written(tmp_path, "log.csv", BASE), mapping=mapping)
    assert words in str(caught.value)
    assert "--map" in caught.value.message
    assert caught.value.exit_code == 2


def test_map_options_read_files_and_short_forms(tmp_path: Path) -> None:
    file = tmp_path / "map.yaml"
    file.write_text("q: {from: /a, field: position}\nlog_time: {}\n")
    assert read_map_options([str(file), "tau=/arm/motors.current"])["tau"] == {"from": "/arm/motors.current"}
    file.write_text("q: {from: /a\n  field: [}\n")
    with pytest.raises(UsageError, match=r"map.yaml:2: expected"):
        read_map_options([str(file)])
    with pytest.raises(UsageError, match="no such file"):
        read_map_options([str(tmp_path / "no.yaml")])
    with pytest.raises(UsageError, match="unknown signal 'torque'"):
        read_map_options(["torque=/x"])
    file.write_text("a: &a [x]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\n" + "c: [*b,*b]\n" * 600)
    with pytest.raises(UsageError, match="aliases"):
        read_map_options([str(file)])


def test_errors_in_files_of_mappings_name_file_and_line(tmp_path: Path) -> None:
    log, file = written(tmp_path, "log.csv", BASE), tmp_path / "map.yaml"
    file.write_text("t: {from: t}\n\nq:\n  from: q.{joint}\n  unitt: deg\n")
    with pytest.raises(UsageError, match=r"map.yaml:5: q: unknown key 'unitt'"):
        read(log, mapping=read_map_options([str(file)]))
    file.write_text("t: {from: t}\nq: {from: 'q.{joint}', unit: degg}\n")
    with pytest.raises(UsageError, match=r"map.yaml:2: q: unknown unit 'degg'"):
        read(log, mapping=read_map_options([str(file)]))
    with pytest.raises(UsageError, match=r"--map: q: unknown unit 'dgg'"):  # the line is no longer the file's
        read(log, mapping=read_map_options([str(file), "q: {from: 'q.{joint}', unit: dgg}"]))
    file.write_text("long: {nam: channel, value: value}\n")
    with pytest.raises(UsageError, match=r"map.yaml:1: long: unknown key 'nam'"):
        read(log, mapping=read_map_options([str(file)]))


# units and signs told from theta against q


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: np.degrees(x), ["theta looks like degrees", "unit: {elbow: deg}"]),
        (lambda x: x / (2 * np.pi), ["theta looks like turns", "unit: {elbow: rev}"]),
        (lambda x: x * 8192 / (2 * np.pi), ["encoder counts", "unit: {elbow: counts:8192}"]),
        (lambda x: x * 80, ["not divided by the gear ratio", "scale: {elbow: 0.0125}"]),
        (
            lambda x: -x,
            ["moves opposite to q", 'theta: {from: "theta.{joint}", sign: {elbow: -1}}'],
        ),
        (lambda x: x + 0.3, ["away from q", "offset: {elbow: -0.3}"]),
        (lambda x: x + 4 * np.pi, ["2 whole turns", "offset: {elbow: -12.5664}"]),
        (lambda x: (x + 2.9 + np.pi) % (2 * np.pi) - np.pi, ["wraps", "unwrap: true"]),
    ],
    ids=["deg", "rev", "counts", "motor side", "sign", "offset", "turns", "wrap"],
)
def test_suspicious_units_are_noticed_and_never_applied(tmp_path: Path, change: object, words: list[str]) -> None:
    base = recording(3000)
    broken = table(base).with_column("theta.elbow", change)  # type: ignore[arg-type]
    got = read(broken.save(tmp_path / "log.csv"))
    assert np.array_equal(got.theta[:, 1], broken.rows[:, broken.column("theta.elbow")])
    text = " | ".join(got.warnings)
    for word in [*words, "elbow"]:
        assert word in text, text
    assert not any("shoulder" in warning or "wrist" in warning for warning in got.warnings)


def test_a_unit_that_all_joints_share_is_proposed_once_and_beside_what_is_written_as_a_factor(tmp_path: Path) -> None:
    base = recording(3000)
    got = read(written(tmp_path, "log.csv", like(base, theta=np.degrees(base.theta))))
    assert all('map it: theta: {from: "theta.{joint}", unit: deg}' in warning for warning in got.warnings)
    assert got.warnings
    wrong = {"theta": {"from": "theta.{joint}", "scale": {"shoulder": 180 / np.pi}}}
    (told,) = read(written(tmp_path, "log.csv", base), mapping=wrong).warnings
    pasted = told.partition("if so, map it: ")[2]
    assert pasted == 'theta: {from: "theta.{joint}", scale: 1}'
    again = read(written(tmp_path, "log.csv", base), mapping=read_map_options([pasted]))
    assert not again.warnings
    np.testing.assert_allclose(again.theta, base.theta, rtol=1e-8)


def test_a_wrapped_angle_is_unwrapped_on_request(tmp_path: Path) -> None:
    broken = table(BASE)
    for joint in JOINTS:
        broken = broken.with_column(f"theta.{joint}", lambda x: np.degrees(x + 2.9 + np.pi) % 360 - 180)
    mapping = {"theta": {"from": "theta.{joint}", "unit": "deg", "unwrap": True}}
    got = read(broken.save(tmp_path / "log.csv"), mapping=mapping)
    assert np.abs((got.theta - got.theta[0]) - (BASE.theta - BASE.theta[0])).max() < 1e-12


def test_swapped_channels_are_noticed(tmp_path: Path) -> None:
    base = recording(3000)
    swapped = like(base, theta=base.theta[:, [1, 0, 2]])
    got = read(written(tmp_path, "log.csv", swapped))
    assert any("shoulder and elbow look swapped" in text for text in got.warnings)


def test_a_motor_that_turns_with_another_joint_is_noticed(tmp_path: Path) -> None:
    base = recording(3000)
    theta = base.theta.copy()
    theta[:, 1] -= base.q[:, 0]
    for robot in (ROBOT, Robot("arm", tuple(Joint(j.name, transmission="rigid") for j in ROBOT.joints))):
        got = read_recording([written(tmp_path, "log.csv", like(base, theta=theta))], robot)
        (told,) = (text for text in got.warnings if "the motor turns with that joint" in text)
        assert told.startswith("elbow: theta - q is -1 times the position of shoulder")
        assert ("for deflection" in told) == robot.joints[1].elastic
        assert not any("the motor turns" in w for w in read(written(tmp_path, "plain.csv", base)).warnings)


def test_efforts_of_the_wrong_side_or_sign_are_noticed(tmp_path: Path) -> None:
    base = recording(3000)
    spring = 4000 * (base.theta - base.q)
    got = read(written(tmp_path, "log.csv", like(base, tau=spring)))
    assert sum("looks like the torque in the transmission" in text for text in got.warnings) == 3
    got = read(written(tmp_path, "log.csv", like(base, tau=-base.tau)))
    assert any("has the opposite sign of the deflection" in text and "sign: -1" in text for text in got.warnings)
    robot = Robot("arm", tuple(Joint(j.name, gear_ratio=j.gear_ratio, parameters={"K": 4000.0}) for j in ROBOT.joints))
    got = read_recording([written(tmp_path, "log.csv", like(base, tau=base.tau / np.array(GEARS)))], robot)
    assert any("shaft torque" in text and "side: motor" in text for text in got.warnings)


def test_a_rigid_joint_with_both_sides_in_other_units_is_noticed(tmp_path: Path) -> None:
    base = recording(3000)
    robot = Robot("arm", (*ROBOT.joints[:2], Joint("wrist", transmission="rigid")))
    broken = table(like(base, theta=base.q)).with_column("theta.wrist", lambda x: np.radians(x))
    got = read_recording([broken.save(tmp_path / "log.csv")], robot)
    assert any("wrist: theta moves 0.01745 times as far as q" in text for text in got.warnings), got.warnings


def test_held_samples_are_noticed(tmp_path: Path) -> None:
    base = recording(3000)
    held = like(base, tau=base.tau[np.arange(3000) // 4 * 4])
    got = read(written(tmp_path, "log.csv", held))
    assert any("tau changes only every 4 samples" in text for text in got.warnings)


def test_a_good_log_raises_no_suspicion(tmp_path: Path) -> None:
    assert read(written(tmp_path, "log.csv", recording())).warnings == ()
    assert read(canonical(tmp_path / "log.mcap")).warnings == ()


def test_values_without_names_are_told_apart_by_the_mapping(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        for name, values in (("t", BASE.t), ("q", BASE.q[:, :2]), ("theta", BASE.theta[:, ::-1]), ("tau", BASE.tau)):
            file[name] = values
    error = refused(path, mapping={"q": {"from": "/q"}}, strict=True)
    assert "joints: {shoulder: 0, elbow: 1}" in (error.detail or "")
    places = {"shoulder": 2, "elbow": 1, "wrist": 0}
    got = read(path, mapping={"q": {"from": "/q", "joints": {"shoulder": 0, "elbow": 1}},
                              "theta": {"from": "/theta", "joints": places}})  # fmt: skip
    assert np.array_equal(got.theta, BASE.theta)
    assert np.array_equal(got.q[:, :2], BASE.q[:, :2])
    assert not any("theta" in note and "no names" in note for note in got.notes)
    assert any("tau" in note and "no names" in note for note in got.notes)


def test_logs_with_and_without_link_positions_are_not_mixed(tmp_path: Path) -> None:
    # read together, the one without made a stiffness of 1800 N·m/rad 16 with an error of 5
    held = BASE.q.copy()
    held[:, 1] = np.nan
    paths = [written(tmp_path, "with.csv", BASE), written(tmp_path, "without.csv", like(BASE, q=held))]
    with pytest.raises(UsageError, match=r"without.csv: no link position of elbow, which .*with.csv has"):
        read(*paths)
    assert read(paths[1]).warnings


def test_a_stiffness_of_a_rigid_joint_is_said_not_to_be_used(tmp_path: Path) -> None:
    path = written(tmp_path, "log.csv", BASE)
    joints = [replace(j, transmission="rigid", parameters={**j.parameters, "K": 3000.0}) for j in ROBOT.joints[1:2]]
    stiff = replace(ROBOT, joints=(ROBOT.joints[0], *joints, *ROBOT.joints[2:]))
    said = [warning for warning in read_recording([path], stiff).warnings if "K is not used" in warning]
    assert said == [f"{stiff.joint_names[1]}: the robot file's K is not used: the transmission counts as rigid"]
    assert not any("K is not used" in warning for warning in read_recording([path], ROBOT).warnings)


def test_what_gravity_bends_a_spring_by_is_no_offset() -> None:
    pair = Pair(0, "elbow", 100.0, 1.0, 0.05, 0.999, 0.002, True)
    plan = ReadPlan({}, None, (), (), {})
    assert any("away from q" in sentence for sentence in pair.sentences(plan))
    assert not list(pair.sentences(plan, bent=0.045))
    assert any("away from q" in sentence for sentence in pair.sentences(plan, bent=0.01))


@pytest.mark.parametrize("sides", [("q", "theta"), ("theta",)])
def test_a_slide_in_millimetres_is_noticed(tmp_path: Path, sides: tuple[str, ...]) -> None:
    base = recording(3000)
    robot = Robot("gantry", (*ROBOT.joints[:2], Joint("wrist", "prismatic", transmission="rigid")))
    large = {side: np.where(np.arange(3) == 2, 1000.0, 1.0) * getattr(base, side) for side in sides}
    gone = {} if "q" in sides else {"q": np.full_like(base.q, np.nan)}
    got = read_recording([written(tmp_path, "log.csv", like(base, **large, **gone))], robot)
    (said,) = [text for text in got.warnings if text.startswith("wrist: its position reaches")]
    assert said.endswith("map it with unit: {wrist: mm}")
    assert not any("position reaches" in text for text in read(written(tmp_path, "plain.csv", base)).warnings)

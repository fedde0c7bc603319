"""What `elid info` knows: channels, rates, gaps, what would be taken, and a mapping that works when pasted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from elid_cli.errors import UsageError
from elid_cli.logs.contract import Channel
from elid_cli.logs.inspect import inspect_log
from elid_cli.logs.mapping.suggest import suggestion
from elid_cli.signals.recording import INERTIAL, LINK_SENSORS
from tests.logs.faults import table
from tests.logs.made_logs import FIELDS, JOINTS, ROBOT, like, read, recording, same, written
from tests.logs.mcap_made import Bag, canonical, joint_state

BASE = recording(800)


@pytest.mark.parametrize("name", ["log.csv", "log.h5", "log.mcap"])
def test_canonical_logs_need_nothing(tmp_path: Path, name: str) -> None:
    info = inspect_log(written(tmp_path, name, BASE))
    assert info.missing == ()
    assert info.mapping == ""
    assert set(info.taken) == {"q", "theta", "tau"}
    assert set(info.joints) == set(JOINTS)
    used = [channel for channel in info.channels if channel.signals]
    assert used
    for channel in used:
        assert channel.count == 800
        assert channel.rate == pytest.approx(1000)
        assert channel.span == pytest.approx(0.799)
        assert channel.gaps == 0


@pytest.mark.parametrize("kind", LINK_SENSORS)
def test_what_an_imu_does_not_measure_is_not_listed(tmp_path: Path, kind: str) -> None:
    axes = {axis: np.where(np.arange(3) > 0, BASE.q, np.nan) for axis in LINK_SENSORS[kind]}
    (other,) = LINK_SENSORS.keys() - {kind}
    both = {FIELDS[other]: {axis: np.where(np.arange(3) == 0, BASE.q, np.nan) for axis in LINK_SENSORS[other]}}
    for more in ({}, both):
        log = like(BASE, **{FIELDS[kind]: axes}, **more)
        info = inspect_log(written(tmp_path, "log.mcap", log))
        held = {axis for axis in INERTIAL if log.signal(axis) is not None}
        assert set(info.taken) == set(info.resolved) == {"q", "theta", "tau", *held}
        places = [channel.name for channel in info.channels if set(channel.signals) & axes.keys()]
        assert [any(joint in place for place in places) for joint in JOINTS] == [False, True, True]


def test_gaps_are_counted(tmp_path: Path) -> None:
    index = np.concatenate([np.arange(200), np.arange(300, 500), np.arange(600, 800)])
    info = inspect_log(table(BASE).take(index).save(tmp_path / "log.csv"))
    assert {channel.gaps for channel in info.channels} == {2}


def test_the_suggested_mapping_can_be_pasted(tmp_path: Path) -> None:
    broken = table(BASE).renamed(
        **{f"theta__{joint}": f"motor{k + 1}_pos_rad" for k, joint in enumerate(JOINTS)},
        **{f"q__{joint}": f"joint{k + 1}_pos_rad" for k, joint in enumerate(JOINTS)},
        **{f"tau__{joint}": f"torque{k + 1}_Nm" for k, joint in enumerate(JOINTS)},
    )
    path = broken.save(tmp_path / "log.csv")
    info = inspect_log(path, ROBOT)
    assert info.missing == ("q", "theta", "tau")
    same(read(path, mapping=yaml.safe_load(info.mapping)), BASE)


def test_other_joint_names_are_paired_in_the_suggestion(tmp_path: Path) -> None:
    bag = Bag()
    for topic in ("/arm/joint_states", "/arm/motors"):
        bag.topic(topic)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp = 10**18 + t
        names = [f"arm_{joint}" for joint in JOINTS]
        bag.add("/arm/joint_states", stamp, joint_state(stamp, names, BASE.q[row]))
        bag.add("/arm/motors", stamp, joint_state(stamp, names, BASE.theta[row], effort=BASE.tau[row]))
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    info = inspect_log(path, ROBOT)
    mapping = yaml.safe_load(info.mapping)
    assert mapping["q"]["joints"] == {joint: f"arm_{joint}" for joint in JOINTS}
    mapping["tau"].pop("side", None)
    same(read(path, mapping=mapping), BASE)


@pytest.mark.parametrize(
    ("labels", "wanted"),
    [
        (("swing", "lift"), {"shoulder": "lift", "elbow": "swing"}),  # in another order
        (("swing_motor", "lift_motor"), {"shoulder": "lift_motor", "elbow": "swing_motor"}),
        (("swing", "x"), {"elbow": "swing"}),  # one is not there: another is no guess for it
    ],
)
def test_a_joint_is_the_same_one_in_every_topic(labels: tuple[str, ...], wanted: dict[str, str]) -> None:
    first = ("lift", "swing")
    names = ("/states", "position", first), ("/motors", "position", labels), ("/motors", "effort", labels)
    channels = [Channel(source, field, 2, labels=own) for source, field, own in names]
    mapping = yaml.safe_load(suggestion(channels, ("shoulder", "elbow"), ("q", "theta", "tau")))
    assert mapping["q"]["joints"] == {"shoulder": "lift", "elbow": "swing"}
    assert mapping["theta"]["joints"] == mapping["tau"]["joints"] == wanted


def test_a_joint_of_the_same_name_is_not_paired_with_another() -> None:
    channel = Channel("/states", "position", 3, labels=("c1", "elbow", "elbow2"))
    mapping = yaml.safe_load(suggestion([channel], ("elbow", "elbow1"), ("q",)))
    assert mapping["q"]["joints"] == {"elbow": "elbow", "elbow1": "elbow2"}


def test_topics_that_cannot_be_decoded_are_listed(tmp_path: Path) -> None:
    bag = Bag()
    bag.topic("/joint_states", language="ros2idl", schema="arm_msgs/msg/X", shown="module x {};", text="float64 a\n")
    bag.add("/joint_states", 5, {"a": 1.0})
    path = tmp_path / "log.mcap"
    path.write_bytes(bag.bytes())
    (channel,) = inspect_log(path).channels
    assert channel.name == "/joint_states"
    assert "arm_msgs/msg/X" in channel.kind
    assert channel.count == 1


def test_info_does_not_need_a_robot_for_numbered_columns(tmp_path: Path) -> None:
    names = {
        f"{signal}__{joint}": f"{signal}{k + 1}_rad" for k, joint in enumerate(JOINTS) for signal in ("q", "theta")
    }
    names |= {f"tau__{joint}": f"current{k + 1}_A" for k, joint in enumerate(JOINTS)}
    info = inspect_log(table(BASE).renamed(**names).save(tmp_path / "log.csv"))
    assert len(info.joints) == 3
    mapping = yaml.safe_load(info.mapping)
    assert mapping["q"] == {"from": "q{i}_rad"}
    assert mapping["theta"] == {"from": "theta{i}_rad"}
    assert mapping["tau"]["from"] == "current{i}_A"
    assert mapping["tau"]["unit"] == "A"


def test_info_says_that_a_log_has_no_time(tmp_path: Path) -> None:
    lines = table(BASE).save(tmp_path / "log.csv").read_text().splitlines()
    (tmp_path / "timeless.csv").write_text("\n".join(line.partition(",")[2] for line in lines) + "\n")
    assert lines[0].startswith("t,")
    info = inspect_log(tmp_path / "timeless.csv")
    assert info.missing == ("t",)
    assert info.reasons["t"] == "nothing holds times that advance"
    assert inspect_log(tmp_path / "log.csv").missing == ()


def test_fields_of_a_custom_message_are_guessed_with_their_units() -> None:
    fields = ("motor_deg", "link_rad", "current_ma", "motor_temperature", "motor_velocity")
    channels = [Channel("/arm/state", field, 3) for field in fields]
    mapping = yaml.safe_load(suggestion(channels, JOINTS, ("q", "theta", "tau")))
    assert mapping["q"] == {"from": "/arm/state", "field": "link_rad"}
    assert mapping["theta"] == {"from": "/arm/state", "field": "motor_deg", "unit": "deg"}
    assert mapping["tau"] == {"from": "/arm/state", "field": "current_ma", "unit": "mA", "scale": 1.0}


def test_numbered_columns_have_their_units_and_goals_are_commands() -> None:
    names = [f"{kind}{k}" for kind in ("pos_deg", "goal_deg") for k in (1, 2, 3)]
    mapping = yaml.safe_load(suggestion([Channel(name, "", 1) for name in names], JOINTS, ("q", "tau")))
    assert mapping["q"] == {"from": "pos_deg{i}", "unit": "deg"}
    assert mapping["q_des"] == {"from": "goal_deg{i}", "unit": "deg"}


def test_damaged_files_say_what_was_lost(tmp_path: Path) -> None:
    data = canonical(tmp_path / "log.mcap", BASE, chunk_size=4000).read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: len(data) // 2])
    info = inspect_log(path, ROBOT)
    assert info.losses
    assert any((channel.count or 0) > 100 for channel in info.channels)
    assert like(BASE).samples == 800


@pytest.mark.parametrize("listed", [["log.csv"], ("log.csv",)])
def test_a_list_of_logs_in_place_of_one_is_called_so(listed: object) -> None:
    with pytest.raises(UsageError, match="a log is a path, not a list") as caught:
        inspect_log(listed)  # type: ignore[arg-type]
    assert "did you mean" not in caught.value.hint

"""Every format that is written holds the same log, bit for bit, and writing twice gives the same bytes."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from elid_cli.errors import UsageError
from elid_cli.logs import read_recording, write_recording
from elid_cli.logs.mapping.language import COMMANDS, SIGNALS
from elid_cli.logs.writing import formats
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import ACCEL, GYRO, INERTIAL, LINK_SENSORS, Recording
from tests.logs.made_logs import FIELDS, JOINTS, ROBOT, like, read, recording, same, written

LACKS = {f"log{suffix}": fmt.lacks for fmt in formats() if fmt.write for suffix in fmt.suffixes}
"""File -> signals that its format has no place for."""
FORMATS = tuple(LACKS)
WITH_SENSORS = tuple(name for name, lacks in LACKS.items() if not set(INERTIAL) & set(lacks))


def full() -> Recording:
    """Return a log of every signal that a recording can hold, all numbers different."""
    base = recording(velocities=True)
    held = {name: base.q + 0.1 * k for k, name in enumerate((*INERTIAL, *COMMANDS), start=1)}
    return like(
        base,
        tau_link=0.9 * base.tau,
        temperature=30 + base.q,
        gyro={name: held[name] for name in GYRO},
        accel={name: held[name] for name in ACCEL},
        commands={name: held[name] for name in COMMANDS},
    )


@pytest.mark.parametrize("name", FORMATS)
def test_every_signal_is_read_back_that_the_format_does_not_say_it_lacks(tmp_path: Path, name: str) -> None:
    wanted = full()
    assert set(LACKS[name]) <= set(SIGNALS) - {"q", "theta", "tau"}
    got = read(written(tmp_path, name, wanted))
    for signal in SIGNALS:
        if signal in LACKS[name]:
            assert got.signal(signal) is None, f"{signal} is held: take it out of `lacks`"
        else:
            held = got.signal(signal)
            assert held is not None, f"{signal} is lost: `write` it, or name it in `lacks`"
            assert np.array_equal(held, wanted.signal(signal)), signal  # type: ignore[arg-type]
    assert got.repairs == got.warnings == ()


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_written_is_read_back_exactly(tmp_path: Path, name: str) -> None:
    base = recording(velocities=True)
    got = read(written(tmp_path, name, base))
    same(got, base, signals=tuple(s for s in ("q", "theta", "tau", "dq", "dtheta") if s not in LACKS[name]))
    assert got.dt == base.dt
    assert got.samples == base.samples
    assert got.repairs == got.warnings == got.notes == ()
    assert got.tau_link is None
    assert got.files == (str(tmp_path / name),)


@pytest.mark.parametrize("name", FORMATS)
def test_writing_twice_gives_the_same_bytes(tmp_path: Path, name: str) -> None:
    first = written(tmp_path, name).read_bytes()
    assert written(tmp_path, name).read_bytes() == first


@pytest.mark.parametrize("name", FORMATS)
def test_formats_are_told_by_content_not_by_suffix(tmp_path: Path, name: str) -> None:
    disguised = tmp_path / "log.dat"
    written(tmp_path, name).rename(disguised)
    same(read(disguised), recording())


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_reads_any_joint_order_and_epoch(tmp_path: Path, name: str) -> None:
    base = recording()
    order = [2, 0, 1]
    shuffled = like(
        base,
        joints=tuple(JOINTS[j] for j in order),
        t=base.t + 1_700_000_000.0,
        q=base.q[:, order],
        theta=base.theta[:, order],
        tau=base.tau[:, order],
    )
    got = read(written(tmp_path, name, shuffled))
    same(got, base)
    assert got.t[0] == 0


@pytest.mark.parametrize("name", FORMATS)
def test_joints_that_the_robot_does_not_have_are_ignored(tmp_path: Path, name: str) -> None:
    robot = Robot("two", (Joint("wrist"), Joint("shoulder")))
    got = read_recording([written(tmp_path, name)], robot)
    assert np.array_equal(got.q, recording().q[:, [2, 0]])


def sensed(base: Recording, kind: str, *joints: int) -> dict[str, dict[str, np.ndarray]]:
    """Return the field of a recording that holds what sensors of a kind measured on the links of some joints."""
    carried = np.isin(np.arange(3), joints)
    return {FIELDS[kind]: {axis: np.where(carried, k + base.q, np.nan) for k, axis in enumerate(LINK_SENSORS[kind])}}


@pytest.mark.parametrize("kind", FIELDS)
def test_sensors_on_links_survive_in_every_format(tmp_path: Path, kind: str) -> None:
    base = recording()
    extra = like(base, **sensed(base, kind, 1))
    for name in WITH_SENSORS:
        got = read(written(tmp_path, name, extra))
        carried = {"gyroscope": got.turning.tolist(), "accelerometer": got.accelerated.tolist()}
        assert carried.pop(kind) == [False, True, False]
        assert list(carried.values()) == [[False] * 3]
        assert {got.notes, got.warnings, got.repairs} == {()}
        assert set(got.sources) & set(INERTIAL) == set(LINK_SENSORS[kind])
        for axis, values in getattr(extra, FIELDS[kind]).items():
            assert np.array_equal(getattr(got, FIELDS[kind])[axis], values, equal_nan=True)
            assert got.signal(axis) is getattr(got, FIELDS[kind])[axis]


def test_a_link_may_carry_either_sensor_or_both(tmp_path: Path) -> None:
    """Messages of the same topics: what one of them does not measure comes back as nothing."""
    base = recording()
    extra = like(base, **sensed(base, "gyroscope", 0, 1), **sensed(base, "accelerometer", 1, 2))
    for name in WITH_SENSORS:
        got = read(written(tmp_path, name, extra))
        assert (got.turning.tolist(), got.accelerated.tolist()) == ([True, True, False], [False, True, True])
        for axis in INERTIAL:
            assert np.array_equal(got.signal(axis), extra.signal(axis), equal_nan=True)  # type: ignore[arg-type]


@pytest.mark.parametrize("kinds", [("gyroscope",), ("accelerometer",), ("gyroscope", "accelerometer")])
def test_imu_messages_are_those_of_ros(tmp_path: Path, kinds: tuple[str, ...]) -> None:
    """Decoded by another reader."""
    base = recording(20)
    held = {name: values for kind in kinds for name, values in sensed(base, kind, 2).items()}
    path = written(tmp_path, "log.mcap", like(base, **held))
    with path.open("rb") as file:
        found = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(f"/imu/{JOINTS[2]}"))
    assert len(found) == 20
    for row, (schema, _, _, message) in enumerate(found):
        assert schema is not None
        assert schema.name == "sensor_msgs/msg/Imu"
        stamp = message.header.stamp
        assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(base.t[row], abs=1e-9)
        assert message.orientation_covariance[0] == -1.0
        for kind, quantity in (("gyroscope", "angular_velocity"), ("accelerometer", "linear_acceleration")):
            vector = getattr(message, quantity)
            wanted = [base.q[row, 2] + k for k in range(3)] if kind in kinds else [0.0] * 3
            assert [vector.x, vector.y, vector.z] == wanted
            covariance = [0.0 if kind in kinds else -1.0, *[0.0] * 8]
            assert list(getattr(message, f"{quantity}_covariance")) == covariance


@pytest.mark.parametrize(
    ("kind", "field", "unit", "factor"),
    [
        ("gyroscope", "angular_velocity", "deg/s", np.pi / 180),
        ("gyroscope", "angular_velocity", "rad/s", 1.0),
        ("accelerometer", "linear_acceleration", "", 1.0),
        ("accelerometer", "linear_acceleration", "m/s^2", 1.0),
        ("accelerometer", "linear_acceleration", "m/s²", 1.0),
        ("accelerometer", "linear_acceleration", "g", 9.80665),
        ("accelerometer", "linear_acceleration", "mg", 9.80665e-3),
    ],
)
def test_a_sensor_is_mapped_to_the_link_that_carries_it(
    tmp_path: Path, kind: str, field: str, unit: str, factor: float
) -> None:
    """As an inertial unit with a topic of its own is: one topic, one joint."""
    base = recording()
    made = sensed(base, kind, 0)
    path = written(tmp_path, "log.mcap", like(base, **made))
    place = f"/imu/{JOINTS[0]}"
    mapping = {
        axis: {"from": [None, place, None], "field": f"{field}.{axis[-1]}", "unit": unit} for axis in LINK_SENSORS[kind]
    }
    got = read_recording([path], ROBOT, mapping)
    assert (got.turning | got.accelerated).tolist() == [False, True, False]
    for axis, values in made[FIELDS[kind]].items():
        assert getattr(got, FIELDS[kind])[axis][:, 1] == pytest.approx(factor * values[:, 0])


@pytest.mark.parametrize("kind", FIELDS)
def test_a_sensor_without_one_axis_is_dropped_and_said(tmp_path: Path, kind: str) -> None:
    base = recording()
    x, y, z = LINK_SENSORS[kind]
    axes = sensed(base, kind, 1)[FIELDS[kind]]
    whole = np.where(np.arange(3) < 2, base.q, np.nan)
    got = read(written(tmp_path, "log.h5", like(base, **{FIELDS[kind]: {**axes, x: whole, z: whole}})))
    assert (got.turning | got.accelerated).tolist() == [False, True, False]
    assert np.isnan(getattr(got, FIELDS[kind])[x][:, 0]).all()
    assert got.warnings == (f"{JOINTS[0]}: no {y}: its {kind} is not used, as an axis is missing",)


@pytest.mark.parametrize(
    ("signal", "unit", "hint"),
    [("gyro_x", "m/s", "rev/s"), ("accel_x", "m/s", "m/s²"), ("accel_x", "m/s2", "m/s^2"), ("accel_x", "Mg", "mg")],
)
def test_a_unit_that_no_such_sensor_has_is_refused(tmp_path: Path, signal: str, unit: str, hint: str) -> None:
    with pytest.raises(UsageError, match=f"unknown unit '{unit}'") as caught:
        read_recording([written(tmp_path, "log.csv")], ROBOT, {signal: {"from": f"{signal}.{{joint}}", "unit": unit}})
    assert f"'{hint}'" in caught.value.hint


def test_standard_input_is_csv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import io
    import types

    data = written(tmp_path, "log.csv").read_bytes()
    for sent in (data, gzip.compress(data)):
        monkeypatch.setattr("sys.stdin", types.SimpleNamespace(buffer=io.BytesIO(sent)))
        got = read_recording(["-"], ROBOT)
        same(got, recording())
        assert got.files == ("-",)


def test_several_logs_are_joined_as_segments(tmp_path: Path) -> None:
    base = recording(1000)
    got = read(written(tmp_path, "a.csv", base), written(tmp_path, "b.mcap", base), written(tmp_path, "c.h5", base))
    assert [(s.start, s.stop, s.source) for s in got.segments] == [(0, 1000, 0), (1000, 2000, 1), (2000, 3000, 2)]
    assert (np.diff(got.t) > 0).all()
    assert np.array_equal(got.tau, np.concatenate([base.tau] * 3))
    assert got.duration == pytest.approx(3 * 0.999)
    assert len(set(got.sha256)) == 3


def test_logs_of_other_rates_are_brought_to_the_first(tmp_path: Path) -> None:
    fast, slow = recording(2000), recording(1000, 500.0)
    got = read(written(tmp_path, "a.csv", fast), written(tmp_path, "b.csv", slow))
    second = got.segments[1]
    wanted = recording(second.stop - second.start)
    assert np.abs(got.q[second.start : second.stop] - wanted.q).max() < 1e-7
    assert any("500 Hz resampled to 1000 Hz" in text for text in got.repairs)


def test_an_unknown_suffix_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot tell the log format") as caught:
        write_recording(recording(10), tmp_path / "log.xls")
    assert ".mcap" in caught.value.hint
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, "log.csv")
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(UsageError, match="cannot be written"):
        write_recording(recording(10), path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]


def test_formats_are_found_by_themselves() -> None:
    names = {fmt.name for fmt in formats()}
    assert {"CSV", "HDF5", "MCAP", "rosbag2", "foreign"} <= names


def test_rigid_joints_need_one_side(tmp_path: Path) -> None:
    rigid = Robot("arm", tuple(Joint(name, transmission="rigid") for name in JOINTS))
    base = recording()
    nan = np.full_like(base.q, np.nan)
    for missing in ("q", "theta"):
        got = read_recording([written(tmp_path, "log.csv", like(base, **{missing: nan}))], rigid)
        assert np.array_equal(got.q, got.theta)
        assert got.warnings == ()


def test_where_signals_are_is_decided_anew_for_another_mapping_or_robot(tmp_path: Path) -> None:
    path = written(tmp_path, "log.csv")
    first = read(path)
    swapped = read_recording([path], ROBOT, {"tau": {"from": "tau.{joint}", "scale": 2.0}})
    np.testing.assert_allclose(swapped.tau, 2 * first.tau)
    fewer = Robot("one", ROBOT.joints[:1])
    assert read_recording([path], fewer).joints == JOINTS[:1]
    np.testing.assert_array_equal(read(path).tau, first.tau)

"""The three canonical formats hold the same log, bit for bit, and writing twice gives the same bytes."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from elid_cli.errors import UsageError
from elid_cli.logs import read_recording, write_recording
from elid_cli.logs.writing import formats
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.recording import GYRO
from tests.logs.made_logs import JOINTS, ROBOT, like, read, recording, same, written

FORMATS = ("log.csv", "log.csv.gz", "log.h5", "log.hdf5", "log.mcap")


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_written_is_read_back_exactly(tmp_path: Path, name: str) -> None:
    base = recording(velocities=True)
    got = read(written(tmp_path, name, base))
    same(got, base, signals=("q", "theta", "tau", "dq", "dtheta"))
    assert got.dt == base.dt
    assert got.samples == base.samples
    assert got.repairs == got.warnings == got.notes == ()
    assert got.tau_link is None
    assert got.files == (str(tmp_path / name),)


@pytest.mark.parametrize("name", FORMATS)
def test_writing_twice_gives_the_same_bytes(tmp_path: Path, name: str) -> None:
    first = written(tmp_path, name).read_bytes()
    assert written(tmp_path, name).read_bytes() == first


def test_formats_are_told_by_content_not_by_suffix(tmp_path: Path) -> None:
    base = recording()
    for name in FORMATS:
        path = written(tmp_path, name)
        disguised = tmp_path / "log.dat"
        path.rename(disguised)
        same(read(disguised), base)


def test_every_format_reads_any_joint_order_and_epoch(tmp_path: Path) -> None:
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
    for name in FORMATS:
        got = read(written(tmp_path, name, shuffled))
        same(got, base)
        assert got.t[0] == 0


def test_joints_that_the_robot_does_not_have_are_ignored(tmp_path: Path) -> None:
    robot = Robot("two", (Joint("wrist"), Joint("shoulder")))
    for name in FORMATS:
        got = read_recording([written(tmp_path, name)], robot)
        assert np.array_equal(got.q, recording().q[:, [2, 0]])


def test_link_torque_and_temperature_survive(tmp_path: Path) -> None:
    base = recording()
    extra = like(base, tau_link=base.tau * 0.9, temperature=np.full_like(base.q, 31.5))
    for name in ("log.csv", "log.h5"):
        got = read(written(tmp_path, name, extra))
        assert got.tau_link is not None
        assert got.temperature is not None
        assert np.array_equal(got.tau_link, extra.tau_link)
        assert np.array_equal(got.temperature, extra.temperature)
    got = read(written(tmp_path, "log.mcap", extra))
    assert got.tau_link is not None
    assert np.array_equal(got.tau_link, extra.tau_link)


def test_gyroscopes_survive_in_every_format(tmp_path: Path) -> None:
    base = recording()
    rates = {axis: np.where(np.arange(3) == 1, k + base.q, np.nan) for k, axis in enumerate(GYRO)}
    extra = like(base, gyro=rates)
    for name in FORMATS:
        got = read(written(tmp_path, name, extra))
        assert got.turning.tolist() == [False, True, False]
        for axis in GYRO:
            assert np.array_equal(got.gyro[axis], rates[axis], equal_nan=True)
            assert got.signal(axis) is got.gyro[axis]


def test_imu_messages_are_those_of_ros(tmp_path: Path) -> None:
    """Decoded by another reader."""
    base = recording(20)
    path = written(tmp_path, "log.mcap", like(base, gyro={axis: base.q + k for k, axis in enumerate(GYRO)}))
    with path.open("rb") as file:
        found = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(f"/imu/{JOINTS[2]}"))
    assert len(found) == 20
    for row, (schema, _, _, message) in enumerate(found):
        assert schema is not None
        assert schema.name == "sensor_msgs/msg/Imu"
        stamp = message.header.stamp
        assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(base.t[row], abs=1e-9)
        turning = message.angular_velocity
        assert [turning.x, turning.y, turning.z] == [base.q[row, 2] + k for k in range(3)]
        assert message.orientation_covariance[0] == message.linear_acceleration_covariance[0] == -1.0


@pytest.mark.parametrize("unit", ["deg/s", "rad/s"])
def test_a_gyroscope_is_mapped_to_the_link_that_carries_it(tmp_path: Path, unit: str) -> None:
    """As an inertial unit with a topic of its own is: one topic, one joint."""
    base = recording()
    rates = {axis: np.where(np.arange(3) == 0, base.q + k, np.nan) for k, axis in enumerate(GYRO)}
    path = written(tmp_path, "log.mcap", like(base, gyro=rates))
    place = f"/imu/{JOINTS[0]}"
    mapping = {
        axis: {"from": [None, place, None], "field": f"angular_velocity.{axis[-1]}", "unit": unit} for axis in GYRO
    }
    got = read_recording([path], ROBOT, mapping)
    factor = np.pi / 180 if unit == "deg/s" else 1.0
    assert got.turning.tolist() == [False, True, False]
    assert got.gyro["gyro_z"][:, 1] == pytest.approx(factor * rates["gyro_z"][:, 0])


def test_a_gyroscope_without_one_axis_is_dropped_and_said(tmp_path: Path) -> None:
    base = recording()
    axes = {axis: np.where(np.arange(3) == 1, base.q, np.nan) for axis in GYRO}
    whole = np.where(np.arange(3) < 2, base.q, np.nan)
    got = read(written(tmp_path, "log.h5", like(base, gyro={**axes, "gyro_x": whole, "gyro_z": whole})))
    assert got.turning.tolist() == [False, True, False]
    assert np.isnan(got.gyro["gyro_x"][:, 0]).all()
    assert got.warnings == (f"{JOINTS[0]}: no gyro_y: its gyroscope is not used, as an axis is missing",)


def test_a_unit_that_no_gyroscope_has_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown unit 'm/s'"):
        read_recording([written(tmp_path, "log.csv")], ROBOT, {"gyro_x": {"from": "gyro_x.{joint}", "unit": "m/s"}})


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

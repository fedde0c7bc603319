"""Items 5, 6 and 7: joints, signals that are not there, units: noticed, proposed as a mapping, never applied."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.logs.faults import Table
from tests.system.hostile.hostile import ROBOT, agrees, base, elid, refused, used
from tests.system.hostile.test_csv_files import NAMES, saved, table


def columns(**changed: np.ndarray) -> Table:
    """Return the good log with other signals."""
    log = base()
    values = [changed.get(signal, getattr(log, signal)) for signal in ("q", "theta", "tau")]
    return Table(NAMES, np.column_stack([log.t, *values]))


def warned(log: Path, *words: str, code: int = 0) -> str:
    """Assert that a log is read, that what is suspicious is said on stderr and in the JSON, and return stderr."""
    done = elid("identify", log, "--robot", ROBOT, "--json")
    assert done.code == code, done.err
    said = " ".join(done.json["log"]["warnings"])
    for word in words:
        assert word in said, (word, said)
        assert word in done.err
    return done.err


def test_joints_in_another_order_and_extra_ones(tmp_path: Path) -> None:
    rows = table().rows
    used(saved(tmp_path, Table(NAMES[::-1], rows[:, ::-1]).text()), tolerance=1e-9)
    extra = Table((*NAMES, "q.gripper", "note"), np.hstack([rows, rows[:, :2]]))
    used(saved(tmp_path, extra.text()), tolerance=1e-9)


def test_a_missing_joint_lists_the_names_seen_and_the_nearest(tmp_path: Path) -> None:
    without = table().without("q.joint2", "theta.joint2", "tau.joint2")
    refused(saved(tmp_path, without.text()), "no position for joint2", "names joint1", "nearest: joint1")
    other = Table(tuple(name.replace("joint", "Joint_") for name in NAMES), table().rows)
    refused(saved(tmp_path, other.text()), "no position for joint1", "nearest: 'theta.Joint_1'", "q.Joint_2")
    refused(saved(tmp_path, table().text()), "joint3", robot="puma560")


@pytest.mark.parametrize("fill", [0.0, np.nan], ids=["zero", "NaN"])
def test_efforts_and_velocities_that_are_nothing_count_as_absent(tmp_path: Path, fill: float) -> None:
    nothing = np.full_like(base().tau, fill)
    said = "joint1 joint2 is zero throughout" if fill == 0.0 else "empty, NaN or zero"
    refused(saved(tmp_path, columns(tau=nothing).text()), "no torque", said)
    one = table().with_column("tau.joint2", lambda v: v * 0 + fill)
    err = warned(saved(tmp_path, one.text()), "joint2: no torque tau")
    assert "joint1: no torque" not in err
    velocities = Table((*NAMES, "dq.joint1", "dq.joint2"), np.hstack([table().rows, nothing]))
    used(saved(tmp_path, velocities.text()), tolerance=1e-9)


def test_single_missing_values_are_masked_and_counted(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = table().rows
    holes = (rng.random(rows.shape) < 0.01) & (np.arange(rows.shape[1]) > 0)
    used(saved(tmp_path, Table(NAMES, np.where(holes, np.nan, rows)).text()), "values are not numbers, left out")
    infinite = table().with_column("q.joint1", lambda v: np.where(np.arange(v.size) == 900, np.inf, v))
    used(saved(tmp_path, infinite.text()), "q of joint1: 1", tolerance=1e-3)


def test_missing_values_are_limited(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    most = table().with_column("tau.joint1", lambda v: np.where(rng.random(v.size) < 0.995, np.nan, v))
    done = elid("identify", saved(tmp_path, most.text()), "--robot", ROBOT, "--json")
    assert "tau of joint1 comes at" in done.err
    assert "too slow: not used" in done.err
    assert done.estimates["fs1"][0] is None
    agrees(done)


@pytest.mark.parametrize(
    ("signal", "count", "size"), [("q", 1, 1e6), ("q", 7, -300.0), ("tau", 5, 1e4), ("theta", 3, 99)]
)
def test_broken_samples_are_left_out_and_counted(tmp_path: Path, signal: str, count: int, size: float) -> None:
    places = np.linspace(100, base().samples - 100, count).astype(int)
    broken = table().with_column(f"{signal}.joint1", lambda v: np.where(np.isin(np.arange(v.size), places), size, v))
    plural = "s" * (count > 1)
    used(saved(tmp_path, broken.text()), f"{signal} of joint1: {count} broken sample{plural} left out", tolerance=1e-2)


def test_channels_that_stand_still_while_the_joint_moves(tmp_path: Path) -> None:
    stuck = {name: saved(tmp_path, table().with_column(name, lambda v: v * 0 + 0.25).text(), f"{name}.csv")
             for name in ("q.joint2", "theta.joint2", "tau.joint1")}  # fmt: skip
    warned(
        stuck["q.joint2"], "q of joint2 never changes while theta moves 2.52 rad", "its transmission counts as rigid"
    )
    refused(stuck["theta.joint2"], "no motor position for joint2", "never changes")
    warned(stuck["tau.joint1"], "tau of joint1 is 0.25 throughout", "joint1: no torque")


def test_repeated_samples_are_noticed(tmp_path: Path) -> None:
    held = table().with_column("q.joint1", lambda v: v[np.arange(v.size) // 3 * 3])
    warned(saved(tmp_path, held.text()), "joint1: q changes only every 3 samples")
    hung = table().with_column("q.joint1", lambda v: np.where((np.arange(v.size) // 500) == 2, v[1000], v))
    warned(saved(tmp_path, hung.text()), "joint1: q stays at", "for 2 s from t = 4 s", "hung")


def test_a_cut_torque_is_noticed(tmp_path: Path) -> None:
    cut = table().with_column("tau.joint1", lambda v: np.clip(v, -60, 60))
    warned(saved(tmp_path, cut.text()), "joint1: tau is exactly 60", "limited there")


def wrapped(angle: np.ndarray) -> np.ndarray:
    shift = np.pi - 0.3
    return np.asarray((angle + shift + np.pi) % (2 * np.pi) - np.pi - shift)


COUNTS = 65536 / (2 * np.pi)
UNITS = {
    "theta in degrees": ({"theta": lambda v: np.degrees(v)}, "theta looks like degrees", "theta", "unit: deg"),
    "q in degrees": ({"q": lambda v: np.degrees(v)}, "q looks like degrees", "q", "unit: deg"),
    "theta in turns": ({"theta": lambda v: v / (2 * np.pi)}, "theta looks like turns", "theta", "unit: rev"),
    "theta in counts": ({"theta": lambda v: np.round(v * COUNTS)}, "encoder counts", "theta", "unit: counts:65536"),
    "motor side": ({"theta": lambda v: v * 0.1}, "not divided by the gear ratio", "theta", "side: motor"),
    "motor side in degrees": ({"theta": lambda v: np.degrees(v * 0.1)}, "motor-side degrees", "theta",
                              "unit: deg, side: motor"),
    "opposite sign": ({"theta": lambda v: -v}, "moves opposite to q", "theta", "sign: -1"),
    "torque's sign": ({"tau": lambda v: -v}, "tau has the opposite sign of the deflection", "tau", "sign: -1"),
    "torque in mN·m": ({"tau": lambda v: v * 1000}, "tau looks like mN·m", "tau", "unit: mN.m"),
    "q wraps": ({"q": wrapped}, "q wraps at ±pi", "q", "unwrap: true"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNITS)
def test_units_are_noticed_and_the_mapping_mends_them(tmp_path: Path, name: str) -> None:
    changes, words, signal, key = UNITS[name]
    changed = {one: change(getattr(base(), one)) for one, change in changes.items()}
    log = saved(tmp_path, columns(**changed).text())
    err = warned(log, words, f'{signal}: {{from: "{signal}.{{joint}}", {key}}}')
    assert "if so, map it" in err
    path = tmp_path / "map.yaml"
    path.write_text(f'{signal}: {{from: "{signal}.{{joint}}", {key}}}\n')
    mended = used(log, more=("--map", path), tolerance=0.05 if "counts" in key else 1e-6)
    assert words not in mended.err


def test_a_constant_offset_is_noticed(tmp_path: Path) -> None:
    shifted = table().with_column("theta.joint1", lambda v: v + 0.5)
    warned(saved(tmp_path, shifted.text()), "joint1: theta is +0.53", "away from q throughout", "offset: {joint1: -0.5")


def test_currents_are_noticed(tmp_path: Path) -> None:
    log = saved(tmp_path, columns(tau=base().tau / np.array([20.0, 15.0])).text())
    warned(log, "joint1: tau looks like a current", "K = 3000 of the robot file", "unit: A, scale: {joint1: 19.8")
    named = saved(tmp_path, table().renamed(tau__joint1="current_1", tau__joint2="current_2").text())
    done = elid("identify", named, "--robot", ROBOT, "--map", "tau=current_{i}")
    assert done.code == 0
    assert "its name says that it is a current" in done.err
    assert "unit: A, scale" in done.err


def test_link_side_torques_are_noticed(tmp_path: Path) -> None:
    link = (base().theta - base().q) * np.array([3000.0, 1800.0])
    warned(saved(tmp_path, columns(tau=link).text()), "without any friction or inertia", "tau_link")


def test_swapped_channels_are_noticed(tmp_path: Path) -> None:
    log = saved(tmp_path, columns(theta=base().theta[:, ::-1]).text())
    warned(log, "theta of joint1 and joint2 look swapped", "joints: {joint1: joint2, joint2: joint1}")
    log = saved(tmp_path, columns(tau=base().tau[:, ::-1]).text())
    warned(log, "tau of joint1 and joint2 look swapped", "joints: {joint1: joint2, joint2: joint1}")
    log = saved(tmp_path, columns(q=base().theta, theta=base().q).text())
    warned(log, "q and theta are swapped")


def test_the_good_log_raises_no_suspicion(tmp_path: Path) -> None:
    done = elid("identify", saved(tmp_path, table().text()), "--robot", ROBOT)
    assert (done.code, done.err) == (0, "")


def test_a_log_named_twice_is_said(tmp_path: Path) -> None:
    one, two = saved(tmp_path, table().text()), saved(tmp_path, table().text(), "copy.csv")
    for verb in ("identify", "validate"):
        done = elid(verb, one, two, "--robot", ROBOT, "--json")
        assert done.code == 0, done.err
        assert f"copy.csv: the same bytes as {one}" in " ".join(done.json["log"]["warnings"])
        assert done.err.count("the same bytes") == 1


@pytest.mark.parametrize("signal", ["q", "theta", "tau"])
@pytest.mark.parametrize("joint", ["joint1", "joint2"])
def test_dropouts_within_the_range_are_left_out_and_counted(tmp_path: Path, signal: str, joint: str) -> None:
    broken = table().with_column(f"{signal}.{joint}", lambda v: np.where(np.arange(v.size) % 250 == 103, 0.0, v))
    done = used(saved(tmp_path, broken.text()), f"{signal} of {joint}: 1", "off the motion left out",
                tolerance=1e-3)  # fmt: skip
    assert "repaired: " in done.err


def test_dropouts_name_no_effect(tmp_path: Path) -> None:
    broken = table().with_column("q.joint2", lambda v: np.where(np.arange(v.size) % 250 == 3, 0.0, v))
    done = elid("diagnose", saved(tmp_path, broken.text()), "--robot", ROBOT, "--json")
    assert done.code == 0, done.err
    assert done.json["effects"] == []

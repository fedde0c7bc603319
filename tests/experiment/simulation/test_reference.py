"""References: inside the limits, at rest at both ends, twice differentiable, the same for the same seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.experiment.reference import ReferenceOptions, random_reference, read_reference
from elid_cli.robot.files import read_robot


@pytest.mark.parametrize("name", ["planar2", "puma560", "emps", "kr300"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_stays_within_the_limits(name: str, seed: int) -> None:
    robot = read_robot(name)
    t = np.linspace(0, 15, 6001)
    q, dq, ddq = random_reference(robot, 15.0, seed).evaluate(t)
    for k, joint in enumerate(robot.joints):
        low, high = joint.limits.position or ((-1.2, 1.2) if joint.revolute else (-0.1, 0.1))
        assert q[:, k].min() >= low
        assert q[:, k].max() <= high
        assert np.ptp(q[:, k]) > 0.1 * (high - low)
        if joint.limits.velocity is not None and joint.limits.acceleration is not None:
            assert np.abs(dq[:, k]).max() <= 1.001 * joint.limits.velocity
            assert np.abs(ddq[:, k]).max() <= 1.001 * joint.limits.acceleration


def test_derivatives_are_derivatives_and_ends_are_at_rest() -> None:
    t = np.linspace(-0.5, 10.5, 110001)
    q, dq, ddq = random_reference(read_robot("puma560"), 10.0, 3).evaluate(t)
    step = t[1] - t[0]
    np.testing.assert_allclose((q[2:] - q[:-2]) / (2 * step), dq[1:-1], atol=1e-5)
    np.testing.assert_allclose((dq[2:] - dq[:-2]) / (2 * step), ddq[1:-1], atol=2e-3)
    outside = (t < 0) | (t > 10)
    assert np.abs(dq[outside]).max() == 0
    assert np.abs(np.diff(ddq, axis=0)).max() < 0.05  # no jump where the motion begins or ends


def test_speed_scales_time() -> None:
    robot = read_robot("planar2")
    slow = random_reference(robot, 20.0, 5, ReferenceOptions(speed=0.5)).evaluate(np.linspace(0, 20, 4001))
    assert np.abs(slow[1]).max() <= 0.5 * 3.0
    assert np.abs(slow[2]).max() <= 0.25 * 12.0
    full = random_reference(robot, 10.0, 5).evaluate(np.linspace(0, 10, 4001))
    np.testing.assert_allclose(slow[0], full[0], atol=1e-9)  # the same path in twice the time


def test_reference_from_a_file(tmp_path: Path) -> None:
    robot = read_robot("planar2")
    t = np.linspace(0, 2, 41)
    path = tmp_path / "traj.csv"
    rows = [f"{a},x,{np.sin(a) ** 3},{1 + a**4 * (2 - a) ** 4}" for a in t]
    path.write_text("\n".join(["t,other,q.joint2,q.joint1", *rows]))
    q, dq, _ = read_reference(str(path), robot).evaluate(t)
    np.testing.assert_allclose(q[:, 1], np.sin(t) ** 3, atol=1e-9)
    np.testing.assert_allclose(q[:, 0], 1 + t**4 * (2 - t) ** 4, atol=1e-9)
    assert np.abs(dq[[0, -1]]).max() < 1e-9


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,q.joint1\n0,1\n", "no column 'q.joint2'"),
        ("t,q.joint1,q.joint2\n0,1,2\n1,2\n", "short"),
        ("t,q.joint1,q.joint2\n0,1,x\n", "no number"),
        ("t,q.joint1,q.joint2\n" + "0,1,2\n" * 8, "increasing"),
        ("", "no column 't'"),
    ],
)
def test_a_file_that_is_no_reference_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "traj.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match=said):
        read_reference(str(path), read_robot("planar2"))
    with pytest.raises(UsageError, match="no such file"):
        read_reference(str(tmp_path / "nothing.csv"), read_robot("planar2"))

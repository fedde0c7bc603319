"""Tables without names: time first or not, blocks of joints, of a robot with a gripper; the hint works when pasted."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.errors import LogError
from elid_cli.logs import read_map_options, read_recording, robot_as_logged
from elid_cli.logs.inspect import inspect_log
from elid_cli.robot.files import read_robot
from elid_cli.robot.locking import beside_chain
from elid_cli.robot.robot import Robot
from tests.cli.test_init import URDF

T = np.arange(800) * 0.005
Q = np.column_stack([np.sin(2 * T), 0.5 * np.cos(3 * T)])
DQ = np.column_stack([2 * np.cos(2 * T), -1.5 * np.sin(3 * T)])
TAU = np.column_stack([9 * np.cos(2 * T) + 1, 4 * np.sin(T)])


@pytest.fixture
def arm(tmp_path: Path) -> Robot:
    """Return an arm of two joints and two fingers."""
    (tmp_path / "arm.urdf").write_text(URDF)
    return read_robot(tmp_path / "arm.urdf")


def mat(path: Path, array: Array) -> None:
    from scipy.io import savemat

    savemat(path, {"data": array})


def mat73(path: Path, array: Array) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("data", data=array.T).attrs["MATLAB_class"] = np.bytes_("double")


WRITERS: dict[str, Callable[[Path, Array], None]] = {
    "log.mat": mat, "v73.mat": mat73, "log.npy": np.save, "log.txt": np.savetxt
}  # fmt: skip


def hint_of(path: Path, robot: Robot) -> str:
    with pytest.raises(LogError) as caught:
        read_recording([path], robot_as_logged(robot, [path]))
    return caught.value.hint


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("velocities", [False, True])
def test_the_hint_of_a_table_with_time_in_front_reads_it(
    name: str, velocities: bool, arm: Robot, tmp_path: Path
) -> None:
    WRITERS[name](path := tmp_path / name, np.column_stack([T, Q, *([DQ] if velocities else []), TAU]))
    words = shlex.split("--map" + hint_of(path, arm).partition("--map")[2])
    assert words[-2] == "--tip"
    held = dict.fromkeys(beside_chain(arm, words[-1]), 0.0)
    mapping = read_map_options(words[1:-2:2])
    log = read_recording([path], robot_as_logged(arm, [path], mapping, held), mapping)
    assert log.joints == ("shoulder", "elbow")
    assert log.dt == pytest.approx(0.005)
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    np.testing.assert_allclose(log.tau, TAU, atol=1e-12)
    assert (log.dq is not None) == velocities


def test_velocities_tell_how_many_joints_a_table_holds(arm: Robot, tmp_path: Path) -> None:
    """Six columns may be three joints' positions and torques, or two joints' positions, velocities and torques."""
    np.savetxt(path := tmp_path / "log.txt", np.column_stack([T, Q, DQ, TAU]))
    assert "q: {from: [column2, column3]}" in hint_of(path, arm)
    np.savetxt(path, np.column_stack([T, Q, TAU[:, 0], TAU, Q[:, 0]]))
    assert "q: {from: [column2, column3, column4]}" in hint_of(path, arm)


def test_positions_and_velocities_alone_are_given_no_torque(arm: Robot, tmp_path: Path) -> None:
    np.savetxt(path := tmp_path / "log.txt", np.column_stack([T, Q, DQ]))
    assert "tau:" not in hint_of(path, arm)


def test_a_first_column_that_does_not_advance_is_no_time(arm: Robot, tmp_path: Path) -> None:
    mat(path := tmp_path / "log.mat", np.column_stack([Q, TAU]))
    assert "t:" not in hint_of(path, arm).replace("at:", "")
    assert [c.name for c in inspect_log(path, arm).channels] == ["/data"]

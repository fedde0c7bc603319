"""Joints that a table names in its columns are found without a robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli import inspect_log
from elid_cli.logs.mapping.joints_in_names import names_in_columns


@pytest.mark.parametrize(
    ("columns", "joints"),
    [
        ("t pos.hip pos.knee torque.hip torque.knee", ("hip", "knee")),
        ("hip_pos knee_pos hip_vel knee_vel time", ("hip", "knee")),
        ("FL_hip_q FL_thigh_q FL_hip_tau FL_thigh_tau", ("FL_hip", "FL_thigh")),
        ("motor_pos_a link_pos_a motor_pos_b link_pos_b", ("a", "b")),
        ("q_1 q_2 tau_1 tau_2", ()),
        ("actual_q_0 actual_q_1 actual_current_0 actual_current_1", ()),
        ("pos1 pos2", ()),
        ("hip_pos hip_torque", ()),
        ("hip_pos knee_torque", ()),
    ],
)
def test_what_tells_columns_of_one_meaning_apart_is_a_joint(columns: str, joints: tuple[str, ...]) -> None:
    assert names_in_columns(columns.split()) == joints


def test_a_guess_without_a_robot_is_of_all_joints(tmp_path: Path) -> None:
    t, names = np.arange(200) * 1_000_000 + 1_700_000_000_000_000_000, ["stamp_ns"]
    columns = [t.astype(str)]
    for joint in ("shoulder", "elbow"):
        for what in ("link_pos_deg", "motor_pos_deg", "motor_torque_mNm"):
            names.append(f"{joint}_{what}")
            columns.append(np.sin(np.arange(200) / 9).astype(str))
    log = tmp_path / "log.csv"
    log.write_text("\n".join([",".join(names), *map(",".join, zip(*columns, strict=True))]) + "\n")
    found = inspect_log(log)
    assert found.joints == ("shoulder", "elbow")
    assert 'q: {from: "{joint}_link_pos_deg", unit: deg}' in found.mapping
    assert found.reasons["t"] == "nothing is called t or time"

"""The rigid-body part of the regressor against Pinocchio's `computeJointTorqueRegressor`."""

from __future__ import annotations

import numpy as np
import pytest

from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import random_motion
from tests.robot.random_robots import random_robot

pin = pytest.importorskip("pinocchio", reason="needs the wheel pin (extra: test)")

ROBOTS = {
    "planar2": read_robot("planar2"),
    "puma560": read_robot("puma560"),
    "seven joints": random_robot(41, 7, "standard"),
    "seven joints, modified": random_robot(42, 7, "modified"),
    "tree": random_robot(45, 9, "urdf", kinds="rrp", parents=(-1, 0, 1, 0, 3, 4, -1, 6, 6), gearless=(2, 5)),
    "tree, standard": random_robot(46, 6, "standard", parents=(-1, 0, 1, 0, 3, -1), rigid=(0, 4), gearless=(1, 4)),
    "sliding": random_robot(43, 5, "standard", kinds="rpr", rigid=(1, 3)),
}
ORDER = ("m", "cx", "cy", "cz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Pinocchio's order of a body's ten parameters."""


def pinocchio_model(robot: Robot) -> object:
    """Return the tree with a joint frame before each body's constant placement; its bodies weigh nothing."""
    model = pin.Model()
    model.gravity.linear = np.array(robot.gravity)
    made = [(0, pin.SE3.Identity())]
    for joint, above, (before, after) in zip(robot.joints, robot.parents, robot.placements(), strict=True):
        parent, offset = made[above + 1]
        kind = pin.JointModelRZ() if joint.revolute else pin.JointModelPZ()
        parent = model.addJoint(parent, kind, offset * pin.SE3(before[:3, :3], before[:3, 3]), joint.name)
        model.appendBodyToJoint(parent, pin.Inertia.Zero(), pin.SE3.Identity())
        made.append((parent, pin.SE3(after[:3, :3], after[:3, 3])))
    return model


def parameters_in_joint_frame(after: np.ndarray) -> np.ndarray:
    """Return the 10x10 matrix that moves a body's parameters from frame i to the joint's frame before it."""
    R, p = after[:3, :3], after[:3, 3]

    def skew(v: np.ndarray) -> np.ndarray:
        return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])

    columns = []
    for e in np.eye(10):
        m, c = e[0], R @ e[1:4]
        tensor = R @ np.array([[e[4], e[5], e[7]], [e[5], e[6], e[8]], [e[7], e[8], e[9]]]) @ R.T
        tensor = tensor - skew(p) @ skew(c) - skew(c) @ skew(p) - m * skew(p) @ skew(p)
        first = c + m * p
        moved = [tensor[0, 0], tensor[0, 1], tensor[1, 1], tensor[0, 2], tensor[1, 2], tensor[2, 2]]
        columns.append([m, *first, *moved])
    return np.array(columns).T


@pytest.mark.parametrize("name", ROBOTS)
def test_rigid_part_is_pinocchios(name: str) -> None:
    robot = ROBOTS[name]
    model = Regressor(robot)
    motion = random_motion(robot.n, robot.elastic, 20, seed=44)
    place = {(plan.row.kind, plan.row.joint): k for k, plan in enumerate(model.equations.rows)}
    links = [place.get(EstimationRow("link", j), place.get(EstimationRow("sum", j))) for j in range(robot.n)]
    dense = model.dense(motion, model.equations)[links]
    theirs = pinocchio_model(robot)
    data = theirs.createData()
    for k in range(motion.samples):
        # Pinocchio numbers joints in the order in which it walks its tree
        rows = [theirs.joints[theirs.getJointId(name)].idx_v for name in robot.joint_names]
        state = [np.empty(robot.n) for _ in range(3)]
        for their, our in zip(state, (motion.q[k], motion.dq[k], motion.ddq[k]), strict=True):
            their[rows] = our
        Y = pin.computeJointTorqueRegressor(theirs, data, *state)[rows]
        for i, (_, after) in enumerate(robot.placements()):
            ours = dense[:, k][:, [model.index[f"{kind}{i + 1}"] for kind in ORDER]]
            body = theirs.getJointId(robot.joint_names[i]) - 1
            expected = Y[:, 10 * body : 10 * body + 10] @ parameters_in_joint_frame(after)
            scale = max(np.abs(expected).max(), 1.0)
            np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-11 * scale)

"""All robots of three public packages: read, classified as Pinocchio's regressor says, written back the same.

The packages are the extra ``robots`` (330 MB of wheels: example-robot-data, rtb-data, robosuite). Where they are not
installed these tests skip.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.errors import RobotError
from elid_cli.model.base_parameters import find_base
from elid_cli.model.dynamics import Dynamics
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot, robot_from_text
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.patch import patched
from elid_cli.robot.robot import Robot
from tests.model.test_pinocchio import pinocchio_model
from tests.system.public_robots import MOST, NO_ROBOT, PACKAGES, files, known, movable, moved, torque_error

pin = pytest.importorskip("pinocchio", reason="needs the wheel pin (extra: test)")

ROUNDED = {"anymal-kinova.urdf", "kinova.urdf", "hextilt_flying_arm_5.urdf", "so100.urdf", "so101.urdf", "xarm7.urdf",
           "al5d_robot.urdf", "puma560_robot.urdf"}  # fmt: skip
"""Files whose right angles are rounded, so that Pinocchio sees up to three parameters more."""
SIMULATED = 10
"""Joints up to which a robot is simulated here, for 0.3 s; `python -m tests.system.reproduce.public_robots`
does it for a second with every robot of up to 60 joints."""
FILES = files()
pytestmark = pytest.mark.skipif(not FILES, reason="needs the public robots: pip install 'elid[robots]'")


def reference(path: Path, robot: Robot) -> object:
    """Return Pinocchio's model of a file, joints that elid holds fixed locked; of an MJCF that of elid's frames."""
    if path.suffix != ".urdf":
        return pinocchio_model(robot.squared())
    model = pin.buildModelFromUrdf(str(path))
    held = [k for k, name in enumerate(model.names) if k and name not in robot.joint_names]
    model = pin.buildReducedModel(model, held, pin.neutral(model)) if held else model
    model.gravity.linear = np.array(robot.gravity)
    return model


def states(model: object, robot: Robot, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return (configuration, velocity, acceleration) in Pinocchio's order."""
    place, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for k, name in enumerate(robot.joint_names):
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 2:  # continuous joints are (cos, sin) there
            place[joint.idx_q : joint.idx_q + 2] = np.cos(q[k]), np.sin(q[k])
        else:
            place[joint.idx_q] = q[k]
        v[joint.idx_v], a[joint.idx_v] = dq[k], ddq[k]
    return place, v, a


def test_all_ninety_are_tried() -> None:
    installed = {package for package in PACKAGES if importlib.util.find_spec(package.replace("-", "_")) is not None}
    assert len(FILES) == 90 or len(installed) < len(PACKAGES)


def changed(robot: Robot) -> Robot:
    """Return the robot with every body heavier, each by another share: what a URDF and an MJCF both can hold."""
    joints = []
    for k, joint in enumerate(robot.joints):
        own = {name: joint.parameters[name] for name in LINK_PARAMETERS if name in joint.parameters}
        joints.append(replace(joint, parameters=joint.parameters | {n: v * (1.1 + 0.01 * k) for n, v in own.items()}))
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("path", [p for p in FILES if p.suffix == ".urdf" and p.name not in NO_ROBOT],
                         ids=lambda path: f"{path.parent.name}/{path.name}")  # fmt: skip
def test_a_public_urdf_written_back_has_the_same_mass_matrix_in_pinocchio(path: Path, tmp_path: Path) -> None:
    robot = changed(read_robot(path))
    if robot.n > MOST:
        pytest.skip("more joints than are identified")
    (again := tmp_path / path.name).write_text(patched(robot))
    model = reference(again, robot)
    data = model.createData()
    q = np.random.default_rng(1).uniform(-1, 1, robot.n)
    place, *_ = states(model, robot, q, q, q)
    whole = np.triu(pin.crba(model, data, place))
    whole = whole + np.triu(whole, 1).T - np.diag(model.armature)
    rows = [model.joints[model.getJointId(name)].idx_v for name in robot.joint_names]
    bodies = known(robot)
    bodies = replace(bodies, joints=tuple(replace(j, parameters={**j.parameters, "Ja": 0.0}) for j in bodies.joints))
    ours = Dynamics(bodies).mass_matrix(q)
    np.testing.assert_allclose(ours, whole[np.ix_(rows, rows)], atol=1e-9 * np.abs(ours).max())


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_public_robot_moves_as_its_torques_make_it(path: Path) -> None:
    if path.name in NO_ROBOT or (described := read_robot(path)).n > SIMULATED:
        pytest.skip("no robot, or one of many joints")
    robot = movable(described)
    assert torque_error(robot, moved(robot, 0.3)) < 1e-8


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_public_robot(path: Path) -> None:
    if path.name in NO_ROBOT:
        with pytest.raises(RobotError, match=NO_ROBOT[path.name]) as caught:
            read_robot(path)
        assert len(str(caught.value).splitlines()) <= 3
        return
    described = read_robot(path)
    assert all(joint.gear_ratio != 1.0 for joint in described.joints)
    assert patched(described).encode() == path.read_bytes()
    if described.n > MOST:
        return
    robot = known(described)
    model = reference(path, robot)
    rows = [model.joints[model.getJointId(name)].idx_v for name in robot.joint_names]
    data, rng = model.createData(), np.random.default_rng(0)
    instants = 60 + min(13 * robot.n, 200)
    regressor = []
    dynamics = Dynamics(robot) if path.suffix == ".urdf" else None
    for k, (q, dq, ddq) in enumerate(rng.uniform(-np.pi, np.pi, (instants, 3, robot.n))):
        state = states(model, robot, q, dq, ddq)
        inertial = pin.computeJointTorqueRegressor(model, data, *state)[rows]
        regressor.append(np.hstack([inertial, np.diag(ddq), np.diag(np.sign(dq)), np.diag(dq)]))
        if k < 3 and dynamics is not None:
            theirs = pin.rnea(model, data, *state)[rows] - model.armature[rows] * ddq
            ours = dynamics.inverse(q, dq, ddq, q, dq, ddq)[1]
            np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())
    count = find_base(Regressor(robot)).count
    assert 0 <= rank_of(np.array(regressor)) - count <= (3 if path.name in ROUNDED else 0)


def rank_of(regressor: np.ndarray) -> int:
    """Return the rank of a regressor (instants, joints, columns), its rows and columns scaled alike."""
    triangles = []
    for row in np.moveaxis(regressor, 1, 0):
        own = row.any(axis=0)  # a joint does not feel most bodies of a robot with branches
        triangle = np.linalg.qr(row[:, own] / np.abs(row).max(), mode="r")
        triangles.append(np.zeros((len(triangle), row.shape[1])))
        triangles[-1][:, own] = triangle
    whole = np.linalg.qr(np.concatenate(triangles), mode="r")
    norms = np.linalg.norm(whole, axis=0)
    shown = norms > 1e-9 * norms.max()
    sizes = np.linalg.svd(whole[:, shown] / norms[shown], compute_uv=False)
    return int(np.count_nonzero(sizes > 1e-11 * sizes[0]))


@pytest.mark.parametrize("path", [p for p in FILES if p.suffix == ".xml"], ids=lambda path: path.parent.name)
def test_a_public_mjcf_written_back_has_the_same_mass_matrix_in_mujoco(path: Path, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    robot = read_robot(path)
    heavier = replace(
        robot,
        joints=tuple(replace(j, parameters={**j.parameters, "fv": 0.3, "Ja": 0.125}) for j in robot.joints),
    )
    folder = shutil.copytree(path.parent, tmp_path / "robot")  # with its meshes
    (folder / path.name).write_text(patched(heavier))
    model = mujoco.MjModel.from_xml_path(str(folder / path.name))
    again = robot_from_text(patched(heavier), str(path))
    joints = [model.joint(name) for name in robot.joint_names]
    places, dofs = ([int(a[0]) for a in each] for each in ([j.qposadr for j in joints], [j.dofadr for j in joints]))
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    q = np.random.default_rng(1).uniform(-1, 1, robot.n)
    data.qpos[places] = q
    dq, ddq = np.random.default_rng(2).uniform(-1, 1, (2, robot.n))
    data.qvel[dofs] = dq
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    ours, dynamics = mass[np.ix_(dofs, dofs)], Dynamics(known(again))
    np.testing.assert_allclose(dynamics.mass_matrix(q), ours, atol=1e-9 * np.abs(ours).max())
    theirs = ours @ ddq + data.qfrc_bias[dofs]
    np.testing.assert_allclose(dynamics.inverse(q, dq, ddq, q, dq, ddq)[1], theirs, atol=1e-9 * np.abs(theirs).max())

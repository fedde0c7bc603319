"""MuJoCo's plants of public robots have the bodies that elid reads: what is fitted to their logs is judged by that."""

from __future__ import annotations

from importlib.metadata import distributions

import numpy as np
import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.model.linearised import Linearised

mujoco = pytest.importorskip("mujoco")
if not list(distributions(name="example-robot-data")):
    pytest.skip("needs the extra robots", allow_module_level=True)

from tests.system.reproduce.mujoco_logs import read  # noqa: E402
from tests.system.reproduce.mujoco_plants import KINDS, logged, plant_of  # noqa: E402


@pytest.mark.parametrize("name", KINDS)
def test_both_have_the_same_inertia_and_forces(name: str) -> None:
    plant = plant_of(name)
    rng = np.random.default_rng(0)
    q, v = rng.uniform(-0.4, 0.4, (2, plant.robot.n))
    local = Linearised(plant.robot, without=("Ja", "fs", "fv")).about(q[None, None], v[None, None])
    data = mujoco.MjData(plant.model)
    plant.model.dof_armature[:] = 0.0
    data.qpos[plant.address], data.qvel[plant.address] = q, v
    mujoco.mj_forward(plant.model, data)
    full = np.zeros((plant.model.nv, plant.model.nv))
    mujoco.mj_fullM(plant.model, data, full)
    mass = full[np.ix_(plant.address, plant.address)]
    np.testing.assert_allclose(mass, local.mass[0, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(data.qfrc_bias[plant.address], local.force[0, 0], rtol=1e-6, atol=1e-8)


def test_an_offset_that_does_not_show_is_in_the_errors_of_what_takes_its_place() -> None:
    # the feet of this biped swing little: taken for none, offsets of some mN·m made first moments 103 and 35 errors off
    plant = plant_of("bolt")
    recording, drives, _ = logged(plant, 3001)
    found = identify(plant.robot, read(plant, recording), EstimateOptions(fit="torque"))
    truth = dict(zip(plant.robot.parameter_names(), plant.robot.reference(), strict=True))
    shown = {item.name: item for item in found.parameters}
    offsets = {n.joint for n in found.nuisances if n.effect == "torque_offset"}
    hidden = [j for j, name in enumerate(plant.robot.joint_names) if name not in offsets and drives.truth[j, 3] != 0]
    assert hidden
    scores = [
        (shown[str(name)].estimate - value) / shown[str(name)].std_error
        for name, value in truth.items()
        if name.kind in ("cx", "cy") and name.joint in hidden and str(name) in shown
    ]
    assert scores
    assert np.abs(scores).max() < 3.0

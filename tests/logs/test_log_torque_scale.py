"""Whether a torque is in N·m at the link, told by a spring whose stiffness the robot file gives; by repetition."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.logs import read_map_options, read_recording, write_recording
from elid_cli.robot.files import read_robot
from tests.system.benchmarks.made import write_short_logs
from tests.system.reproduce.inverse_logs import Laws, Made, World, log_of, make, recorded

ARMS = range(1, 13)


def said(folder: Path, made: Made, laws: Laws, scale: Callable[[int], float] = lambda _: 1.0) -> set[tuple[str, str]]:
    """Return (joint, what its torque looks like) of a log whose torques are scaled by joint."""
    log = recorded(made, log_of(made, laws), db=90.0, counts=2e5, torque=0.01, colour=0.0, seed=1)
    factors = np.array([scale(k) for k in range(made.truth.n)])
    write_recording(replace(log, tau=log.tau * factors), str(folder / "log.h5"))
    warnings = read_recording([str(folder / "log.h5")], made.truth).warnings
    told = [w.split(": tau looks like ") for w in warnings if ": tau looks like " in w]
    return {(joint, rest.split(",")[0]) for joint, rest in told}


def viscous(made: Made, link: float, motor: float) -> Laws:
    """Return viscous friction of links and motors, in units of the motors' own."""
    own = np.array([joint.parameters["fv"] for joint in made.truth.joints])

    def of(size: float) -> Callable[[World], np.ndarray]:
        return lambda world: size * own * world.dq

    return Laws(link=[of(link)], motor=[of(motor)])


def test_a_right_scale_is_not_doubted(tmp_path: Path) -> None:
    for seed in ARMS:
        made = make(seed, 3)
        for laws in (Laws(), viscous(made, 3.0, 0.0), viscous(made, 20.0, 0.0), viscous(made, 0.0, 20.0)):
            assert said(tmp_path, made, laws) == set()


@pytest.mark.parametrize("motor", [4.0, 10.0])
def test_friction_on_both_sides_is_no_other_unit(tmp_path: Path, motor: float) -> None:
    """Both follow the speed: the torque is then many times the spring's, in N·m all the same."""
    for seed in ARMS:
        made = make(seed, 2)
        bare = replace(made.truth, gravity=(0.0, 0.0, 0.0))
        assert said(tmp_path, replace(made, truth=bare), viscous(made, 20.0, 20.0 * motor)) == set()


@pytest.mark.parametrize("scale", ["shaft", "mN·m", "current"])
def test_a_wrong_scale_of_one_joint_is_named_there_and_nowhere_else(tmp_path: Path, scale: str) -> None:
    found = 0
    for seed in ARMS:
        made, wrong = make(seed, 3), seed % 3
        gear = made.truth.joints[wrong].gear_ratio
        factor, what = {
            "shaft": (1.0 / gear, "the motor's shaft torque"),
            "mN·m": (1000.0, "mN·m"),
            "current": (1.0 / 12.0, "a current or another unit (or the positions are in one)"),
        }[scale]
        told = said(tmp_path, made, Laws(), lambda k, w=wrong, f=factor: f if k == w else 1.0)  # type: ignore[misc]
        assert told <= {(f"j{wrong + 1}", what)}
        found += len(told)
    assert found >= 9


@pytest.mark.parametrize(("factor", "close"), [("shaft", 1e-3), ("mN·m", 1e-3), ("current", 0.35)])
def test_the_mapping_that_it_proposes_leaves_the_other_joints_as_they_are(
    tmp_path: Path, factor: str, close: float
) -> None:
    made = next(
        m for m in (make(seed, 3) for seed in ARMS) if len(said(tmp_path, m, Laws(), lambda k: 1e3 if k == 0 else 1.0))
    )
    size = {"shaft": 1.0 / made.truth.joints[0].gear_ratio, "mN·m": 1000.0, "current": 1.0 / 12.0}[factor]
    assert len(said(tmp_path, made, Laws(), lambda k: size if k == 0 else 1.0)) == 1
    wrong = read_recording([str(tmp_path / "log.h5")], made.truth)
    line = next(w for w in wrong.warnings if "tau looks like" in w).partition("map it: ")[2]
    right = read_recording([str(tmp_path / "log.h5")], made.truth, mapping=read_map_options([line]))
    assert not any("tau looks like" in warning for warning in right.warnings)
    np.testing.assert_allclose(right.tau[:, 1:], wrong.tau[:, 1:], rtol=1e-12)
    np.testing.assert_allclose(right.tau[:, 0], wrong.tau[:, 0] / size, rtol=close)


def test_a_second_of_a_soft_arm_is_not_doubted(tmp_path: Path) -> None:
    """Its deflection is a tenth of the motion: theta moves 0.9 times as far as q, and no gear ratio is wrong."""
    write_short_logs(tmp_path, 40)
    robot = read_robot("planar2")
    for log in sorted(tmp_path.iterdir()):
        assert read_recording([str(log)], robot).warnings == ()


def test_a_wrong_gear_ratio_of_a_soft_arm_is_doubted(tmp_path: Path) -> None:
    write_short_logs(tmp_path, 8)
    robot = read_robot("planar2")
    for log in sorted(tmp_path.iterdir()):
        right = read_recording([str(log)], robot)
        write_recording(replace(right, theta=1.25 * right.theta), str(tmp_path / "wrong.h5"))
        said = read_recording([str(tmp_path / "wrong.h5")], robot).warnings
        assert all(any(f"{joint}: theta moves 1." in warning for warning in said) for joint in robot.joint_names)

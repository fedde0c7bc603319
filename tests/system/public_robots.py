"""Robots of three public packages (extra ``robots``: example-robot-data, rtb-data, robosuite), moved by simulation."""

from __future__ import annotations

import importlib.metadata
from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.experiment.simulation.run import Simulation, SimulationOptions, run
from elid_cli.model.dynamics import Dynamics
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Robot

PACKAGES = {"example-robot-data": ".urdf", "rtb-data": ".urdf", "robosuite": "robot.xml"}
NO_ROBOT = {"quadrotor_base.urdf": "no joint moves", "iris_simple.urdf": "no joint moves", "ur3.urdf": "no links",
            "test.urdf": "not well-formed XML"}  # fmt: skip
"""Files without a moving joint, or that are no URDF: one clear error."""
MOST = 60
EVERY = 9
"""Instants of a simulated log between two at which torques are computed anew."""


def files() -> list[Path]:
    """Return the robots of the packages that are installed."""
    found = []
    for package, ending in PACKAGES.items():
        try:
            listed = importlib.metadata.files(package) or []
        except importlib.metadata.PackageNotFoundError:
            continue
        places = sorted(Path(str(file.locate())) for file in listed if str(file).endswith(ending))
        inside = (place for place in places if ending != "robot.xml" or place.parents[1].name == "robots")
        found += [place for place in inside if place.is_file()]
    return found


def known(robot: Robot) -> Robot:
    """Return the robot with rigid joints, nothing left open: massless where the file says nothing, no friction."""
    kept = (*LINK_PARAMETERS, "Ja")
    joints = (
        replace(
            j, transmission="rigid", gear_ratio=None,
            parameters={"fs": 0.0, "fv": 0.0} | {kind: j.parameters.get(kind, 0.0) for kind in kept},
        )
        for j in robot.joints
    )  # fmt: skip
    return replace(robot, joints=tuple(joints), effects=())


def movable(robot: Robot) -> Robot:
    """Return the known robot with reflected inertia at every joint: some files give their bodies no mass."""
    joints = known(robot).joints
    heavy = (replace(j, parameters={**j.parameters, "Ja": max(j.parameters["Ja"], 0.01)}) for j in joints)
    return replace(known(robot), joints=tuple(heavy))


def moved(robot: Robot, duration: float = 1.0) -> Simulation:
    """Return some seconds of the robot's motion, logged at 100 Hz."""
    return run(robot, SimulationOptions(duration=duration, rate=100))


def torque_error(robot: Robot, found: Simulation) -> float:
    """Return how far inverse dynamics of a simulated motion is from its torques, at most, over the largest of them."""
    motion, dynamics, worst = found.motion, Dynamics(robot), 0.0
    for k in range(0, len(found.tau), EVERY):
        at = (motion.q, motion.dq, motion.ddq, motion.theta, motion.dtheta, motion.ddtheta)
        needed = dynamics.inverse(*(values[k] for values in at))[1]
        worst = max(worst, float(np.abs(needed - found.tau[k]).max() / np.abs(found.tau).max()))
    return worst

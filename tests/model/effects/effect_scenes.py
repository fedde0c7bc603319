"""Scenes of smooth random motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.model.effects.scene import DIRECTION_WIDTH, Scene
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Joint, Robot
from elid_cli.signals.motion import Motion

DT = 1e-3
N = 3000


def planar() -> Robot:
    return read_robot("planar2")


def rigid(robot: Robot) -> Robot:
    """Return a robot with rigid transmissions in the place of its elastic ones."""

    def held(joint: Joint) -> Joint:
        known = {name: value for name, value in joint.parameters.items() if name != "K"}
        return replace(joint, transmission="rigid", parameters=known)

    return replace(robot, joints=tuple(map(held, robot.joints)))


def spatial() -> Robot:
    """Return three joints: turning and elastic, sliding and rigid, turning and elastic; gravity along no axis."""
    body = {"m": 4.0, "cx": -0.3, "cy": 0.1, "cz": 0.05, "Ixx": 0.2, "Iyy": 0.3, "Izz": 0.25, "Ixy": 0.01,
            "Ixz": -0.02, "Iyz": 0.015}  # fmt: skip
    drive = {"Jm": 2e-4, "fs": 2.0, "fv": 1.0}
    return Robot(
        name="spatial3",
        gravity=(1.0, 2.0, -9.5),
        joints=(
            Joint("shoulder", a=0.1, alpha=1.3, d=0.4, gear_ratio=60, parameters={**body, **drive, "K": 4000.0}),
            Joint("slide", type="prismatic", alpha=-0.8, d=0.2, gear_ratio=300, transmission="rigid",
                  parameters={**body, **drive}),
            Joint("wrist", a=0.2, alpha=0.4, gear_ratio=100, parameters={**body, **drive, "K": 900.0}),
        ),
    )  # fmt: skip


def motion_of(robot: Robot, samples: int = N, seed: int = 0) -> Motion:
    """Return sums of sines with exact derivatives; deflections of some mrad."""
    generator = np.random.default_rng(seed)
    t = DT * np.arange(samples)

    def wave(size: float, slowest: float, fastest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        total = [np.zeros((samples, robot.n)) for _ in range(3)]
        for j in range(robot.n):
            for _ in range(5):
                w, phase = generator.uniform(slowest, fastest), generator.uniform(0, 6.28)
                a = size * generator.uniform(0.3, 1.0) / w
                total[0][:, j] += a * np.sin(w * t + phase)
                total[1][:, j] += a * w * np.cos(w * t + phase)
                total[2][:, j] -= a * w**2 * np.sin(w * t + phase)
        return total[0], total[1], total[2]

    q, dq, ddq = wave(1.5, 2.0, 8.0)
    e, de, dde = wave(0.06, 5.0, 15.0)
    theta, dtheta, ddtheta = (np.where(robot.elastic, a - b, a) for a, b in ((q, e), (dq, de), (ddq, dde)))
    return Motion(t, q, dq, ddq, theta, dtheta, ddtheta)


def torque_of(robot: Robot, motion: Motion, parameters: np.ndarray, direction: np.ndarray | None = None) -> np.ndarray:
    """Return (link rows, motor rows) of the plain model, each (N, n); a rigid joint's sum is in its motor row.

    Coulomb friction is rounded as effects round it, unless `direction` (N, n) says otherwise.
    """
    model = Regressor(robot)
    motor_speed = np.where(robot.elastic, motion.dtheta, motion.dq)
    direction = np.tanh(motor_speed / DIRECTION_WIDTH) if direction is None else direction
    torque = np.zeros((2, motion.samples, robot.n))
    for item, values in zip(model.equations.rows, model.dense(motion, model.equations), strict=True):
        side = 0 if item.row.kind == "link" else 1
        torque[side, :, item.row.joint] = values @ parameters
        if side == 1:
            friction = parameters[model.index[f"fs{item.row.joint + 1}"]]
            sign = np.sign(motor_speed[:, item.row.joint])
            torque[side, :, item.row.joint] += friction * (direction[:, item.row.joint] - sign)
    return torque


def scene_of(robot: Robot, samples: int = N, seed: int = 0, motion: Motion | None = None) -> Scene:
    """Return a scene whose torques are the model's own, with a little structure on top."""
    motion = motion_of(robot, samples, seed) if motion is None else motion
    parameters = np.nan_to_num(robot.reference())
    predicted = torque_of(robot, motion, parameters).sum(axis=0)
    stiffness = np.array([joint.parameters.get("K", np.nan) for joint in robot.joints])
    load = np.where(np.isfinite(stiffness), np.nan_to_num(stiffness) * (motion.theta - motion.q), 0.9 * predicted)
    return Scene(
        robot=robot,
        motion=motion,
        dt=DT,
        tau=predicted * 1.1 + 0.5,
        load=load,
        predicted=predicted,
        parameters=parameters,
        duration=DT * motion.samples,
        stiffness=stiffness,
        tau_link=np.where(np.isfinite(stiffness), load, np.nan),
        error_integral=DT * np.cumsum(0.1 * predicted, axis=0),
    )


def instant(scene: Scene, k: int) -> Scene:
    """Return the scene of sample k alone."""
    row = slice(k, k + 1)
    return replace(
        scene,
        motion=scene.motion[row],
        tau=scene.tau[row],
        load=scene.load[row],
        predicted=scene.predicted[row],
        tau_link=None if scene.tau_link is None else scene.tau_link[row],
        error_integral=None if scene.error_integral is None else scene.error_integral[row],
        starts=(0,),
        cache={},
    )

"""Payload: the last body, or that of a branch, changes while the log runs."""

from __future__ import annotations

import numpy as np

from elid_cli._types import Array
from elid_cli.memory import Recent
from elid_cli.model.base_parameters import Dependencies, combination, leftmost, tidy
from elid_cli.model.effects.bodies import NEW, body_columns, end_bodies
from elid_cli.model.effects.effect import Alteration, Columns, Effect, Parameter
from elid_cli.model.effects.scene import EquationRow, Scene
from elid_cli.robot.parameter import LINK_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion, random_motion

THINNED = 600
"""Instants of the log at which a change is tried."""
MARGIN = 0.04
"""Share of the log at either end in which no change is looked for."""
BEST = 3
FARTHEST = 9.0
"""Times its usual size that the missing torque is taken for at most: six standard deviations of noise."""
_END_BODY: Recent[tuple[Array, Motion, Robot]] = Recent(1)
"""The columns of a body along the motion that was asked about last, whatever the model's parameters are."""
_UNITS = ("kg", *["kg·m"] * 3, *["kg·m²"] * 6)


class Payload(Effect):
    """Ten inertial parameters added to a body that carries no other one, from one instant on.

    It is the robot's last body where no joint is named. A chain cannot tell all ten apart. As in the base parameters,
    the leftmost independent ones carry those that depend on them; the others have columns of zeros and are not named.
    """

    name = "payload"
    summary = "mass gripped (or dropped) during the log"
    equation = "link equations: (last body's columns) · change, for t ≥ start"
    physics = (
        "A gripper closes on a part. A payload that is there from the first instant to the last is part of the last"
        " body and cannot be seen in the log. Of several branches it is at the body of the joint that is named."
    )
    typical = "a tenth to the whole of the rated payload"
    fingerprint = (
        "whole joint only, of all joints from one instant on, in the pattern of the last body's gravity and inertia"
    )
    record = "the same motion before and after the change"
    place = "chain"
    either_sign = "A load is gripped or dropped."
    whole_robot = True
    amplitudes = tuple(
        Parameter(name, unit, f"change of the last body's {name}", default=0.0)
        for name, unit in zip(LINK_PARAMETERS, _UNITS, strict=True)
    )
    shapes = (Parameter("start", "s", "instant of the change", low=0.0),)
    example = {"m": 2.0, "cx": 0.3, "cy": 0.1, "start": 0.7}
    local = True
    carried = True
    simulated = "robot"

    @classmethod
    def number(cls, robot: Robot, joint: str | None) -> int:
        """Return the number of the body, named by its joint: the last one where none is named."""
        return robot.n - 1 if joint is None else robot.joint_names.index(joint)

    def joint_name(self, robot: Robot) -> str | None:
        """Return the name of the body's joint; None where there is one branch."""
        return None if len(end_bodies(robot)) == 1 else robot.joint_names[self.joint]

    @classmethod
    def unfit(cls, robot: Robot, joint: int) -> str:
        """Return why a load is not looked at here: the body carries another one."""
        ends = end_bodies(robot)
        return "" if joint in ends else f"loads are at the last body, that of {robot.joint_names[ends[0]]}"

    @classmethod
    def grid(cls, scene: Scene, joint: int) -> list[tuple[float, ...]]:
        """Return the instants at which a change would explain most of the torque that the model misses."""
        t = scene.motion.t
        if len(t) < 100:
            return []
        thin = slice(None, None, max(1, len(t) // THINNED))
        rows = _columns(scene, joint)[:, :, thin]
        gain = _gain(rows, _without_outliers((scene.tau[thin] - scene.predicted[thin]).T))
        times = t[thin]
        gain[(times < times[0] + MARGIN * np.ptp(times)) | (times > times[-1] - MARGIN * np.ptp(times))] = 0.0
        found: list[tuple[float, ...]] = []
        apart = max(1, len(times) // 20)
        for _ in range(BEST):
            k = int(np.argmax(gain))
            if gain[k] <= 0:
                break
            found.append((float(times[k]),))
            gain[max(k - apart, 0) : k + apart + 1] = 0.0
        return found

    @classmethod
    def looks(cls, scene: Scene, joint: int) -> int:
        """Return how many instants the grid was chosen from."""
        return min(THINNED, max(scene.samples, 1))

    def columns(self, scene: Scene) -> Columns:
        """Return the body's independent columns in the link rows from the start on, zeros for the others."""
        after = scene.motion.t >= self.shape[0]
        columns, moving = _columns(scene, self.joint), scene.robot.ancestors[self.joint]
        return {EquationRow("link", j): columns[j] * after for j in moving}

    def named(self, scene: Scene, coefficients: Array) -> dict[str, float]:
        """Return the changes that can be told apart, and the start."""
        kept = independent(scene.robot, self.joint)
        values = {
            name: float(c) for name, c, keep in zip(LINK_PARAMETERS, coefficients, kept, strict=True) if keep or c != 0
        }
        return {**values, "start": self.shape[0]}

    @classmethod
    def in_sums(cls, robot: Robot, joint: str | None = None) -> dict[str, str]:
        """Return the sums of the body's parameters that its leading ones stand for."""
        found = _dependencies(robot, cls.number(robot, joint))
        followers = [LINK_PARAMETERS[k] for k in found.followers]
        sums = {}
        for leader, row in zip(found.leaders, found.coefficients, strict=True):
            name, shares = LINK_PARAMETERS[leader], zip(followers, row.tolist(), strict=True)
            if others := {other: tidy(share) for other, share in shares if share}:
                sums[name] = combination({name: 1.0, **others})
        return sums

    def altered(self, robot: Robot, parameters: Array, coefficients: Array) -> Alteration:
        """Return the parameters with the payload."""
        names = robot.parameter_names()
        changed = np.array(parameters, dtype=float)
        for name, change in zip(LINK_PARAMETERS, coefficients, strict=True):
            changed[names.index(StandardParameter(name, self.joint))] += change
        return Alteration(self.shape[0], robot, changed)


def _columns(scene: Scene, body: int) -> Array:
    """Return a body's columns, those that depend on others as zeros, (n, 10, N); shared by all starts."""

    def made() -> tuple[Array, Motion, Robot]:
        columns = body_columns(scene.robot, body, scene.motion)
        columns *= independent(scene.robot, body)[:, None]
        return columns, scene.motion, scene.robot  # held, so that nothing else takes their place in memory

    return _END_BODY.of((id(scene.motion), id(scene.robot), body), made)[0]


def _without_outliers(missing: Array) -> Array:
    """Return torques that the model misses, (n, N), none farther from 0 than a few times what is usual.

    At the ends of a log accelerations of coarse encoders are hundreds of times off: one such instant would decide.
    """
    usual = FARTHEST * np.median(np.abs(missing), axis=1, keepdims=True)
    return np.asarray(np.clip(missing, -usual, usual))


def _gain(rows: Array, missing: Array) -> Array:
    """Return how much of the missing torque's square a change of the body from each instant on explains, (N,).

    `rows` (n, 10, N), `missing` (n, N). The model holds these columns from the first instant to the last already, so
    that only what is orthogonal to them counts.
    """
    columns = rows[:, np.any(rows, axis=(0, 2))]
    if not columns.size:
        return np.zeros(missing.shape[1])
    scale = 1.0 / np.maximum(np.std(missing, axis=1), 1e-12)  # rows of joints with more unexplained count less
    columns, missing = columns * scale[:, None, None], missing * scale[:, None]
    columns = columns / np.sqrt(np.sum(columns**2, axis=(0, 2)))[:, None]
    squares = np.cumsum(np.einsum("jan,jbn->nab", columns, columns)[::-1], axis=0)[::-1]
    products = np.cumsum(np.einsum("jan,jn->na", columns, missing)[::-1], axis=0)[::-1]
    whole = np.linalg.pinv(squares[0], rcond=1e-8, hermitian=True)
    left = squares - squares @ whole @ squares
    right = products - squares @ whole @ products[0]
    # a little of the whole keeps instants near the ends, which hardly change anything, from exploding
    left = left + 1e-6 * np.eye(left.shape[1])
    return np.asarray(np.einsum("na,na->n", right, np.linalg.solve(left, right[..., None])[..., 0]))


def independent(robot: Robot, body: int) -> Array:
    """Return 1 for a body's parameters that no earlier one of them can stand for, else 0, shape (10,)."""
    kept = np.zeros(len(LINK_PARAMETERS))
    kept[_dependencies(robot, body).leaders] = 1.0
    return kept


def _dependencies(robot: Robot, body: int) -> Dependencies:
    motion = random_motion(robot.n, robot.elastic, samples=24)
    columns = body_columns(robot, body, motion).transpose(1, 0, 2).reshape(len(LINK_PARAMETERS), -1)
    return leftmost(columns.T, NEW, null=0.0)

"""Random robots with the parameters of real bodies, for tests that need more than the shipped ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.robot.robot import Joint, Robot


def unit(rng: np.random.Generator) -> tuple[float, float, float]:
    x, y, z = (lambda v: v / np.linalg.norm(v))(rng.normal(size=3))
    return float(x), float(y), float(z)


def random_robot(
    seed: int, n: int, dh: str, *, kinds: str = "r", rigid: tuple[int, ...] = (), own_axes: bool = False,
    parents: tuple[int, ...] = (), gearless: tuple[int, ...] = (),
) -> Robot:  # fmt: skip
    """Return a robot of n joints, types taken cyclically from `kinds` (r, p), with every parameter known.

    Bodies are ten point masses and the discs of the rotors that they carry, so they can be taken apart again.
    `parents` (-1: the base) makes a tree of it; the gear ratios of `gearless` joints are unknown.
    """
    rng = np.random.default_rng(seed)
    axes = [unit(rng) if own_axes else (0.0, 0.0, 1.0) for _ in range(n)]
    rotors = rng.uniform(1e-4, 1e-2, n)
    joints = []
    for i in range(n):
        points, masses = rng.normal(size=(10, 3)) * 0.1, rng.uniform(0.1, 1.0, 10)
        tensor = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, points, strict=True))
        for k in range(n):
            if k not in gearless and (parents[k] if parents else k - 1) == i:
                z = np.array(axes[k])
                tensor = tensor + rotors[k] / 2 * (np.eye(3) + np.outer(z, z))
        xx, yy, zz = np.diag(tensor)
        values = [masses.sum(), *(masses @ points), xx, yy, zz, tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        parameters = dict(zip(LINK_PARAMETERS, map(float, values), strict=True))
        parameters |= {"Jm": float(rotors[i]), "fs": float(rng.uniform(0, 2)), "fv": float(rng.uniform(0, 2))}
        if i not in rigid:
            parameters["K"] = float(rng.uniform(500, 5000))
        geometry = {
            key: float(value) for key, value in zip(("a", "alpha", "d", "theta"), rng.normal(size=4), strict=True)
        }
        if dh == "urdf":
            geometry = {"xyz": tuple(map(float, rng.normal(size=3))), "rpy": tuple(map(float, rng.normal(size=3)))}
            geometry["axis"] = unit(rng)
        parent = parents[i] if parents else i - 1
        joint = Joint(
            name=f"axis_{i + 1}",
            parent="" if parent == i - 1 else "base" if parent < 0 else f"axis_{parent + 1}",
            type="revolute" if kinds[i % len(kinds)] == "r" else "prismatic",
            gear_ratio=float(rng.uniform(5, 120) * rng.choice([-1, 1])),
            motor_axis=axes[i],
            transmission="rigid" if i in rigid else "elastic",
            parameters=parameters,
            **geometry,
        )
        if i in gearless:
            parameters["Ja"] = parameters.pop("Jm") * joint.gear_ratio**2
            joint = replace(joint, gear_ratio=None)
        joints.append(joint)
    gx, gy, gz = rng.normal(size=3) * 6
    return Robot(name=f"random{seed}", joints=tuple(joints), gravity=(float(gx), float(gy), float(gz)), dh=dh)

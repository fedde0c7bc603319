"""Robots and logs that the benchmarks measure on, made deterministically and in blocks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot, robot_from_text
from elid_cli.robot.robot import Robot
from elid_cli.signals.motion import Motion

Array = NDArray[np.float64]
BLOCK = 20_000
MARGIN = 3
"""Samples beyond the ends of a block whose second differences are off."""


def puma() -> Robot:
    """Return the PUMA 560."""
    return read_robot("puma560")


def seven() -> Robot:
    """Return a seven-joint arm with the Panda's geometry."""
    a = (0, 0, 0, 0.0825, -0.0825, 0, 0.088)
    alpha = ("0", "-pi/2", "pi/2", "pi/2", "-pi/2", "pi/2", "pi/2")
    d = (0.333, 0, 0.316, 0, 0.384, 0, 0)
    return _arm("seven", "modified", [(a[k], alpha[k], d[k], "0") for k in range(7)])


def random_arm() -> Robot:
    """Return six joints without a zero or a right angle in their geometry."""
    draw = np.random.default_rng(3).uniform(0.1, 1.2, (6, 4))
    return _arm("random", "standard", [tuple(row) for row in draw.tolist()])


def chain(joints: int, offset: float = 0.1) -> Robot:
    """Return a chain of rigid joints that turn about changing axes, with reference parameters; `offset` in m."""
    values = "{m: 3, cx: 0.3, cy: 0.1, cz: 0.2, Ixx: 0.1, Iyy: 0.1, Izz: 0.15, Jm: 2.0e-4, fs: 2, fv: 1.5}"
    angles = ("pi/2", "-pi/2", "0")
    lines = []
    for k in range(joints):
        place = f"a: {offset + 0.01 * (k % 5):g}, alpha: {angles[k % 3]}, d: {0.05 * (k % 2):g}, theta: 0"
        lines.append(f"  - {{name: j{k}, {place}, gear_ratio: 50, transmission: rigid, parameters: {values}}}")
    head = ["name: chain", "gravity: [0, 0, -9.81]", "dh: standard", "joints:"]
    return robot_from_text("\n".join([*head, *lines]), "chain")


def coupled_wrist() -> Robot:
    """Return six rigid joints with the geometry of a Stäubli TX40; masses, friction and limits are made up."""
    geometry = [(0, "0", 0), (0, "-pi/2", 0), (0.225, "0", 0.035), (0, "pi/2", 0.225), (0, "-pi/2", 0), (0, "pi/2", 0)]
    limits = [(3.1, 5, 15, 200), (2.1, 5, 15, 200), (2.2, 6, 20, 100), (4, 10, 40, 40), (2, 9, 40, 40), (4, 15, 60, 15)]
    bodies = [
        {"m": 8, "cy": 0.1, "Ixx": 0.2, "Iyy": 0.2, "Izz": 0.25, "Ja": 0.35, "fs": 7, "fv": 8},
        {"m": 9, "cx": 1, "cy": 0.05, "cz": 0.3, "Ixx": 0.1, "Iyy": 0.4, "Izz": 0.4, "Ja": 0.35, "fs": 8, "fv": 5.5},
        {
            "m": 5,
            "cx": 0.05,
            "cy": -0.4,
            "cz": 0.05,
            "Ixx": 0.1,
            "Iyy": 0.03,
            "Izz": 0.1,
            "Ja": 0.1,
            "fs": 6.5,
            "fv": 2,
        },
        {"m": 1.5, "cy": 0.02, "cz": -0.05, "Ixx": 0.01, "Iyy": 0.01, "Izz": 0.005, "Ja": 0.03, "fs": 2.5, "fv": 1.2},
        {"m": 1, "cx": 0.005, "cy": -0.03, "Ixx": 0.006, "Iyy": 0.004, "Izz": 0.006, "Ja": 0.04, "fs": 3, "fv": 1.8},
        {"m": 0.3, "cz": 0.01, "Ixx": 0.001, "Iyy": 0.001, "Izz": 0.0005, "Ja": 0.01, "fs": 0.4, "fv": 0.7},
    ]
    none = dict.fromkeys(("cx", "cy", "cz", "Ixy", "Ixz", "Iyz"), 0)
    lines = []
    for k, ((a, alpha, d), most, body) in enumerate(zip(geometry, limits, bodies, strict=True), 1):
        bounds = dict(zip(("velocity", "acceleration", "torque"), most[1:], strict=True))
        within = ", ".join(
            [f"position: [-{most[0]}, {most[0]}]", *(f"{name}: {value}" for name, value in bounds.items())]
        )
        values = ", ".join(f"{name}: {value}" for name, value in (none | body).items())
        lines.append(f"  - {{name: joint{k}, a: {a}, alpha: {alpha}, d: {d}, theta: 0, transmission: rigid,")
        lines.append(f"     limits: {{{within}}}, parameters: {{{values}}}}}")
    head = ["name: wrist", "gravity: [0, 0, -9.81]", "dh: modified", "joints:"]
    return robot_from_text("\n".join([*head, *lines]), "wrist")


def planar3() -> Robot:
    """Return three parallel elastic joints with reference parameters."""
    values = "{m: 5, cx: -1, cy: 0.1, Izz: 0.8, Jm: 2, fs: 0.5, fv: 0.4, K: 2000}"
    joints = [f"  - {{name: j{k}, a: 0.4, alpha: 0, d: 0, theta: 0, gear_ratio: 0.1, parameters: {values}}}"
              for k in (1, 2, 3)]  # fmt: skip
    return robot_from_text(
        "\n".join(["name: planar3", "gravity: [0, -9.81, 0]", "dh: standard", "joints:", *joints]), "planar3"
    )


def rigid(robot: Robot) -> Robot:
    """Return the robot with rigid transmissions."""
    return robot.stiffened(np.ones(robot.n, dtype=bool))


def _arm(name: str, dh: str, rows: list[tuple[object, ...]]) -> Robot:
    lines = [f"name: {name}", "gravity: [0, 0, -9.81]", f"dh: {dh}", "joints:"]
    for k, (a, alpha, d, theta) in enumerate(rows, start=1):
        lines.append(f"  - {{name: j{k}, a: {a}, alpha: {alpha}, d: {d}, theta: {theta}, gear_ratio: 0.01}}")
    return robot_from_text("\n".join(lines), name)


class Movement:
    """Sums of sines of every joint, and what the robot's reference parameters make of them."""

    def __init__(self, robot: Robot, seed: int = 0) -> None:
        draw = np.random.default_rng(seed)
        self.robot, self.model = robot, Regressor(robot)
        self.frequency = 2 * np.pi * draw.uniform(0.05, 0.6, (robot.n, 5))
        self.size, self.phase = draw.uniform(0.1, 0.4, (robot.n, 5)), draw.uniform(0, 6.28, (robot.n, 5))
        self.noise = np.random.default_rng(seed + 1)

    def block(self, start: int, stop: int, dt: float, margin: int = MARGIN) -> tuple[Array, Array, Array, Array]:
        """Return t, q, theta and tau of some samples, with sensor noise.

        The motors' speeds are differences of their positions: without a `margin` of samples beyond its ends, a block
        has wrong accelerations, and torques that its robot never needed, there.
        """
        t, *signals = (
            values[margin : margin + stop - start] for values in self._exact(start - margin, stop + margin, dt)
        )
        q, theta, tau = signals
        tau = tau + 0.02 * np.abs(tau).mean(0) * self.noise.standard_normal(tau.shape)
        q, theta = (values + 1e-6 * self.noise.standard_normal(q.shape) for values in (q, theta))
        return t, q, theta, tau

    def _exact(self, start: int, stop: int, dt: float) -> tuple[Array, Array, Array, Array]:
        robot, model = self.robot, self.model
        t = np.arange(start, stop) * dt
        angle = self.frequency * t[:, None, None] + self.phase
        q = (self.size * np.sin(angle)).sum(2)
        dq = (self.size * self.frequency * np.cos(angle)).sum(2)
        ddq = (-self.size * self.frequency**2 * np.sin(angle)).sum(2)
        reference = np.nan_to_num(robot.reference())
        rows = model.rows(Motion(t, q, dq, ddq, q, dq, ddq), model.equations)
        theta = q.copy()
        for item in model.equations.rows:
            if item.row.kind == "link":
                stiffness = model.index[f"K{item.row.joint + 1}"]
                load = reference[item.columns] @ rows[item.row]  # without deflection the spring's column is zero
                theta[:, item.row.joint] += load / reference[stiffness]
        dtheta = np.gradient(theta, dt, axis=0)
        motion = Motion(t, q, dq, ddq, theta, dtheta, np.gradient(dtheta, dt, axis=0))
        rows = model.rows(motion)
        tau = np.stack([reference[i.columns] @ rows[i.row] for i in model.estimation.rows if i.row.kind == "sum"], 1)
        return t, q, theta, tau


def write_hdf5(robot: Robot, path: Path, seconds: float, rate: float = 1000.0, margin: int = MARGIN) -> None:
    """Write a log of any length without holding it."""
    import h5py

    movement, samples = Movement(robot), int(seconds * rate)
    with h5py.File(path, "w") as file:
        file.attrs["joint_names"] = [name.encode() for name in robot.joint_names]
        time = file.create_dataset("t", (samples,), dtype="f8")
        sets = [file.create_dataset(name, (samples, robot.n), dtype="f8") for name in ("q", "theta", "tau")]
        for start in range(0, samples, BLOCK):
            stop = min(start + BLOCK, samples)
            t, *signals = movement.block(start, stop, 1 / rate, margin)
            time[start:stop] = t
            for dataset, values in zip(sets, signals, strict=True):
                dataset[start:stop] = values


def write_csv(robot: Robot, path: Path, seconds: float, rate: float = 1000.0) -> None:
    """Write a CSV log of any length without holding it, every digit of it."""
    draw, samples = np.random.default_rng(0), int(seconds * rate)
    speed, phase = 2 * np.pi * np.linspace(0.2, 0.7, robot.n), np.arange(robot.n)
    with path.open("w") as file:
        names = [f"{signal}.{joint}" for signal in ("q", "theta", "tau") for joint in robot.joint_names]
        file.write(",".join(["t", *names]) + "\n")
        for start in range(0, samples, BLOCK):
            t = np.arange(start, min(start + BLOCK, samples)) / rate
            q, dq = np.sin(speed * t[:, None] + phase), speed * np.cos(speed * t[:, None] + phase)
            theta = q + 1e-3 * dq + 1e-6 * draw.standard_normal(q.shape)
            tau = -3 * speed**2 * q + 2 * np.sign(dq) + 0.05 * draw.standard_normal(q.shape)
            rows = np.hstack([t[:, None], q, theta, tau]).tolist()
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def write_short_logs(folder: Path, count: int, samples: int = 1000) -> None:
    """Write many logs of a second, cut at random from the shipped log of planar2, with noise of their own."""
    from elid_cli.logs import read_recording, write_recording
    from elid_cli.signals.recording import Segment

    whole = read_recording([Path(__file__).parents[3] / "sample_logs/planar2.h5"], read_robot("planar2"))
    draw = np.random.default_rng(0)
    for number in range(count):
        first = int(draw.integers(0, whole.samples - samples))
        part = slice(first, first + samples)
        q, theta = (a[part] + 1e-6 * draw.standard_normal(a[part].shape) for a in (whole.q, whole.theta))
        tau = whole.tau[part] + 0.05 * draw.standard_normal(whole.tau[part].shape)
        log = replace(
            whole, t=whole.t[part] - whole.t[first], q=q, theta=theta, tau=tau, segments=(Segment(0, samples),)
        )
        write_recording(log, folder / f"{number:04d}.h5")


def write_other(robot: Robot, path: Path, seconds: float, rate: float = 1000.0) -> None:
    """Write a log in the format of the name's suffix."""
    from elid_cli.logs import write_recording

    write_recording(recording(robot, seconds, rate), path)


def recording(robot: Robot, seconds: float, rate: float = 1000.0):  # type: ignore[no-untyped-def]
    """Return a recording in memory."""
    from elid_cli.signals.recording import Recording, Segment

    samples = int(seconds * rate)
    movement = Movement(robot)
    blocks = [movement.block(k, min(k + 10_000, samples), 1 / rate) for k in range(0, samples, 10_000)]
    t, q, theta, tau = (np.concatenate(part) for part in zip(*blocks, strict=True))
    return replace(
        Recording(robot.joint_names, 1 / rate, t, q, theta, tau), segments=(Segment(0, samples),), files=("made",)
    )

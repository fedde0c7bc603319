"""Section 6 of the paper with elid: Tables 1-6 and Figures 3-7.

Run: python -m tests.reproduce.paper [--quick] [--plot DIR].
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elid_cli.base import find_base
from elid_cli.estimate import EstimateOptions, Identification, identify
from elid_cli.model import Model
from elid_cli.paper import RateNoise, identify_paper
from elid_cli.recording import Recording
from elid_cli.reference import ReferenceOptions
from elid_cli.robot import EffectSpec, Robot
from elid_cli.robot_file import read_robot
from elid_cli.signals import SignalOptions, prepare
from elid_cli.simulation import ControlOptions, Simulation, SimulationOptions, run

Array = NDArray[np.float64]

FRICTION = np.array(
    [[0.1434, 0.3302, 0.2499, 0.0537, 0.2991, 16.624], [0.1391, 0.3576, 0.2451, 0.1073, 0.3389, 10.097]]
)
"""Eq. (44): f1...f6 of joints 1 and 2."""
COUNTS = 1.25e6
LEVELS: tuple[float | None, ...] = (None, 200, 100, 80, 70, 60, 40, 20)
STATES = ("q", "dq", "ddq", "theta", "dtheta", "ddtheta")
PRINTED = (
    -30.8352,
    6.5670,
    22.6345,
    -1.04e-5,
    -0.7835,
    3.18e-6,
    21.1446,
    12.1036,
    0.1016,
    0.1249,
    0.1288,
    0.1389,
    3000.79,
    1799.79,
)
"""Table 1's estimates, in standard order."""
TABLE_2 = {20: "3.84e+3", 70: "44.5", 80: "4.73", 100: "0.157", 200: "0.111", None: "0.103"}


def with_friction(robot: Robot, *, known: bool) -> Robot:
    """Return the robot with the Stribeck terms of eq. (43): their values, or only that they exist."""
    specs = []
    for joint, f in zip(robot.joint_names, FRICTION, strict=True):
        for amplitude, velocity, exponent in ((-f[2], f[3], 1.0), (-f[4], 1.0 / f[5], -1.0)):
            given = {"amplitude": amplitude, "velocity": velocity} if known else {"velocity": 0.1}
            specs.append(EffectSpec("stribeck", joint, {**given, "exponent": exponent}))
    return replace(robot, effects=tuple(specs))


def motion_of(robot: Robot, seed: int, duration: float = 8.9) -> Simulation:
    """Simulate a B-spline motion under PD control at 1 kHz, exact positions."""
    options = SimulationOptions(
        duration=duration,
        seed=seed,
        reference=ReferenceOptions(amplitude=0.75, interval=1.1),
        control=ControlOptions(continuous=True),
    )
    return run(robot, options)


def quantised(values: Array) -> Array:
    step = 2 * np.pi / COUNTS
    return np.round(values / step) * step


def noise_of(values: Array, level: float | None) -> Array:
    return np.zeros(values.shape[1]) if level is None else values.std(axis=0) * 10 ** (-level / 20)


def log_of(
    simulation: Simulation, level: float | None, seed: int, *, rates: bool
) -> tuple[Recording, tuple[Array, Array] | None]:
    """Return a noisy log; with `rates`, noise is on q, q' and q'' separately, as the paper words it."""
    generator = np.random.default_rng(seed)
    noisy = {}
    for name in STATES:
        exact = getattr(simulation.motion, name)
        noisy[name] = exact + noise_of(exact, level) * generator.standard_normal(exact.shape)
    recording = replace(simulation.recording, q=quantised(noisy["q"]), theta=quantised(noisy["theta"]))
    if not rates:
        return replace(recording, dq=None, dtheta=None), None
    return replace(recording, dq=noisy["dq"], dtheta=noisy["dtheta"]), (noisy["ddq"], noisy["ddtheta"])


def by_paper(robot: Robot, simulation: Simulation, level: float | None, seed: int, *, rates: bool) -> Identification:
    recording, _ = log_of(simulation, None if rates else level, seed, rates=False)
    spread = {name: noise_of(getattr(simulation.motion, name), level) for name in STATES}
    noise = RateNoise(spread, seed) if rates else None
    return identify_paper(robot, prepare(recording, robot), EstimateOptions(estimator="paper"), noise)


def by_elid(
    robot: Robot, simulation: Simulation, level: float | None, seed: int, *, rates: bool, accurate: bool = False
) -> Identification:
    recording, accelerations = log_of(simulation, level, seed, rates=rates)
    signals = prepare(recording, robot, SignalOptions(), accelerations)
    return identify(robot, signals, EstimateOptions(accurate=accurate, guards=False))


def median(errors: Sequence[float]) -> str:
    return f"{np.median(errors):10.4f}"


def table_1(robot: Robot, simulation: Simulation) -> None:
    known, stribeck = robot, with_friction(robot, known=False)
    columns = [
        by_paper(known, simulation, None, 1, rates=False),
        by_elid(known, simulation, None, 1, rates=False),
        by_elid(stribeck, simulation, None, 1, rates=True),
        by_elid(stribeck, simulation, None, 1, rates=False, accurate=True),
    ]
    print("Table 1: no noise but the encoders', friction of eq. (43) in the data")
    print(
        f"{'base parameter':28} {'real':>11} {'printed':>11} {'paper':>11} "
        f"{'default':>11} {'+ Stribeck':>11} {'accurate+S':>11}"
    )
    base = columns[0].base
    for k, name in enumerate(base.names):
        values = " ".join(f"{c.estimate[k]:11.4f}" for c in columns)
        print(f"{name:28} {columns[0].reference[k]:11.4f} {PRINTED[k]:11.4f} {values}")
    printed = np.array(PRINTED)
    reference = columns[0].reference
    error = np.where(reference == 0, 0, np.abs(printed - reference) / np.where(reference == 0, 1, np.abs(reference)))
    print(
        f"{'normalised mean error':28} {'':11} {error.mean():11.4f} "
        + " ".join(f"{c.normalised_mean_error():11.4f}" for c in columns)
    )


def table_2(
    robot: Robot, motions: Sequence[Simulation], plain: Sequence[Simulation], levels: Sequence[float | None]
) -> None:
    stribeck = with_friction(robot, known=False)
    print("\nTable 2: normalised mean error, median over", len(motions), "motions")
    print(
        "(+S: Stribeck terms declared; plain: data and model with Coulomb and viscous friction only;\n"
        " bound: mean error that the accurate estimate's own covariance expects)"
    )
    names = (
        "printed",
        "paper q",
        "paper all",
        "default q",
        "default all",
        "+S all",
        "accurate +S q",
        "plain default",
        "plain accurate",
        "bound",
    )
    print("SN dB   " + " ".join(f"{n:>14}" for n in names))
    for level in levels:
        cells: dict[str, list[float]] = {n: [] for n in names[1:]}
        for seed, (m, p) in enumerate(zip(motions, plain, strict=True)):
            cells["paper q"].append(by_paper(robot, m, level, seed, rates=False).normalised_mean_error())
            cells["paper all"].append(by_paper(robot, m, level, seed, rates=True).normalised_mean_error())
            cells["default q"].append(by_elid(robot, m, level, seed, rates=False).normalised_mean_error())
            cells["default all"].append(by_elid(robot, m, level, seed, rates=True).normalised_mean_error())
            cells["+S all"].append(by_elid(stribeck, m, level, seed, rates=True).normalised_mean_error())
            cells["accurate +S q"].append(
                by_elid(stribeck, m, level, seed, rates=False, accurate=True).normalised_mean_error()
            )
            cells["plain default"].append(by_elid(robot, p, level, seed, rates=False).normalised_mean_error())
            best = by_elid(robot, p, level, seed, rates=False, accurate=True)
            cells["plain accurate"].append(best.normalised_mean_error())
            relative = best.std_error / np.where(best.reference == 0, np.inf, np.abs(best.reference))
            cells["bound"].append(float(np.nanmean(relative) * np.sqrt(2 / np.pi)))
        text = " ".join(f"{median(cells[n]):>14}" for n in names[1:])
        print(f"{'none' if level is None else f'{level:g}':7} {TABLE_2.get(level, '-'):>14} {text}", flush=True)


def puma_tables(duration: float) -> None:
    robot = read_robot("puma560")
    joints = tuple(replace(j, parameters={**j.parameters, "K": 2000.0}) for j in robot.joints)
    robot = replace(robot, joints=joints)
    across = replace(robot, gravity=(0.0, -9.81, 0.0))
    standing = replace(robot, gravity=(0.0, 0.0, -9.81))
    a, b = find_base(Model(across)), find_base(Model(standing))
    print(
        f"\nPUMA 560, K = 2000 N·m/rad: {a.count} base parameters with the paper's gravity (-y0), "
        f"{b.count} for a standing arm"
    )
    supported = sum(1 for kind in a.classes.values() if kind == "independent")
    print(
        f"Of the paper's 84 printed estimates the data can support {supported} by themselves; the other "
        f"{84 - supported} are in combinations only or do not show at all, "
        "so their printed values are one of infinitely many solutions."
    )
    simulation = run(across, SimulationOptions(duration=duration, seed=1, control=ControlOptions(continuous=True)))
    recording, _ = log_of(simulation, None, 1, rates=False)
    found = identify(across, prepare(recording, across), EstimateOptions(guards=False))
    old = identify_paper(across, prepare(recording, across), EstimateOptions(estimator="paper"))
    print("Tables 3-6, what is identifiable (base parameters):")
    for k, name in enumerate(found.base.names):
        label = name if len(name) < 40 else name[:37] + "..."
        print(
            f"{label:40} real {found.reference[k]:12.5g}  paper {old.estimate[k]:12.5g}  "
            f"default {found.estimate[k]:12.5g} {found.verdict[k]}"
        )
    print(
        f"normalised mean error: paper's estimator {old.normalised_mean_error():.4f}, "
        f"default {found.normalised_mean_error():.4f} (printed: 0.123)"
    )


def figures(folder: Path, simulation: Simulation, quick: bool) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)

    def save(name: str, x: Array, lines: Sequence[tuple[str, Array]], x_label: str, y_label: str) -> None:
        figure, axes = pyplot.subplots(figsize=(7, 4))
        for label, y in lines:
            axes.plot(x, y, label=label)
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.legend()
        figure.tight_layout()
        figure.savefig(folder / name)
        pyplot.close(figure)

    v = np.linspace(-1.5, 1.5, 601)
    a, s, f = np.abs(v) + 1e-9, np.sign(v), FRICTION[0]
    complete = f[0] * v + f[1] * s - f[2] * s * np.exp(-a / f[3]) - f[4] * s * np.exp(-1 / (f[5] * a))
    save("figure3.png", v, [("eq. (43)", complete), ("Coulomb", f[1] * s)], "velocity [rad/s]", "friction [N·m]")

    def motion_figures(numbers: tuple[int, int], what: Simulation) -> None:
        m, n = what.motion, what.tau.shape[1]
        save(
            f"figure{numbers[0]}a.png", m.t, [(f"u{k + 1}", what.tau[:, k]) for k in range(n)], "t [s]", "torque [N·m]"
        )
        save(f"figure{numbers[0]}b.png", m.t, [(f"q{k + 1}", m.q[:, k]) for k in range(n)], "t [s]", "position [rad]")
        gap = np.degrees(m.q - m.theta)
        lines = [(f"q{k + 1} - theta{k + 1}", gap[:, k]) for k in range(2)]
        save(f"figure{numbers[1]}.png", m.t, lines, "t [s]", "deflection [deg]")

    motion_figures((4, 5), simulation)
    if not quick:
        motion_figures((6, 7), run(read_robot("puma560"), SimulationOptions(duration=8.9, seed=1)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one motion, three noise levels, no PUMA")
    parser.add_argument("--plot", type=Path, metavar="DIR", help="write figures 3-7 there")
    chosen = parser.parse_args()
    robot = read_robot("planar2")
    count = 1 if chosen.quick else 4
    motions = [motion_of(with_friction(robot, known=True), seed) for seed in range(1, count + 1)]
    plain = [motion_of(robot, seed) for seed in range(1, count + 1)]
    table_1(robot, motions[0])
    table_2(robot, motions, plain, (None, 80, 40) if chosen.quick else LEVELS)
    if not chosen.quick:
        puma_tables(20.0)
    if chosen.plot is not None:
        figures(chosen.plot, motions[0], chosen.quick)


if __name__ == "__main__":
    main()

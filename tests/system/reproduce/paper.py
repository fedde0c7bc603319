"""Section 6 of the paper with elid: Tables 1-6 and Figures 3-7.

Run: python -m tests.system.reproduce.paper [--quick] [--only PART …] [--motions 1-4] [--levels none 80 …]
[--columns NAME …] [--plot DIR].
`tests/system/reproduce/paper.txt` is what it printed.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from elid_cli.errors import LogError
from elid_cli.estimation.classical import identify_paper
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.experiment.simulation import ControlOptions, Simulation, SimulationOptions, run
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import prepare
from tests.system.reproduce.paper_figures import figures
from tests.system.reproduce.paper_logs import by_elid, by_paper, log_of, motion_of, with_friction

LEVELS: tuple[float | None, ...] = (None, 200, 100, 80, 70, 60, 40, 20)
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
PARTS = ("table1", "table2", "puma")
TABLE_2 = {20: "3.84e+3", 70: "44.5", 80: "4.73", 100: "0.157", 200: "0.111", None: "0.103"}


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


COLUMNS = (
    "paper q",
    "paper all",
    "default q",
    "default all",
    "+S all",
    "accurate +S q",
    "plain default",
    "plain motion",
    "plain accurate",
    "bound",
    "bound +S",
)
"""Columns of Table 2 beside the printed one."""


def expected(found: Identification) -> float:
    """Return the mean error that an estimate's own covariance expects."""
    relative = found.std_error / np.where(found.reference == 0, np.inf, np.abs(found.reference))
    return float(np.nanmean(relative) * np.sqrt(2 / np.pi))


def table_2(
    robot: Robot,
    motions: Sequence[Simulation],
    plain: Sequence[Simulation],
    seeds: Sequence[int],
    levels: Sequence[float | None],
    columns: Sequence[str] = COLUMNS,
) -> None:
    stribeck = with_friction(robot, known=False)
    print("\nTable 2: normalised mean error, median over", len(motions), "motions")
    print(
        "(+S: Stribeck terms declared; plain: data and model with Coulomb and viscous friction only;\n"
        " motion: --fit trajectory, which refuses positions noisier than 65 dB (nan);\n"
        " bound: mean error that the accurate estimate's own covariance expects; +S: with those terms declared)"
    )
    print("SN dB   " + " ".join(f"{n:>14}" for n in ("printed", *columns)))
    for level in levels:
        cells: dict[str, list[float]] = {n: [] for n in columns}
        for seed, m, p in zip(seeds, motions, plain, strict=True):
            ways = {
                "paper q": partial(by_paper, robot, m, level, seed, rates=False),
                "paper all": partial(by_paper, robot, m, level, seed, rates=True),
                "default q": partial(by_elid, robot, m, level, seed, rates=False),
                "default all": partial(by_elid, robot, m, level, seed, rates=True),
                "+S all": partial(by_elid, stribeck, m, level, seed, rates=True),
                "accurate +S q": partial(by_elid, stribeck, m, level, seed, rates=False, accurate=True),
                "plain default": partial(by_elid, robot, p, level, seed, rates=False),
                "plain motion": partial(by_elid, robot, p, level, seed, rates=False, fit="trajectory"),
            }
            for name in (n for n in columns if n in ways):
                try:
                    cells[name].append(ways[name]().normalised_mean_error())
                except LogError:  # too noisy for the trajectory fit, which says so
                    cells[name].append(np.nan)
            if {"plain accurate", "bound"} & set(columns):
                best = by_elid(robot, p, level, seed, rates=False, accurate=True)
                cells.setdefault("plain accurate", []).append(best.normalised_mean_error())
                cells.setdefault("bound", []).append(expected(best))
            if "bound +S" in columns:
                cells["bound +S"].append(expected(by_elid(stribeck, m, level, seed, rates=False, accurate=True)))
        text = " ".join(f"{median(cells[n]):>14}" for n in columns)
        print(f"{'none' if level is None else f'{level:g}':7} {TABLE_2.get(level, '-'):>14} {text}", flush=True)


def puma_motion() -> tuple[Robot, Simulation]:
    """Return the PUMA 560 as the paper has it, K = 2000 everywhere and gravity along -y0, and 20 s of its motion."""
    robot = read_robot("puma560")
    joints = tuple(replace(j, parameters={**j.parameters, "K": 2000.0}) for j in robot.joints)
    across = replace(robot, joints=joints, gravity=(0.0, -9.81, 0.0))
    return across, run(across, SimulationOptions(duration=20.0, seed=1, control=ControlOptions(continuous=True)))


def puma_tables(across: Robot, simulation: Simulation) -> None:
    standing = replace(across, gravity=(0.0, 0.0, -9.81))
    a, b = find_base(Regressor(across)), find_base(Regressor(standing))
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


def numbers(text: str) -> list[int]:
    """Return the numbers of a range such as 5-8, or of one number."""
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def level(text: str) -> float | None:
    """Return a noise level in dB; `none` for no noise."""
    return None if text == "none" else float(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one motion, three noise levels, no PUMA")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART", help=", ".join(PARTS))
    parser.add_argument(
        "--motions", type=numbers, default=[1, 2, 3, 4], metavar="A-B", help="seeds of Table 2's motions"
    )
    parser.add_argument("--levels", type=level, nargs="+", default=list(LEVELS), metavar="DB", help="Table 2's SN, dB")
    parser.add_argument(
        "--columns", nargs="+", choices=COLUMNS, default=list(COLUMNS), metavar="NAME", help="Table 2's columns"
    )
    parser.add_argument("--plot", type=Path, metavar="DIR", help="write figures 3-7 there")
    chosen = parser.parse_args()
    parts, seeds, levels = chosen.only, chosen.motions, chosen.levels
    if chosen.quick:
        parts, seeds, levels = [part for part in parts if part != "puma"], seeds[:1], [None, 80.0, 40.0]
    robot = read_robot("planar2")
    rough = with_friction(robot, known=True)
    if "table1" in parts:
        table_1(robot, motion_of(rough, seeds[0]))
    if "table2" in parts:
        print("\nmotions", *seeds)
        table_2(
            robot,
            [motion_of(rough, s) for s in seeds],
            [motion_of(robot, s) for s in seeds],
            seeds,
            levels,
            chosen.columns,
        )
    puma = puma_motion() if "puma" in parts else None
    if puma is not None:
        puma_tables(*puma)
    if chosen.plot is not None:
        figures(chosen.plot, motion_of(rough, seeds[0]), None if puma is None else puma[1])


if __name__ == "__main__":
    main()

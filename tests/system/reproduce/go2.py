"""The measured quadruped: identified or diagnosed from some runs, replayed on others, by elid and by MuJoCo.

    python -m tests.system.reproduce.go2 [--only ROW …] [--pairs] [--trends] [--data FOLDER]

Each row is what a user would type: `identify --fit trajectory`, or `diagnose`, writes a patched go2.xml and the file
of actuators beside it; `replay` judges both on runs that were not fitted, MuJoCo the patched file as it stands (base
fixed, commands held for their sample with the log's gains, 1 ms steps), with offsets and delay. Effects that an MJCF
lacks take part in elid's replay only. Processor time is that of the command that fits.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from elid_cli.estimation.regression.long_run import student_quantile

DATA = Path(__file__).parents[4] / "shared" / "data"
ROWS: dict[str, tuple[tuple[str, ...], tuple[int, ...], tuple[int, ...]]] = {
    "least squares": (("identify", "--physical"), (0,), (3, 4)),
    "one run": (("identify", "--fit", "trajectory"), (0,), (3, 4)),
    "four runs": (("identify", "--fit", "trajectory"), (0, 1, 2, 3), (4,)),
    "diagnosed": (("diagnose",), (0, 1, 2, 3), (4,)),
}
"""Command, runs that it is given, runs that it is judged on."""


def elid(*arguments: str) -> tuple[str, float]:
    """Return what a command prints, and the processor time that it took, s."""
    before = os.times()
    command = [sys.executable, "-m", "elid_cli", *arguments]
    done = subprocess.run(command, capture_output=True, check=False, encoding="utf-8")
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    after = os.times()
    return done.stdout, sum(after[2:4]) - sum(before[2:4])


def judged(row: str, data: Path, folder: Path) -> tuple[list[tuple[int, float, float]], float, dict[str, float]]:
    """Return run, error by elid and by MuJoCo, mrad, of every run that is judged, and the fit's processor time.

    And `apart` of the rotor inertias that it found.
    """
    command, fitted, others = ROWS[row]
    logs = [str(data / f"go2_{k}.h5") for k in fitted]
    robot, beside = str(folder / "go2.xml"), str(folder / "actuators.json")
    arguments = (*logs, "--robot", str(data / "go2.xml"), "--write-robot", robot, "--write-actuators", beside)
    _, seconds = elid(command[0], *arguments, *command[1:])
    errors = []
    for k in others:
        by = []
        for engine in ("elid", "mujoco"):
            told, _ = elid("replay", str(data / f"go2_{k}.h5"), "--robot", robot, "--actuators", beside,
                           "--engine", engine, "--json")  # fmt: skip
            by.append(1e3 * json.loads(told)["mean_abs"])
        errors.append((k, by[0], by[1]))
    return errors, seconds, apart(json.loads(Path(beside).read_text("utf-8"))["actuators"]["armature"])


def apart(inertias: Mapping[str, float | None]) -> dict[str, float]:
    """Return how far those of the four legs are from their mean at most, part of it, by kind of joint."""
    by: dict[str, list[float]] = {}
    for joint, value in inertias.items():
        by.setdefault(joint.split("_")[1], []).append(np.nan if value is None else value)
    return {kind: float(np.abs(np.array(own) / np.mean(own) - 1.0).max()) for kind, own in by.items()}


def pairs(data: Path) -> None:
    """Print how often 95 % intervals from one run hold what another run gives, by kind of parameter."""
    kinds = ("Ja", "fs", "fv", "offset")
    keys = ("estimate", "std_error", "within_recording", "another_recording")
    values = []
    for k in range(5):
        told, _ = elid("identify", str(data / f"go2_{k}.h5"), "--robot", str(data / "go2.xml"), "--fit", "trajectory",
                       "--json")  # fmt: skip
        joints = json.loads(told)["settings"]["trajectory"]["joint_parameters"].values()
        values.append([[[own[kind][key] for key in keys] for kind in kinds]
                       for own in joints])  # fmt: skip
    z, deviation, within, another = np.moveaxis(np.array(values), -1, 0)
    print("95 % intervals from one run that hold the estimate of another, of 960 pairs")
    print(f"{'':38}" + "".join(f"{kind:>8}" for kind in kinds) + f"{'all':>8}")
    gap = np.abs(z[:, None] - z[None])
    apart = ~np.eye(len(z), dtype=bool)
    for words, wide in (
        ("standard error", deviation),
        ("with the scatter within the recording", np.hypot(deviation, within)),
        ("another_recording", another),
    ):
        held = (gap < 1.96 * wide[:, None])[apart].mean(axis=(0, 1))
        shares(words, held)
    # offsets are set when encoders start: of one run no interval can know it, of several their scatter does
    others = np.array([np.delete(z, k, axis=0) for k in range(len(z))])
    reach = student_quantile(others.shape[1] - 1, 0.975) * np.sqrt(1 + 1 / others.shape[1])
    held = np.abs(z - others.mean(axis=1)) < reach * others.std(axis=1, ddof=1)
    shares("mean and scatter of the four others", held.mean(axis=(0, 1)))


def shares(words: str, held: np.ndarray) -> None:
    print(f"{words:38}" + "".join(f"{100 * share:7.0f}%" for share in (*held, held.mean())))


def trends(data: Path, folder: Path) -> None:
    """Print what `elid trend` says of the five runs, after least squares and after the trajectory fit of each."""
    for fit in (("--fit", "torque"), ("--fit", "trajectory")):
        saved, delays = [], []
        for k in range(5):
            told, _ = elid("identify", str(data / f"go2_{k}.h5"), "--robot", str(data / "go2.xml"), *fit, "--json")
            late = [
                item["parameters"]["delay"] for item in json.loads(told)["nuisances"] if "delay" in item["parameters"]
            ]
            delays.append(f"{1e3 * np.mean(late):.1f}" if late else "none")
            saved.append(folder / f"go2_{k}.json")
            saved[-1].write_text(told, encoding="utf-8")
        told, _ = elid("trend", *map(str, saved), "--json")
        print(" ".join(["identify", *fit]) + f": mean delay found, by run: {', '.join(delays)} ms")
        print(f"{'':5}{'joints':>7}{'mean over joints, by run':>36}{'slope, %':>19}{'p':>9}{'p together':>12}  verdict")
        for item in json.loads(told)["families"]:
            means = "".join(f"{value:7.3f}" for value in item["means"])
            reach = (item["slope_interval"][1] - item["slope_interval"][0]) / 2
            print(f"{item['kind']:5}{len(item['names']):7}{means:>36}{100 * item['slope']:11.1f} ± {100 * reach:4.1f}"
                  f"{item['slope_p']:10.2g}{item['together_p']:12.1g}  {item['verdict']}")  # fmt: skip
        apart = [item["name"] for item in json.loads(told)["parameters"] if item["verdict"] == "disagrees"]
        print(f"recordings disagree: {', '.join(apart)}\n")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=ROWS, default=list(ROWS), metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--pairs", action="store_true", help="print only what one run's intervals hold of other runs")
    parser.add_argument("--trends", action="store_true", help="print only what elid trend says of the five runs")
    options = parser.parse_args()
    if options.trends:
        with tempfile.TemporaryDirectory() as folder:
            trends(options.data, Path(folder))
        return
    if options.pairs:
        pairs(options.data)
        return
    print("mean absolute error of simulated positions on runs not fitted, mrad")
    print(f"{'':15}{'from runs':>11}{'on run':>8}{'elid':>8}{'MuJoCo':>8}{'processor s':>13}", flush=True)
    for row in options.only:
        with tempfile.TemporaryDirectory() as folder:
            errors, seconds, spread = judged(row, options.data, Path(folder))
        runs = ROWS[row][1]
        told = f"{runs[0]}" if len(runs) == 1 else f"{runs[0]} to {runs[-1]}"
        for place, (k, ours, theirs) in enumerate(errors):
            spent = f"{seconds:.1f}" if place == 0 else ""
            print(f"{row:15}{told:>11}{k:>8}{ours:8.2f}{theirs:8.2f}{spent:>13}", flush=True)
        legs = ", ".join(f"{kind} {100 * part:.0f} %" for kind, part in spread.items())
        print(f"{'':15}armature of the four legs is off its mean by at most: {legs}", flush=True)


if __name__ == "__main__":
    main()

"""Encoder skew and stiffness of the KR300 from parts of its log, at half the rate, and with noise added.

python -m tests.system.measured.parts data/kr300_A.csv
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROBOT = "kr300"


def variants(header: list[str], table: NDArray[np.float64]) -> dict[str, tuple[list[str], NDArray[np.float64]]]:
    """Return what is done to the log: words -> (header, samples)."""
    n = len(table)
    still = [k for k, name in enumerate(header) if not name.startswith(("dq", "dtheta"))]
    generator = np.random.default_rng(0)
    noisy = table.copy()
    for k, name in enumerate(header):
        if name.startswith("taum"):
            noisy[:, k] += 0.01 * table[:, k].std() * generator.standard_normal(n)
        elif name.startswith(("q", "theta")):
            noisy[:, k] += 1e-5 * generator.standard_normal(n)
    return {
        "whole": (header, table),
        "without the velocity columns": ([header[k] for k in still], table[:, still]),
        "first half": (header, table[: n // 2]),
        "second half": (header, table[n // 2 :]),
        "middle 60 %": (header, table[n // 5 : n - n // 5]),
        "every other sample": (header, table[::2]),
        "1 % of torque noise, 10 µrad of position noise": (header, noisy),
    }


def line(words: str, path: Path) -> str:
    """Return one row of the table, from what the command prints."""
    command = [sys.executable, "-m", "elid_cli", "diagnose", str(path), "--robot", ROBOT, "--json"]
    found = json.loads(subprocess.run(command, capture_output=True, check=True, encoding="utf-8").stdout)
    skews = {e["joint"]: e["parameters"]["skew"] for e in found["effects"] if e["effect"] == "encoder_skew"}
    told = ", ".join(f"{1e3 * skews[joint]:.2f}" if joint in skews else "–" for joint in found["joints"][:3])
    base = {b["name"]: b for b in found["base_parameters"]}
    stiffness = [
        "not shown" if base[name]["estimate"] is None
        else f"{base[name]['estimate'] / 1e6:.1f} ± {base[name]['std_error'] / 1e6:.1f}"
        for name in ("K2", "K3")
    ]  # fmt: skip
    return f"| {words} | {told} | {' | '.join(stiffness)} |"


def main() -> None:
    """Print the table."""
    source = Path(sys.argv[1])
    header = source.read_text("utf-8").splitlines()[0].split(",")
    table = np.loadtxt(source, delimiter=",", skiprows=1)
    print("| log | skew, axes 1 to 3, ms | K2, 1e6 N·m/rad | K3 |")
    print("|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for words, (names, samples) in variants(header, table).items():
            path = Path(folder) / "part.csv"
            np.savetxt(path, samples, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
            print(line(words, path), flush=True)


if __name__ == "__main__":
    main()

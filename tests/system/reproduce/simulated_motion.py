"""Simulated positions of two published data sets: EMPS (one rail axis) and a KUKA KR300 (six axes).

    python -m tests.system.reproduce.simulated_motion [--data FOLDER]

EMPS is identified from its first record and simulated on both, by the recorded force (whole record; restarted) and
under its position controller, whose gains are found from the record itself: force = kp (reference - position) - kd
speed. The pulses of the second record are a known force. KR300: all axes taken as rigid, identified (--physical) from
the first six seconds, simulated over 150 samples (0.6 s) from measured states on the last four.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elid_cli.robot.files import shipped_robots

Array = NDArray[np.float64]
DATA = Path(__file__).parents[4] / "shared" / "data"
FORCE = 35.15065188
"""N/V of the EMPS."""
HORIZON, SPLIT = 0.6, 6.0
"""s: 150 samples of the KR300, and where its record is parted."""


def elid(*arguments: str) -> str:
    """Return what a command prints."""
    command = [sys.executable, "-m", "elid_cli", *arguments]
    done = subprocess.run(command, capture_output=True, check=False, encoding="utf-8")
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return done.stdout


def table(path: Path) -> dict[str, Array]:
    """Return the columns of a CSV file."""
    names = path.read_text("utf-8").split("\n", 1)[0].strip().split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def written(path: Path, columns: dict[str, Array]) -> str:
    """Write columns as a CSV log, and return its name."""
    np.savetxt(path, np.stack(list(columns.values()), axis=1), delimiter=",", header=",".join(columns), comments="",
               fmt="%.12g")  # fmt: skip
    return str(path)


def gains_of(log: dict[str, Array]) -> tuple[float, float]:
    """Return the controller's gains, N/m and N·s/m, by least squares on the smoothed record."""
    from scipy.signal import butter, filtfilt

    low = butter(4, 0.2)
    speed = np.gradient(log["q_meas_m"], log["t_s"])
    errors = np.stack([filtfilt(*low, log["q_ref_m"] - log["q_meas_m"]), filtfilt(*low, -speed)], axis=1)
    kp, kd = np.linalg.lstsq(errors, filtfilt(*low, FORCE * log["u_V"]), rcond=None)[0]
    return float(kp), float(kd)


def emps(data: Path, folder: Path) -> None:
    """Print the table of the EMPS."""
    first, second = table(data / "emps.csv"), table(data / "emps_pulses.csv")
    pulse = next(second[name] for name in second if name.startswith("pulse"))
    kp, kd = gains_of(first)
    robot = str(folder / "emps.yaml")
    plain = {"t": first["t_s"], "q.joint1": first["q_meas_m"], "tau.joint1": FORCE * first["u_V"]}
    elid("identify", written(folder / "first.csv", plain), "--robot", "emps", "--write-robot", robot)
    print(f"EMPS: mean absolute / rms error, mm (kp {kp:.4g} N/m, kd {kd:.4g} N·s/m)")
    print(f"{'':30}{'first record':>22}{'record with pulses':>22}")
    logs = {}
    for name, own, extra in (("first", first, 0.0 * first["t_s"]), ("second", second, pulse)):
        common = {"t": own["t_s"], "q.joint1": own["q_meas_m"]}
        force = written(folder / f"{name}_force.csv", {**common, "tau.joint1": FORCE * own["u_V"] + extra})
        held = written(folder / f"{name}_reference.csv", {**common, "q_des.joint1": own["q_ref_m"],
                                                          "tau_ff.joint1": extra})  # fmt: skip
        logs[name] = (force, held)
    ways = (
        ("the reference, its controller", 1, ("--kp", f"{kp}", "--kd", f"{kd}")),
        ("the force, whole record", 0, ("--horizon", "1000")),
        ("the force, restarted every s", 0, ("--horizon", "1")),
    )
    for words, which, options in ways:
        cells = []
        for name in ("first", "second"):
            told = json.loads(elid("replay", logs[name][which], "--robot", robot, *options, "--json"))
            error = told["error"]["joint1"]
            cells.append(f"{1e3 * error['mean_abs']:.3g} / {1e3 * error['rms']:.3g}")
        print(f"{words:30}{cells[0]:>22}{cells[1]:>22}", flush=True)


def kr300(data: Path, folder: Path) -> None:
    """Print the table of the KR300."""
    log = table(data / "kr300_A.csv")
    time = next(name for name in log if name.lower().startswith("t"))
    begin = log[time] - log[time][0] < SPLIT
    parts = [written(folder / f"{k}.csv", {n: v[use] for n, v in log.items()}) for k, use in enumerate((begin, ~begin))]
    robot, found = folder / "kr300_rigid.yaml", str(folder / "found.yaml")
    shipped = shipped_robots()["kr300"].read_text("utf-8")
    robot.write_text(shipped.replace("transmission: elastic", "transmission: rigid"), "utf-8")
    elid("identify", parts[0], "--robot", str(robot), "--physical", "--write-robot", found)
    told = json.loads(elid("replay", parts[1], "--robot", found, "--horizon", f"{HORIZON}", "--json"))
    print(f"\nKR300: {HORIZON:g} s from measured states; normalised: rms over the position's deviation")
    print(f"{'axis':6}{'mean absolute, mrad':>22}{'rms, mrad':>12}{'normalised':>12}")
    for k, error in enumerate(told["error"].values(), start=1):
        spread = float(np.std(log[f"theta{k}_rad"][~begin]))
        print(f"{k:<6}{1e3 * error['mean_abs']:22.2f}{1e3 * error['rms']:12.2f}{error['rms'] / spread:12.4f}")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        emps(options.data, Path(folder))
        kr300(options.data, Path(folder))


if __name__ == "__main__":
    main()

"""Every figure of speed and memory that elid claims, in one table.

    python -m tests.system.benchmarks.run [--minutes 60] [--mcap-minutes 60] [--messages 600000] [--only WORD]
                                          [--figaroh PYTHON]

CPU time (user and system) of medians that take turns, in fresh processes with one BLAS thread; memory is the peak of
the process. Ratios travel between machines, seconds do not.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib import util
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
KEPT = {"cpu": 16.7, "decimated": 6.1, "peak": 3000.0}
"""FIGAROH 1.0.2's pipeline where it is not installed, and with its decimation by 10, s and MB; see README.md …"""
BY_HAND = 3.4
"""… and the loop and lstsq by hand on the machine that it was measured on, s."""

OPTIONS = ("--robot", "puma560", "--json")
ROUNDS = 3


class Row(NamedTuple):
    """A line of the table."""

    what: str
    elid: str
    against: str
    ratio: str
    goal: str
    floor: str = ""


def off(what: str, floor: float, elid: float, unit: str = "s") -> str:
    """Say what nothing could be faster than, and how far elid is from it."""
    return f"{what} {floor:.2f} {unit}, {elid / max(floor, 1e-9):.1f}× off"


def fresh(*command: str) -> tuple[float, float, str]:
    """Run a command in a process of its own: CPU seconds, peak MB, what it printed."""
    code = (
        "import json, resource, subprocess, sys\n"
        "done = subprocess.run(sys.argv[1:], capture_output=True, text=True)\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "figures = [done.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]\n"
        "print(json.dumps([*figures, done.stdout, done.stderr]))"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    # a small process in between: the peak that the system reports of a child is at least its parent's at the fork
    out = subprocess.run(
        [sys.executable, "-c", code, *command], check=True, capture_output=True, text=True, env=environment
    )
    status, cpu, peak, printed, complaint = json.loads(out.stdout)
    if status:
        raise SystemExit(f"{' '.join(command)}: {complaint}")
    return cpu, peak, printed


def case(name: str, *arguments: str) -> dict[str, float]:
    """Run a case of cases.py in a fresh process; adds its peak memory."""
    _, peak, printed = fresh(sys.executable, __file__, "--case", name, *arguments)
    return {**json.loads(printed), "peak": peak}


def elid(*arguments: str) -> tuple[float, float]:
    """Run elid itself: CPU seconds and peak MB."""
    return fresh(sys.executable, "-m", "elid_cli", *arguments)[:2]


def regressors() -> Iterator[Row]:
    """Yield the regressor alone and with its reduction."""
    labels = {"puma": "PUMA 560", "seven": "7-joint arm", "random_arm": "random geometry"}
    for which, goal in (("puma", 7.0), ("seven", 5.5), ("random_arm", 4.0)):
        found = case("rigid_regressor", which)
        yield Row(f"rigid regressor, {labels[which]}", f"{found['elid']:.2f} µs/sample",
                  f"{found['pin']:.2f} µs, Pinocchio loop", f"{found['pin'] / found['elid']:.1f}×", f"≥ {goal:g}×",
                  off("writing it", found["floor"], found["elid"], "µs"))  # fmt: skip
    for which, goal in (("puma", 3.5), ("seven", 3.0)):
        found = case("elastic_reduction", which)
        yield Row(f"elastic regressor + reduction, {labels[which]}", f"{found['elid']:.2f} µs/sample",
                  f"{found['pin']:.2f} µs, the loop alone", f"{found['pin'] / found['elid']:.1f}×", f"≥ {goal:g}×",
                  off("filter and QR at GEMM speed", found["floor"], found["elid"], "µs"))  # fmt: skip
        yield Row("the same, every sample reduced", f"{found['full']:.2f} µs/sample",
                  f"{found['pin']:.2f} µs", f"{found['pin'] / found['full']:.1f}×", "")  # fmt: skip


class Figaroh(NamedTuple):
    """What FIGAROH takes for the log of `identify_arrays`: CPU seconds and MB."""

    words: str
    arrays: float
    peak: float
    whole: float
    """From file to answer, start of Python and imports included."""
    decimated: float
    """The same with its decimation by 10."""


def figaroh(folder: Path, python: str, hand: float) -> Figaroh:
    """Run FIGAROH by an interpreter that has it; without one, take what is kept here, scaled by the work by hand."""
    if not python:
        here = hand / BY_HAND
        whole, decimated = KEPT["cpu"] * here, KEPT["decimated"] * here
        return Figaroh("FIGAROH elsewhere, scaled by hand's", KEPT["cpu"] * here, KEPT["peak"], whole, decimated)
    from elid_cli.robot.urdf.write import urdf_text
    from tests.system.benchmarks import made

    robot, urdf, log = made.rigid(made.puma()), folder / "rigid.urdf", folder / "rigid.npz"
    urdf.write_text(urdf_text(robot))
    recording = made.recording(robot, 100.0)
    np.savez(log, t=recording.t, q=recording.q, tau=recording.tau)
    command = (python, str(HERE / "figaroh_run.py"), str(urdf), str(log))
    whole, peak, printed = fresh(*command)
    return Figaroh("FIGAROH", json.loads(printed)["cpu"], peak, whole, fresh(*command, "--decimate")[0])


def arrays(folder: Path, python: str) -> Iterator[Row]:
    """Yield identification from arrays, and from a file."""
    from elid_cli.robot.files import write_robot
    from tests.system.benchmarks import made

    found, hand = case("identify_arrays"), case("by_hand")["hand"]
    theirs = figaroh(folder, python, hand)
    yield Row("identify 100 k samples, 6 rigid joints, all checks on", f"{found['elid']:.2f} s",
              f"{theirs.arrays:.1f} s, {theirs.words}", f"{theirs.arrays / found['elid']:.0f}×", "≥ 80×",
              off("a copy of the signals, filter and QR at GEMM speed", found["floor"], found["elid"]))  # fmt: skip
    yield Row("the same at a given cut-off (--cutoff 10)", f"{found['given']:.2f} s", f"{theirs.arrays:.1f} s",
              f"{theirs.arrays / found['given']:.0f}×", "")  # fmt: skip
    yield Row("the same, all checks on, against work by hand", f"{found['elid']:.2f} s",
              f"{hand:.2f} s, loop and lstsq by hand", f"{hand / found['elid']:.1f}×", "")  # fmt: skip
    yield Row("its memory", f"{found['peak']:.0f} MB", f"{theirs.peak:.0f} MB",
              f"{theirs.peak / found['peak']:.0f}×", "≥ 10×")  # fmt: skip
    robot, log = folder / "rigid.yaml", folder / "rigid.h5"
    write_robot(made.rigid(made.puma()), robot)
    made.write_hdf5(made.rigid(made.puma()), log, 100.0)
    runs = sorted(elid("identify", str(log), "--robot", str(robot), "--json") for _ in range(4))
    yield Row("the same from a file, start of Python included", f"{runs[1][0]:.2f} s, {runs[1][1]:.0f} MB",
              f"{theirs.whole:.1f} s, {theirs.words}", f"{theirs.whole / runs[1][0]:.0f}×", "≥ 40×",
              f"{theirs.decimated / runs[1][0]:.0f}× with its decimation by 10")  # fmt: skip


def hours(folder: Path, minutes: float) -> Iterator[Row]:
    """Yield a long HDF5 log from file to answer."""
    from tests.system.benchmarks import made

    path, half = folder / "long.h5", folder / "half.h5"
    made.write_hdf5(made.puma(), path, 60 * minutes)
    made.write_hdf5(made.puma(), half, 30 * minutes)
    found = case("hdf5_arrays", str(path))
    yield Row("HDF5 to arrays", f"{found['elid']:.2f} s", f"{found['h5py']:.2f} s, h5py",
              f"{found['elid'] / found['h5py']:.2f}×", "≤ 1.5×",
              f"a copy in memory {found['floor']:.2f} s")  # fmt: skip
    tiny = folder / "tiny.h5"
    made.write_hdf5(made.puma(), tiny, 60.0)
    elid("identify", str(tiny), *OPTIONS)
    bases, runs = [], []
    for _ in range(ROUNDS):
        bases.append(case("read_and_filter", str(path)))
        runs.append([elid("identify", str(log), *OPTIONS) for log in (path, half, tiny)])
    whole, small, start = (median(several[k][0] for several in runs) for k in range(3))
    peak, smaller = (max(several[k][1] for several in runs) for k in (0, 1))
    base = {name: median(b[name] for b in bases) for name in ("filter", "floor")}
    ratio = median(several[0][0] / b["filter"] for several, b in zip(runs, bases, strict=True))
    yield Row(f"identify {minutes:g} min, HDF5, end to end", f"{whole:.1f} s",
              f"{base['filter']:.1f} s, read and filter", f"{ratio:.1f}×", "≤ 5×",
              off("reading and hashing it", base["floor"], whole))  # fmt: skip
    signals = path.stat().st_size / 1e6
    yield Row("its memory", f"{peak:.0f} MB", "", "", "≤ 600 MB", f"the signals {signals:.0f} MB")
    growth = median((a - c) / (b - c) for (a, _), (b, _), (c, _) in runs)
    yield Row("twice the log, time without start-up", f"{whole - start:.1f} s", f"{small - start:.1f} s",
              f"{growth:.2f}×", "1.7 to 2.3×", f"a log of one minute takes {start:.2f} s")  # fmt: skip
    yield Row("twice the log, memory", f"{peak:.0f} MB", f"{smaller:.0f} MB", f"+{peak - smaller:.0f} MB",
              f"≤ +{signals / 2:.0f} MB, its signals")  # fmt: skip


def mcap(folder: Path, minutes: float, messages: int) -> Iterator[Row]:
    """Yield the MCAP decoder, and a long log from file to answer."""
    from tests.system.benchmarks import made, mcap_reading

    path = folder / "messages.mcap"
    mcap_reading.generate(path, messages)
    found = {how: mcap_reading.measure(how, path) for how in mcap_reading.READERS}
    ours, theirs = found["elid"], found["mcap_ros2"]
    yield Row(f"MCAP, {messages} JointStates, to arrays", f"{ours['cpu']:.2f} s", f"{theirs['cpu']:.1f} s, mcap_ros2",
              f"{theirs['cpu'] / ours['cpu']:.0f}×", "≥ 30×",
              off("zstd alone", found["floor"]["cpu"], ours["cpu"]))  # fmt: skip
    yield Row("memory above the arrays", f"{max(ours['extra'] - ours['arrays'], 0.0):.0f} MB", "", "", "≤ 50 MB")
    path = folder / "long.mcap"
    made.write_other(made.puma(), path, 60 * minutes)
    bases, runs = [], []
    elid("--version")
    for _ in range(ROUNDS):
        bases.append(case("mcap_decode", str(path))["decode"])
        runs.append(elid("identify", str(path), *OPTIONS))
    whole, peak, base = median(cpu for cpu, _ in runs), max(high for _, high in runs), median(bases)
    ratio = median(cpu / alone for (cpu, _), alone in zip(runs, bases, strict=True))
    floor = mcap_reading.measure("floor", path)["cpu"]
    yield Row(f"identify {minutes:g} min, MCAP", f"{whole:.1f} s", f"{base:.1f} s, decoding alone",
              f"{ratio:.1f}×", "≤ 3×", off("zstd alone", floor, whole))  # fmt: skip
    yield Row("its memory", f"{peak:.0f} MB", "", "", "≤ 900 MB for an hour")


def tables(folder: Path, minutes: float) -> Iterator[Row]:
    """Yield CSV logs of seven joints: one of 105 MB, and a long one."""
    from tests.system.benchmarks import made

    long = f"CSV, {minutes:g} min of 7 joints at 1 kHz"
    sizes = (("CSV, 105 MB", 251.0, "≤ 0.6 s", "≤ 100 MB"), (long, 60 * minutes, "≤ 3×", ""))
    for label, seconds, most, room in sizes:
        path = folder / "table.csv"
        made.write_csv(made.seven(), path, seconds)
        found, memory = case("csv_reading", str(path)), case("csv_memory", str(path))
        size = path.stat().st_size / 1e6
        yield Row(f"{label}, read and checked", f"{found['elid']:.2f} s", f"{found['pandas']:.2f} s, pandas",
                  f"{found['elid'] / found['pandas']:.2f}×", most, f"{size:.0f} MB")  # fmt: skip
        beyond = memory["peak"] - memory["before"] - memory["arrays"]
        yield Row("its memory", f"{memory['peak']:.0f} MB", f"{memory['arrays']:.0f} MB, its arrays",
                  f"{beyond:+.0f} MB", room or "≤ 700 MB in all", f"{memory['before']:.0f} MB before it")  # fmt: skip


def short(folder: Path, count: int) -> Iterator[Row]:
    """Yield what each of many short logs takes that are identified in one call."""
    from tests.system.benchmarks import made

    place = folder / "short"
    place.mkdir()
    made.write_short_logs(place, count)
    found = case("short_logs", str(place))
    yield Row(f"identify {count} logs of 1 s, 2 joints, in one call", f"{found['each']:.1f} ms each", "", "",
              "≤ 20 ms", f"{found['peak']:.0f} MB")  # fmt: skip


def start_up(folder: Path) -> Iterator[Row]:
    """Yield what a short log takes, start of Python included."""
    from elid_cli.robot.files import write_robot
    from tests.system.benchmarks import made

    robot, path = made.planar3(), folder / "short.csv"
    write_robot(robot, folder / "planar3.yaml")
    made.write_other(robot, path, 24.0)
    runs = sorted(elid("identify", str(path), "--robot", str(folder / "planar3.yaml"), "--json")[0] for _ in range(5))
    yield Row("identify 24 s, 3 joints, CSV", f"{runs[2]:.2f} s", "", "", "≤ 3 s")
    tiny = folder / "tiny.h5"
    made.write_hdf5(robot, tiny, 2.0)
    elid("identify", str(tiny), "--robot", str(folder / "planar3.yaml"), "--json")
    runs = sorted(elid("identify", str(tiny), "--robot", str(folder / "planar3.yaml"), "--json")[0] for _ in range(5))
    yield Row("identify 2 s of the same, HDF5: start-up", f"{runs[2]:.2f} s", "", "", "≤ 0.4 s")
    runs = sorted(elid("--version")[0] for _ in range(5))
    yield Row("elid --version", f"{1e3 * runs[2]:.0f} ms", "", "", "")


def waiting(folder: Path) -> Iterator[Row]:
    """Yield what users wait for: a simulation, plain and compiled, diagnoses, and many joints."""
    from elid_cli.robot.files import write_robot
    from tests.system.benchmarks import made

    seconds = 20.0
    found = case("simulate", str(seconds))
    yield Row(f"simulate {seconds:g} s of PUMA 560, plain Python", f"{found['plain']:.1f} s",
              f"{seconds:g} s, real time", f"{seconds / found['plain']:.1f}×", "≥ 4×")  # fmt: skip
    yield Row("the same compiled (Numba)", f"{found['compiled']:.1f} s", f"{found['plain']:.1f} s, plain",
              f"{found['plain'] / found['compiled']:.1f}×", "≥ 2.5×",
              f"{seconds / found['compiled']:.0f}× real time")  # fmt: skip
    for name, robot, goal in made_and_shipped(folder):
        cpu, peak = elid("diagnose", str(name), "--robot", robot, "--json")
        yield Row(f"diagnose {name.name}", f"{cpu:.1f} s, {peak:.0f} MB", "", "", f"≤ {goal:g} s, 400 MB")
    chain = folder / "chain40.yaml"
    write_robot(made.chain(40), chain)
    cpu, peak = elid("classify", "--robot", str(chain), "--json")
    yield Row("classify 40 rigid joints", f"{cpu:.2f} s, {peak:.0f} MB", "", "", "≤ 1 s, 200 MB")
    found = case("excite", "20")
    yield Row("excite 10 s of 20 rigid joints", f"{found['elid']:.1f} s, {found['peak']:.0f} MB", "", "", "")


def made_and_shipped(folder: Path) -> Iterator[tuple[Path, str, float]]:
    """Yield logs to diagnose with their robots and goals: shipped, measured where the data are, and a made one."""
    from elid_cli.robot.files import write_robot
    from tests.system.benchmarks import made

    root = Path(__file__).parents[3]
    yield root / "sample_logs/puma560_load.mcap", "puma560", 6.0
    yield root / "sample_logs/planar2_stribeck.h5", "planar2", 4.0
    measured = Path(os.environ.get("ELID_DATA", root.parent / "shared/data"))
    if (measured / "panda_a.csv.gz").exists():
        yield measured / "panda_a.csv.gz", str(measured / "panda.yaml"), 12.0
    robot, log = folder / "wrist.yaml", folder / "coupled_wrist_5khz.h5"
    write_robot(made.coupled_wrist(), robot)
    effects = ("velocity_coupling@joint5:viscous=0.5,coulomb=0.6,other=6",
               "velocity_coupling@joint6:viscous=0.3,coulomb=0.3,other=5")  # fmt: skip
    asked = [word for effect in effects for word in ("--effect", effect)]
    elid("simulate", "--robot", str(robot), *asked, "--rate", "5000", "--duration", "9", "--torque-noise", "1%",
         "--counts", "1000000", "-o", str(log))  # fmt: skip
    yield log, str(robot), 15.0


def growing() -> Iterator[Row]:
    """Yield how the work grows with joints, samples and candidates."""
    from tests.system.benchmarks.growth import exponent

    for name, label, sizes, goal in (
        ("classify", "classify, rigid chains, joints", ("10", "20", "40"), "≤ 2"),
        ("identify_joints", "identify 20 s, rigid chains, joints", ("3", "6", "12"), "≤ 1.5"),
        ("identify_samples", "identify, 6 rigid joints, seconds at 1 kHz", ("50", "100", "200"), "≤ 1.1"),
        ("diagnose_joints", "diagnose 8 s at 500 Hz, rigid chains, joints", ("2", "4", "8"), "≤ 2"),
        ("diagnose_candidates", "diagnose the same, 4 joints, candidates", ("4", "8", "16"), "≤ 1.1"),
    ):
        found = case(name, *sizes)
        peak = found.pop("peak")
        power = exponent([float(size) for size in found], list(found.values()))
        yield Row(f"growth of {label} {', '.join(found)}", ", ".join(f"{value:.2f}" for value in found.values()) + " s",
                  "", f"exponent {power:.2f}", goal, f"{peak:.0f} MB")  # fmt: skip


def main() -> None:
    """Print the table."""
    if sys.argv[1:2] == ["--case"]:
        from tests.system.benchmarks import cases

        print(json.dumps(cases.CASES[sys.argv[2]](*sys.argv[3:])))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--mcap-minutes", type=float, default=60.0)
    parser.add_argument("--messages", type=int, default=600_000)
    parser.add_argument("--short-logs", type=int, default=2000)
    words = "regressors, arrays, start, waiting, growth, hours, csv, short or mcap"
    parser.add_argument("--only", default="", help=words)
    own = sys.executable if util.find_spec("figaroh") else ""
    parser.add_argument("--figaroh", default=own, metavar="PYTHON", help="an interpreter that has FIGAROH 1.0.2")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # an installed program finds its modules compiled
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
        groups = {
            "regressors": regressors,
            "arrays": lambda: arrays(folder, chosen.figaroh),
            "start": lambda: start_up(folder),
            "waiting": lambda: waiting(folder),
            "growth": growing,
            "hours": lambda: hours(folder, chosen.minutes),
            "csv": lambda: tables(folder, chosen.minutes),
            "short": lambda: short(folder, chosen.short_logs),
            "mcap": lambda: mcap(folder, chosen.mcap_minutes, chosen.messages),
        }
        print("| what | elid | against | ratio | goal | floor |\n|---|---|---|---|---|---|", flush=True)
        for group, rows in groups.items():
            if chosen.only in group:
                for row in rows():
                    print("|", " | ".join(row), "|", flush=True)


if __name__ == "__main__":
    main()

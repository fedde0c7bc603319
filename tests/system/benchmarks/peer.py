"""MuJoCo's system identification toolbox beside elid: the same log, the same processor, the same judge.

    python -m tests.system.benchmarks.peer [--fitted 0] [--judged 3 4] [--intervals] [--data FOLDER]

Armature, damping, friction loss and a torque offset of the Go2's twelve joints, fitted to the same runs by
`mujoco.sysid` and by `elid identify --fit trajectory`, each in a process of its own. Both results, as a patched go2.xml
with a file of offsets, are replayed by MuJoCo on runs that neither saw, under commands that are held for their sample.
`--intervals`: how many 95 % intervals from the fitted run hold what the same program finds in each judged run, too.

The toolbox is the extra ``peers``. It is given what helps it: commands on its own grid of 1 ms, which it would draw as
lines between samples, and positions of the state itself, not of a sensor that is one step old.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.system.benchmarks.run import fresh

DATA = Path(__file__).parents[4] / "shared" / "data"
STEP = 1e-3
"""s; MuJoCo's step, of the peer's fit and of the judge."""
KINDS = {"armature": (0.01, 1e-3, 0.2), "damping": (0.1, 0.0, 2.0), "frictionloss": (0.2, 0.0, 3.0),
         "offset": (0.0, -3.0, 3.0)}  # fmt: skip
"""Where the peer starts, and its bounds: nominal values of such drives."""
OURS = {"armature": "Ja", "damping": "fv", "frictionloss": "fs", "offset": "offset"}
REASON = "the toolbox is not installed: pip install -e '.[peers]'"


def toolbox() -> Any:
    """Return the peer, or leave with a word where it is missing."""
    try:
        from mujoco import sysid
    except ImportError:
        raise SystemExit(REASON) from None
    if not hasattr(sysid, "optimize"):  # the package hides what it misses itself
        raise SystemExit(REASON)
    return sysid


def log_of(data: Path, run: int) -> dict[str, Any]:
    """Return time, positions, commands and gains of a run."""
    import h5py

    with h5py.File(data / f"go2_{run}.h5") as file:
        told: dict[str, Any] = {key: file[key][:] for key in ("t", "q", "q_des")}
        told |= {"kp": file.attrs["kp"], "kd": file.attrs["kd"], "names": list(map(str, file.attrs["joint_names"]))}
    told["t"] = told["t"] - told["t"][0]
    return told


def fitted_by_peer(data: Path, runs: Sequence[int]) -> dict[str, Any]:
    """Return the peer's estimates and half widths of its 95 % intervals, {kind: {joint: (value, half width)}}."""
    sysid, logs = toolbox(), [log_of(data, run) for run in runs]
    spec = _spec(data / "go2.xml", logs[0])
    model, places = spec.compile(), logs[0]["names"]
    parameters = _parameters(sysid, places)
    start, control, seen = [], [], []
    for log in logs:
        told = sysid.TimeSeries.from_control_names(log["t"], log["q_des"], model)
        fine = np.arange(int(log["t"][-1] / STEP)) * STEP
        values = told.interpolate(fine, "zoh")
        fine[-1] -= 1e-9  # its resampling adds a step otherwise
        control.append(sysid.TimeSeries(fine, values, told.signal_mapping))
        start.append(sysid.create_initial_state(model, log["q"][0], np.zeros(len(places))))
        seen.append(sysid.TimeSeries.from_names(log["t"], log["q"], model,
                                                [(name, sysid.SignalType.MjStateQPos) for name in places]))  # fmt: skip
    sequences = sysid.ModelSequences("go2", spec, [f"run {run}" for run in runs], start, control, seen)
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)
    found, done = sysid.optimize(parameters, residual, verbose=False)
    left, _, _ = residual(done.x, found)
    _, half = sysid.calculate_intervals(left, np.asarray(done.jac))
    table = np.stack([np.ravel(done.x), half], axis=1).reshape(len(KINDS), len(places), 2)
    table[list(KINDS).index("offset"), :, 0] *= -1  # elid's offset is what the drives lack
    return {kind: dict(zip(places, rows, strict=True)) for kind, rows in zip(KINDS, table.tolist(), strict=True)}


def _spec(path: Path, log: dict[str, Any]) -> Any:
    """Return the robot with its base held and drives with the log's gains, cut at the file's limits."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    model = spec.compile()
    limit = {model.joint(model.actuator_trnid[k, 0]).name: model.actuator_ctrlrange[k] for k in range(model.nu)}
    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    for item in (*free, *spec.actuators, *spec.keys, *spec.sensors):
        spec.delete(item)
    spec.option.timestep = STEP
    for name, kp, kd in zip(log["names"], log["kp"], log["kd"], strict=True):
        drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.set_to_position(kp=kp, kv=kd)
        drive.forcelimited, drive.forcerange, drive.ctrllimited = True, limit[name], False
        # as many sensors as positions are compared; the positions themselves are the state's
        spec.add_sensor(
            name=f"{name}_pos", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name
        )
    return spec


def _parameters(sysid: Any, places: Sequence[str]) -> Any:
    """Return the peer's unknowns: what each does to the model."""
    made = sysid.ParameterDict()
    for kind, (value, low, high) in KINDS.items():
        for name in places:

            def change(spec: Any, told: Any, kind: str = kind, name: str = name) -> None:
                if kind == "offset":
                    spec.actuator(name).biasprm[0] = told.value[0]
                elif kind == "damping":
                    spec.joint(name).damping[0] = told.value[0]
                else:
                    setattr(spec.joint(name), kind, told.value[0])

            made.add(sysid.Parameter(f"{name}_{kind}", value, low, high, modifier=change))
    return made


def fitted_by_elid(data: Path, runs: Sequence[int], folder: Path) -> tuple[dict[str, Any], float]:
    """Return elid's estimates and half widths, and processor seconds; its files are written to the folder."""
    logs = [str(data / f"go2_{run}.h5") for run in runs]
    robot, beside = str(folder / "go2.xml"), str(folder / "actuators.json")
    seconds, _, printed = fresh(
        sys.executable, "-m", "elid_cli", "identify", *logs, "--robot", str(data / "go2.xml"), "--fit", "trajectory",
        "--write-robot", robot, "--write-actuators", beside, "--json",
    )  # fmt: skip
    joints = json.loads(printed)["settings"]["trajectory"]["joint_parameters"]
    wide = "another_recording" if len(runs) == 1 else "std_error"
    return {
        kind: {joint: (own[name]["estimate"], 1.96 * own[name][wide]) for joint, own in joints.items()}
        for kind, name in OURS.items()
    }, seconds


def write_peer(data: Path, found: dict[str, Any], folder: Path) -> None:
    """Write the peer's result as elid's is written: a patched MJCF and a file of offsets."""
    tree = ET.parse(data / "go2.xml")
    for joint in tree.iter("joint"):
        if joint.get("name") in found["armature"]:
            for kind in ("armature", "damping", "frictionloss"):
                joint.set(kind, repr(found[kind][joint.get("name")][0]))
    tree.write(folder / "go2.xml", encoding="unicode")
    offsets = {joint: value for joint, (value, _) in found["offset"].items()}
    (folder / "actuators.json").write_text(json.dumps({"actuators": {"offset": offsets}, "effects": []}), "utf-8")


def judged(data: Path, run: int, folder: Path) -> float:
    """Return MuJoCo's mean absolute error of positions on a run, mrad."""
    _, _, printed = fresh(
        sys.executable, "-m", "elid_cli", "replay", str(data / f"go2_{run}.h5"), "--robot", str(folder / "go2.xml"),
        "--actuators", str(folder / "actuators.json"), "--engine", "mujoco", "--json",
    )  # fmt: skip
    return 1e3 * float(json.loads(printed)["mean_abs"])


def held(from_one: dict[str, Any], of_another: dict[str, Any]) -> float:
    """Return the share of intervals that hold what another run gives."""
    inside = [
        abs(of_another[kind][joint][0] - value) < half
        for kind, own in from_one.items() for joint, (value, half) in own.items()
    ]  # fmt: skip
    return float(np.mean(inside))


def peer_in_own_process(data: Path, runs: Sequence[int]) -> tuple[dict[str, Any], float]:
    """Return the peer's result and the processor seconds of its process."""
    seconds, _, printed = fresh(sys.executable, "-m", "tests.system.benchmarks.peer", "--as-peer", "--data", str(data),
                                "--fitted", *map(str, runs))  # fmt: skip
    return json.loads(printed.splitlines()[-1]), seconds


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fitted", nargs="+", type=int, default=[0], help="runs that are fitted")
    parser.add_argument("--judged", nargs="+", type=int, default=[3, 4], help="runs that judge")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--intervals", action="store_true", help="fit the judged runs as well, for the last column")
    parser.add_argument("--as-peer", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.as_peer:
        print(json.dumps(fitted_by_peer(options.data, options.fitted)))
        return
    toolbox()
    runs = "".join(f"{f'run {run}, mrad':>13}" for run in options.judged)
    print(f"{'':22}{'processor s':>12}{runs}" + f"{'95 % hold':>12}" * options.intervals)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        seconds, errors = {}, {}
        for name in ("elid", "mujoco.sysid"):
            ours = name == "elid"

            def fit(runs: Sequence[int], ours: bool = ours) -> tuple[dict[str, Any], float]:
                if ours:
                    return fitted_by_elid(options.data, runs, folder)
                return peer_in_own_process(options.data, runs)

            others = [fit([run])[0] for run in options.judged] if options.intervals else []
            found, seconds[name] = fit(options.fitted)
            if not ours:
                write_peer(options.data, found, folder)
            errors[name] = [judged(options.data, run, folder) for run in options.judged]
            told = f"{100 * np.mean([held(found, other) for other in others]):10.0f} %" if others else ""
            print(f"{name:22}{seconds[name]:12.1f}" + "".join(f"{e:13.2f}" for e in errors[name]) + f"{told:>12}",
                  flush=True)  # fmt: skip
    parts = [theirs / ours for ours, theirs in zip(errors["elid"], errors["mujoco.sysid"], strict=True)]
    print(f"{'mujoco.sysid over elid':22}{seconds['mujoco.sysid'] / seconds['elid']:12.1f}"
          + "".join(f"{part:13.2f}" for part in parts))  # fmt: skip


if __name__ == "__main__":
    main()

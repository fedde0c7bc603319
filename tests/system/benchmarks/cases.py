"""What is measured: each case runs in a fresh process and returns CPU seconds of its parts, taken in turn."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.system.benchmarks import growth

SAMPLES = 100_000
ROUNDS = 5


def in_turn(parts: dict[str, Callable[[], object]], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the median CPU seconds of each part; the parts take turns, so that all see the same machine."""
    times: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(rounds):
        for name, part in parts.items():
            begin = time.process_time()
            part()
            times[name].append(time.process_time() - begin)
    return {name: float(np.median(found)) for name, found in times.items()}


def pin_loop(robot, samples: int) -> Callable[[], np.ndarray]:  # type: ignore[no-untyped-def]
    """Return Pinocchio's joint torque regressor in a Python loop into one array, for the robot's geometry."""
    import pinocchio as pin

    model = pin.Model()
    parent, place = 0, pin.SE3.Identity()
    for k, (before, after) in enumerate(robot.placements()):
        parent = model.addJoint(parent, pin.JointModelRZ(), place * pin.SE3(before[:3, :3], before[:3, 3]), f"j{k}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        place = pin.SE3(after[:3, :3], after[:3, 3])
    data, n = model.createData(), robot.n
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, samples, n))
    table = np.empty((samples * n, 10 * n))
    regressor = pin.computeJointTorqueRegressor

    def loop() -> np.ndarray:
        for k in range(samples):
            table[k * n : k * n + n] = regressor(model, data, q[k], v[k], a[k])
        return table

    return loop


def rigid_regressor(which: str) -> dict[str, float]:
    """µs per sample of the rigid-body regressor in blocks, against the loop."""
    from elid_cli.model import tracing as trace
    from elid_cli.model.regressor import Regressor, inputs_of
    from elid_cli.model.terms.rigid_body import RigidBody
    from elid_cli.signals.motion import random_motion
    from tests.system.benchmarks import made

    robot = getattr(made, which)()
    program = Regressor(made.rigid(robot), (RigidBody(),)).estimation.program
    motion = random_motion(robot.n, np.zeros(robot.n, dtype=bool), SAMPLES)
    out, inputs = np.empty((program.outputs, trace.BLOCK)), np.empty((program.inputs, trace.BLOCK))

    def blocks() -> None:
        for start in range(0, SAMPLES, trace.BLOCK):
            part = motion[start : start + trace.BLOCK]
            here = slice(part.samples)
            program.run(inputs_of(part, program, inputs[:, here]), out[:, here])

    def writing() -> None:
        for _ in range(0, SAMPLES, trace.BLOCK):
            out.fill(0.0)

    loop = SAMPLES // 5
    found = in_turn({"pin": pin_loop(robot, loop), "elid": blocks, "floor": writing})
    return {"pin": found["pin"] / loop * 1e6, "elid": found["elid"] / SAMPLES * 1e6,
            "floor": found["floor"] / SAMPLES * 1e6}  # fmt: skip


def elastic_reduction(which: str) -> dict[str, float]:
    """µs per sample of the full elastic regressor (2n rows), filtered, decimated and reduced as identify does it.

    Also the same without filter and decimation, every sample reduced, and the bare loop.
    """
    from elid_cli.estimation.regression.filtered_rows import CHUNK
    from elid_cli.estimation.streaming.accumulate import GrowingTriangle
    from elid_cli.model.regressor import Regressor, inputs_of
    from elid_cli.signals.lowpass import low_pass
    from elid_cli.signals.motion import random_motion
    from tests.system.benchmarks import made

    robot = getattr(made, which)()
    plan = Regressor(robot).estimation
    program, place = plan.program.distinct
    motion = random_motion(robot.n, np.ones(robot.n, dtype=bool), SAMPLES)
    out, inputs = np.empty((program.outputs, CHUNK)), np.empty((program.inputs, CHUNK))
    filter_ = low_pass(10.0, 1e-3, 20)

    def reduced(decimated: bool) -> None:
        triangles = {item.row: GrowingTriangle(len(item.columns)) for item in plan.rows}
        for start in range(0, SAMPLES, out.shape[1]):
            part = motion[start : start + out.shape[1]]
            rows = out[:, : part.samples]
            program.run(inputs_of(part, program, inputs[:, : part.samples]), rows)
            rows = filter_.apply(rows) if decimated else rows
            for item in plan.rows:
                triangles[item.row].add(rows.take(place[item.slots], axis=0))
        for triangle in triangles.values():
            triangle.factor()

    flops = sum(2.0 * len(item.columns) ** 2 for item in plan.rows) / filter_.step
    flops += 2.0 * plan.program.outputs * len(filter_.taps) / filter_.step
    matrix = np.random.default_rng(0).random((1000, 1000))
    loop = SAMPLES // 5
    parts = {"pin": pin_loop(robot, loop), "elid": lambda: reduced(True), "full": lambda: reduced(False),
             "gemm": lambda: matrix @ matrix}  # fmt: skip
    found = in_turn(parts)
    speed = 2 * 1000**3 / found["gemm"]
    return {"pin": found["pin"] / loop * 1e6, "elid": found["elid"] / SAMPLES * 1e6,
            "full": found["full"] / SAMPLES * 1e6, "floor": flops / speed * 1e6}  # fmt: skip


def identify_arrays() -> dict[str, float]:
    """CPU seconds of identify on arrays with all its checks, rigid model, 100 k samples of six joints.

    Freed memory is kept, as the command keeps it.
    """
    from elid_cli.estimation.identify import identify
    from elid_cli.memory import keep_freed_memory
    from elid_cli.model.regressor import Regressor
    from elid_cli.signals.options import SignalOptions
    from elid_cli.signals.signals import prepare
    from tests.system.benchmarks import made

    robot = made.rigid(made.puma())
    recording = made.recording(robot, SAMPLES / 1000)

    def whole(cutoff: float | None = None) -> None:
        identify(robot, prepare(recording, robot, SignalOptions(cutoff=cutoff)))

    keep_freed_memory()
    whole()
    prepared = prepare(recording, robot)
    plan, filter_ = Regressor(robot).estimation, prepared.filter
    matrix = np.random.default_rng(0).random((1000, 1000))
    signals = (recording.t, recording.q, recording.theta, recording.tau)
    parts = {
        "elid": whole,
        "given": lambda: whole(10.0),
        "copy": lambda: [a.copy() for a in signals],
        "gemm": lambda: matrix @ matrix,
    }
    found = in_turn(parts)
    # what has to pass the filter at the log's rate, and the triangles of what comes out
    flops = 2.0 * 4 * robot.n * len(filter_.taps) * SAMPLES / filter_.step
    flops += sum(2.0 * len(item.columns) ** 2 for item in plan.rows) * SAMPLES / filter_.step
    return {
        "elid": found["elid"],
        "given": found["given"],
        "floor": found["copy"] + flops * found["gemm"] / (2 * 1000**3),
    }


def by_hand() -> dict[str, float]:
    """CPU seconds of what one writes without a tool: Pinocchio's loop, rotor and friction columns, numpy's lstsq.

    The same number of samples and joints as `identify_arrays`; nothing is filtered, judged or checked.
    """
    from tests.system.benchmarks import made

    robot = made.rigid(made.puma())
    loop = pin_loop(robot, SAMPLES)
    n = robot.n
    dq, ddq = np.random.default_rng(1).uniform(-1, 1, (2, SAMPLES, n))
    tau = np.random.default_rng(2).uniform(-1, 1, SAMPLES * n)

    def solved() -> None:
        bodies = loop()
        drives = np.zeros((SAMPLES, n, 3, n))
        for k in range(n):
            drives[:, k, :, k] = np.stack([ddq[:, k], np.sign(dq[:, k]), dq[:, k]], axis=1)
        np.linalg.lstsq(np.hstack([bodies, drives.reshape(SAMPLES * n, 3 * n)]), tau, rcond=None)

    return in_turn({"hand": solved}, 3)


def hdf5_arrays(path: str) -> dict[str, float]:
    """CPU seconds of an HDF5 log to arrays that have been looked at, against h5py's whole read."""
    import h5py

    from elid_cli.logs.contract import Pick
    from elid_cli.logs.formats.hdf5 import FORMAT
    from elid_cli.logs.source import open_source
    from tests.system.benchmarks import made

    names = made.puma().joint_names
    SIGNALS = ("q", "theta", "tau")

    def plain() -> None:
        with h5py.File(path) as file:
            arrays = [file[name][()] for name in ("t", *SIGNALS)]
            sum(a.sum() for a in arrays)

    def ours() -> None:
        log = FORMAT.open(open_source(Path(path)))[0]
        streams = log.load([Pick(f"/{name}", "", names, time="/t") for name in SIGNALS])
        sum(stream.values.sum() for stream in streams)

    with h5py.File(path) as file:
        arrays = [file[name][()] for name in ("t", *SIGNALS)]
    return in_turn({"h5py": plain, "elid": ours, "floor": lambda: [a.copy() for a in arrays]}, 3)


def csv_reading(path: str) -> dict[str, float]:
    """CPU seconds of a CSV log read and checked, against pandas' plain read of it."""
    import pandas
    import pyarrow.csv  # noqa: F401  # started, as pandas is

    from elid_cli.logs import read_recording
    from tests.system.benchmarks import made

    robot = made.seven()
    read_recording([path], robot)
    return in_turn({"pandas": lambda: pandas.read_csv(path), "elid": lambda: read_recording([path], robot)}, 3)


def csv_memory(path: str) -> dict[str, float]:
    """MB of the process before a CSV log is read, and of its arrays."""
    import resource

    import pyarrow.csv  # noqa: F401

    from elid_cli.logs import read_recording
    from tests.system.benchmarks import made

    robot = made.seven()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found = read_recording([path], robot)
    arrays = (found.t, found.q, found.theta, found.tau)
    return {"before": before, "arrays": sum(array.nbytes for array in arrays) / 1e6}


def short_logs(folder: str) -> dict[str, float]:
    """CPU ms of each of many short logs that are identified in one call."""
    from elid_cli import LogRequest, identify_logs
    from elid_cli.robot.files import read_robot

    logs, robot = sorted(map(str, Path(folder).iterdir())), read_robot("planar2")
    identify_logs(LogRequest(tuple(logs[:2]), robot))
    found = in_turn({"elid": lambda: identify_logs(LogRequest(tuple(logs), robot))}, 1)
    return {"each": 1e3 * found["elid"] / len(logs)}


def read_and_filter(path: str) -> dict[str, float]:
    """CPU seconds of reading an HDF5 log and filtering its channels, and nothing else."""
    import h5py
    from scipy.signal import butter, sosfiltfilt

    sections = butter(4, 20.0, fs=1000.0, output="sos")

    def both() -> None:
        with h5py.File(path) as file:
            for name in ("q", "theta", "tau"):
                values = file[name][()]
                for start in range(0, len(values), 200_000):
                    # blocks with overlap, equal to the whole to 1e-12
                    sosfiltfilt(sections, values[max(start - 700, 0) : start + 200_700], axis=0)

    def floor() -> None:
        with h5py.File(path) as file:
            for name in ("q", "theta", "tau"):
                file[name][()]
        with Path(path).open("rb") as stream:
            hashlib.file_digest(stream, "sha256")

    return in_turn({"filter": both, "floor": floor}, 1)  # again and again, in turn with elid


def mcap_decode(path: str) -> dict[str, float]:
    """CPU seconds of the bulk decoder alone."""
    from elid_cli.logs.contract import Pick
    from elid_cli.logs.formats.mcap import CANONICAL, McapLog
    from elid_cli.logs.source import open_source
    from tests.system.benchmarks import made

    names = made.puma().joint_names

    def decode() -> None:
        source = open_source(Path(path))
        picks = [Pick(s["from"], s["field"], names) for k, s in CANONICAL.items() if k in ("q", "theta", "tau")]
        McapLog(source.name, [source]).load(picks)

    return in_turn({"decode": decode}, 1)


def simulate(seconds: str) -> dict[str, float]:
    """CPU seconds of simulating PUMA 560, in plain Python and compiled, as a second call finds it."""
    from elid_cli.experiment.simulation import SimulationOptions, kernel, run
    from elid_cli.robot.files import read_robot

    robot, options = read_robot("puma560"), SimulationOptions(duration=float(seconds), seed=2)
    found = {}
    for name, worth in (("plain", 10**12), ("first", 0), ("compiled", 0)):
        kernel.WORTH = worth
        found |= in_turn({name: lambda: run(robot, options)}, 1)
    return found


def excite(joints: str) -> dict[str, float]:
    """CPU seconds of looking for an exciting trajectory of 10 s for a chain of rigid joints."""
    from elid_cli.experiment.excitation import ExciteOptions
    from elid_cli.experiment.excitation import excite as search
    from elid_cli.memory import keep_freed_memory
    from tests.system.benchmarks import made

    keep_freed_memory()
    robot = made.chain(int(joints))
    return in_turn({"elid": lambda: search(robot, ExciteOptions(duration=10.0))}, 1)


CASES: dict[str, Callable[..., dict[str, float]]] = {
    f.__name__: f
    for f in (
        rigid_regressor,
        elastic_reduction,
        identify_arrays,
        by_hand,
        hdf5_arrays,
        csv_reading,
        csv_memory,
        short_logs,
        read_and_filter,
        mcap_decode,
        simulate,
        excite,
        growth.classify,
        growth.identify_joints,
        growth.identify_samples,
        growth.diagnose_joints,
        growth.diagnose_candidates,
    )
}

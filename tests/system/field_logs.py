"""One small recording as thirty-two tools write it: bags, exports of other languages, arrays, tables of all shapes.

Every writer takes a folder and a `Recording` of joints ``joint1``, ``joint2`` (q, dq, tau; 250 Hz) and returns the log.
"""

from __future__ import annotations

import gzip
import json
import sqlite3
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from elid_cli.logs.mcap.write import joint_state_schema
from elid_cli.signals.recording import Recording
from tests.logs.mcap_made import DYNAMIC, Bag, encoder, joint_state

EPOCH = 1_700_000_000
NAMES = ("joint1", "joint2")
KIND = "sensor_msgs/msg/JointState"
Columns = Mapping[str, np.ndarray]


def text(
    path: Path, columns: Columns, separator: str = ",", *, comma: bool = False, head: Sequence[str] = (),
    named: bool = True, end: str = "", encoding: str = "utf-8", form: str = ".9g",
) -> Path:  # fmt: skip
    """Write columns as a table of text, after lines of `head`."""
    rows = [separator.join(format(x, form) for x in row) for row in np.column_stack(list(columns.values())).tolist()]
    body = [row.replace(".", ",") if comma else row for row in rows]
    lines = [*head, *([separator.join(columns)] if named else []), *body]
    path.write_text("".join(f"{line}{end}\n" for line in lines), encoding)
    return path


def each(pattern: str, values: np.ndarray, first: int = 1) -> dict[str, np.ndarray]:
    """Return the columns of a signal, named by the joints' numbers or names."""
    return {pattern.format(k + first, j=NAMES[k]): column for k, column in enumerate(values.T)}


def stamps(log: Recording) -> list[int]:
    return [EPOCH * 10**9 + round(t * 1e9) for t in log.t.tolist()]


def states(log: Recording) -> list[dict[str, Any]]:
    """Return joint states as a driver publishes them: joints in its own order, a gripper among them."""
    names = ["gripper", "joint2", "joint1"]
    return [
        joint_state(stamp, names, [0.02, *q[::-1]], [0.0, *dq[::-1]], [1.5, *tau[::-1]])
        for stamp, q, dq, tau in zip(stamps(log), log.q, _rates(log), log.tau, strict=True)
    ]


def _rates(log: Recording) -> np.ndarray:
    assert log.dq is not None
    return log.dq


def bag_folder(folder: Path, storage: str) -> Path:
    """Return the folder of `ros2 bag record`, with the metadata that it writes."""
    place = folder / "run"
    place.mkdir()
    suffix = {"sqlite3": "db3", "mcap": "mcap"}[storage]
    (place / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 8\n  storage_identifier: {storage}\n"
        f"  relative_file_paths:\n    - run_0.{suffix}\n"
    )
    return place


def rosbag_sqlite(folder: Path, log: Recording) -> Path:
    place, encode = bag_folder(folder, "sqlite3"), encoder(KIND, joint_state_schema().decode())
    with sqlite3.connect(place / "run_0.db3") as base:
        base.execute("CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL)")
        base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        base.execute("INSERT INTO topics VALUES(1, '/joint_states', ?, 'cdr')", (KIND,))
        rows = [(1, stamp + 200_000, encode(m)) for stamp, m in zip(stamps(log), states(log), strict=True)]
        base.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)
    base.close()
    return place


def mcap(log: Recording, topic: str = "/joint_states") -> bytes:
    bag = Bag()
    bag.topic(topic)
    for stamp, message in zip(stamps(log), states(log), strict=True):
        bag.add(topic, stamp + 200_000, message)
    return bag.bytes()


def rosbag_mcap(folder: Path, log: Recording) -> Path:
    place = bag_folder(folder, "mcap")
    (place / "run_0.mcap").write_bytes(mcap(log))
    return place


def other_topic(folder: Path, log: Recording) -> Path:
    (path := folder / "log.mcap").write_bytes(mcap(log, "/arm/measured/states"))
    return path


def dynamic_state(folder: Path, log: Recording) -> Path:
    """Write ros2_control's states, interfaces by name."""
    bag, topic = Bag(), "/dynamic_joint_states"
    bag.topic(topic, "control_msgs/msg/DynamicJointState", DYNAMIC)
    for stamp, q, tau in zip(stamps(log), log.q, log.tau, strict=True):
        head = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
        values = [{"interface_names": ["position", "effort"], "values": [a, b]} for a, b in zip(q, tau, strict=True)]
        bag.add(topic, stamp, {"header": head, "joint_names": list(NAMES), "interface_values": values})
    (path := folder / "log.mcap").write_bytes(bag.bytes())
    return path


def plotjuggler(folder: Path, log: Recording, indexed: bool = False) -> Path:
    names = ("/joint_states/{j}/position", "/joint_states/{j}/effort")
    if indexed:
        names = ("/arm/state/position[{}]", "/arm/state/effort[{}]")
    q, tau = (each(name, values, 0) for name, values in zip(names, (log.q, log.tau), strict=True))
    return text(folder / "log.csv", {"__time": EPOCH + log.t, **q, **tau}, form=".15g")


def matlab(folder: Path, log: Recording) -> Path:
    """Write what `save -v7.3` writes: HDF5 after a block of MATLAB's own, every array transposed."""
    path = folder / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", log.t[:, None]), ("q", log.q), ("tau", log.tau)):
            file.create_dataset(name, data=values.T).attrs["MATLAB_class"] = np.bytes_("double")
    data = bytearray(path.read_bytes())
    data[:124] = (
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  6 10:00:00 2025 HDF5 schema 1.00 .".ljust(124)
    )
    data[124:128] = b"\x00\x02IM"
    path.write_bytes(bytes(data))
    return path


def pandas_times(folder: Path, log: Recording) -> Path:
    """Write `frame.to_csv()` with an index of times."""
    import pandas as pd

    at = pd.to_datetime(EPOCH * 10**9 + np.rint(log.t * 1e9).astype(np.int64))
    frame = pd.DataFrame({**each("{j}_position", log.q), **each("{j}_torque", log.tau)}, index=at)
    frame.to_csv(path := folder / "log.csv", index_label="timestamp")
    return path


def parquet(folder: Path, log: Recording, *, lists: bool = False) -> Path:
    import pandas as pd

    columns: dict[str, Any] = {"timestamp": log.t}
    if lists:
        columns |= {"observation.position": list(log.q), "observation.effort": list(log.tau)}
    else:
        columns |= {**each("q.{j}", log.q), **each("tau.{j}", log.tau)}
    pd.DataFrame(columns).to_parquet(path := folder / "log.parquet")
    return path


def long_rows(log: Recording) -> list[str]:
    rows = []
    for k, t in enumerate(log.t.tolist()):
        for j, name in enumerate(NAMES):
            rows += [f"{t:.6f},{name}/position,{log.q[k, j]:.9g}", f"{t:.6f},{name}/torque,{log.tau[k, j]:.9g}"]
    return rows


def long_form(folder: Path, log: Recording) -> Path:
    (path := folder / "log.csv").write_text("\n".join(["time,name,value", *long_rows(log)]) + "\n")
    return path


def row_per_joint(folder: Path, log: Recording) -> Path:
    rows = [
        f"{t:.6f},{j + 1},{log.q[k, j]:.9g},{log.tau[k, j]:.9g}" for k, t in enumerate(log.t.tolist()) for j in (0, 1)
    ]
    (path := folder / "log.csv").write_text("\n".join(["timestamp,joint,position,effort", *rows]) + "\n")
    return path


def arrays(folder: Path, log: Recording) -> Path:
    """Write one array as the SARCOS data are: positions, velocities, accelerations, torques of all joints."""
    rates = _rates(log)
    accelerations = np.gradient(rates, log.dt, axis=0)
    np.savez(path := folder / "log.npz", t=log.t, data=np.hstack([log.q, rates, accelerations, log.tau]))
    return path


def untimed(folder: Path, log: Recording) -> Path:
    """Write the SARCOS data as they are handed on: one array, no time."""
    rates = _rates(log)
    rows = np.hstack([log.q, rates, np.gradient(rates, log.dt, axis=0), log.tau])
    np.savez(path := folder / "log.npz", sarcos_inv=rows)
    return path


def single_array(folder: Path, log: Recording) -> Path:
    np.save(path := folder / "log.npy", np.hstack([log.q, _rates(log), log.tau]))
    return path


def old_matlab(folder: Path, log: Recording, inside: str = "") -> Path:
    """Write what MATLAB's `save` writes unless told otherwise, variables alone or `inside` a structure."""
    from scipy.io import savemat

    held = {"t": log.t[:, None], "q": log.q, "theta": log.theta, "tau": log.tau}
    savemat(path := folder / "log.mat", {inside: held} if inside else held, do_compression=True)
    return path


def json_lines(folder: Path, log: Recording) -> Path:
    """Write one object per sample."""
    signals = [values.tolist() for values in (log.t, log.q, log.theta, log.tau)]
    rows = (dict(zip(("t", "q", "theta", "tau"), row, strict=True)) for row in zip(*signals, strict=True))
    (path := folder / "log.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def json_messages(folder: Path, log: Recording) -> Path:
    """Write one message per line beside its topic, another topic between them."""
    lines = []
    for stamp, message in zip(stamps(log), states(log), strict=True):
        lines.append({"topic": "/joint_states", "timestamp": stamp * 1e-9, "msg": message})
        lines.append({"topic": "/battery", "timestamp": stamp * 1e-9, "msg": {"voltage": 24.1}})
    (path := folder / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def topic_echo(folder: Path, log: Recording) -> Path:
    """Write what ``ros2 topic echo --csv /joint_states`` prints."""
    signals = (log.q.tolist(), _rates(log).tolist(), log.tau.tolist())
    each_row = zip(stamps(log), *signals, strict=True)
    rows = [[s // 10**9, s % 10**9, "", *NAMES, *q, *dq, *tau] for s, q, dq, tau in each_row]
    (path := folder / "log.csv").write_text("".join(",".join(map(str, row)) + "\n" for row in rows))
    return path


def episode(folder: Path, log: Recording) -> Path:
    """Write HDF5 as data sets for learning are: observations in a group."""
    with h5py.File(path := folder / "episode_0.hdf5", "w") as file:
        for name, values in (("qpos", log.q), ("qvel", _rates(log)), ("effort", log.tau)):
            file[f"observations/{name}"] = values
        file["timestamps"] = log.t
    return path


def packed(folder: Path, log: Recording) -> Path:
    inner = text(folder / "inner.csv", {"t": log.t, **each("q.{j}", log.q), **each("tau.{j}", log.tau)})
    with zipfile.ZipFile(path := folder / "log.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(inner, "run/log.csv")
    return path


def gzipped(folder: Path, log: Recording) -> Path:
    inner = text(folder / "inner.csv", {"t": log.t, **each("q_{j}", log.q), **each("tau_{j}", log.tau)})
    (path := folder / "log.csv.gz").write_bytes(gzip.compress(inner.read_bytes()))
    return path


def csv(columns: Callable[[Recording], Columns], *options: str, **more: Any) -> Callable[[Path, Recording], Path]:
    """Return a writer of a table of text."""
    return lambda folder, log: text(folder / "log.csv", columns(log), *options, **more)


LOGS: dict[str, Callable[[Path, Recording], Path]] = {
    "rosbag2 sqlite3": rosbag_sqlite,
    "rosbag2 mcap": rosbag_mcap,
    "mcap, joint states on another topic": other_topic,
    "mcap, ros2_control": dynamic_state,
    "PlotJuggler CSV": plotjuggler,
    "PlotJuggler CSV of arrays": lambda f, log: plotjuggler(f, log, indexed=True),
    "MATLAB v7.3": matlab,
    "MATLAB writetable": csv(lambda log: {"t": log.t, **each("q_{j}", log.q), **each("tau_{j}", log.tau)}),
    "pandas CSV, index of times": pandas_times,
    "pandas CSV, numbered index": csv(
        lambda log: {"": np.arange(len(log.t)), "time": log.t, **each("joint_{}_pos", log.q, 0),
                     **each("joint_{}_torque", log.tau, 0)}),
    "Parquet": parquet,
    "Parquet with lists": lambda f, log: parquet(f, log, lists=True),
    "libfranka CSV": csv(
        lambda log: {"time": log.t, **each("q[{}]", log.q, 0), **each("dq[{}]", _rates(log), 0),
                     **each("tau_J[{}]", log.tau, 0)}),
    "UR RTDE CSV": csv(
        lambda log: {"timestamp": log.t, **each("actual_q_{}", log.q, 0), **each("actual_qd_{}", _rates(log), 0),
                     **each("target_moment_{}", log.tau, 0)}, " "),
    "SARCOS-like npz": arrays,
    "SARCOS-like npz without time": untimed,
    "npy": single_array,
    "MATLAB before v7.3": old_matlab,
    "MATLAB structure": lambda f, log: old_matlab(f, log, "run"),
    "JSON lines": json_lines,
    "JSON lines of messages": json_messages,
    "ros2 topic echo --csv": topic_echo,
    "HDF5 of an episode": episode,
    "German export": csv(
        lambda log: {"Zeit [s]": log.t, **each("Winkel Achse {} [Grad]", np.degrees(log.q)),
                     **each("Drehmoment Achse {} [Nm]", log.tau)}, ";", comma=True, encoding="latin-1"),
    "spreadsheet, UTF-16": csv(
        lambda log: {"Time (ms)": 1e3 * log.t, **each("Position {} (deg)", np.degrees(log.q)),
                     **each("Torque {} (Nm)", log.tau)}, "\t", encoding="utf-16"),
    "controller export with remarks": csv(
        lambda log: {"time[s]": log.t, **each("A{}_pos[deg]", np.degrees(log.q)), **each("A{}_tq[mNm]", 1e3 * log.tau)},
        ";", head=("# controller V8.3", "# trace of 2 axes", ""), end=";"),
    "stamps in ns": csv(
        lambda log: {"stamp_ns": EPOCH * 10**9 + np.rint(log.t * 1e9), **each("pos_{j}", log.q),
                     **each("effort_{j}", log.tau)}, form=".19g"),
    "zip": packed,
    "gzip": gzipped,
    "long form": long_form,
    "a row per joint": row_per_joint,
    "headerless columns": csv(
        lambda log: {"t": log.t, **each("q{}", log.q), **each("u{}", log.tau)}, " ", named=False),
}  # fmt: skip
"""What writes it -> the writer."""

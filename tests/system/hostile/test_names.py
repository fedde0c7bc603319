"""Names and texts from files of every kind, full of controls and markup, on the way to terminals, reports, figures."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.logs.mcap_made import Bag, joint_state
from tests.system.hostile.bags import joint_states, stamps
from tests.system.hostile.hostile import ROBOT, base, elid

EVIL = "\x1b]0;x\x07<script>alert(1)</script>\u202e"
CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
ROBOT_FILE = Path(__file__).parents[3] / "robots" / "planar2.yaml"


def columns(joint: str = "joint2") -> dict[str, np.ndarray]:
    log = base()
    signals = {"q": log.q, "theta": log.theta, "tau": log.tau}
    named = {f"{s}.{j}": v[:, k] for s, v in signals.items() for k, j in enumerate(("joint1", joint))}
    return {"t": log.t, **named}  # type: ignore[dict-item]


def table(path: Path, named: dict[str, np.ndarray]) -> Path:
    head = ",".join(f'"{name}"' for name in named)
    rows = np.column_stack(list(named.values()))
    np.savetxt(path, rows, delimiter=",", header=head, comments="", encoding="utf-8")
    return path


def evil_column(folder: Path) -> Path:
    return table(folder / "log.csv", columns() | {EVIL: base().t, f"{EVIL} [°]": base().t})


def evil_file_name(folder: Path) -> Path:
    return table(folder / f"{EVIL.replace('/', '')}.csv", columns())


def evil_parquet(folder: Path) -> Path:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(arrow.table(columns() | {EVIL: base().t}), path := folder / "log.parquet")
    return path


def evil_json_lines(folder: Path) -> Path:
    (path := folder / "log.jsonl").write_text(
        "".join(
            json.dumps(dict(zip([*columns(), EVIL], [*row, "x" + EVIL], strict=True))) + "\n"
            for row in np.column_stack(list(columns().values())).tolist()
        )
    )
    return path


def evil_datasets(folder: Path) -> Path:
    log = base()
    with h5py.File(path := folder / "log.h5", "w") as file:
        for name, values in (("t", log.t), ("q", log.q), ("theta", log.theta), ("tau", log.tau)):
            file[name] = values
        file[EVIL.replace("/", "")] = log.t
        file["text" + EVIL.replace("/", "")] = np.array([EVIL.encode()])
        file["link" + EVIL.replace("/", "")] = h5py.SoftLink(f"/{EVIL}")
        file["outside"] = h5py.ExternalLink(EVIL, EVIL)
        file.attrs["joint_names"] = [b"joint1", b"joint2"]
    return path


def evil_arrays(folder: Path) -> Path:
    log = base()
    np.savez(
        path := folder / "log.npz", t=log.t, q=log.q, theta=log.theta, tau=log.tau, joint_names=["joint1", "joint2"],
        **{EVIL.replace("/", ""): log.t, "text": np.array([EVIL])},
    )  # fmt: skip
    return path


def evil_topics(folder: Path, schema: str = "x/msg/Y") -> Path:
    log, bag = base(), Bag()
    for name in ("/joint_states", "/motor_states", f"/{EVIL}"):
        bag.topic(name)
    bag.writer.register_channel(f"/a{EVIL}", "cdr", bag.writer.register_schema(schema + EVIL, "ros2msg", EVIL.encode()))
    bag.writer.register_channel(f"/b{EVIL}", EVIL, bag.writer.register_schema("y", EVIL, EVIL.encode()))
    joints = ["joint1", "joint2", EVIL]
    for row, stamp in stamps():
        bag.add("/joint_states", stamp, joint_state(stamp, joints, [*log.q[row], 0.0]))
        bag.add("/motor_states", stamp, joint_state(stamp, joints, [*log.theta[row], 0.0], effort=[*log.tau[row], 0.0]))
        bag.add(f"/{EVIL}", stamp, joint_state(stamp, [EVIL], [0.0]))
    (path := folder / "log.mcap").write_bytes(bag.bytes())
    return path


def evil_metadata(folder: Path) -> Path:
    bag = folder / "bag"
    bag.mkdir()
    (bag / "run_0.mcap").write_bytes(joint_states())
    files = json.dumps(["run_0.mcap", f"{EVIL.replace('/', '')}.mcap"])
    (bag / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths: {files}\n")
    return bag


SOURCES: dict[str, Callable[[Path], Path]] = {
    "CSV column": evil_column, "file name": evil_file_name, "Parquet column": evil_parquet,
    "JSON key": evil_json_lines, "HDF5 dataset": evil_datasets, "npz array": evil_arrays,
    "MCAP topic, joint, schema": evil_topics, "metadata.yaml": evil_metadata,
}  # fmt: skip


def visible_only(*texts: str) -> None:
    for text in texts:
        assert not CONTROLS.search(text), ascii(text[max(0, CONTROLS.search(text).start() - 80) :][:200])  # type: ignore[union-attr]


def files_are_visible(folder: Path) -> None:
    reports = [p for p in folder.rglob("*") if p.suffix in (".txt", ".md", ".html", ".json", ".svg")]
    assert reports
    for path in reports:
        text = path.read_text("utf-8")
        visible_only(text)
        if path.suffix in (".html", ".svg"):
            assert "<script>alert" not in text


@pytest.mark.parametrize("source", SOURCES)
def test_what_files_name_is_shown_with_its_controls_visible(tmp_path: Path, source: str) -> None:
    log = SOURCES[source](tmp_path)
    done = elid("info", log, "--robot", ROBOT)
    visible_only(done.out, done.err)
    reports = [
        part for kind in ("txt", "md", "html", "json") for part in ("--report", tmp_path / "out" / f"report.{kind}")
    ]
    (tmp_path / "out").mkdir()
    found = elid("identify", log, "--robot", ROBOT, *reports)
    assert found.code == 0, found.err
    visible_only(found.out, found.err)
    files_are_visible(tmp_path / "out")
    other = elid("identify", log, "--robot", "puma560")  # refused: lists what the log has
    assert other.code == 3
    visible_only(other.out, other.err)
    shown = done.out + done.err + found.out + found.err + other.err
    assert r"\x1b]0;x\x07" in shown, "the name is not shown at all: nothing was tried"


@pytest.mark.parametrize("joint", ["../arm/joint2", r"$\frac{$<script>alert(1)</script>"])
def test_joints_of_any_name_have_figures(tmp_path: Path, joint: str) -> None:
    robot = tmp_path / "arm.yaml"
    robot.write_text(ROBOT_FILE.read_text("utf-8").replace("name: joint2", f"name: {json.dumps(joint)}"))
    log = table(tmp_path / "log.csv", columns(joint))
    out = tmp_path / "out"
    out.mkdir()
    more = ("--plot", out / "plots", "--report", out / "page.html", "--report", out / "page.md")
    done = elid("identify", log, "--robot", robot, *more)
    assert done.code == 0, done.err
    visible_only(done.out, done.err)
    files_are_visible(out)
    assert list((out / "plots").iterdir())
    assert {p.name for p in tmp_path.iterdir()} == {"arm.yaml", "log.csv", "out"}


def test_names_of_saved_results_are_shown_with_their_controls_visible(tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv", columns())
    good = elid("identify", log, "--robot", ROBOT, "--json").out
    data, first = json.loads(good), json.loads(good)
    data["robot"] = data["model"] = EVIL
    data["log"]["files"] = data["log"]["repairs"] = data["log"]["warnings"] = [EVIL]
    for entry in (*data["base_parameters"], *first["base_parameters"]):
        entry["unit"] = EVIL  # of both: parameters in other units are not compared
    data["base_parameters"][0]["name"] = EVIL
    one, other = tmp_path / "one.json", tmp_path / "other.json"
    one.write_text(json.dumps(first))
    other.write_text(json.dumps(data))
    out = tmp_path / "out"
    out.mkdir()
    reports = [part for kind in ("txt", "md", "html") for part in ("--report", out / f"r.{kind}")]
    for line in (["compare", one, other, *reports], ["trend", one, one, other], ["sample", other, "-n", "2"]):
        done = elid(*line)
        visible_only(done.out, done.err)
    files_are_visible(out)

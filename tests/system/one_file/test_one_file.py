"""A log format, an output format or a kind of figure is one file: dropped, it is found with nothing else changed."""

from __future__ import annotations

import json

from tests.system.one_file.conftest import ROOT, Copy

LOG = str(ROOT / "sample_logs/planar2.csv")


def test_a_log_format(copy: Copy) -> None:
    copy.drop("json_lines.py", "logs/formats")
    simulated = ("simulate", "--robot", "planar2", "--duration", "4", "--rate", "250", "--seed", "1")
    copy.elid(*simulated, "-o", "log.jsonl")
    copy.elid(*simulated, "-o", "log.csv")
    assert "joint2" in copy.elid("info", "log.jsonl")
    found, usual = (
        json.loads(copy.elid("identify", f"log.{s}", "--robot", "planar2", "--json")) for s in ("jsonl", "csv")
    )
    assert found["base_parameters"] == usual["base_parameters"]


def test_an_output_format(copy: Copy) -> None:
    copy.drop("tsv.py", "report/formats")
    copy.elid("identify", LOG, "--robot", "planar2", "--report", "found.tsv")
    assert "m1 - 4*Izz1 + 4*Izz2\t" in (copy.folder / "found.tsv").read_text("utf-8")


def test_a_kind_of_figure(copy: Copy) -> None:
    copy.drop("speeds.py", "report/figures/plots")
    copy.elid("validate", LOG, "--robot", "planar2", "--report", "page.html", "--plot", "figures")
    assert "How fast the joints moved" in (copy.folder / "page.html").read_text("utf-8")
    assert (copy.folder / "figures/speeds.png").read_bytes().startswith(b"\x89PNG")

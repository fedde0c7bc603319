"""An effect, a log format, an output format, a kind of figure is one file: dropped, it is found by itself."""

from __future__ import annotations

import json

import pytest

from tests.system.one_file.conftest import ROOT, Copy

LOG = str(ROOT / "sample_logs/planar2.csv")


def test_a_log_format(copy: Copy) -> None:
    copy.drop("samples.py", "logs/formats")
    simulated = ("simulate", "--robot", "planar2", "--duration", "4", "--rate", "250", "--seed", "1")
    copy.elid(*simulated, "-o", "log.samples")
    copy.elid(*simulated, "-o", "log.csv")
    assert "joint2" in copy.elid("info", "log.samples")
    found, usual = (
        json.loads(copy.elid("identify", f"log.{s}", "--robot", "planar2", "--json")) for s in ("samples", "csv")
    )
    assert found["base_parameters"] == usual["base_parameters"]


def test_the_dropped_format_passes_what_every_format_does(copy: Copy) -> None:
    copy.drop("samples.py", "logs/formats")
    said = copy.tested("samples", "tests/logs/test_log_round_trip.py", "tests/system/hostile/test_headers.py")
    assert "test_every_signal_is_read_back_that_the_format_does_not_say_it_lacks[log.samples]" in said
    assert "test_a_broken_head_is_one_error_or_a_recording[samples]" in said


def test_an_output_format(copy: Copy) -> None:
    copy.drop("tsv.py", "report/formats")
    copy.elid("identify", LOG, "--robot", "planar2", "--report", "found.tsv")
    assert "m1 - 4*Izz1 + 4*Izz2\t" in (copy.folder / "found.tsv").read_text("utf-8")


def test_a_kind_of_figure(copy: Copy) -> None:
    copy.drop("speeds.py", "report/figures/plots")
    copy.elid("validate", LOG, "--robot", "planar2", "--report", "page.html", "--plot", "figures")
    assert "How fast the joints moved" in (copy.folder / "page.html").read_text("utf-8")
    assert (copy.folder / "figures/speeds.png").read_bytes().startswith(b"\x89PNG")


def test_an_effect(copy: Copy) -> None:
    copy.drop("rising_spring.py", "model/effects/library")
    at_work = "rising_spring@joint1:stiffness=4"
    copy.elid(
        "simulate", "--robot", "planar2", "--effect", at_work, "--duration", "10", "--rate", "250", "-o", "log.h5"
    )

    found = json.loads(copy.elid("diagnose", "log.h5", "--robot", "planar2", "--write-robot", "found.yaml", "--json"))
    assert [(e["effect"], e["joint"]) for e in found["effects"]] == [("rising_spring", "joint1")]
    assert found["effects"][0]["parameters"]["stiffness"] == pytest.approx(4.0, rel=0.05)

    judged, plain = (
        json.loads(copy.elid("validate", "log.h5", "--robot", robot, "--json")) for robot in ("found.yaml", "planar2")
    )
    assert judged["error"]["joint1"]["rms"] < 0.2 * plain["error"]["joint1"]["rms"]

    assert "stiffness" in copy.elid("effects", "rising_spring")
    page = copy.python("-c", "from tests.system.reproduce.reference import effects_page; print(effects_page())")
    assert "\n## rising_spring\n" in page


def test_the_dropped_effect_passes_the_contract_of_all_effects(copy: Copy) -> None:
    copy.drop("rising_spring.py", "model/effects/library")
    files = [f"tests/model/effects/test_effect_{name}.py" for name in ("contract", "files", "recipe", "simulated")]
    said = copy.tested("rising_spring", *files)
    assert "test_a_robot_with_the_effect_is_written_read_and_judged[rising_spring]" in said

"""A diagnosis and a validation as people take them away: page, figures, Markdown, gates, what a written file says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from elid_cli.cli import main
from elid_cli.robot.files import read_robot

LOG = str(Path(__file__).parents[2] / "sample_logs" / "planar2_stribeck.h5")
LEVER = """\
name: lever
gravity: [0, -9.81, 0]
dh: standard
joints:
  - {name: joint1, a: 0.5, alpha: 0, d: 0, theta: 0, gear_ratio: 0.1, motor_axis: [0, 0, 1],
     limits: {position: [-2, 2], velocity: 3, acceleration: 12, torque: 120},
     parameters:
      {m: 10, cx: -2.5, cy: 0, cz: 0, Ixx: 0, Iyy: 0.625, Izz: 0.8583, Ixy: 0, Ixz: 0, Iyz: 0, Jm: 12.1,
       fs: 0.3576, fv: 0.1391, K: 1800}}
"""
"""One joint: each of the figures is drawn, none twice."""
EFFECT = "stribeck@joint1:amplitude=0.8,velocity=0.15"


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with everything that one diagnosis can leave behind."""
    folder = tmp_path_factory.mktemp("taken away")
    log, robot = str(folder / "run.h5"), str(folder / "lever.yaml")
    (folder / "lever.yaml").write_text(LEVER, "utf-8")
    line = ["simulate", "--robot", robot, "--duration", "8", "--rate", "500", "--output", log, "--quiet"]
    assert main([*line, "--effect", EFFECT, "--torque-noise", "0.2%"]) == 0
    line = ["diagnose", log, "--robot", robot, "--quiet", "--fail-on-effect"]
    line += [part for name in ("page.html", "comment.md", "result.json") for part in ("--report", str(folder / name))]
    line += ["--plot", str(folder / "figures"), "--plot-format", "svg", "--write-robot", str(folder / "refined.yaml")]
    assert main(line) == 1, "the log lacks an effect, and a limit says so after everything is written"
    return folder


def test_the_page_of_a_diagnosis_opens_with_what_it_found(taken: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (taken / "page.html").read_text("utf-8")
    answers = text[text.index("class=answers") : text.index("</section>")]
    for word in (
        "Stribeck friction at joint1",
        "Can I trust it?",
        "What to record next?",
        "base parameters (what motion can show)",
    ):
        assert word in answers
    assert "→ good" in text[text.index("class=lights") : text.index("<figure")]
    assert text.count('id="f-effect1"') == 1
    assert "friction curve" in text
    assert not re.search(r'(src|href)="(?!data:|#)', text), "nothing is fetched"
    assert "sha256" in text[text.index("<footer>") :]
    assert "numpy" in text[text.index("<footer>") :]
    for key in (
        "effect1",
        "torque_joint1",
        "residual_joint1",
        "spring_joint1",
        "parameters",
        "classification",
        "coverage",
    ):
        assert f'id="f-{key}"' in text


def test_every_figure_of_the_page_is_a_file_too(taken: Path) -> None:
    text = (taken / "page.html").read_text("utf-8")
    files = sorted((taken / "figures").iterdir())
    assert {file.suffix for file in files} == {".svg"}
    assert {file.stem for file in files} == set(re.findall(r'<figure id="f-([^"]+)"', text))
    assert all(b"</svg>" in file.read_bytes() for file in files)


def test_the_comment_says_what_the_json_says(taken: Path) -> None:
    result = json.loads((taken / "result.json").read_text("utf-8"))
    comment = (taken / "comment.md").read_text("utf-8")
    assert comment.startswith("## lever")
    assert result["effects"]
    for effect in result["effects"]:
        assert f"| {effect['effect']} | {effect['joint']} |" in comment
    assert comment.count("\n| --- |") >= 2, "tables that GitHub draws"


def test_a_written_file_says_what_its_values_are(taken: Path) -> None:
    text = (taken / "refined.yaml").read_text("utf-8")
    assert text.startswith("# Identified by elid.")
    assert "--physical" in text
    named = sorted((effect.effect, effect.joint) for effect in read_robot(taken / "refined.yaml").effects)
    result = json.loads((taken / "result.json").read_text("utf-8"))
    assert named == sorted((effect["effect"], effect["joint"]) for effect in result["effects"] + result["nuisances"])
    assert {joint for name, joint in named if name == "stribeck"} == {"joint1"}


def test_a_validation_writes_a_page_and_png_figures(
    taken: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, figures = tmp_path / "judged.html", tmp_path / "figures"
    robot = str(taken / "refined.yaml")
    line = ["validate", str(taken / "run.h5"), "--robot", robot, "--held-out", "--max-error", "1%"]
    assert main([*line, "--report", str(page), "--plot", str(figures), "--markdown"]) == 0
    assert capsys.readouterr().out.startswith("## lever")
    text = page.read_text("utf-8")
    assert '<figure id="f-torque_joint1">' in text
    assert "stribeck" in text
    assert {file.suffix for file in figures.iterdir()} == {".png"}


def test_what_no_effect_explains_can_fail_a_job(capsys: pytest.CaptureFixture[str]) -> None:
    """Only backlash is tried on friction that lacks something else: the rest stays unexplained."""
    line = ["diagnose", LOG, "--robot", "planar2", "--only", "backlash", "--quiet"]
    assert main(line) == 0
    assert "what no effect explains" in capsys.readouterr().out
    assert main([*line, "--fail-on-unexplained"]) == 1
    assert "unexplained" in capsys.readouterr().err


def test_a_refused_stiffness_is_not_written_as_if_it_were_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    puma = str(Path(__file__).parents[2] / "sample_logs" / "puma560.h5")
    written = tmp_path / "mine.yaml"
    assert main(["identify", puma, "--robot", "puma560", "--json", "--write-robot", str(written)]) == 0
    result = json.loads(capsys.readouterr().out)
    refused = {p["name"] for p in result["base_parameters"] if p["verdict"] == "refused"}
    text = " ".join(line.removeprefix("#").strip() for line in written.read_text("utf-8").splitlines())
    assert refused
    assert all(f"{name} is not known" in text for name in refused)


def test_a_stiffness_of_a_rigid_joint_cannot_be_required(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["classify", "--robot", "kr300", "--require-independent", "K5"]) == 2
    said = capsys.readouterr().err
    assert "declared rigid" in said
    assert "transmission: elastic" in said


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        (["identify", LOG, "--robot", "planar2", "--estimator", "papper"], "paper"),
        (["identify", LOG, "--robot", "planar2", "--plot-format", "pgn"], "png"),
        (["completion", "bsh"], "bash"),
        (["exite", "--robot", "planar2"], "excite"),
        (["identify", LOG, "--robot", "planar3"], "planar2"),
        (["diagnose", LOG, "--robot", "planar2", "--only", "backlas"], "backlash"),
        (["excite", "--robot", "planar2", "-o", "x.csv", "--for", "Jm3"], "Jm"),
        (["identify", LOG, "--robot", "planar2", "--map", "thta=/x"], "theta"),
    ],
)
def test_a_typo_is_answered_by_what_was_meant(line: list[str], meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line) == 2
    assert f"did you mean '{meant}" in capsys.readouterr().err

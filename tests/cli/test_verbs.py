"""identify, classify, validate and info on a small log whose answer is known."""

from __future__ import annotations

import fcntl
import gzip
import json
import re
import shlex
import signal
import struct
import subprocess
import termios
import time
from pathlib import Path

import pytest

from tests.cli.conftest import JOINT, Elid, environment, interruptible, spindle_log

LOG, ROBOT = "run 07.csv", "spindle.yaml"
TRUTH = {"Izz1 + Jm1": 0.6, "fs1": 0.4, "fv1": 0.3}


def on(place: Path, elid: Elid, verb: str, *arguments: str, **env: str) -> subprocess.CompletedProcess[str]:
    return elid(verb, LOG, "--robot", ROBOT, *arguments, cwd=place, **env)


def answer(done: subprocess.CompletedProcess[str]) -> dict:
    assert done.stderr == ""
    return json.loads(done.stdout, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


def test_identify_finds_the_truth_and_says_it_twice_alike(elid, place: Path) -> None:
    data = answer(on(place, elid, "identify", "--json"))
    assert (data["schema"], data["command"], data["robot"]) == ("elid/1", "identify", "spindle")
    assert data["joints"] == [JOINT]
    assert data["log"]["files"] == [LOG]
    assert re.fullmatch(r"[0-9a-f]{64}", data["log"]["sha256"][0])
    assert re.fullmatch(r"[0-9a-f]{16,64}", data["robot_fingerprint"])
    assert data["log"]["samples"] == 2400
    assert data["log"]["rate"] == pytest.approx(200)
    assert data["counts"] == {"parameters": 13, "base": 3, "independent": 2, "combined": 2, "unidentifiable": 9}
    assert set(data["classification"]) == set(data["this_log"])
    values = {entry["name"]: entry for entry in data["base_parameters"]}
    for name, truth in TRUTH.items():
        assert values[name]["estimate"] == pytest.approx(truth, rel=2e-2)
        assert values[name]["verdict"] == "supported"
        assert values[name]["relative_error"] == pytest.approx(abs(values[name]["estimate"] / truth - 1), abs=1e-9)
    assert values["Izz1 + Jm1"]["terms"] == {"Izz1": 1, "Jm1": 1}
    assert data["error"][JOINT]["relative"] < 0.01

    done = on(place, elid, "identify")
    assert (done.returncode, done.stderr) == (0, "")
    for name, entry in values.items():
        row = next(line for line in done.stdout.splitlines() if line.startswith(f"  {name}"))
        printed, deviation = row.removeprefix(f"  {name}").split()[:2]
        assert float(printed) == pytest.approx(entry["estimate"], abs=0.6 * float(deviation))
        assert float(deviation) == pytest.approx(entry["std_error"], rel=0.35)


def test_a_report_goes_from_input_to_next_command(elid, place: Path) -> None:
    lines = on(place, elid, "identify").stdout.splitlines()
    starts = ("spindle · run 07.csv", "can I trust it?", JOINT, "base parameter", "recorded", "used", "Next: elid")
    places = [next(k for k, line in enumerate(lines) if line.lstrip().startswith(start)) for start in starts]
    assert places == sorted(places)
    assert f"'{LOG}' --robot {ROBOT}" in lines[places[-1]]
    assert all(len(line) <= 80 for line in lines[:-1])


def test_a_row_is_a_line_in_a_pipe_unless_columns_are_asked_for(elid) -> None:
    done = elid("classify", "--robot", "puma560", "--all")
    names = [base["name"] for base in answer(elid("classify", "--robot", "puma560", "--json"))["base_parameters"]]
    assert max(map(len, names)) > 80
    lines = [line.split("  ")[1] for line in done.stdout.splitlines() if line.startswith("  ")]
    assert set(names) <= set(lines)
    asked = elid("classify", "--robot", "puma560", "--all", COLUMNS="80").stdout
    assert max(len(line) for line in asked.splitlines() if not line.startswith("Next")) <= 80


@pytest.mark.parametrize("verb", ["identify", "classify", "validate", "info"])
def test_nothing_is_cut_at_40_columns_or_in_ascii(elid, place: Path, verb: str) -> None:
    wide = on(place, elid, verb, COLUMNS="200").stdout
    narrow = on(place, elid, verb, COLUMNS="40").stdout
    plain = on(place, elid, verb, COLUMNS="40", PYTHONIOENCODING="ascii").stdout
    assert plain.isascii()
    assert "…" not in narrow
    for word in set(wide.split()) - {"–", "verdict"}:  # records leave out empty cells
        assert word in narrow.replace("\n", " ") or f"{word}:" in narrow
    assert "N*m" in plain or verb in ("info",)


VERBS, FORMS = ("identify", "classify", "validate", "info"), ("--json", "--markdown", "--quiet")
SAID = """
import contextlib, io, json, os, sys

from elid_cli.cli import main

os.chdir(sys.argv[1])
said = {}
for line in json.loads(sys.argv[2]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(line)
    said[line[0] + line[-1]] = [code, out.getvalue(), err.getvalue()]
print(json.dumps(said))
"""
"""Prints what commands say, by the first and last words of their lines."""


@pytest.fixture(scope="module")
def said_twice(elid, place: Path) -> list[dict[str, list]]:
    """Return what commands say under two orders of sets, each of one start of Python."""
    lines = json.dumps([[verb, LOG, "--robot", ROBOT, form] for verb in VERBS for form in FORMS])
    runs = [elid.python(SAID, str(place), lines, PYTHONHASHSEED=seed) for seed in ("1", "2")]
    return [json.loads(done.stdout) for done in runs]


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("form", FORMS)
def test_same_input_same_bytes(said_twice: list[dict[str, list]], verb: str, form: str) -> None:
    first, second = (said[verb + form] for said in said_twice)
    assert first[:2] == second[:2]
    assert first[1] or form == "--quiet"
    assert first[2] == ""


def test_options_may_stand_before_the_log_and_the_robot_in_the_environment(elid, place: Path) -> None:
    usual = on(place, elid, "identify", "--json").stdout
    assert elid("identify", "--json", "--robot", ROBOT, LOG, cwd=place).stdout == usual
    assert elid("identify", "--json", LOG, cwd=place, ELID_ROBOT=ROBOT).stdout == usual


def test_a_log_is_known_by_its_content(elid, place: Path, tmp_path: Path) -> None:
    expected = answer(on(place, elid, "identify", "--json"))["base_parameters"]
    (tmp_path / "noname").write_bytes((place / LOG).read_bytes())
    (tmp_path / "packed.bin").write_bytes(gzip.compress((place / LOG).read_bytes()))
    robot = str(place / ROBOT)
    for name in ("noname", "packed.bin"):
        assert answer(elid("identify", name, "--robot", robot, "--json", cwd=tmp_path))["base_parameters"] == expected
    piped = elid("identify", "-", "--robot", robot, "--json", stdin=(place / LOG).read_text())
    assert answer(piped)["base_parameters"] == expected


def test_a_written_robot_predicts_as_well(elid, place: Path, tmp_path: Path) -> None:
    found = str(tmp_path / "gefunden ä.yaml")
    first = on(place, elid, "identify", "--json", "--cutoff", "10", "--write-robot", found)
    once = Path(found).read_bytes()
    on(place, elid, "identify", "--json", "--cutoff", "10", "--write-robot", found)
    assert Path(found).read_bytes() == once
    assert [p.name for p in tmp_path.iterdir()] == ["gefunden ä.yaml"]
    error = answer(first)["error"][JOINT]
    judged = answer(elid("validate", str(place / LOG), "--robot", found, "--json", "--cutoff", "10"))["error"][JOINT]
    assert judged["rms"] == pytest.approx(error["rms"], rel=0.1)
    again = answer(elid("identify", str(place / LOG), "--robot", found, "--json", "--cutoff", "10"))["error"][JOINT]
    assert again["rms"] == pytest.approx(error["rms"], rel=1e-6)


@pytest.mark.parametrize("verb", ["info", "validate", "classify"])
def test_the_next_command_reads_the_log_as_this_one_did(elid, place: Path, verb: str) -> None:
    """With its --map: the line is there to be pasted, and without the mapping it could not find a signal."""
    lines = (place / LOG).read_text("utf-8").splitlines()
    other = place / "other names.csv"
    other.write_text("\n".join([lines[0].replace("tau.", "effort of "), *lines[1:]]) + "\n", "utf-8")
    try:
        done = elid(verb, other.name, "--robot", ROBOT, "--map", f"tau=effort of {JOINT}", cwd=place)
        assert done.returncode == 0, done.stderr
        following = next(line for line in done.stdout.splitlines() if line.startswith("Next: elid "))
        pasted = shlex.split(following.removeprefix("Next: elid "))
        assert pasted[-2:] == ["--map", f"tau=effort of {JOINT}"]
        assert pasted[1] == other.name
        assert elid("validate", *pasted[1:], cwd=place).returncode == 0
    finally:
        other.unlink()


def test_a_motor_row_above_the_limit_breaks_it_where_the_whole_joint_keeps_it(elid, tmp_path: Path) -> None:
    """A spring that is too soft by 1 %: link and motor side are wrong by the same torque, and their sum is right."""
    root = Path(__file__).parents[2]
    soft = (root / "robots" / "planar2.yaml").read_text("utf-8").replace("K: 1800", "K: 1780")
    (tmp_path / "soft.yaml").write_text(soft)
    line = ("validate", str(root / "sample_logs" / "planar2.h5"), "--robot", "soft.yaml", "--max-error")
    done = elid(*line, "1%", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr == "error: joint2: torque error 1.04 % (motor side) exceeds --max-error 1 %\n"
    assert "an error above 1 % (rms" in done.stdout.replace("\n", " ").replace("                    ", "")
    assert elid(*line, "2%", cwd=tmp_path).stderr == ""


def test_a_limit_of_5_is_not_taken_as_500_percent(elid, place: Path) -> None:
    done = on(place, elid, "validate", "--max-error", "5")
    assert done.returncode == 2
    assert "5 is 500 %; write 5% or 0.05" in done.stderr
    assert on(place, elid, "validate", "--max-error", "150%").returncode == 0


@pytest.mark.parametrize(
    ("verb", "gate", "words"),
    [
        ("validate", ("--max-error", "0.001%"), f"error: {JOINT}: torque error "),
        ("identify", ("--max-error", "1e-6"), f"error: {JOINT}: torque error "),
        ("identify", ("--require-independent", "Izz1", "--require-independent", "fs1"), "error: Izz1: combined, not"),
        ("classify", ("--require-independent", "m1"), "error: m1: unidentifiable, not independent"),
    ],
)
def test_a_broken_limit_exits_1_after_the_report(elid, place: Path, verb: str, gate, words: str) -> None:
    free = on(place, elid, verb, "--json")
    done = on(place, elid, verb, "--json", *gate)
    assert (free.returncode, done.returncode) == (0, 1)
    assert done.stdout == free.stdout
    assert done.stderr.startswith(words)
    assert len(done.stderr.splitlines()) == 1
    assert on(place, elid, verb, "--require-independent" if verb == "classify" else "--max-error",
              "fs1" if verb == "classify" else "50%").returncode == 0  # fmt: skip


def test_info_shows_channels_rates_and_signals(elid, place: Path) -> None:
    data = answer(on(place, elid, "info", "--json"))
    channels = {channel["name"]: channel for channel in data["logs"][0]["channels"]}
    assert channels[f"tau.{JOINT}"]["signals"] == ["tau"]
    assert channels[f"tau.{JOINT}"]["rate"] == pytest.approx(200)
    done = elid("info", LOG, cwd=place)
    assert f"tau.{JOINT}" in done.stdout
    assert done.stdout.rstrip().endswith(f"Next: elid identify '{LOG}' --robot ROBOT")


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (["identify", "run07.csv", "--robot", ROBOT], 3, ["run07.csv: no such file", "did you mean 'run 07.csv'"]),
        (["identify", LOG], 2, ["error: elid identify: needs --robot"]),
        (["identify", "--robot", ROBOT], 2, ["error: elid identify: no log given", "hint: elid identify run07.mcap"]),
        (["identify", LOG, "--robot", ""], 2, ["an empty name is no robot"]),
        (["identify", LOG, "--robot", "planr2"], 2, ["no robot named 'planr2'", "did you mean 'planar2'?"]),
        (["identify", LOG, "--robot", "spindel.yaml"], 2, ["spindel.yaml", "did you mean 'spindle.yaml'?"]),
        (["identify", LOG, "--robot", "typo.yaml"], 2, ["typo.yaml:5", "'gear_rato'", "did you mean 'gear_ratio'"]),
        (["identify", LOG, "--robot", ROBOT, "--map", "tua=x"], 2, ["unknown signal 'tua'", "did you mean 'tau'"]),
        (["identify", LOG, "--robot", ROBOT, "--cutoff", "-1"], 2, ["--cutoff: -1 is not greater than 0"]),
        (["identify", LOG, "--robot", ROBOT, "--cutoff", "nan"], 2, ["--cutoff: 'nan' is not finite"]),
        (["identify", LOG, "--robot", ROBOT, "--write-robot", "no/x.yaml"], 2, ["no/x.yaml: no folder no"]),
        (["identify", LOG, "--robot", ROBOT, "--require-independent", "fz1"], 2, ["no parameter 'fz1'"]),
        (["identify", "notau.csv", "--robot", ROBOT], 3, ["notau.csv", "tau"]),
        (["identify", "rest.csv", "--robot", ROBOT], 4, ["rest.csv: no joint moves"]),
        (["identify", "short.csv", "--robot", ROBOT], 3, ["short.csv: 3 usable samples"]),
        (["identify", "empty.csv", "--robot", ROBOT], 3, ["empty.csv: empty"]),
        (["info", "zeros.bin"], 3, ["zeros.bin"]),
    ],
)
def test_faults_are_one_message(elid, place: Path, tmp_path: Path, change, code, words) -> None:
    for name in (LOG, ROBOT):
        (tmp_path / name).write_bytes((place / name).read_bytes())
    lines = (place / LOG).read_text().splitlines()
    robot = (place / ROBOT).read_text("utf-8")
    (tmp_path / "typo.yaml").write_text(robot.replace("gear_ratio", "gear_rato"))
    (tmp_path / "notau.csv").write_text("\n".join(line.rsplit(",", 1)[0] for line in lines))
    (tmp_path / "rest.csv").write_text("\n".join([lines[0], *(f"{k / 200},0.5,0.5,0.1" for k in range(2400))]))
    (tmp_path / "short.csv").write_text("\n".join(lines[:4]))
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "zeros.bin").write_bytes(bytes(5000))
    before = sorted(tmp_path.iterdir())
    done = elid(*change, cwd=tmp_path)
    assert done.returncode == code
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) <= 3
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr
    assert sorted(tmp_path.iterdir()) == before


def test_repairs_are_said_on_stderr_and_in_the_json(elid, place: Path, tmp_path: Path) -> None:
    lines = (place / LOG).read_text().splitlines()
    broken = [*lines[:500], lines[499], *lines[500:1000], *lines[1200:]]
    (tmp_path / "gap.csv").write_text("\n".join(broken))
    arguments = ("identify", "gap.csv", "--robot", str(place / ROBOT))
    done = elid(*arguments, "--json", cwd=tmp_path)
    repairs = json.loads(done.stdout)["log"]["repairs"]
    assert repairs
    assert done.stderr.splitlines() == [f"repaired: {sentence}" for sentence in repairs]
    assert done.returncode == 0
    assert elid(*arguments, "--quiet", cwd=tmp_path).stderr == ""
    human = elid(*arguments, cwd=tmp_path, COLUMNS="500").stdout
    assert all(sentence in human for sentence in repairs)


def test_progress_is_shown_on_a_terminal_only_and_is_gone_at_the_end(elid, place: Path) -> None:
    arguments = ("identify", str(place / LOG), "--robot", str(place / ROBOT))
    code, shown = elid.terminal(*arguments)
    assert code == 0
    assert "reading" in shown.split("spindle")[0]
    assert "\x1b[2K" in shown.split("spindle")[0]  # the line is erased before the report
    for extra, env in [(("--quiet",), {}), ((), {"TERM": "dumb"})]:
        assert "reading" not in elid.terminal(*arguments, *extra, **env)[1].split("spindle")[0]


def waiting_in(pipe: int) -> int:
    """Return how many bytes lie in a pipe."""
    return struct.unpack("i", fcntl.ioctl(pipe, termios.FIONREAD, b"\0" * 4))[0]


def test_control_c_while_reading_is_quiet(place: Path, tmp_path: Path) -> None:
    found = tmp_path / "found.yaml"
    command = [*Elid.command, "identify", "-", "--robot", str(place / ROBOT), "--write-robot", str(found)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(),
        preexec_fn=interruptible,
    ) as process:  # fmt: skip
        assert process.stdin is not None
        process.stdin.write(spindle_log().encode()[:1000])
        process.stdin.flush()
        while waiting_in(process.stdin.fileno()):  # until elid has taken what there is and waits for the rest
            time.sleep(0.02)
        time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (130, b"", b"")
    assert list(tmp_path.iterdir()) == []


def test_robots_complete(elid) -> None:
    words = "elid identify --robot pu"
    done = elid(_ELID_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD="3")
    assert done.stdout.split() == ["plain,puma560"]


def test_several_logs_show_which_fits_worse(elid, place: Path, tmp_path: Path) -> None:
    for name, inertia in [("a.csv", 0.6), ("b.csv", 0.6001), ("worn.csv", 0.65)]:
        (tmp_path / name).write_text(spindle_log(inertia=inertia))
    logs = ("a.csv", "b.csv", "worn.csv")
    done = elid("identify", *logs, "--robot", str(place / ROBOT), cwd=tmp_path)
    assert f"worn.csv fits worse than the others at {JOINT}" in done.stdout
    data = answer(elid("identify", *logs, "--robot", str(place / ROBOT), "--json", cwd=tmp_path))
    errors = {entry["file"]: entry["error"][JOINT]["rms"] for entry in data["error_by_log"]}
    assert errors["worn.csv"] > 1.5 * errors["a.csv"]
    assert data["log"]["files"] == list(logs)

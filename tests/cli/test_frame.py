"""The frame of the command line, seen from a shell: help, errors, exit codes, pipes, colour."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from elid_cli import __version__
from elid_cli.cli.group import summaries
from tests.cli.conftest import interruptible

ESCAPE = "\x1b"


@pytest.mark.parametrize("arguments", [(), ("-h",), ("--help",)])
def test_help_opens_with_an_example(elid, arguments) -> None:
    done = elid(*arguments)
    assert done.returncode == 0
    assert done.stdout.startswith("Example: elid identify")
    assert done.stderr == ""
    for verb in summaries():
        assert f"\n  {verb} " in done.stdout


@pytest.mark.parametrize("verb", list(summaries()))
def test_every_verb_explains_itself(elid, verb) -> None:
    done = elid(verb, "--help", COLUMNS="40")
    assert done.returncode == 0
    assert done.stdout.startswith(f"Example: {'eval' if verb == 'completion' else 'elid ' + verb}")
    assert summaries()[verb]


def test_version_is_one_line(elid) -> None:
    done = elid("--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"elid {__version__}\n", "")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["identify", "--help"], ["effects", "--nonsense"]])
def test_help_loads_nothing_heavy(elid, arguments) -> None:
    code = "import sys; from elid_cli.cli import main; main(sys.argv[1:]); print('#', *sys.modules)"
    done = elid.python(code, *arguments)
    loaded = set(done.stdout.rsplit("#", 1)[1].split())
    assert not loaded & {"numpy", "scipy", "rich", "h5py", "mcap", "yaml", "matplotlib", "pandas"}


def test_help_is_instant(elid) -> None:
    taken = []
    for _ in range(5):  # processor time, since other tests may run on this machine at the same time
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        elid("--help")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(taken) < 0.2


@pytest.mark.parametrize(
    ("arguments", "first", "hint"),
    [
        (["efects"], "error: elid: no such command 'efects'", "did you mean 'effects'?"),
        (["effects", "--jsn"], "error: elid effects: no such option '--jsn'", "did you mean '--json'?"),
        (["effects", "stribek"], "error: elid effects: no effect 'stribek'", "did you mean 'stribeck'?"),
        (["--json"], "error: elid: no such option '--json'", "elid COMMAND --json"),
        (["effects", "--color", "red"], "error: elid effects: --color: 'red' is not one of", ""),
        (["effects", "--json", "--markdown"], "error: elid effects: --json and --markdown exclude each other", ""),
        (["effects", "--report", "x.pdf"], "error: x.pdf: no report format for .pdf", "known: "),
        (
            ["reduce", "a.h5", "--robot", "planar2", "-o", "x.h5"],
            "error: x.h5: not a name for reduced logs",
            "name it x.npz",
        ),
        (
            ["excite", "--robot", "planar2", "-o", "x.mcap"],
            "error: x.mcap: not a name for a trajectory",
            "name it x.csv",
        ),
        (["identify", "a.h5", "--robot", "planar2", "--write-robot", "x.csv"], "error: x.csv: not a name", "it x.yaml"),
        (["diagnose", "a.h5", "--robot", "planar2", "--write-robot", "x.json"], "error: x.json: not a", "it x.yaml"),
        (["effects", "--report", "nowhere/x.md"], "error: nowhere/x.md: no folder nowhere", "mkdir -p nowhere"),
        (["completion"], "error: elid completion: no shell given", "elid completion bash"),
        (["effects", "stribeck", "hysteresis"], "error: elid effects: got unexpected extra argument", "--help"),
        (["effects", "--report"], "error: elid effects: option '--report' requires an argument", "--help"),
    ],
)
def test_wrong_usage_is_one_message(elid, tmp_path: Path, arguments, first, hint) -> None:
    done = elid(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert lines[0].startswith(first)
    assert len(lines) <= 3
    assert all(line.startswith("  ") for line in lines[1:])
    if hint:
        assert lines[-1].startswith("  hint: ")
        assert hint in lines[-1]


def test_a_file_in_place_of_a_verb_is_understood(elid, tmp_path: Path) -> None:
    (tmp_path / "0725_2.mcap").write_text("x")
    done = elid("0725_2.mcap", cwd=tmp_path)
    assert done.returncode == 2
    assert "hint: elid info 0725_2.mcap" in done.stderr


BUG = """
import sys
import elid_cli.model.effects
from elid_cli.cli import main
def effect_classes():
    raise {problem}
elid_cli.model.effects.effect_classes = effect_classes
sys.exit(main(sys.argv[1:]))
"""


def test_a_bug_is_one_line_and_exit_70(elid) -> None:
    done = elid.python(BUG.format(problem="ZeroDivisionError('division by zero')"), "effects")
    assert done.returncode == 70
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert re.match(
        r"error: a bug in elid .*ZeroDivisionError: division by zero; please report it to its developers", line
    )
    assert "http" not in line  # there is no public place yet; an invented address helps nobody


def test_debug_shows_where(elid) -> None:
    done = elid.python(BUG.format(problem="ZeroDivisionError('division by zero')"), "effects", "--debug")
    assert done.returncode == 70
    assert "Traceback" in done.stderr
    assert "effect_classes" in done.stderr


@pytest.mark.parametrize(
    ("problem", "code", "words"),
    [
        ("KeyboardInterrupt", 130, ""),
        ("BrokenPipeError(32, 'Broken pipe')", 141, ""),
        ("MemoryError('9 GB')", 3, "error: not enough memory\n  9 GB\n  hint: "),
        ("OSError(28, 'No space left on device', 'x.html')", 2, "error: x.html: no space left on device\n"),
        ("RuntimeError('two\\nlines')", 70, "RuntimeError: two lines;"),
    ],
)
def test_other_ends(elid, problem, code, words) -> None:
    done = elid.python(BUG.format(problem=problem), "effects")
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert bool(done.stderr) == bool(words)


SLOW = """
import sys, time
import elid_cli.model.effects
from elid_cli.cli import main
def effect_classes():
    sys.stderr.write("ready\\n"); sys.stderr.flush()
    time.sleep(60)
elid_cli.model.effects.effect_classes = effect_classes
sys.exit(main(sys.argv[1:]))
"""


def test_control_c_is_quiet_and_130(elid, tmp_path: Path) -> None:
    report = tmp_path / "report.md"
    command = [sys.executable, "-c", SLOW, "effects", "--report", str(report)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=interruptible
    ) as process:
        assert process.stderr is not None
        process.stderr.readline()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (130, "", "")
    assert list(tmp_path.iterdir()) == []


def test_a_closed_pipe_is_quiet_and_141(elid) -> None:
    done = elid.shell("elid effects --json | head -1; echo ${PIPESTATUS[0]} >&2; true > >(exec 1>&-)")
    # The pipe may close before or after the last byte; what counts is that nobody complains.
    assert done.stdout == "{\n"
    assert done.stderr.strip() in ("0", "141")
    never_read = elid.python(
        "import os, sys; from elid_cli.cli import main\n"
        "r, w = os.pipe(); os.dup2(w, 1); os.close(w); os.close(r)\n"
        "sys.exit(main(['effects', '--json']))"
    )
    assert (never_read.returncode, never_read.stderr) == (141, "")


def test_a_file_to_write_may_be_the_pipe_that_stdout_is(elid) -> None:
    code = "from elid_cli.files import write_text; write_text('/dev/stdout', 'whole')"
    assert elid.python(code).stdout == "whole"


def test_closed_descriptors_do_no_harm(elid) -> None:
    assert elid.shell("elid effects >&-").stderr == ""
    assert elid.shell("elid effects 2>&- >/dev/null").returncode == 0
    assert elid.shell("elid nonsense 2>&-").returncode == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("command", ["elid effects", "elid effects --json", "elid --help", "elid --version"])
def test_a_full_disk_is_a_clear_error(elid, command) -> None:
    done = elid.shell(f"{command} > /dev/full")
    assert done.returncode == 2
    assert done.stderr == "error: standard output: no space left on device\n"


def test_a_pipe_gets_no_escape_codes_and_silence_on_stderr(elid) -> None:
    for env in ({}, {"FORCE_COLOR": "1"}, {"CLICOLOR_FORCE": "1", "FORCE_COLOR": "3"}):
        for form in ([], ["--json"], ["--markdown"]):
            done = elid("effects", *form, **env)
            assert ESCAPE not in done.stdout
            assert done.stderr == ""
    assert json.loads(elid("effects", "--json", FORCE_COLOR="1").stdout)["schema"] == "elid/1"
    assert ESCAPE not in elid("nonsense", FORCE_COLOR="1").stderr


def test_a_terminal_gets_colour_unless_it_says_no(elid) -> None:
    assert ESCAPE in elid.terminal("effects")[1]
    assert ESCAPE in elid("effects", "--color", "always").stdout
    assert ESCAPE not in elid("effects", "--color", "always", "--json").stdout
    for arguments, env in [((), {"NO_COLOR": "1"}), ((), {"TERM": "dumb"}), (("--color", "never"), {})]:
        assert ESCAPE not in elid.terminal("effects", *arguments, **env)[1]
        assert ESCAPE not in elid.terminal("effects", "nonsense", *arguments, **env)[1]
    assert f"{ESCAPE}[1;31merror:" in elid.terminal("effects", "nonsense")[1]


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
@pytest.mark.parametrize("form", [[], ["--json"], ["--markdown"]])
def test_no_encoding_of_stdout_crashes(elid, encoding, form) -> None:
    done = subprocess.run(
        [*elid.command, "effects", "stribeck", *form], capture_output=True, check=False,
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )  # fmt: skip
    assert done.returncode == 0
    assert done.stderr == b""
    text = done.stdout.decode(encoding)
    assert ("N*m" if encoding == "ascii" and form[:1] != ["--json"] else "N") in text


def test_the_c_locale_works(elid, tmp_path: Path) -> None:
    place = tmp_path / "Prüfung 1"
    place.mkdir()
    done = elid("effects", "stribeck", "--report", str(place / "Größe.md"), LC_ALL="C", PYTHONUTF8="0",
                PYTHONCOERCECLOCALE="0")  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.isascii()
    assert "N·m" in (place / "Größe.md").read_text("utf-8")
    missing = elid("effects", "--report", str(place / "fehlt" / "ä.md"), LC_ALL="C")
    assert missing.returncode == 2
    assert "Traceback" not in missing.stderr


def test_a_name_that_is_no_unicode_is_said_as_it_is(elid, tmp_path: Path) -> None:
    done = subprocess.run(
        [*elid.command, b"effects", b"--report", b"no\xff/x.md"], capture_output=True, cwd=tmp_path, check=False
    )
    assert done.returncode == 2
    assert b"error: no\xff/x.md: no folder no\xff" in done.stderr


def test_a_read_only_home_does_no_harm(elid, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir(mode=0o500)
    done = elid("effects", HOME=str(home), XDG_CACHE_HOME=str(home), XDG_CONFIG_HOME=str(home))
    assert (done.returncode, done.stderr) == (0, "")
    assert list(home.iterdir()) == []


@pytest.mark.parametrize("form", [[], ["--json"], ["--markdown"]])
def test_same_input_same_bytes(elid, form) -> None:
    assert elid("effects", *form).stdout == elid("effects", *form, PYTHONHASHSEED="7").stdout


def test_report_files_follow_their_suffix(elid, tmp_path: Path) -> None:
    done = elid("effects", "--report", "a.json", "--report", "b.md", "--report", "c.txt", cwd=tmp_path)
    assert done.returncode == 0
    assert json.loads((tmp_path / "a.json").read_text())["command"] == "effects"
    assert "| --- |" in (tmp_path / "b.md").read_text()
    assert "stribeck" in (tmp_path / "c.txt").read_text()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "b.md", "c.txt"]


def complete(elid, words: str, shell: str = "bash") -> list[str]:
    line = words.split(" ")
    env = {"_ELID_COMPLETE": f"{shell}_complete", "COMP_WORDS": words, "COMP_CWORD": str(len(line) - 1)}
    done = elid(**env)
    assert done.stderr == ""
    return [item.partition(",")[2] for item in done.stdout.splitlines()]


def test_completion(elid) -> None:
    assert "effects" in complete(elid, "elid eff")
    assert "--version" in complete(elid, "elid --v")
    assert "--markdown" in complete(elid, "elid effects --ma")
    assert "stribeck" in complete(elid, "elid effects str")
    assert complete(elid, "elid effects --color n") == ["never"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(elid, shell) -> None:
    done = elid("completion", shell)
    assert done.returncode == 0
    assert f"_ELID_COMPLETE={shell}_complete" in done.stdout
    if shell == "bash":
        assert elid.shell('eval "$(elid completion bash)" && complete -p elid').returncode == 0


def test_a_file_to_write_is_named_once(elid) -> None:
    # the first of two was never written, and nothing said so
    done = elid("simulate", "--robot", "planar2", "-o", "a.csv", "-o", "b.csv")
    assert done.returncode == 2
    assert "given 2 times" in done.stderr
    assert elid("diagnose", "none.csv", "--robot", "planar2", "--check", "a.csv", "--check", "b.csv").returncode == 3

"""Pictures of the page as people see it: wide, on a telephone, dark, printed; with sizes and times.

    python -m tests.system.reproduce.pages FOLDER [CASE…]

For a planar arm with friction that the model lacks, a seven-joint arm of 40 s, a log before anything is fitted and,
where the measured logs are at hand, a flexible link and a seven-joint arm; all or the cases named. Needs chromium, and
pdftoppm for pictures of the printed pages.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from elid_cli.cli import main as elid
from tests.system.browser.chromium import Browser

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data"
SEVEN = """\
name: seven
gravity: [0, 0, -9.81]
dh: standard
joints:
{joints}
"""
JOINT = """\
  - {{name: joint{k}, a: 0, alpha: {alpha}, d: {d}, theta: 0, gear_ratio: 100, motor_axis: [0, 0, 1],
     limits: {{position: [-2, 2], velocity: 2, acceleration: 8, torque: 300}},
     parameters: {{m: 2.5, cx: 0.05, cy: 0.02, cz: -0.3, Ixx: 1.2, Iyy: 1.2, Izz: 0.9, Ixy: 0.001, Ixz: 0.002,
       Iyz: 0.001, Jm: 4.0e-5, fs: 1.2, fv: 0.8, K: {stiffness}}}}}
"""


def seven(path: Path) -> Path:
    """Write a seven-joint arm."""
    joints = "".join(
        JOINT.format(k=k, alpha=(1.5707963, -1.5707963)[k % 2], d=0.35 if k % 2 else 0.0, stiffness=20000 - 2000 * k)
        for k in range(1, 8)
    )
    path.write_text(SEVEN.format(joints=joints), "utf-8")
    return path


def main() -> None:
    """Make pages and pictures of them, and print what they cost."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    cases = _cases(folder)
    with Browser() as seen:
        for name in sys.argv[2:] or cases:
            line = cases[name]
            page = folder / f"{name}.html"
            plain, whole = (_cost([*line, *more]) for more in ((), ("--report", str(page))))
            size = page.stat().st_size / 1e6
            for look, width, dark in (("wide", 1280, False), ("telephone", 400, False), ("dark", 1280, True)):
                seen.open(page, width, dark=dark)
                time.sleep(0.5)
                (folder / f"{name}_{look}.png").write_bytes(seen.picture(whole=True))
            seen.open(page)
            (folder / f"{name}.pdf").write_bytes(printed := seen.printed())
            sheets = len(re.findall(rb"/Type /Page\b", printed))
            cost = f"{whole - plain:.1f} s of processor time on top of {plain:.1f} s"
            print(f"{name}: {size:.2f} MB, {cost}, {sheets} printed pages", flush=True)
            if shutil.which("pdftoppm"):
                subprocess.run(["pdftoppm", "-r", "50", "-png", str(folder / f"{name}.pdf"), str(folder / f"{name}_p")],
                               check=True)  # fmt: skip


def _cases(folder: Path) -> dict[str, list[str]]:
    """Return the commands whose pages are looked at."""
    arm, log = seven(folder / "seven.yaml"), folder / "seven.h5"
    if not log.exists():
        elid(["simulate", "--robot", str(arm), "--duration", "40", "--rate", "500", "--counts", "1000000", "--quiet",
              "--torque-noise", "0.3%", "-o", str(log)])  # fmt: skip
    cases = {
        "seven": ["identify", str(log), "--robot", str(arm)],
        "planar2": ["diagnose", str(ROOT / "sample_logs/planar2_stribeck.h5"), "--robot", "planar2"],
        "log": ["plot", str(ROOT / "sample_logs/puma560_load.mcap"), "--robot", "puma560"],
    }
    if DATA.is_dir():
        quanser, panda = ["quanser_2dsfl.csv", "quanser_2dsfl"], ["panda_a.csv.gz", str(DATA / "panda.yaml")]
        cases["quanser"] = ["diagnose", str(DATA / quanser[0]), "--robot", quanser[1]]
        cases["panda"] = ["identify", str(DATA / panda[0]), "--robot", panda[1]]
    return cases


def _cost(line: list[str]) -> float:
    """Return the processor time of a command, s, in a process of its own."""
    program = "import sys, time; from elid_cli.cli import main; main(sys.argv[1:]); "
    program += "print(time.process_time(), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program, *line, "--quiet"], capture_output=True, text=True, check=True)
    return float(done.stderr.split()[-1])


if __name__ == "__main__":
    main()

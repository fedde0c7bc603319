"""Every public robot of up to 60 joints moves for a second, as its torques make it.

    python -m tests.system.reproduce.public_robots [--joints FROM TO] [--limit SECONDS] [WORD ...]

Prints name, joints, processor time in s, the largest difference between the torques of the simulation and those of
inverse dynamics, over the largest torque, and what went wrong. Needs the extra ``robots``.
"""

from __future__ import annotations

import argparse
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from elid_cli.errors import ElidError
from elid_cli.robot.files import read_robot
from tests.system.public_robots import MOST, NO_ROBOT, files, movable, moved, torque_error

LIMIT = 1e-8


def stop(number: int, frame: object) -> NoReturn:
    """Stop what runs, as its processor time is over."""
    raise TimeoutError


def result_of(path: Path, limit: float) -> tuple[float, str]:
    """Return the processor time of a second's motion and what came of it; none takes longer than the limit."""
    robot = movable(read_robot(path))
    start = time.process_time()
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    try:
        error = torque_error(robot, moved(robot))
    except TimeoutError:
        return time.process_time() - start, "stopped"
    except ElidError as fault:
        return time.process_time() - start, f"failed: {fault.message}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    said = f"{error:.1e}" if error < LIMIT else f"{error:.1e}, more than {LIMIT:g}"
    return time.process_time() - start, said


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line per robot, those of few joints first; return how many went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--joints", type=int, nargs=2, default=(1, MOST), help="fewest and most joints of a robot")
    parser.add_argument("--limit", type=float, default=0, help="processor time in s after which one is stopped")
    parser.add_argument("words", nargs="*", help="only files whose path has one of them, such as tiago.urdf")
    options = parser.parse_args(arguments)
    chosen = [path for path in files() if any(word in str(path) for word in options.words or [""])]
    robots = [(read_robot(path).n, path) for path in chosen if path.name not in NO_ROBOT]
    signal.signal(signal.SIGVTALRM, stop)
    wrong = tried = 0
    for joints, path in sorted(robots):
        if not options.joints[0] <= joints <= options.joints[1]:
            continue
        seconds, said = result_of(path, options.limit)
        tried += 1
        wrong += any(word in said for word in ("failed", "more", "stopped"))
        print(f"{path.parent.name + '/' + path.name:42} {joints:3} {seconds:6.1f}  {said}", flush=True)
    print(f"{tried - wrong} of {tried} robots as their torques make them")
    return wrong


if __name__ == "__main__":
    raise SystemExit(main())

"""How often the member of the friction family that made a log is the one supported.

    python -m tests.system.reproduce.friction_family [SEEDS]

The logs are the pendulum's of tests/diagnosis/test_friction_family.py: 24 s at 250 Hz, torque noise of 0.02 N·m.
"""

from __future__ import annotations

import sys

from tests.diagnosis.test_friction_family import CASES, compared, log_of


def main(seeds: int = 10) -> None:
    """Print one line per member: logs, supported as made, what was supported instead."""
    print("made by  logs  supported  instead")
    for member, values in CASES.items():
        found = [compared(log_of(values, seed)).supported["hinge"] for seed in range(seeds)]
        other = " ".join(name for name in found if name != member) or "-"
        print(f"{member:7}  {seeds:4d}  {found.count(member):9d}  {other}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

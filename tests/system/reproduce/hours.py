"""An hour's numbers against the truth: z values of what is supported, with and without edges between the blocks.

    python -m tests.system.reproduce.hours [--minutes 60] [--robot puma560]

The hour is generated in blocks of 20 s. `seamless` has exact torques throughout; in `edges` the motors' accelerations
are one-sided differences at both ends of every block, so that its torques jump there, which no robot does: what the
second log is off by is the fault of how it was made. A value is off by z standard errors; of 95 in 100, |z| is below 2.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from elid_cli import LogRequest, identify_logs
from elid_cli.robot.files import read_robot
from tests.system.benchmarks.made import MARGIN, write_hdf5


def main() -> None:
    """Print the z values of both hours."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--robot", default="puma560")
    parser.add_argument("--all", action="store_true", help="print every value, not only those with |z| above 2")
    chosen = parser.parse_args()
    robot = read_robot(chosen.robot)
    for label, margin in (("seamless", MARGIN), ("edges", 0)):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "hour.h5"
            write_hdf5(robot, path, 60.0 * chosen.minutes, margin=margin)
            found = identify_logs(LogRequest((str(path),), robot)).found
        known = [p for p in found.parameters if p.verdict == "supported"]
        z = np.array([(p.estimate - p.reference) / p.std_error for p in known])
        off = np.array([abs(p.estimate / p.reference - 1) if p.reference else np.nan for p in known])
        inside, rms = np.mean(np.abs(z) < 1.96), np.sqrt(np.mean(z**2))
        print(f"{chosen.robot}, {chosen.minutes:g} min, {label}: {len(known)} of {len(found.parameters)} supported,")
        print(f"  {inside:.0%} of the intervals hold the truth, z rms {rms:.2f}, largest |z| {np.abs(z).max():.1f},")
        print(f"  largest relative error {np.nanmax(off):.2%}, median {np.nanmedian(off):.3%}; model {found.model}")
        for p, score, share in zip(known, z, off, strict=True):
            if chosen.all or abs(score) > 2:
                print(f"    {str(p.name)[:60]:60} {p.estimate:12.5g} {p.reference:12.5g} z {score:6.1f} {share:8.2%}")


if __name__ == "__main__":
    main()

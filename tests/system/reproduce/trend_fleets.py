"""How often ``elid trend`` finds wear, and how often it names a change where there is none.

    python -m tests.system.reproduce.trend_fleets [--fleets 200]

Every fleet is one machine of 40 parameters over its recordings. Values scatter between recordings by twice the standard
error of one recording, which the standard errors do not know.
"""

from __future__ import annotations

import argparse

import numpy as np

from elid_cli.estimation.comparison import Estimate, SavedResult
from elid_cli.estimation.trend.trends import Trends, trend

PARAMETERS = 40
ERROR, BETWEEN = 0.002, 0.004
"""Standard error of one recording and spread between recordings, as parts of a value."""
WEAR = 0.03 / 100
"""Part of a value by which the worn parameter falls from one recording to the next."""


def fleet(seed: int, recordings: int, wear: float = 0.0, parameters: int = PARAMETERS) -> Trends:
    """Return the trends of one machine; the first parameter wears."""
    rng = np.random.default_rng(seed)
    values = 1.0 + np.hypot(ERROR, BETWEEN) * rng.standard_normal((recordings, parameters))
    values[:, 0] -= wear * np.arange(recordings)
    results = [
        SavedResult(f"{k}.json", "arm", {f"p{j}": Estimate(float(v), ERROR, "N·m") for j, v in enumerate(row)}, {})
        for k, row in enumerate(values)
    ]
    return trend(results)


def main() -> None:
    """Print both shares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--fleets", type=int, default=200)
    count = parser.parse_args().fleets
    found = sum(fleet(seed, 60, WEAR).trends[0].word in ("trend", "step") for seed in range(count))
    quiet = sum(bool(fleet(10_000 + seed, 100).of("trend", "step")) for seed in range(count))
    print(f"wear of 3 % per 100 recordings named by recording 60: {found} of {count}")
    print(f"quiet machines of {PARAMETERS} parameters and 100 recordings with a change named: {quiet} of {count}")


if __name__ == "__main__":
    main()

"""How often ``elid trend`` finds wear, and how often it names a change where there is none.

    python -m tests.system.reproduce.trend_fleets [--fleets 200]

Every fleet is one machine of 40 parameters over its recordings. Values scatter between recordings by twice the standard
error of one recording, which the standard errors do not know.

A warming robot is five recordings of twelve joints: viscous friction falls by 15 to 25 % from first to last, each
joint by a share of its own, and scatters by 6 % between recordings; inertias and Coulomb friction stay.
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


def warming(seed: int, fall: tuple[float, float] = (0.15, 0.25), joints: int = 12, recordings: int = 5) -> Trends:
    """Return the trends of a robot that warms up, or of one that does not."""
    rng = np.random.default_rng(seed)
    kinds = {"fv": 0.06, "fs": 0.06, "Ja": 0.02}
    results = []
    falls = rng.uniform(*fall, joints)
    for k in range(recordings):
        values = {
            f"{kind}{j + 1}": (1.0 - falls[j] * (kind == "fv") * k / (recordings - 1))
            * (1.0 + scatter * rng.standard_normal())
            for kind, scatter in kinds.items()
            for j in range(joints)
        }
        told = {name: Estimate(float(value), 0.02, "N·m") for name, value in values.items()}
        results.append(SavedResult(f"{k}.json", "dog", told, {}))
    return trend(results)


def changed(found: Trends) -> list[str]:
    """Return what is named: parameters, and kinds of them that change together."""
    alone = [item.series.name for item in found.of("trend", "step")]
    return alone + [family.kind for family in found.families if family.named]


def main() -> None:
    """Print both shares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--fleets", type=int, default=200)
    count = parser.parse_args().fleets
    found = sum(fleet(seed, 60, WEAR).trends[0].word in ("trend", "step") for seed in range(count))
    quiet = sum(bool(changed(fleet(10_000 + seed, 100))) for seed in range(count))
    warm = [changed(warming(seed)) for seed in range(count)]
    cool = sum(bool(changed(warming(20_000 + seed, (0.0, 0.0)))) for seed in range(count))
    print(f"wear of 3 % per 100 recordings named by recording 60: {found} of {count}")
    print(f"quiet machines of {PARAMETERS} parameters and 100 recordings with a change named: {quiet} of {count}")
    print(
        f"warming robots whose viscous friction is named: {sum('fv' in names for names in warm)} of {count}; "
        f"anything else named: {sum(bool(set(names) - {'fv'}) for names in warm)}"
    )
    print(f"such robots at one temperature with a change named: {cool} of {count}")


if __name__ == "__main__":
    main()

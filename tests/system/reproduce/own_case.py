"""The paper's own case: friction of eq. (43) in the data, Coulomb and viscous friction in the model.

    python -m tests.system.reproduce.own_case --motions 5 6 --db 80

Prints what `diagnose` names, the normalised mean error of the base parameters before and after, and that of an
identification in which both forms of eq. (43) are declared at both joints, by the default and the accurate estimator.
Noise is on positions only, or with --rates on positions and velocities separately.
"""

from __future__ import annotations

import argparse

import numpy as np

from elid_cli.diagnosis import diagnose
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare
from tests.system.reproduce.paper_logs import Array, by_elid, log_of, motion_of, with_friction


def error(base_values: Array, truth: Array) -> float:
    """Return the normalised mean error; parameters that are truly 0 count as no error."""
    zero = np.abs(truth) < 1e-9
    return float(np.mean(np.where(zero, 0.0, np.abs(base_values - truth) / np.where(zero, 1.0, np.abs(truth)))))


def main() -> None:
    """Run the case and print one line per motion."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, nargs="+", default=[5, 6])
    parser.add_argument("--db", type=float, default=80.0)
    parser.add_argument("--rates", action="store_true")
    parser.add_argument("--duration", type=float, default=20.0)
    parser.add_argument("--declared", action="store_true", help="only the identification with both forms declared")
    options = parser.parse_args()
    robot = read_robot("planar2")
    plain, told = with_friction(robot, known=True), with_friction(robot, known=False)
    bare = type(robot)(**{**robot.__dict__, "effects": ()})
    base = find_base(Regressor(bare))
    truth = base.values(bare.reference())
    print(f"normalised mean error, {options.db:g} dB, {'positions and velocities' if options.rates else 'positions'}")
    for seed in options.motions:
        simulation = motion_of(plain, seed, options.duration)
        recording, rates = log_of(simulation, options.db, seed, rates=options.rates)
        declared = [
            by_elid(told, simulation, options.db, seed, rates=options.rates, accurate=accurate).normalised_mean_error()
            for accurate in (False, True)
        ]
        last = "eq. (43) declared: default {:.4f}, accurate {:.4f}".format(*declared)
        if options.declared:
            print(f"motion {seed}: {last}", flush=True)
            continue
        found = diagnose(bare, prepare(recording, bare, SignalOptions.for_diagnosis(1.0 / recording.dt), rates))
        named = ", ".join(f"{e.effect}@{e.joint}" for e in found.effects) or "nothing"
        before, after = (error(base.transform @ s.standard, truth) for s in (found.state_before, found.state_after))
        print(f"motion {seed}: before {before:.4f}, after {after:.4f} ({named}); {last}", flush=True)


if __name__ == "__main__":
    main()

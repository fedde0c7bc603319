"""How often the band of the motions of ``elid sample``'s sets holds the measured motion of runs that nobody fitted.

    python -m tests.system.reproduce.sample_band [--sets 24] [--simulated] [--folder ../shared/data]

Three runs are identified by trajectory, sets are drawn from the three results together (the spread between recordings
included), each is replayed under the commands of two other runs, and the share of measured positions inside the
pointwise 95 % band is printed, joint by joint. Four bands are compared: what `elid sample` draws; with the drives'
offsets and delays, which are no parameters of the robot, drawn as well; that with what the three fits leave of
their own runs added as noise; and that noise alone about the mean motion. `--simulated` does the same on logs of a
plant that shares no code with elid, whose truth is known.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli._types import Array
from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.estimation.result import Identification
from elid_cli.estimation.sampling.sets import sample
from elid_cli.experiment.replay import replay
from elid_cli.logs import robot_as_logged
from elid_cli.logs.reading import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant

FITTED, UNSEEN = 3, 2
WIDTH = 1.96
"""Standard deviations of a 95 % band."""
TITLES = ("parameters", "+ drives", "+ residual", "residual alone")


def go2(folder: Path) -> tuple[Robot, list[Recording]]:
    """Return the measured machine and its five runs."""
    robot = read_robot(str(folder / "go2.xml"))
    files = [str(folder / f"go2_{k}.h5") for k in range(FITTED + UNSEEN)]
    seen = robot_as_logged(robot, [files[0]])
    return seen, [read_recording([name], seen) for name in files]


def simulated(folder: Path) -> tuple[Robot, list[Recording]]:
    """Return the plant's robot and five runs of it."""
    robot = plant.robot(folder)
    files = [plant.written(folder, f"run{k}.h5", plant.moved(40 + k, 16.0, sweep=0.15)) for k in range(FITTED + UNSEEN)]
    return robot, [read_recording([name], robot) for name in files]


def drives(results: Sequence[Identification], count: int, rng: np.random.Generator) -> Iterator[list[EffectSpec]]:
    """Yield offsets and delays of the drives, drawn about their mean over the results with the spread between them."""
    found: dict[tuple[str, str | None, str], list[float]] = {}
    for result in results:
        for nuisance in result.nuisances:
            for name, value in nuisance.parameters.items():
                found.setdefault((nuisance.effect, nuisance.joint, name), []).append(value)
    for _ in range(count):
        specs = []
        for (effect, joint, name), values in found.items():
            known = [*values, *[0.0] * (len(results) - len(values))]  # not significant counts as none
            spread = float(np.std(known, ddof=1)) * float(np.sqrt(1 + 1 / len(known)))
            specs.append(EffectSpec(effect, joint, {name: float(np.mean(known)) + spread * rng.standard_normal()}))
        yield specs


def motions(robots: Sequence[Robot], recording: Recording) -> tuple[Array, Array]:
    """Return simulated positions of every robot, (robots, M, n), and the measured ones, (M, n)."""
    replays = [replay(robot, recording) for robot in robots]
    return np.stack([item.simulated for item in replays]), replays[0].measured


def held(moved: Array, measured: Array, noise: Array, *, spread: bool) -> Array:
    """Return the share of measured positions inside the 95 % band, joint by joint, (n,)."""
    own = moved.std(axis=0, ddof=1) if spread else 0.0
    inside = np.abs(measured - moved.mean(axis=0)) <= WIDTH * np.sqrt(own**2 + noise**2)
    return np.asarray(np.mean(inside, axis=0))


def main(robot: Robot, recordings: Sequence[Recording], count: int) -> dict[str, Array]:
    """Print and return the shares held by each band, one row per unseen run, (runs, n)."""
    options = EstimateOptions(fit="trajectory")
    bare = replace(robot, effects=())
    results = [identify(bare, prepare(log, bare), options) for log in recordings[:FITTED]]
    own = [replay(identified_robot(r), log).difference for r, log in zip(results, recordings, strict=False)]
    residual = np.sqrt(np.nanmean(np.concatenate(own) ** 2, axis=0))
    # what no result shows, an armature beside a delay, is held at what one of them found
    sets = sample(results, count, replace(identified_robot(results[0]), effects=()))
    plain = sets.robots()
    driven = [
        replace(one, effects=(*one.effects, *specs))
        for one, specs in zip(plain, drives(results, count, np.random.default_rng(5)), strict=True)
    ]
    shares: dict[str, list[Array]] = {title: [] for title in TITLES}
    for log in recordings[FITTED:]:
        moved, measured = motions(plain, log)
        shares["parameters"].append(held(moved, measured, np.zeros_like(residual), spread=True))
        moved, measured = motions(driven, log)
        shares["+ drives"].append(held(moved, measured, np.zeros_like(residual), spread=True))
        shares["+ residual"].append(held(moved, measured, residual, spread=True))
        shares["residual alone"].append(held(moved, measured, residual, spread=False))
    print(f"{count} sets, {FITTED} runs fitted, {len(recordings) - FITTED} unseen; inside the 95 % band, %:")
    print(f"{'joint':>20}" + "".join(f" {title:>15}" for title in TITLES))
    table = {title: np.array(rows) for title, rows in shares.items()}
    for k, joint in enumerate(robot.joint_names):
        print(f"{joint:>20}" + "".join(f" {100 * table[title][:, k].mean():>15.1f}" for title in TITLES))
    print(f"{'all':>20}" + "".join(f" {100 * table[title].mean():>15.1f}" for title in TITLES))
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=24)
    parser.add_argument("--simulated", action="store_true")
    parser.add_argument("--folder", type=Path, default=Path(__file__).parents[4] / "shared" / "data")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        chosen = simulated(Path(name)) if asked.simulated else go2(asked.folder)
        main(*chosen, asked.sets)

"""Drives whose loops run at periods that are no part of a log's sample, under the commands of a policy."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.estimation.trajectory.decided import fit_with_columns
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.estimation.trajectory.loop_periods import late_commands
from elid_cli.experiment.replay.replay import ReplayOptions, replay
from elid_cli.model.drives import parts_of_loops
from elid_cli.model.effects.of_drives import holding
from elid_cli.robot.files import read_robot
from elid_cli.robot.robot import EffectSpec
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, DT, KD, KP, NAMES, OFFSET, VISCOUS, robot, written
from tests.estimation.trajectory.test_simulator_steps import NOISE, moved, scores, steps_of, told

TRUTH = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
STEP = DT / 10
LIVELY = 0.1
"""rad; smooth motion hardly shows loops."""
POLICY = 4
"""Samples for which a command stays."""


def periods_of(found: dict[str, object]) -> dict[str, float]:
    nuisances = found["nuisances"]
    return {item["joint"]: item["parameters"]["period"] for item in nuisances if item["effect"] == "held_loop"}  # type: ignore[attr-defined]


@pytest.mark.parametrize("period", [2.5e-3, 4e-3, 1e-2])
def test_a_loop_in_a_simulator_is_found_with_its_period(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], period: float
) -> None:
    """Without it viscous friction was 2 to 20 % too small, hundreds of its errors, and nothing said so."""
    found = told(tmp_path, capsys, moved(6, 7.5, STEP, every=POLICY, loop=period, lively=LIVELY))
    assert periods_of(found) == {name: pytest.approx(period) for name in NAMES}
    assert all(own["step"] == pytest.approx(STEP) for own in steps_of(found).values())
    assert np.abs(scores(found)).max() < 4
    assert np.all(0.5 * period * KP > 0.05 * VISCOUS)
    assert np.all(0.5 * period * KD > 0.02 * ARMATURE)

    again, other = (
        read_robot(tmp_path / "found.yaml"),
        moved(8, 5.0, STEP, every=POLICY, loop=period, lively=LIVELY, speeds=True),
    )
    assert replay(again, other).mean_abs < 1.1 * NOISE
    assert replay(again, other, ReplayOptions(horizon=0.5)).mean_abs < 1.5 * NOISE  # stretches begin within a period
    assert replay(again, other, ReplayOptions(engine="mujoco")).mean_abs < 5 * NOISE
    bare = replace(again, effects=tuple(spec for spec in again.effects if spec.effect != "held_loop"))
    assert replay(bare, other).mean_abs > 3 * NOISE


def test_a_declared_loop_of_two_thirds_of_a_sample_is_simulated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    period = 2.0 / 3.0 * DT
    log = written(tmp_path, "log.h5", moved(6, 7.5, DT / 12, every=POLICY, loop=period, lively=LIVELY))
    arm = tmp_path / "pendulums.elid.yaml"
    arm.write_text("effects:\n" + "".join(
        f"  - {{effect: held_loop, joint: {name}, parameters: {{period: {period}}}}}\n" for name in NAMES
    ))  # fmt: skip
    line = ["identify", log, "--robot", str(robot(tmp_path).source), "--fit", "trajectory", "--json"]
    assert main(line) == 0
    assert np.abs(scores(json.loads(capsys.readouterr().out))).max() < 4
    arm.unlink()
    assert main(line) == 0
    assert np.abs(scores(json.loads(capsys.readouterr().out))).max() > 20


@pytest.mark.parametrize(
    ("period", "dt", "often"),
    [
        (5e-3, 5e-3, 1.0),
        (2e-3, 5e-3, 2.5),
        (5e-3, 4e-3, 0.8),
        (5e-3, 1e-3, 0.2),
        (5.1e-3, 5e-3, 1.0),
        (1e-4, 5e-3, 0.0),
    ],
)
def test_a_loop_runs_at_parts_of_a_sample(tmp_path: Path, period: float, dt: float, often: float) -> None:
    """A period that is a little off a sample is one, and one far shorter than a sample acts all the time."""
    arm = replace(robot(tmp_path), effects=(EffectSpec("held_loop", "two", {"period": period}),))
    np.testing.assert_allclose(holding(arm, dt), [0.0, often, 0.0], rtol=1e-12)


def test_instants_of_loops_fall_on_parts_of_a_sample() -> None:
    np.testing.assert_array_equal(parts_of_loops(np.array([0.0, 1.0, 2.5, 0.8, 0.2, 4.0])), [1, 1, 5, 4, 1, 4])


def test_a_loop_that_misses_commands_is_found_by_those_that_it_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Commands change at every sample of 5 ms; on average they are taken 3.5 ms late, as by a delay."""
    found = told(tmp_path, capsys, moved(6, 6.0, STEP, loop=8e-3))
    assert periods_of(found) == {name: pytest.approx(8e-3) for name in NAMES}
    assert np.abs(scores(found)).max() < 4
    late = [item["parameters"]["delay"] for item in found["nuisances"] if item["effect"] == "torque_delay"]  # type: ignore[attr-defined]
    assert np.abs(late).max(initial=0.0) < 5e-5

    # one of two samples hardly shows in smooth motion: the bound knows it
    open_one = told(tmp_path, capsys, moved(6, 6.0, STEP, loop=1e-2))
    assert open_one["settings"]["trajectory"]["unseen_loop"] == pytest.approx(1e-2)  # type: ignore[index]


def test_a_loop_takes_commands_later_the_longer_it_is(tmp_path: Path) -> None:
    recording, arm = moved(6, 3.0, STEP), robot(tmp_path)
    fit, _ = fit_with_columns(arm, commanded_runs(recording, arm), TRUTH)
    for period, late in ((DT, 0.0), (DT / 2, 0.0), (2 * DT, DT / 2), (1.6 * DT, 0.7 * DT)):
        np.testing.assert_allclose(late_commands(fit, period), late, atol=0.05 * DT)

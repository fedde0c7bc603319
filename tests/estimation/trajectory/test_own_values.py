"""Friction and torque offsets that changed between recordings: each has its own, and nothing else is bent by them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.identify import identify
from elid_cli.estimation.result import EstimateOptions
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.fit import TrajectoryFit
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.estimation.trajectory.normal_equations import simulated
from elid_cli.estimation.trajectory.softening import columns_of
from elid_cli.estimation.trajectory.unknowns import KINDS, PARAMETERS
from elid_cli.logs.reading import read_recording
from elid_cli.logs.writing import write_recording
from elid_cli.model.linearised import Linearised
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals, prepare
from tests.diagnosis.by_motion import plant

HELD = np.array([0.12, -0.08, 0.05])
OFFSETS = tuple((joint, KINDS.index("offset")) for joint in range(3))
TRUE = np.stack([plant.ARMATURE, plant.COULOMB, plant.VISCOUS], axis=1)


def _logs(folder: Path, seed: int, changes: tuple[np.ndarray, ...], **further: object) -> tuple[Robot, Signals]:
    arm, logs = plant.robot(folder), []
    for number, own in enumerate(changes):
        logs.append(str(folder / f"log{number}.h5"))
        write_recording(plant.moved(seed + number, 4.0, held=own, **further), Path(logs[-1]))  # type: ignore[arg-type]
    return arm, prepare(read_recording(logs, arm), arm)


def _fit(arm: Robot, signals: Signals) -> TrajectoryFit:
    assert signals.recording is not None
    return fit_trajectory(arm, commanded_runs(signals.recording, arm), started_from(arm, signals))


def test_each_recording_has_its_offsets_and_the_rest_is_as_if_they_had_one(tmp_path: Path) -> None:
    arm, signals = _logs(tmp_path, 30, (np.zeros(3), HELD, -0.5 * HELD))
    fit = _fit(arm, signals)
    assert fit.unknowns.own == OFFSETS
    assert (fit.above_noise(signals) < 1.1).all()
    assert fit.values[:, :3] == pytest.approx(TRUE, rel=2e-3)
    off = np.array([plant.OFFSET - own for own in (np.zeros(3), HELD, -0.5 * HELD)])
    assert fit.alone[:, 3:12:4] == pytest.approx(off, abs=5e-4)
    assert fit.values[:, 3] == pytest.approx(off.mean(axis=0), abs=5e-4)
    assert fit.unknowns.departures_of(fit.z).sum(axis=0) == pytest.approx(np.zeros((3, 4)), abs=1e-12)


def test_errors_of_the_rest_are_those_of_recordings_with_one_offset(tmp_path: Path) -> None:
    """One offset for both made them 78 to 250 times as large."""
    fits = [_fit(*_logs(tmp_path, 40, (np.zeros(3), own))) for own in (np.zeros(3), HELD)]
    assert [fit.unknowns.own for fit in fits] == [(), OFFSETS]
    same, own = (fit.unknowns.joint_values(fit.deviation) for fit in fits)
    assert (own[:, :3] < 1.5 * same[:, :3]).all()
    # of two offsets that are known, the mean is known no better than they scatter
    assert own[:, 3] == pytest.approx(np.abs(HELD) / 2, rel=0.02)


@pytest.mark.parametrize("changed", [True, False])
def test_standard_errors_hold_over_seeds(tmp_path: Path, changed: bool) -> None:
    apart = []
    for seed in range(50, 62, 2):
        fit = _fit(*_logs(tmp_path, seed, (np.zeros(3), HELD if changed else np.zeros(3))))
        errors = fit.unknowns.joint_values(fit.deviation)[:, :3]
        apart.append((fit.values[:, :3] - TRUE) / errors)
        assert bool(fit.unknowns.own) == changed
    assert 0.6 < float(np.sqrt(np.mean(np.square(apart)))) < 1.3


def test_friction_that_changed_is_each_recordings_own(tmp_path: Path) -> None:
    """Of one joint the viscous friction, of another one the Coulomb friction; the other values stay as sure."""
    arm, logs = plant.robot(tmp_path), []
    more = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.08, 0.0])
    for number in range(2):
        log = plant.moved(
            80 + number, 4.0, push=lambda q, dq, need, own=number: own * more[0] * dq,
            grip=lambda q, dq, need, own=number: own * more[1],
        )  # fmt: skip
        logs.append(str(tmp_path / f"log{number}.h5"))
        write_recording(log, Path(logs[-1]))
    signals = prepare(read_recording(logs, arm), arm)
    fit = _fit(arm, signals)
    assert fit.unknowns.own == ((0, KINDS.index("viscous")), (1, KINDS.index("coulomb")))
    assert (fit.above_noise(signals) < 1.1).all()
    alone = np.array([fit.unknowns.joint_values(z)[:, :3] for z in fit.alone])
    assert alone[0] == pytest.approx(TRUE, rel=5e-3)
    assert alone[1] == pytest.approx(TRUE + np.stack([np.zeros(3), more[1], more[0]], axis=1), rel=5e-3)
    said = diagnose_motion(arm, signals, None, ("link_spring",))
    assert not said.effects
    assert {(item.name, item.joint) for item in said.differing} == {("fv", "one"), ("fs", "two")}


def test_friction_that_changed_does_not_bend_the_shape_of_an_effect(tmp_path: Path) -> None:
    arm, logs = plant.robot(tmp_path), []
    for number in range(2):
        log = plant.moved(
            82 + number, 4.0, push=lambda q, dq, need: np.array([0.0, 0.0, 0.06]) * dq * np.abs(dq),
            grip=lambda q, dq, need, own=number: own * np.array([0.0, 0.0, 0.15]),
        )  # fmt: skip
        logs.append(str(tmp_path / f"log{number}.h5"))
        write_recording(log, Path(logs[-1]))
    found = diagnose_motion(arm, prepare(read_recording(logs, arm), arm), None, ("quadratic_viscous", "link_spring"))
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("quadratic_viscous", "three")
    for name, truth in (("amplitude", 0.06), ("power", 2.0)):
        assert abs(effect.parameters[name] - truth) < 4 * effect.std_error[name]
        assert effect.std_error[name] < 0.1 * truth
    assert {(item.name, item.joint) for item in found.differing} == {("fs", "three")}


def test_columns_are_the_slopes_of_the_motion(tmp_path: Path) -> None:
    arm, signals = _logs(tmp_path, 30, (np.zeros(3), HELD, -0.5 * HELD))
    fit = _fit(arm, signals)
    own, step, equations = fit.unknowns, 1e-3, Linearised(arm, without=PARAMETERS)

    def positions(z: np.ndarray) -> np.ndarray:
        items = [replace(item, local=None) for item in fit.tracked]
        return np.concatenate([simulated(equations, item, own, z, arm.reference(), plain=True).error for item in items])

    columns = np.concatenate(columns_of(fit))
    for k in range(own.departures.start, own.departures.stop):
        unit = step * np.eye(own.count)[k]
        slope = (positions(fit.z + unit) - positions(fit.z - unit)) / (2 * step)
        assert np.std(slope - columns[:, :, k]) < 0.03 * np.std(slope), k


def test_a_spring_in_other_poses_is_a_spring_and_no_change_of_offsets(tmp_path: Path) -> None:
    arm, signals = _logs(tmp_path, 60, (np.zeros(3),) * 2, push=lambda q, dq, need: np.array([0.0, 1.5 * q[1], 0.0]))
    found = diagnose_motion(arm, signals, None, ("link_spring",))
    assert [(e.effect, e.joint) for e in found.effects] == [("link_spring", "two")]
    assert found.fit_after.unknowns.own == ()
    assert not found.differing


def test_offsets_that_changed_do_not_hide_what_is_missing(tmp_path: Path) -> None:
    def spring(q: np.ndarray, dq: np.ndarray, need: np.ndarray) -> np.ndarray:
        return np.array([0.0, 1.5 * q[1], 0.0])

    arm, signals = _logs(tmp_path, 60, (np.zeros(3), HELD), push=spring)
    found = diagnose_motion(arm, signals, None, ("link_spring",))
    (effect,) = found.effects
    assert (effect.effect, effect.joint) == ("link_spring", "two")
    assert effect.parameters["stiffness"] == pytest.approx(1.5, rel=5e-3)
    assert {(item.name, item.joint) for item in found.differing} == {("offset", name) for name in plant.NAMES}
    assert all(item.after < 1.3e-4 for item in found.position.values())


def test_what_recordings_show_with_opposite_signs_is_no_effect(tmp_path: Path) -> None:
    """Each alone asks for a spring: one that pulls back, and one that pushes away."""
    arm, logs = plant.robot(tmp_path), []
    for number, stiffness in enumerate((1.0, -1.0)):

        def spring(q: np.ndarray, dq: np.ndarray, need: np.ndarray, own: float = stiffness) -> np.ndarray:
            return np.array([0.0, own * q[1], 0.0])

        logs.append(str(tmp_path / f"log{number}.h5"))
        write_recording(plant.moved(70 + number, 4.0, push=spring), Path(logs[-1]))
    found = diagnose_motion(arm, prepare(read_recording(logs, arm), arm), None, ("link_spring", "velocity_coupling"))
    assert not found.effects
    assert [item.joint for item in found.unexplained] == ["two"]


def test_identify_says_that_each_recording_has_its_own(tmp_path: Path) -> None:
    arm, signals = _logs(tmp_path, 30, (np.zeros(3), HELD))
    found = identify(arm, signals, EstimateOptions(fit="trajectory"))
    (said,) = [note for note in found.notes if "each recording has its own" in note]
    assert "its own torque offset of one, two and three in the simulated motion" in said
    told = found.drives["one"]["offset"]
    assert told["by_recording"]["estimate"] == pytest.approx([0.15, 0.15 - HELD[0]], abs=5e-4)
    assert all(0 < error < 5e-4 for error in told["by_recording"]["std_error"])
    assert "by_recording" not in found.drives["one"]["Ja"]

"""Drives whose held torque takes more from viscous friction than there is: the fit's friction ends at 0 beside them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.trajectory import simulator_steps
from elid_cli.estimation.trajectory.beginning import started_from
from elid_cli.estimation.trajectory.decided import fit_trajectory
from elid_cli.estimation.trajectory.held_loops import of_loops
from elid_cli.estimation.trajectory.identification import commanded_runs
from elid_cli.logs.reading import read_recording
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, DT, KD, KP, NAMES, OFFSET, VISCOUS, robot, written
from tests.estimation.trajectory import test_simulator_steps as simulator

LITTLE = 0.4 * 0.5 * DT * KP
"""N·m·s/rad; viscous friction of which a held torque leaves none."""


def told(folder: Path, capsys: pytest.CaptureFixture[str], log: Recording, *more: str) -> dict[str, object]:
    line = ["identify", written(folder, "log.h5", log), "--robot", str(robot(folder).source), "--json", *more]
    assert main(line) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def values(found: dict[str, object], name: str) -> tuple[np.ndarray, np.ndarray]:
    own = found["settings"]["trajectory"]["joint_parameters"].values()  # type: ignore[index]
    estimate, error = (np.array([joint[name][what] for joint in own]) for what in ("estimate", "std_error"))
    return estimate, error


def effects(found: dict[str, object], name: str) -> list[dict[str, object]]:
    return [item for item in found["nuisances"] if item["effect"] == name]  # type: ignore[attr-defined]


def test_loops_are_found_where_friction_ends_at_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plant, "VISCOUS", LITTLE)
    found = told(tmp_path, capsys, plant.moved(6, 7.5, noise=1e-4, once=True))
    assert [item["joint"] for item in effects(found, "held_loop")] == list(NAMES)
    for name, truth in (("Ja", ARMATURE), ("fv", LITTLE), ("fs", COULOMB)):
        estimate, error = values(found, name)
        assert np.abs((estimate - truth) / error).max() < 4, name
    np.testing.assert_allclose(values(found, "fv")[0], LITTLE, rtol=0.1)


def test_loops_under_coarse_encoders_are_found_or_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plant, "VISCOUS", LITTLE)
    for noise in (5e-3, 2e-2):
        found = told(tmp_path, capsys, plant.moved(6, 6.0, noise=noise, once=True))
        estimate, error = values(found, "fv")
        assert np.abs((estimate - LITTLE) / error).max() < 4
        assert effects(found, "held_loop") or (error > 0.2 * 0.5 * DT * KP).any()


def _thinned(log: Recording, every: int) -> Recording:
    """Return every so-many-th sample of a log, which holds no commanded velocity."""
    own = slice(None, None, every)
    commands = {name: part[own] for name, part in log.commands.items() if name != "dq_des"}
    q = log.q[own]
    return replace(log, dt=every * log.dt, t=log.t[own], q=q, theta=q, tau=np.full_like(q, np.nan), dq=None,
                   commands=commands, segments=(Segment(0, len(q)),))  # fmt: skip


def test_drives_that_are_told_no_rate_are_not_taken_to_be_told_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A slow log of commands that change all the time: a rate and a delay of samples made up for their stairs."""
    found = told(tmp_path, capsys, _thinned(plant.moved(6, 9.0, noise=1e-4, rates=False), 4))
    assert not any("told the rate of q_des, with" in note for note in found["notes"])  # type: ignore[attr-defined]
    assert all(abs(item["parameters"]["delay"]) < 4e-3 for item in effects(found, "torque_delay"))  # type: ignore[index]
    np.testing.assert_allclose(values(found, "Ja")[0], ARMATURE, rtol=0.2)
    np.testing.assert_allclose(values(found, "fv")[0], VISCOUS, rtol=0.1)


def test_commands_of_a_policy_are_not_smooth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = told(tmp_path, capsys, simulator.moved(6, 7.5, DT / 2, every=4))
    assert not any("change smoothly" in note for note in found["notes"])  # type: ignore[attr-defined]
    assert np.abs(simulator.scores(found)).max() < 4


def test_a_search_counts_steps_that_are_too_short_to_show(tmp_path: Path) -> None:
    arm, log = robot(tmp_path), simulator.moved(6, 7.5, DT / 40)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    fit = diagnose_motion(arm, signals, None, ("stribeck",)).fit_after
    error = fit.unknowns.joint_values(fit.deviation)[:, 0]
    assert fit.ahead > 0
    np.testing.assert_allclose(error, 0.5 * DT / 40 * KD, rtol=0.2)
    assert np.abs((fit.values[:, 0] - ARMATURE) / error).max() < 4


def test_a_filter_of_the_velocity_is_no_held_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both take from inertia and viscous friction: of two that are nearer than loops that act always, the nearest."""
    arm, log = robot(tmp_path), plant.moved(6, 7.5, noise=3e-5, smoothing=4e-3, rates=False)
    recording = read_recording([written(tmp_path, "log.h5", log)], arm)
    signals = prepare(recording, arm)
    fit = fit_trajectory(arm, commanded_runs(recording, arm), started_from(arm, signals))
    held = of_loops(replace(fit, z=fit.z * (np.arange(len(fit.z)) < fit.unknowns.delays.start)), 1, DT)
    assert held is not None
    monkeypatch.setattr(simulator_steps, "with_held_loops", lambda *given: held)
    found = simulator_steps.with_drives_in_time(fit, signals)
    assert found.tracked[0].run.drives.held is None
    np.testing.assert_allclose(found.filters, 4e-3, rtol=0.1)


def test_a_drive_that_is_off_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = plant.moved(6, 6.0)
    gains = {name: log.commands[name] * np.array([1.0, 1.0, 0.0]) for name in ("kp", "kd")}
    found = told(tmp_path, capsys, replace(log, commands={**log.commands, **gains}))
    assert any("three: no torque tau" in line for line in found["warnings"])  # type: ignore[attr-defined]


def test_a_fit_that_begins_nowhere_begins_again(tmp_path: Path) -> None:
    arm, log = robot(tmp_path), plant.moved(6, 6.0, noise=1e-4)
    recording = read_recording([written(tmp_path, "log.h5", log)], arm)
    fit = fit_trajectory(arm, commanded_runs(recording, arm), np.full((3, 4), 1e-7))
    truth = np.stack([ARMATURE, COULOMB, VISCOUS, OFFSET], axis=1)
    np.testing.assert_allclose(fit.values, truth, atol=0.01, rtol=0.03)

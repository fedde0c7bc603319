"""Simulators that take semi-implicit Euler steps, told by the motion of a plant that shares no code with elid."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.replay.replay import ReplayOptions, replay
from elid_cli.logs.reading import read_recording
from elid_cli.model.drives import Drives, Fading, Joints
from elid_cli.model.linearised import Linearised
from elid_cli.model.rollout_steps import advance, advance_arrays
from elid_cli.model.runs import runs_of
from elid_cli.robot.files import read_robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, DT, KD, KP, NAMES, VISCOUS, robot, written

NOISE = 3e-5
"""rad."""
STEP = DT / 5
TRUTH = {"Ja": ARMATURE, "fs": COULOMB, "fv": VISCOUS}


def moved(
    seed: int, duration: float, step: float, *, implicit: bool = False, every: int = 1, limit: float = np.inf,
    loop: float = 0.0, lively: float = 0.0, speeds: bool = False,
) -> Recording:  # fmt: skip
    """Return a log of the pendulums whose positions a simulator stepped, with the commands of the plant's own.

    Commands change `every` so many samples, as those of a policy, that tell no rates then. Drives deliver at most
    `limit`, N·m. They compute their torque every `loop` s and hold it until the next time; 0: in every step.
    Commands jump by `lively`, rad rms, beside the plant's own. Velocities are logged where `speeds`, without noise.
    """
    log = plant.moved(seed, duration, noise=0.0)
    each = round(DT / step)
    h, q_des, dq_des = DT / each, log.commands["q_des"], log.commands["dq_des"]
    if every > 1:
        q_des = q_des + lively * np.random.default_rng(seed + 70).standard_normal(q_des.shape)
        q_des, dq_des = q_des[np.arange(len(q_des)) // every * every], np.zeros_like(dq_des)
        log = replace(log, commands={**log.commands, "q_des": q_des, "dq_des": dq_des})
    inertia = plant.INERTIA + plant.MASS * plant.REACH**2 + ARMATURE
    weight = plant.MASS * plant.GRAVITY * plant.REACH
    # joints' own damping is taken at the step's end, that of the drives where it is implicit
    mass = inertia + h * (VISCOUS + (KD if implicit else 0.0))
    x, v, drive = q_des[0].copy(), np.zeros(3), np.zeros(3)
    q, dq = np.empty((2, *q_des.shape))
    for k in range(len(q)):
        q[k], dq[k] = x, v
        for now in range(k * each, (k + 1) * each):
            if now % max(round(loop / h), 1) == 0:
                drive = np.clip(KP * (q_des[k] - x) + KD * (dq_des[k] - v), -limit, limit)
            torque = drive - (plant.OFFSET + VISCOUS * v + weight * np.sin(x))
            free = v + h * torque / mass
            v = free - np.clip(free, -h * COULOMB / mass, h * COULOMB / mass)
            x = x + h * v
    q += NOISE * np.random.default_rng(seed + 50).standard_normal(q.shape)
    return replace(log, q=q, theta=q, dq=dq if speeds else np.full_like(q, np.nan))


def told(folder: Path, capsys: pytest.CaptureFixture[str], log: Recording) -> dict[str, object]:
    line = ["identify", written(folder, "log.h5", log), "--robot", str(robot(folder).source), "--fit", "trajectory"]
    assert main([*line, "--json", "--write-robot", str(folder / "found.yaml")]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def scores(found: dict[str, object], less: np.ndarray | float = 0.0) -> np.ndarray:
    """Return how many standard errors the values of every joint are off, inertias after `less` is taken off, (3, 3)."""
    values = found["settings"]["trajectory"]["joint_parameters"].values()  # type: ignore[index]
    taken = np.broadcast_to(less, 3)
    return np.array([
        [(own[name]["estimate"] - (taken[k] if name == "Ja" else 0.0) - truth[k]) / own[name]["std_error"]
         for name, truth in TRUTH.items()]
        for k, own in enumerate(values)
    ])  # fmt: skip


def steps_of(found: dict[str, object]) -> dict[str, dict[str, float]]:
    nuisances = found["nuisances"]
    return {item["joint"]: item["parameters"] for item in nuisances if item["effect"] == "euler_steps"}  # type: ignore[attr-defined]


def test_steps_are_found_and_the_written_robot_has_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = told(tmp_path, capsys, moved(6, 7.5, STEP))
    steps = steps_of(found)
    assert list(steps) == list(NAMES)
    assert all(own["step"] == pytest.approx(STEP) and own["implicit"] == 0 for own in steps.values())
    assert any("semi-implicit Euler steps of 1 ms" in note for note in found["notes"])  # type: ignore[attr-defined]
    assert np.abs(scores(found)).max() < 4
    # as smooth motion, inertia would be too small by this, many times its error
    assert np.all(0.5 * STEP * (KD - VISCOUS) > 0.01 * ARMATURE)

    again, other = read_robot(tmp_path / "found.yaml"), moved(8, 6.0, STEP)
    assert replay(again, other).mean_abs < 1.1 * NOISE
    assert replay(again, other, ReplayOptions(engine="mujoco")).mean_abs < 3 * NOISE  # its friction fades in
    bare = replace(again, effects=tuple(spec for spec in again.effects if spec.effect != "euler_steps"))
    assert replay(bare, other).mean_abs > 5 * NOISE
    odd = tuple(
        replace(spec, parameters={"step": 0.4 * DT}) if spec.effect == "euler_steps" else spec for spec in again.effects
    )
    assert not replay(again, other).left_out
    assert replay(replace(again, effects=odd), other).left_out  # no whole number of them is a sample
    signals = prepare(read_recording([written(tmp_path, "other.h5", other)], again), again)
    for joint in again.joint_names:
        assert validate(again, signals).error[joint].relative < 1.02 * validate(bare, signals).error[joint].relative


def test_steps_as_long_as_samples_are_no_smooth_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # half a sample ahead of held commands is what commands that change all the time look like, too
    found = told(tmp_path, capsys, moved(6, 7.5, DT))
    assert [own["step"] for own in steps_of(found).values()] == [pytest.approx(DT)] * 3
    assert not any("commands are taken to change smoothly" in note for note in found["notes"])  # type: ignore[attr-defined]
    assert np.abs(scores(found)).max() < 4


def test_implicit_damping_that_the_motion_does_not_tell_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = moved(6, 7.5, STEP, implicit=True)
    found = told(tmp_path, capsys, log)
    assert all(own["implicit"] == 0 for own in steps_of(found).values())
    assert any("declare euler_steps with implicit: 1" in note for note in found["notes"])  # type: ignore[attr-defined]
    assert np.abs(scores(found, STEP * KD)).max() < 4

    arm = tmp_path / "pendulums.elid.yaml"
    arm.write_text("effects:\n" + "".join(
        f"  - {{effect: euler_steps, joint: {name}, parameters: {{step: {STEP}, implicit: 1}}}}\n" for name in NAMES
    ))  # fmt: skip
    declared = told(tmp_path, capsys, log)
    assert np.abs(scores(declared)).max() < 4
    again = read_robot(tmp_path / "found.yaml")
    for engine in ("elid", "mujoco"):
        assert replay(again, log, ReplayOptions(engine=engine)).mean_abs < 3 * NOISE  # type: ignore[arg-type]


def test_steps_that_are_too_short_to_show_are_in_the_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = told(tmp_path, capsys, moved(6, 7.5, DT / 40))
    assert not steps_of(found)
    assert any("ahead of the commands, as in a simulator's steps" in note for note in found["notes"])  # type: ignore[attr-defined]
    assert np.abs(scores(found)).max() < 4
    values = found["settings"]["trajectory"]["joint_parameters"].values()  # type: ignore[index]
    lead = np.array([own["Ja"]["std_error"] for own in values])
    np.testing.assert_allclose(lead, 0.5 * DT / 40 * KD, rtol=0.2)


def test_steps_of_a_fifth_of_a_millisecond_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The next longer ones that were tried stood in for them: friction and inertia were five and seven errors off."""
    found = told(tmp_path, capsys, moved(6, 7.5, DT / 25))
    assert {round(own["step"], 6) for own in steps_of(found).values()} == {DT / 25}
    assert np.abs(scores(found)).max() < 4


def test_limits_are_found_in_the_steps_of_a_simulator(tmp_path: Path) -> None:
    """Found in smooth motion they were 1 to 2 % too low, many of their errors, and inertia with them."""
    arm, limit = robot(tmp_path), 3.0
    log = moved(6, 6.0, DT / 10, every=8, limit=limit)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("saturation",))
    assert found.effects
    for effect in found.effects:
        assert abs(effect.parameters["limit"] - limit) < 4 * effect.std_error["limit"]
        assert effect.std_error["limit"] < 0.01 * limit
    assert {spec.effect for spec in found.refined.effects} >= {"euler_steps"}
    error = found.fit_after.unknowns.joint_values(found.fit_after.deviation)[:, [0, 2]]
    truth = np.stack([ARMATURE, VISCOUS], axis=1)
    assert np.abs((found.fit_after.values[:, [0, 2]] - truth) / error).max() < 4


def test_a_search_has_the_steps_that_the_motion_shows(tmp_path: Path) -> None:
    arm, log = robot(tmp_path), moved(6, 7.5, STEP)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    found = diagnose_motion(arm, signals, None, ("stribeck", "velocity_filter"))
    assert not found.effects
    assert [spec.joint for spec in found.refined.effects if spec.effect == "euler_steps"] == list(NAMES)
    np.testing.assert_allclose(found.fit_after.values[:, [0, 2]], np.stack([ARMATURE, VISCOUS], axis=1), rtol=0.01)


@pytest.mark.parametrize("how", ["explicit", "implicit"])
@pytest.mark.parametrize("often", [0.0, 1.0, 5.0, 2.5, 0.25])
def test_loops_and_arrays_step_alike(tmp_path: Path, how: str, often: float) -> None:
    arm, log = robot(tmp_path), plant.moved(1, 1.0, noise=0.0)
    (run,) = runs_of(log, arm, None, np.zeros(3), commanded=True)
    run = replace(run.stepping(how, STEP, -2e-4), begun=7.0)  # type: ignore[arg-type]
    run = run.holding(np.array([often, 0.0, often]), -2e-4) if often else run
    local = Linearised(arm, without=("Ja", "fs", "fv")).about(
        run.near[:, None], np.gradient(run.near, DT, axis=0)[:, None]
    )
    drives = run.drives
    own_times = (drives.held, drives.lag, drives.since)
    held, lag, since = (None if part is None else part[None, None] for part in own_times)
    alone = Drives(
        drives.told[:, None, None], drives.kp[None, None], drives.kd[None, None], drives.limit, None, None, held, lag,
        drives.stepped, since,
    )  # fmt: skip
    own = [np.array(part)[None, None, None] for part in (ARMATURE, 0.5 * COULOMB, VISCOUS, np.zeros(3))]
    fading = Fading(own[1], np.full_like(own[1], 0.02), np.full_like(own[1], 0.009))
    start = tuple(part[None, None] for part in run.start)
    parts = (local.mass, local.force, local.slope, local.swerve, local.place, local.speed)
    shaped = type(local)(*(part[:, :, None] for part in parts))
    for joints in (Joints(*own), Joints(*own, fading=fading)):
        by_loops, by_arrays = (step(shaped, start, alone, joints, DT)[0] for step in (advance, advance_arrays))
        np.testing.assert_allclose(by_loops, by_arrays, atol=1e-9)
        smooth = advance(shaped, start, replace(alone, stepped=None), joints, DT)[0]
        assert np.abs(by_loops - smooth).max() > 1e-5

"""No prediction sees what it predicts: measured torque is altered where it is judged, and no prediction moves.

Of every effect in the library, at every joint that it fits, elastic and rigid, and by every way of judging: a robot
file on another log (`validate`, `--check`, `--max-error`), the stretches that identification predicts in turn, those
that a search never sees, and quarters. Doubled or with a sine added, the torque is no longer what any model says: the
error must grow, and the prediction, its parameters fitted elsewhere, must be the same to the last digits.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from elid_cli._types import Array
from elid_cli.cli import main
from elid_cli.diagnosis.diagnose import divided
from elid_cli.diagnosis.evidence.quarters import left_out
from elid_cli.diagnosis.fit.state import State, fit
from elid_cli.estimation.identify import identify
from elid_cli.estimation.regression.covariance import residuals
from elid_cli.estimation.regression.effect_columns import extra_of, full_rate, scene_of
from elid_cli.estimation.regression.least_squares import reweighted
from elid_cli.estimation.regression.observation import Observation, observe
from elid_cli.estimation.regression.triangles import ExtraColumns, to_triangles
from elid_cli.estimation.stretches import quarter_of, stretch_of
from elid_cli.estimation.validation.cross_validation import fold_fits
from elid_cli.estimation.validation.prediction import Validation, validate
from elid_cli.experiment import simulation
from elid_cli.logs import write_recording
from elid_cli.model.effects import effect_classes
from elid_cli.model.effects.effect import Effect
from elid_cli.model.effects.scene import Scene
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.robot.files import write_robot
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals, prepare
from tests.diagnosis.diagnosis_logs import arm

LIBRARY = effect_classes()
KINDS = sorted(LIBRARY)
ALTERED: dict[str, Callable[[Array], Array]] = {
    "doubled": lambda tau: 2.0 * tau,
    "sine": lambda tau: tau + 0.7 * np.std(tau) * np.sin(0.11 * np.arange(len(tau))),
}
JUDGED = 1
"""Stretch, or quarter, whose torque is altered."""
SAME = 1e-9
"""Part of the torque within which predictions are the same."""
CHANNEL = {name for name, kind in LIBRARY.items() if kind.simulated == "motor" or kind.corrects == "torque"}
"""Effects that put the measured torque right; what they read of it belongs to what is predicted."""
Case = tuple[Effect, Array]
"""An effect at a joint, and its amplitudes."""


def mixed() -> Robot:
    """Return an arm whose first joint is elastic and whose second is rigid."""
    robot = arm()
    first, last = robot.joints
    known = {name: value for name, value in last.parameters.items() if name != "K"}
    return replace(robot, joints=(first, replace(last, transmission="rigid", parameters=known)))


@cache
def recording() -> Recording:
    options = simulation.SimulationOptions(duration=6.0, seed=3, rate=250.0)
    return simulation.run(arm(), options).recording


@cache
def log(*, sensed: bool = False) -> tuple[Robot, Signals, Regressor, Scene]:
    """Return the arm, its log, model and scene; a sensor's effects need an elastic arm with torque sensors."""
    robot, logged = (arm(), recording()) if sensed else (mixed(), replace(recording(), tau_link=None))
    signals = prepare(logged, robot, SignalOptions.for_diagnosis(logged.rate))
    model = Regressor(robot)
    return robot, signals, model, scene_of(model, signals, np.nan_to_num(robot.reference()))


def cases(name: str) -> Iterator[tuple[int, Case]]:
    """Yield the effect with its example's values at every joint that it fits; of the whole robot, for each torque."""
    kind = LIBRARY[name]
    robot, _, _, scene = log(sensed=kind.place == "sensor")
    for joint in range(robot.n):
        at = kind.number(robot, None) if kind.whole_robot else joint
        if kind.applies(robot, at):
            values = dict(kind.example)
            if "other" in values:
                values["other"] = 2.0 - at
            if "limit" in values:  # one that cuts the peaks of this log
                values["limit"] = 0.9 * float(np.abs(scene.tau[:, at]).max())
            linear, shape = kind.coefficients(scene, at, values)
            yield joint, (kind(at, shape), linear)


def altered(signals: Signals, joint: int, how: str, where: np.ndarray | None = None) -> Signals:
    """Return signals with the torque of a joint altered at the instants `where`, (N,), all of them by default."""
    tau = signals.tau.copy()
    change = ALTERED[how](tau[:, joint]) - tau[:, joint]
    tau[:, joint] += change if where is None else np.where(where, change, 0.0)
    return replace(signals, tau=tau)


def samples_of(signals: Signals, chosen: np.ndarray) -> np.ndarray:
    """Return the samples, (N,), that nothing but the chosen instants (M,) are filtered from."""
    filtered = np.zeros(signals.motion.samples, dtype=bool)
    reach = signals.filter.half + signals.filter.step
    for k in signals.outputs[~chosen]:
        filtered[max(int(k) - reach, 0) : int(k) + reach + 1] = True
    return ~filtered


def predicted(found: Validation) -> dict[EstimationRow, Array]:
    """Return what a robot file predicts, N·m, by row."""
    return {row: found.observation.group(row).target - left for row, left in found.residual.items()}


def assert_same(before: Array, after: Array) -> None:
    np.testing.assert_allclose(after, before, rtol=0, atol=SAME * max(float(np.abs(before).max(initial=0.0)), 1.0))


def test_only_what_puts_the_torque_channel_right_reads_measured_torque() -> None:
    readers = set()
    for name in KINDS:
        for joint, (effect, _) in cases(name):
            _, signals, _, scene = log(sensed=effect.place == "sensor")
            before = full_rate(effect, scene)
            for how in ALTERED:
                tau = altered(signals, joint, how).tau
                after = full_rate(effect, replace(scene, tau=tau, cache={}))
                if before.keys() != after.keys() or any(not np.array_equal(before[row], after[row]) for row in before):
                    readers.add(name)
    assert readers == CHANNEL == {"saturation", "torque_delay"}


@pytest.mark.parametrize("name", KINDS)
def test_a_robot_file_predicts_the_same_whatever_was_measured(name: str) -> None:
    tried = 0
    for joint, (effect, linear) in cases(name):
        robot, signals, _, scene = log(sensed=effect.place == "sensor")
        where = effect.joint_name(robot)
        robot = replace(robot, effects=(EffectSpec(name, where, effect.named(scene, linear)),))
        before = validate(robot, signals)
        for how in ALTERED:
            after = validate(robot, altered(signals, joint, how))
            assert before.residual.keys() == after.residual.keys()
            for row, torque in predicted(before).items():
                assert_same(torque, predicted(after)[row])
            errors = [(a.rms, b.rms) for a, b in zip(before.error.values(), after.error.values(), strict=True)]
            assert abs(errors[joint][1] / errors[joint][0] - 1) > 0.01  # the example's values need not be the log's
            assert errors[1 - joint][1] == pytest.approx(errors[1 - joint][0], rel=1e-9)
            tried += 1
    assert tried


def compared(
    observation: Observation, effect: Effect, extra: ExtraColumns, values: Array
) -> dict[EstimationRow, Array]:
    """Return predictions of fitted parameters (p + d,), N·m (M,) by row: all that is not the measured channel's."""
    own = values.copy()
    if effect.name in CHANNEL:
        own[observation.parameters :] = 0.0
    left = residuals(observation, own, (extra,))
    return {g.row: g.target - left[g.row.kind, g.row.joint] for g in observation.groups}


def assert_blind(
    effect: Effect, chosen: np.ndarray, before: tuple[Observation, ExtraColumns, Array],
    after: tuple[Observation, ExtraColumns, Array], joint: int,
) -> None:  # fmt: skip
    """Assert that two fits predict the same at the chosen instants, and that the altered torque is further off."""
    first, second = (compared(o, effect, extra, values) for o, extra, values in (before, after))
    sizes = []
    for observation, extra, values in (before, after):
        left, row = residuals(observation, values, (extra,)), EstimationRow("sum", joint)
        sizes.append(float(np.sqrt(np.mean(left["sum", joint][chosen & observation.group(row).use] ** 2))))
    for row, torque in first.items():
        assert_same(torque[chosen], second[row][chosen])
    assert sizes[1] > 1.2 * sizes[0]


@pytest.mark.parametrize("name", KINDS)
def test_stretches_left_out_are_predicted_blindly(name: str) -> None:
    """Identification predicts each of six from the other five: what `--max-error` judges."""
    for k, (joint, (effect, _)) in enumerate(cases(name)):
        _, signals, model, scene = log(sensed=effect.place == "sensor")
        fold = stretch_of(len(signals.outputs))
        chosen = fold == JUDGED
        how = list(ALTERED)[k % 2]
        other = altered(signals, joint, how, samples_of(signals, chosen))
        fitted, solution = [], None
        for log_, tau in ((signals, scene.tau), (other, other.tau)):
            observation = observe(model, log_)
            extra = extra_of(effect, replace(scene, tau=tau, cache={}), log_)
            triangles = to_triangles(observation, (extra,), fold)
            solution = solution or reweighted(triangles, model.parameters + extra.width)
            fitted.append((observation, extra, list(fold_fits(triangles, solution))[JUDGED]))
        assert_blind(effect, chosen, fitted[0], fitted[1], joint)


def searched(name: str) -> Iterator[tuple[State, Signals, int, str]]:
    """Yield a diagnosis's model with the effect at every joint, its log, the joint and how to alter its torque."""
    for k, (joint, (effect, _)) in enumerate(cases(name)):
        robot, signals, _, _ = log(sensed=effect.place == "sensor")
        yield fit(divided(robot, signals), [effect]), signals, joint, list(ALTERED)[1 - k % 2]


@pytest.mark.parametrize("name", KINDS)
def test_stretches_that_a_search_never_sees_are_predicted_blindly(name: str) -> None:
    for before, signals, joint, how in searched(name):
        chosen = before.log.fold < 0
        other = altered(signals, joint, how, samples_of(signals, chosen))
        after = fit(divided(before.log.level, other), before.effects)
        assert_same(before.solution.values, after.solution.values)
        told = [(s.log.observation, s.columns[0], without_nuisances(s)) for s in (before, after)]
        assert_blind(before.effects[0], chosen, told[0], told[1], joint)


def without_nuisances(state: State, values: Array | None = None) -> Array:
    """Return the parameters (p + d,) of a state, or those given, without delays: they put the channel right."""
    values = state.solution.values if values is None else values
    return np.concatenate([values[: state.log.model.parameters], values[state.place(0)]])


@pytest.mark.parametrize("name", KINDS)
def test_quarters_are_predicted_blindly(name: str) -> None:
    for before, signals, joint, how in searched(name):
        fold = quarter_of(before.log.observation.instants)
        chosen = fold == JUDGED
        other = altered(signals, joint, how, samples_of(signals, chosen))
        log_ = divided(before.log.level, other)
        scene = replace(before.scene, tau=other.tau, cache={})
        every = [*log_.data.delays, *log_.data.offsets]
        found = tuple(
            next(e for e in every if e.nuisance == old.nuisance and e.rows.keys() == old.rows.keys())
            for old in before.nuisances
        )
        after = replace(
            before, log=log_, nuisances=found, columns=(extra_of(before.effects[0], scene, other),), scene=scene
        )
        told = []
        for state in (before, after):
            solution = left_out(state)[JUDGED]
            assert solution is not None
            told.append((state.log.observation, state.columns[0], without_nuisances(state, solution.values)))
        assert_blind(before.effects[0], chosen, told[0], told[1], joint)


def test_errors_are_shares_of_the_torque_that_was_delivered() -> None:
    """Were they shares of what was logged, a limit far below it would leave next to nothing to predict."""
    robot, signals, *_ = log()
    name, limit = robot.joint_names[1], 0.6 * float(np.abs(signals.tau[:, 1]).max())
    plain = identify(robot, signals).error[name]
    found = identify(replace(robot, effects=(EffectSpec("saturation", name, {"cut": 1.0, "limit": limit}),)), signals)
    values, error = found.effects[0].parameters, found.error[name]
    command = signals.tau[:, 1]
    acted = command - values["cut"] * (command - np.clip(command, -values["limit"], values["limit"]))
    assert error.torque_rms < 0.98 * plain.torque_rms
    assert error.torque_rms == pytest.approx(plain.torque_rms * np.std(acted) / np.std(command), rel=0.02)
    assert error.relative == pytest.approx(error.rms / error.torque_rms)


def test_commands_judge_what_was_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`validate`, `--max-error` and `--check` all tell a log whose torque was doubled from the one that it was."""
    robot, *_ = log()
    write_robot(robot, tmp_path / "arm.yaml")
    tau = recording().tau.copy()
    tau[:, 1] *= 2.0
    write_recording(replace(recording(), tau_link=None), tmp_path / "own.h5")
    write_recording(replace(recording(), tau=tau, tau_link=None), tmp_path / "other.h5")
    own, other, arm_ = (str(tmp_path / name) for name in ("own.h5", "other.h5", "arm.yaml"))
    for line, code in (
        (["validate", own], 0), (["validate", other], 1), (["identify", own], 0), (["identify", own, other], 1),
    ):  # fmt: skip
        assert main([*line, "--robot", arm_, "--max-error", "15%", "--json"]) == code
        capsys.readouterr()
    assert main(["diagnose", own, "--robot", arm_, "--only", "load_friction", "--check", other, "--json"]) == 0
    (check,) = json.loads(capsys.readouterr().out)["checks"]
    assert check["after"]["error"]["joint1"]["relative"] < 0.15
    assert check["after"]["error"]["joint2"]["relative"] > 0.3

"""Friction curves of two terms (eq. 43): their shapes' cost has several valleys, and noise hides which is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elid_cli.estimation.collocation.starts import _named_by
from elid_cli.estimation.default_fit import DefaultFit, fit_log
from elid_cli.estimation.identify import EstimateOptions, Identification, identify
from elid_cli.estimation.regression.covariance import lasting_weights
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.other_shapes import explains_as_well, sentences
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.robot.robot import EffectSpec, Robot
from elid_cli.signals.signals import Signals, prepare
from tests.system.reproduce.inverse_logs import Laws, Made, World, laws_of, log_of, make, recorded

FADING, RISING = (-0.25, 0.0537), (-0.3, 0.06)
"""Amplitude, in Coulomb frictions, and velocity, rad/s, of the two terms."""


def curve(made: Made, joint: int) -> Laws:
    size = made.truth.joints[joint].parameters["fs"]

    def friction(world: World) -> np.ndarray:
        speed = np.abs(world.dtheta[:, joint])
        terms = FADING[0] * np.exp(-speed / FADING[1]) + RISING[0] * np.exp(-RISING[1] / np.maximum(speed, 1e-9))
        torque = np.zeros_like(world.dtheta)
        torque[:, joint] = size * np.sign(world.dtheta[:, joint]) * terms
        return torque

    return Laws(motor=[friction])


def logged(seed: int, db: float, joint: int = 0) -> tuple[Made, Robot, Signals]:
    """Return an arm, the robot file that declares the two terms by a guess of their velocity, and a log."""
    made = make(seed, 2, rate=500.0, duration=12.0)
    log = recorded(made, log_of(made, curve(made, joint)), db=db, counts=0.0, torque=0.0, colour=0.0, seed=seed)
    name = made.robot.joint_names[joint]
    specs = tuple(EffectSpec("stribeck", name, {"velocity": 0.1, "exponent": e}) for e in (1.0, -1.0))
    robot = replace(made.robot, effects=specs)
    return made, robot, prepare(log, robot)


def fitted(seed: int, db: float, joint: int = 0) -> Identification:
    made, robot, signals = logged(seed, db, joint)
    found = identify(robot, signals, EstimateOptions(guards=False))
    return found.beside(found.base.values(made.truth.reference()))


def fit_of(robot: Robot, signals: Signals) -> DefaultFit:
    model = Regressor(robot)
    return fit_log(model, find_base(model), signals, EstimateOptions())


@pytest.mark.parametrize(
    ("seed", "joint", "db"), [(3, 0, 80.0), (6, 0, 80.0), (6, 0, 70.0), (7, 1, 80.0), (8, 1, 70.0), (9, 1, 80.0)]
)
def test_a_valley_that_explains_the_log_as_well_is_named_and_within_the_errors(
    seed: int, joint: int, db: float
) -> None:
    """In some of these logs the wrong valley costs ten less than the right one: less than the cost scatters by."""
    found = fitted(seed, db, joint)
    assert any(f"j{joint + 1}: stribeck velocity" in note and "as well" in note for note in found.notes)
    score = (found.estimate - found.reference) / found.std_error
    assert np.nanmax(np.abs(score)) < 3.5


def test_the_collocation_tries_the_valleys_that_the_fit_could_not_tell_apart() -> None:
    fit = fit_of(*logged(9, 80.0, 1)[1:])
    assert fit.effects is not None
    shapes = [[effect.shape[0] for effect in other.values()] for other in fit.effects.others]
    assert np.exp(_named_by(fit)) == pytest.approx(np.array(shapes))
    assert min(abs(np.log(first / FADING[1])) + abs(np.log(second / RISING[1])) for first, second in shapes) < 0.4


def test_a_cost_is_compared_with_its_scatter() -> None:
    rng = np.random.default_rng(0)
    white = rng.standard_normal(400)
    more = 0.05 + white - white.mean()  # 20 in all
    stretch = np.zeros(400, dtype=np.intp)
    assert explains_as_well(more, stretch)  # whose standard deviation is 20
    assert not explains_as_well(more + 0.2, stretch)
    assert not explains_as_well(np.full(400, 0.05), stretch)
    assert explains_as_well(np.full(400, 0.01), stretch)  # a cost of 4
    slow = more + 0.2 + 3 * np.sin(np.linspace(0, 4 * np.pi, 400))
    assert explains_as_well(slow, stretch)  # few independent instants


def test_an_effect_without_a_given_shape_keeps_what_was_found() -> None:
    """Nothing is known of a ripple's order before the log speaks: no round of the fit may go back to a first guess."""
    made = make(1, 2, rate=500.0, duration=12.0)
    signals = log_of(made, laws_of("torque_ripple", made, 0))
    log = recorded(made, signals, db=90.0, counts=0.0, torque=0.0, colour=0.0, seed=1)
    robot = replace(made.robot, effects=(EffectSpec("torque_ripple", made.robot.joint_names[0], {}),))
    (effect,) = identify(robot, prepare(log, robot), EstimateOptions(guards=False)).effects
    assert effect.parameters["order"] == pytest.approx(14.0, rel=0.02)


def test_a_sliding_joints_other_shapes_are_in_metres() -> None:
    _, robot, signals = logged(6, 80.0)
    fit = fit_of(robot, signals)
    assert fit.effects is not None
    slides = replace(robot, joints=(replace(robot.joints[0], type="prismatic"), *robot.joints[1:]))
    for same, unit in ((robot, "rad/s"), (slides, "m/s")):
        (note, *_) = sentences(fit.effects, same)
        assert note.startswith("j1: stribeck velocity")
        assert f"{unit}, exponent 1 with" in note


def test_a_curve_that_the_log_shows_has_one_valley() -> None:
    found = fitted(2, 130.0)
    assert not any("as well" in note for note in found.notes)
    (fading, rising) = (effect.parameters["velocity"] for effect in found.effects)
    assert fading == pytest.approx(FADING[1], rel=0.05)
    assert rising == pytest.approx(RISING[1], rel=0.05)


def with_slow_error(observation: Observation, size: float) -> Observation:
    """Return the equations with an error of the first row that goes once up and down."""
    first, *rest = observation.groups
    slow = size * np.sin(np.linspace(0.0, 2 * np.pi, observation.instants))
    return replace(observation, groups=(replace(first, target=first.target + slow), *rest))


def test_instants_of_a_slow_residual_count_for_less() -> None:
    made = make(2, 2, rate=500.0, duration=12.0)
    log = recorded(made, log_of(made, Laws()), db=100.0, counts=0.0, torque=0.003, colour=0.0, seed=2)
    signals = prepare(log, made.robot)
    fit = fit_of(made.robot, signals)
    first = fit.observation.groups[0].row
    plain = lasting_weights(fit.observation, fit.solution, fit.extras)[first]
    share = (plain / fit.solution.weights[first]) ** 2
    independent = 2 * signals.filter.cutoff / fit.observation.rate
    assert share == pytest.approx(independent, rel=0.4)  # white torque noise below the filter's cut-off
    slow = with_slow_error(fit.observation, 3.0 / fit.solution.weights[first])
    assert lasting_weights(slow, fit.solution, fit.extras)[first] < 0.1 * plain
    small = replace(fit.solution, weights={row: 1e-3 * weight for row, weight in fit.solution.weights.items()})
    assert lasting_weights(fit.observation, small, fit.extras) == small.weights  # nothing to speak of

"""Laws of friction that a log cannot tell apart: the usual one is named, and standard errors reach to the others."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.fit.state import without
from elid_cli.diagnosis.form_errors import reaching_forms
from elid_cli.diagnosis.result import FoundEffect, OtherForm
from elid_cli.diagnosis.search import other_forms as forms_of_friction
from elid_cli.diagnosis.search.candidate import Candidate
from elid_cli.diagnosis.search.other_forms import other_forms, with_usual_forms
from elid_cli.diagnosis.search.refitted_forms import in_form
from elid_cli.diagnosis.search.screening import score
from elid_cli.diagnosis.search.steps import Found, Step
from elid_cli.estimation.identify import Identification, identify
from elid_cli.logs import read_recording
from elid_cli.report import formats
from elid_cli.report.answers.diagnosis import diagnosis_report
from elid_cli.report.answers.diagnosis_input import DiagnosisInput
from elid_cli.robot.files import read_robot
from elid_cli.signals.signals import prepare
from tests.system.reproduce.friction_forms import Told, told

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tied() -> Told:
    return told(202)


def test_of_laws_that_explain_a_log_alike_the_usual_one_is_named(tied: Told) -> None:
    """Friction that rises towards a higher Coulomb friction explains this log a little better than the true law."""
    assert tied.exponents == [tied.law] == [1.0]
    form = tied.found.effects[0].forms[0]
    assert form.parameters["exponent"] == -1.0
    assert form.parameters["amplitude"] < 0
    assert form.behind < 0


def test_standard_errors_reach_to_what_the_other_law_says(tied: Told) -> None:
    form = tied.found.effects[0].forms[0]
    other = dict(form.moved)["fs1"]
    item = next(p for p in tied.found.identified_after.parameters if p.name == "fs1")
    assert abs(tied.score) < 1
    assert abs(other - item.estimate) == pytest.approx(2 * item.std_error, rel=0.1)


def test_the_other_law_stands_in_the_report_and_in_json(tied: Told) -> None:
    found = tied.found
    told_ = DiagnosisInput(
        found,
        found.identified_before,
        found.identified_after,
        found.contributions,
        replace(found.recording, files=("log.h5",)),
        "arm.yaml",
    )
    report = diagnosis_report(told_)
    text = " ".join(formats.render(report, "terminal", formats.Style(width=400)).split())
    assert "exponent -1 would explain this log about as well, and make fs1" in text
    (payload,) = json.loads(formats.render(report, "json", formats.Style()))["effects"]
    assert payload["forms"][0]["parameters"]["exponent"] == -1.0
    assert set(payload["forms"][0]["moved"]) >= {"fs1"}


@pytest.mark.parametrize("number", [115, 117])
def test_rounded_reversals_are_no_second_term(number: int) -> None:
    """Two terms that cancel, or one that fades within the reversals, take up what splines round off there."""
    found = told(number)
    assert found.exponents == [found.law]
    assert abs(found.score) < 3


def test_a_law_that_the_log_shows_has_no_other() -> None:
    found = told(103)
    assert found.exponents == [found.law] == [2.0]
    assert found.ties == 0


def misled(tied: Told, monkeypatch: pytest.MonkeyPatch) -> Found:
    """Return an outcome whose friction has the wrong law, which scores far better than the true one (exponent 1)."""
    state = tied.found.state_after
    (effect,) = state.effects
    state = in_form(state, 0, type(effect)(effect.joint, (1.5 * effect.shape[0], 2.0)))
    own = score(without(state, 0), state.effects[0], 1, 1)
    assert own is not None

    def behind(own: Candidate, other: Candidate) -> float:
        ahead = own.effect.shape[1] - other.effect.shape[1]
        return 0.1 * own.gain.likelihood if ahead > 0 else -0.1 * own.gain.likelihood

    monkeypatch.setattr(forms_of_friction, "_behind", behind)
    return Found(tied.found.state_before, state, (Step(own, ()),), (), 1, ())


def test_the_usual_law_is_named_where_it_fits_and_predicts_better(tied: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    """What scores best is at times what splines round off at reversals; what was held out knows nothing of that."""
    true = tied.found.effects[0].parameters
    found = with_usual_forms(misled(tied, monkeypatch), 0)
    assert found.after.effects[0].shape == pytest.approx((true["velocity"], 1.0), rel=0.02)
    assert found.after.named(0)["amplitude"] == pytest.approx(true["amplitude"], rel=0.02)
    assert found.steps[0].candidate.effect.shape[1] == 1.0
    (told_, *_) = other_forms(found, 0)[0]
    assert told_.parameters["exponent"] == 2.0


def test_a_law_that_fits_as_well_is_told_in_the_shape_that_fits(tied: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    true = tied.found.effects[0].parameters
    usual = next(form for form in other_forms(misled(tied, monkeypatch), 0)[0] if form.parameters["exponent"] == 1.0)
    assert usual.parameters["amplitude"] == pytest.approx(true["amplitude"], rel=0.02)
    assert usual.behind < 0


@pytest.fixture(scope="module")
def planar() -> Identification:
    robot = read_robot("planar2")
    return identify(robot, prepare(read_recording([ROOT / "sample_logs" / "planar2.h5"], robot), robot))


def test_a_parameter_that_another_form_moves_far_is_weakly_known(planar: Identification) -> None:
    names = [item.name for item in planar.parameters]
    change = np.zeros(len(names))
    change[names.index("fs1")], change[names.index("fs2")] = 0.3, 1e-4
    form = OtherForm({"amplitude": 1.0}, 1.0, change, (("fs1", 0.63),))
    effect = FoundEffect("stribeck", "joint1", {}, {}, 0.9, "", forms=(form,))
    after = reaching_forms(planar, [effect])
    before, wider = (dict(zip(names, found.parameters, strict=True)) for found in (planar, after))
    assert wider["fs1"].std_error == pytest.approx(0.15, rel=1e-3)
    assert wider["fs1"].verdict == "weak"
    assert "stribeck in another form would make it 0.63" in wider["fs1"].reason
    assert wider["fs2"].verdict == "supported"
    assert wider["fs2"].std_error == pytest.approx(np.hypot(before["fs2"].std_error, 5e-5))
    assert wider["K1"] == before["K1"]
    assert np.sqrt(np.diag(after.covariance))[names.index("fs1")] == pytest.approx(0.15, rel=1e-3)
    assert reaching_forms(planar, [replace(effect, forms=())]) is planar

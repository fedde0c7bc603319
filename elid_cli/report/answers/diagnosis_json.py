"""The JSON object of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from elid_cli.diagnosis import Diagnosis, FoundEffect
from elid_cli.diagnosis.refit import Contribution
from elid_cli.diagnosis.residuals import RowState
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.result import Identification
from elid_cli.model.effects import effect_classes
from elid_cli.report.answers.diagnosis_input import DiagnosisInput, referenced
from elid_cli.report.answers.diagnosis_tables import also_words
from elid_cli.report.answers.identification_json import error_payload as errors
from elid_cli.report.answers.identification_json import identification_payload
from elid_cli.report.answers.inputs import log_payload, nuisance_payload
from elid_cli.report.answers.missing import curve_words, poorly_fitted
from elid_cli.report.tree import picked


def diagnosis_payload(told: DiagnosisInput) -> dict[str, Any]:
    """Return the JSON object of a diagnosis (docs/reference/json.md)."""
    found = told.found
    before, after = found.left_out
    return {
        **identification_payload(told.after, told.recording),
        "declared": nuisance_payload(told.after.effects),
        "before": _side(found.before, found.rows_before, told.before, before),
        "after": _side(found.after, found.rows_after, told.after, after),
        "effects": [
            _effect_payload(found, c)
            for c in told.contributions
        ],
        "nuisances": nuisance_payload(found.corrected),
        "also_possible": [
            {**picked(r, "effect joint gain instead_of parameters std_error behind separate"), "instead_at": r.at}
            for r in found.also_possible
        ],
        "unexplained": [
            {**picked(u, "joint rows variable share rms ratio"),
             "nearest": [picked(n, "effect joint gain parameters") for n in u.nearest]}
            for u in found.unexplained
        ],
        "refuted": [
            {"effect": s.effect, "joint": s.joint, "quarters": s.gains, "gain": s.whole, **picked(s, "kept cutoff")}
            for s in found.refuted
        ],
        "row_noise": _noise_payload(found),
        "triage": found.triage,
        "organised": [
            {"joint": joint, "rows": rows, **picked(o, "variable share")}
            for (joint, rows), entries in found.organised.items()
            for o in entries
        ],
        **({"partial": True} if found.partial else {}),
        "sufficient": found.sufficient,
        "motion_repeats": found.repeats,
        **picked(found, "predicted_worse tried searched_at held_out"),
        "moved": [picked(m, "name before after deviations") for m in found.moved],
        "checks": [
            {"log": log_payload(c.recording), "before": {"error": errors(c.before)},
             "after": {"error": errors(c.after)}}
            for c in told.checks
        ],
    }  # fmt: skip


def _noise_payload(found: Diagnosis) -> dict[str, Any]:
    """Return the noise of the rows, as a plan of the next experiment needs it."""
    model = found.row_noise
    return {
        "rate": model.rate,
        "cutoff": found.state_after.log.signals.filter.cutoff,
        "share": model.share,
        "joints": [
            {"joint": found.robot.joint_names[w.rows[0].joint], "rows": [row.kind for row in w.rows],
             **picked(w, "lags mix")}
            for w in model.joints
        ],
    }  # fmt: skip


def _side(
    error: Mapping[str, JointError],
    rows: Sequence[RowState],
    model: Identification,
    published: Mapping[str, JointError],
) -> dict[str, Any]:
    return {
        "error": errors(error),
        "rows": [picked(r, "joint rows rms share ratio") for r in rows],
        "published": errors(published),
        "normalised_mean_error": model.normalised_mean_error() if referenced(model) else None,
    }


def forms_payload(effect: FoundEffect) -> list[dict[str, Any]]:
    """Return the other forms of an effect that explain a log about as well."""
    return [{**picked(form, "parameters behind"), "moved": dict(form.moved)} for form in effect.forms]


def _effect_payload(found: Diagnosis, contribution: Contribution) -> dict[str, Any]:
    effect = contribution.effect
    curve, also = curve_words(effect), also_words(found, effect)
    sums = {} if curve else effect_classes()[effect.effect].in_sums(found.robot, effect.joint)
    payload = {
        **picked(effect, "effect joint parameters std_error gain"),
        "certain": found.certain(effect),
        "poor_fit": effect.joint in poorly_fitted(found),
        **picked(effect, "summary folds quarters local collocated absorbed"),
        "forms": forms_payload(effect),
        "error": {
            "joint": contribution.joint,
            "rows": contribution.rows,
            "before": contribution.without,
            "after": contribution.with_it,
        },
    }
    further = {"curve": curve, "also": also, "sums": {k: v for k, v in sums.items() if k in effect.parameters}}
    return {**payload, **{key: said for key, said in further.items() if said}}

"""Results by themselves, as `elid_cli.tables` asks for them: the sections and values of their command's report."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from elid_cli.report.formats import Style
from elid_cli.report.formats.json import plain
from elid_cli.report.tree import Report, Section, Text, warned
from elid_cli.robot.robot import Joint, Robot

if TYPE_CHECKING:
    from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
    from elid_cli.diagnosis.result import Diagnosis
    from elid_cli.estimation.comparison import Comparison
    from elid_cli.estimation.physical.nearest import PhysicalParameters
    from elid_cli.estimation.result import Identification
    from elid_cli.estimation.sampling.sets import ParameterSets
    from elid_cli.estimation.trend.trends import Trends
    from elid_cli.estimation.validation.prediction import Validation
    from elid_cli.experiment.excitation import Excitation
    from elid_cli.experiment.replay.replay import Replay
    from elid_cli.experiment.resolve import Resolution
    from elid_cli.logs.inspect import LogInfo
    from elid_cli.model.base_parameters import BaseParameters
    from elid_cli.signals.recording import Recording
    from elid_cli.signals.signals import Signals

SIGMAS = 3.0
"""Standard deviations by which a compared parameter has moved, as ``elid compare`` has it by default."""


class View(NamedTuple):
    """What there is to show of a result, each made when it is asked for."""

    sections: Callable[[], Iterable[Section]]
    payload: Callable[[], Mapping[str, Any]]
    table: Callable[[Mapping[str, Any]], Sequence[Mapping[str, Any]] | Mapping[str, Any]]
    """The result's main table, from its payload: one entry per row, or columns by name."""


def text(result: object) -> str:
    """Return a result as a terminal shows it."""
    from elid_cli.report.formats.terminal import render

    style = Style(width=shutil.get_terminal_size().columns, rest="to_frame()")
    return render(Report("", {}, _sections(result)), style).rstrip("\n")


def html(result: object) -> str:
    """Return a result as a part of a page."""
    from elid_cli.report.formats.html import fragment

    return fragment(_sections(result))


def payload(result: object) -> dict[str, Any]:
    """Return a result in JSON's own types."""
    values: dict[str, Any] = plain(_view(result).payload())
    return values


def table(result: object) -> Any:
    """Return a result's main table, what has parts of its own left out: one entry per row, or columns by name."""
    view = _view(result)
    entries = view.table(plain(view.payload()))
    if isinstance(entries, Mapping):
        return entries
    return [{k: v for k, v in entry.items() if not isinstance(v, dict | list)} for entry in entries]


def _sections(result: object) -> tuple[Section, ...]:
    return tuple(s for s in _view(result).sections() if not (isinstance(s, Text) and s.role == "next"))


def _view(result: object) -> View:
    return _VIEWS[type(result).__name__](result)


def _identification(found: Identification) -> View:
    from elid_cli.report.answers import identification as answer
    from elid_cli.report.answers.error_tables import error_table, sensor_table
    from elid_cli.report.answers.identification_json import identification_payload

    return View(
        lambda: [
            Text("title", f"{found.robot.name}: {dict(answer.result_items(found))['parameters']}", "heading"),
            *answer.base_tables(found),
            error_table(found.robot, found.error),
            *sensor_table(found.robot, found.error),
            *warned((*found.log_warnings, *found.warnings)),
        ],
        lambda: identification_payload(found),
        lambda values: values["base_parameters"],
    )


def _diagnosis(found: Diagnosis) -> View:
    from elid_cli.report.answers import diagnosis as answer
    from elid_cli.report.answers.diagnosis_input import DiagnosisInput
    from elid_cli.report.answers.diagnosis_json import diagnosis_payload

    told = DiagnosisInput(
        found, found.identified_before, found.identified_after, found.contributions, found.recording, found.robot.name
    )
    return View(
        lambda: [Text("title", found.robot.name, "heading"), *answer.result_sections(told)],
        lambda: diagnosis_payload(told),
        _found_parameters,
    )


def _found_parameters(values: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return one row per parameter of an effect that was found."""
    return [
        {"effect": e["effect"], "joint": e["joint"], "parameter": name, "value": value,
         "std_error": e["std_error"].get(name), "gain": e["gain"]}
        for e in values["effects"]
        for name, value in e["parameters"].items()
    ]  # fmt: skip


def _motion_diagnosis(found: MotionDiagnosis) -> View:
    from elid_cli.report.answers import motion_diagnosis as answer

    return View(
        lambda: answer.motion_diagnosis_report(found, found.robot.name).sections,
        lambda: answer.motion_diagnosis_payload(found),
        _found_parameters,
    )


def _replay(found: Replay) -> View:
    from elid_cli.report.answers import replay as answer

    return View(
        lambda: answer.replay_report([found]).sections,
        lambda: answer.replay_payload([found]),
        lambda values: [{"joint": joint, **error} for joint, error in values["error"].items()],
    )


def _validation(found: Validation) -> View:
    from elid_cli.estimation.validation.sufficiency import judge_prediction
    from elid_cli.report.answers.validation import validation_payload, validation_sections

    said = cache(lambda: judge_prediction(found))
    return View(
        lambda: [Text("title", found.robot.name, "heading"), *validation_sections(found, said())],
        lambda: validation_payload(found, said()),
        lambda values: [{"joint": joint, **error} for joint, error in values["error"].items()],
    )


def _comparison(found: Comparison) -> View:
    return _comparisons([found])


def _comparisons(found: Sequence[Comparison]) -> View:
    """Return the view of several; where there are more than one, rows of the table say of which result they are."""
    from elid_cli.report.answers.comparison import comparison_report

    report = comparison_report(found, SIGMAS)
    return View(
        lambda: report.sections,
        lambda: report.payload,
        lambda values: [
            {**({"result": one["after"]} if len(found) > 1 else {}), **change}
            for one in values["comparisons"]
            for change in (*one["changes"], *one["beside"])
        ],
    )


def _trends(found: Trends) -> View:
    from elid_cli.report.answers import trend as answer

    report = answer.trend_report(found)
    return View(lambda: report.sections, lambda: report.payload, lambda values: values["parameters"])


def _sets(found: ParameterSets) -> View:
    from elid_cli.report.answers.sampling import sampling_report, with_samples

    report = with_samples(sampling_report(found), found)
    return View(
        lambda: report.sections,
        lambda: {key: value for key, value in report.payload.items() if key != "written"},
        lambda _: {name: found.values[:, k] for k, name in enumerate(found.names)},
    )


def _excitation(found: Excitation) -> View:
    from elid_cli.report.answers import excitation as answer

    return View(
        lambda: [Text("title", found.robot.name, "heading"), answer.limits_table(found), answer.expected_table(found)],
        lambda: answer.excitation_payload(found),
        lambda values: values["base_parameters"],
    )


def _resolution(found: Resolution) -> View:
    from elid_cli.report.answers import resolution as answer

    return View(
        lambda: [Text("title", found.robot.name, "heading"), *answer.resolution_sections(found)],
        lambda: answer.resolution_payload(found),
        lambda values: values["pairs"],
    )


def _physical(found: PhysicalParameters) -> View:
    from elid_cli.model.base_parameters import find_base
    from elid_cli.model.regressor import Regressor
    from elid_cli.report.answers.physical import physical_payload, physical_sections

    base = find_base(Regressor(found.robot))
    units = dict(zip(base.parameters, found.robot.parameter_units(), strict=True))
    return View(
        lambda: physical_sections(found, base),
        lambda: physical_payload(found, base),
        lambda values: [
            {"name": name, "value": value, "unit": units[name], "origin": values["origin"][name]}
            for name, value in values["parameters"].items()
        ],
    )


def _base(found: BaseParameters) -> View:
    from elid_cli.report.answers import classification as answer

    return View(
        lambda: answer.base_sections(found),
        lambda: answer.base_payload(found),
        lambda values: values["base_parameters"],
    )


def _inspected(found: LogInfo) -> View:
    from elid_cli.report.answers import info as answer

    return View(
        lambda: answer.log_sections(found),
        lambda: answer.inspected_payload(found),
        lambda values: [
            {**c, "labels": " ".join(c["labels"]), "signals": " ".join(c["signals"])} for c in values["channels"]
        ],
    )


def _recording(found: Recording) -> View:
    from elid_cli.report.answers import inputs as answer

    robot = Robot("log", tuple(Joint(name) for name in found.joints))
    return View(
        lambda: answer.recording_sections(robot, found),
        lambda: answer.log_payload(found),
        lambda _: _samples(found),
    )


def _samples(found: Recording) -> Mapping[str, Any]:
    """Return columns ``t``, ``q.<joint>`` and so on, called as in CSV."""
    from elid_cli.report.answers.inputs import SIGNALS

    signals = {name: values for name in SIGNALS if (values := found.signal(name)) is not None}
    columns = {f"{name}.{joint}": v[:, k] for name, v in signals.items() for k, joint in enumerate(found.joints)}
    return {"t": found.t, **columns}


def _robot(found: Robot) -> View:
    from elid_cli.report.answers import robot as answer

    return View(
        lambda: answer.robot_sections(found),
        lambda: answer.robot_values(found),
        lambda _: answer.robot_rows(found),
    )


def _signals(found: Signals) -> View:
    from elid_cli.report.answers import signals as answer

    return View(
        lambda: answer.signals_sections(found),
        lambda: answer.signals_payload(found),
        lambda _: answer.signals_columns(found),
    )


_VIEWS: dict[str, Callable[[Any], View]] = {
    "BaseParameters": _base,
    "Comparison": _comparison,
    "Comparisons": _comparisons,
    "Diagnosis": _diagnosis,
    "Excitation": _excitation,
    "Resolution": _resolution,
    "Identification": _identification,
    "LogInfo": _inspected,
    "MotionDiagnosis": _motion_diagnosis,
    "ParameterSets": _sets,
    "PhysicalParameters": _physical,
    "Recording": _recording,
    "Replay": _replay,
    "Robot": _robot,
    "Signals": _signals,
    "Trends": _trends,
    "Validation": _validation,
}
"""By the name of their class, so that printing one imports no other."""

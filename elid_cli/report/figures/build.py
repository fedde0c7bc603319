"""The figures of each report: arrays named as `elid_cli.report.figures` draws them; made only when someone looks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace

from elid_cli._types import Array
from elid_cli.diagnosis.refit import Contribution
from elid_cli.diagnosis.result import Diagnosis
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.noise_floor import noise_floor
from elid_cli.estimation.validation.prediction import Validation, validate
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.report.figures.data import JointView, coverage, joint_views, singular_values, spring_views
from elid_cli.report.figures.effect_data import effect_views
from elid_cli.report.tree import Figure, Report
from elid_cli.robot.robot import Robot
from elid_cli.signals.signals import Signals


def with_figures(report: Report, figures: Sequence[Figure]) -> Report:
    """Return the report with figures, before its closing next command where it has one."""
    sections = list(report.sections)
    place = next((k for k, section in enumerate(sections) if section.key == "next"), len(sections))
    return replace(report, sections=(*sections[:place], *figures, *sections[place:]))


def identification_figures(found: Identification, refined: Robot, signals: Signals) -> tuple[Figure, ...]:
    """Return the figures of an identification; `refined` describes what was found."""
    judged = validate(refined, signals)
    return (
        *_torques(joint_views(judged, signals, _floor(found, signals, judged))),
        *_springs(judged, signals, refused_names(found)),
        *_residuals(joint_views(judged, signals)),
        *_parameters(found, signals),
    )


def validation_figures(found: Validation, signals: Signals) -> tuple[Figure, ...]:
    """Return the figures of a validation."""
    views = joint_views(found, signals)
    return (*_torques(views), *_springs(found, signals), *_residuals(views), _coverage(found.robot, signals))


def diagnosis_figures(
    found: Diagnosis, identified: Identification, parts: Sequence[Contribution], signals: Signals
) -> tuple[Figure, ...]:
    """Return the figures of a diagnosis: each effect, each joint before and after, the springs, the parameters."""
    before = {view.joint: view for view in joint_views(found.validation_before, signals)}
    views = joint_views(found.validation_after, signals, found.state_after.floor.rms)
    effects = [
        Figure(
            f"effect{k}",
            f"{view.effect} of {view.joint}: without and with",
            "effect",
            asdict(view),
            "The residual of the model without the effect, all else fitted again, and with it, against the variable "
            "that the effect follows most. Line: mean; band: the middle 90 %.",
        )
        for k, view in enumerate(effect_views(found, parts), start=1)
    ]
    return (
        *effects,
        *_torques(views, before),
        *_springs(found.validation_after, signals, refused_names(identified)),
        *_residuals(views, before),
        *_parameters(identified, signals),
    )


def refused_names(found: Identification) -> frozenset[str]:
    """Return the names of base parameters that were refused."""
    verdicts = zip(found.base.names, found.verdict, strict=True)
    return frozenset(name for name, verdict in verdicts if verdict == "refused")


def _torques(views: Sequence[JointView], before: Mapping[str, JointView] | None = None) -> list[Figure]:
    caption = (
        "Filtered motor torque, measured and predicted with the spring eliminated, and their difference. Grey: "
        "left out, around reversals."
    )
    figures = []
    for view in views:
        old = None if before is None else before.get(view.joint)
        residuals = [{"name": "residual", "residual": view.residual, "before": None if old is None else old.residual,
                      "floor": view.floor}]  # fmt: skip
        if view.spring_residual is not None:
            residuals.append(
                {"name": "residual, spring torque from the deflection", "residual": view.spring_residual,
                 "before": None if old is None else old.spring_residual, "floor": view.spring_floor}
            )  # fmt: skip
        data = {"joint": view.joint, "unit": view.unit, "t": view.t, "measured": view.measured, "used": view.used,
                "residuals": residuals}  # fmt: skip
        figures.append(Figure(f"torque_{view.joint}", f"{view.joint}: torque and residual", "torque", data, caption))
    return figures


def _residuals(views: Sequence[JointView], before: Mapping[str, JointView] | None = None) -> list[Figure]:
    figures = []
    for view in views:
        old = None if before is None else before.get(view.joint)
        figures.append(_followed(view, view.residual, None if old is None else old.residual, ""))
        if view.spring_residual is not None and (view.spring_stands_out or (old is not None and old.spring_stands_out)):
            previous = None if old is None else old.spring_residual
            figures.append(_followed(view, view.spring_residual, previous, "_spring"))
    return figures


def _followed(view: JointView, residual: Array, before: Array | None, suffix: str) -> Figure:
    where = ", spring torque from the deflection" if suffix else ""
    data = {
        "joint": view.joint, "unit": view.unit, "residual": residual[view.used],
        "before": None if before is None else before[view.used],
        "variables": {name: values[view.used] for name, values in view.variables.items()},
    }  # fmt: skip
    caption = "Points: instants; line: mean; band: the middle 90 %. A model that lacks nothing leaves a flat line."
    title = f"{view.joint}: what the residual follows{where}"
    return Figure(f"residual_{view.joint}{suffix}", title, "residual", data, caption)


def _springs(judged: Validation, signals: Signals, refused: Collection[str] = ()) -> list[Figure]:
    springs = [asdict(view) for view in spring_views(judged, signals, refused)]
    if not springs:
        return []
    caption = (
        "Torque through each transmission (motor torque less the motor's inertia and friction) against its deflection "
        "e; below, less the line K·e. Two branches mean hysteresis or friction in the transmission, a flat middle "
        "backlash, a bend a stiffness that grows. Pale: around reversals of the motor, where its friction is undefined."
    )
    return [Figure("springs", "Deflection and torque of the transmissions", "spring", {"springs": springs}, caption)]


def _parameters(found: Identification, signals: Signals) -> list[Figure]:
    base = found.base
    figures = [
        Figure("parameters", "Base parameters", "parameters", {
            "names": base.names, "estimate": found.estimate, "std_error": found.std_error,
            "reference": found.reference, "verdict": found.verdict,
        }, "Each on the scale of its own value; bars are 95 % intervals, diamonds the robot file's values."),
        Figure("classification", "What this log shows of each parameter", "classes", {
            "classes": dict(found.this_log), "joints": found.robot.joint_names,
        }, "The 14 parameters of each joint."),
        _coverage(found.robot, signals),
    ]  # fmt: skip
    if found.triangles is not None:
        values, rank = singular_values(base, found.triangles, found.weights)
        figures.append(
            Figure("singular", "Singular values of the regressor", "singular", {"values": values, "rank": rank},
                   "Columns of unit norm. The wider the step, the surer the number of base parameters.")
        )  # fmt: skip
    return figures


def _coverage(robot: Robot, signals: Signals) -> Figure:
    joints = [asdict(view) for view in coverage(robot, signals)]
    return Figure("coverage", "Where the joints have been", "coverage", {"joints": joints},
                  "Position against velocity; dashed: limits of the robot file.")  # fmt: skip


def _floor(found: Identification, signals: Signals, judged: Validation) -> Mapping[EstimationRow, float] | None:
    errors = {row: e.floor for row, e in ((EstimationRow("sum", k), found.error.get(j.name))
                                          for k, j in enumerate(found.robot.joints)) if e is not None}  # fmt: skip
    known = {row: floor for row, floor in errors.items() if floor is not None}
    if known:
        return known
    return noise_floor(Regressor(found.robot), signals, judged.observation, found.standard).rms

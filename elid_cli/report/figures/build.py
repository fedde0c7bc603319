"""The figures of each command: every kind in `plots` takes its own from what was found; made only if someone looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING

from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.noise_floor import noise_floor
from elid_cli.estimation.validation.prediction import ByLog, Validation, validate
from elid_cli.model.regressor import EstimationRow, Regressor
from elid_cli.report.figures import figures_of
from elid_cli.report.figures.input import FigureInput
from elid_cli.report.tree import Figure, Report
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals

if TYPE_CHECKING:  # each command has its own of these at hand
    from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
    from elid_cli.diagnosis.friction_family import FrictionFamily
    from elid_cli.diagnosis.refit import Contribution
    from elid_cli.diagnosis.result import Diagnosis
    from elid_cli.estimation.comparison import Comparison
    from elid_cli.estimation.sampling.sets import ParameterSets
    from elid_cli.estimation.trend.trends import Trends
    from elid_cli.experiment.replay import Replay

MEAN = "Error of the simulated position", "Mean size of the simulated minus the measured position."
HELD_OUT = (
    "Error of the simulated position",
    "Simulated minus measured position, rms, on stretches that the values were not fitted to.",
)
CHANGED = (
    "Error of each joint",
    "Held-out error, rms, as a share of the joint's torque. Before: with the robot file's effects alone; after: with "
    "everything that was found.",
)
MEMBERS = "Held-out error of each member", "Motor torque minus prediction, rms, on stretches that no fit saw."


def with_figures(report: Report, figures: Sequence[Figure]) -> Report:
    """Return the report with figures, before its closing next command where it has one."""
    sections = list(report.sections)
    place = next((k for k, section in enumerate(sections) if section.key == "next"), len(sections))
    return replace(report, sections=(*sections[:place], *figures, *sections[place:]))


def shares(error: Mapping[str, JointError]) -> dict[str, float]:
    """Return the relative error of each joint."""
    return {joint: e.relative for joint, e in error.items()}


def motor_sides(cases: Sequence[tuple[str, Mapping[str, JointError]]]) -> list[tuple[str, dict[str, float]]]:
    """Return the relative error of each joint's motor side, of every case that has one."""
    known = [(label, {joint: e.spring_relative for joint, e in error.items() if e.spring_relative is not None})
             for label, error in cases]  # fmt: skip
    return [(label, sides) for label, sides in known if sides]


def identification_figures(found: Identification, refined: Robot, signals: Signals) -> tuple[Figure, ...]:
    """Return the figures of an identification; `refined` describes what was found."""
    judged = validate(refined, signals)
    cases = [("held-out error", shares(found.error))]
    sides = motor_sides([("held-out error", found.error)])
    told = FigureInput(
        signals, judged, floor=_floor(found, signals, judged), identified=found, cases=cases, sides=sides
    )
    return figures_of(told)


def comparison_figures(comparisons: Sequence[Comparison]) -> tuple[Figure, ...]:
    """Return the figures of saved results."""
    results = [comparisons[0].first, *(found.other for found in comparisons)]
    return figures_of(FigureInput(comparisons=comparisons, cases=[(r.file, r.error) for r in results]))


def log_figures(recording: Recording, robot: Robot) -> tuple[Figure, ...]:
    """Return the figures of a log that nothing was fitted to."""
    return figures_of(FigureInput(recording=recording, described=robot))


def replay_figures(found: Replay, other: Replay | None = None) -> tuple[Figure, ...]:
    """Return the figures of a replay, and of the same log with another robot where there is one."""
    replays = (found,) if other is None else (found, other)
    labels = ("error", "error of the other robot")
    # no bar is as long as the error of a motion that ran away
    cases = [(label, {joint: 1e3 * e.mean_abs for joint, e in item.error.items() if isfinite(e.mean_abs)})
             for label, item in zip(labels, replays, strict=False)]  # fmt: skip
    unit, units = milli(found.robot), millis(found.robot)
    return figures_of(FigureInput(replays=replays, cases=cases, unit=unit, units=units, heading=MEAN))


def motion_figures(found: MotionDiagnosis) -> tuple[Figure, ...]:
    """Return the figures of a diagnosis by motion, whose motion before and after is simulated for them."""
    from elid_cli.estimation.refined_robot import identified_robot
    from elid_cli.experiment.replay import replay

    after, before = (replay(moving, found.recording) for moving in (found.refined, identified_robot(found.before)))
    cases = [("before", {joint: 1e3 * p.before for joint, p in found.position.items()}),
             ("after", {joint: 1e3 * p.after for joint, p in found.position.items()})]  # fmt: skip
    return figures_of(FigureInput(
        identified=found.after, replays=(after, before), replay_labels=("error after", "error before"), cases=cases,
        unit=milli(found.robot), units=millis(found.robot), heading=HELD_OUT,
    ))  # fmt: skip


def friction_figures(found: FrictionFamily) -> tuple[Figure, ...]:
    """Return the figures of a friction family: the held-out error of every member."""
    units = {found.robot.joint(name).units[1] for name in found.fits}
    cases = [(name, {joint: fits[name].error.rms for joint, fits in found.fits.items()}) for name in found.members]
    return figures_of(FigureInput(cases=cases, unit=" or ".join(sorted(units)), heading=MEMBERS))


def milli(robot: Robot) -> str:
    """Return what errors of positions are told in."""
    turning = [joint.revolute for joint in robot.joints]
    return "mrad" if all(turning) else "mm" if not any(turning) else "mrad or mm"


def millis(robot: Robot) -> dict[str, str]:
    """Return the same of each joint, by name."""
    return {joint.name: "mrad" if joint.revolute else "mm" for joint in robot.joints}


def trend_figures(found: Trends) -> tuple[Figure, ...]:
    """Return the figures of parameters over recordings."""
    return figures_of(FigureInput(trends=found))


def sampling_figures(sets: ParameterSets) -> tuple[Figure, ...]:
    """Return the figures of drawn parameter sets."""
    return figures_of(FigureInput(sets=sets))


def validation_figures(found: Validation, signals: Signals, others: Sequence[ByLog] = ()) -> tuple[Figure, ...]:
    """Return the figures of a validation, compared with other robots or logs where there are any."""
    errors = [(case.label, case.error) for case in others] or [("error", found.error)]
    cases = [(label, shares(error)) for label, error in errors]
    return figures_of(FigureInput(signals, found, cases=cases, sides=motor_sides(errors)))


def diagnosis_figures(
    found: Diagnosis, identified: Identification, parts: Sequence[Contribution], signals: Signals
) -> tuple[Figure, ...]:
    """Return the figures of a diagnosis; `identified` is the model after, `parts` are its `contributions`."""
    floor = found.state_after.floor.rms
    before, after = found.validation_before if parts else None, found.validation_after
    errors = [("before", found.before), ("after", found.after)] if parts else [("held-out error", found.after)]
    cases, sides = [(word, shares(error)) for word, error in errors], motor_sides(errors)
    told = FigureInput(signals, after, before, floor, identified, found, parts, cases=cases, sides=sides)
    return figures_of(replace(told, heading=CHANGED) if parts else told)


def _floor(found: Identification, signals: Signals, judged: Validation) -> Mapping[EstimationRow, float] | None:
    errors = {row: e.floor for row, e in ((EstimationRow("sum", k), found.error.get(j.name))
                                          for k, j in enumerate(found.robot.joints)) if e is not None}  # fmt: skip
    known = {row: floor for row, floor in errors.items() if floor is not None}
    if known:
        return known
    return noise_floor(Regressor(found.robot), signals, judged.observation, found.standard).rms

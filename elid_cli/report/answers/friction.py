"""The answer of ``elid friction``: the members of the friction family side by side, and which one a log supports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from elid_cli.diagnosis.friction_family import PLAIN, FrictionFamily, MemberFit
from elid_cli.diagnosis.friction_shapes import family
from elid_cli.model.effects.effect import Member
from elid_cli.report import tree
from elid_cli.report.answers import inputs
from elid_cli.report.answers.error_tables import torque_unit
from elid_cli.report.answers.identification_json import error_payload
from elid_cli.report.answers.summary import listed
from elid_cli.report.tree import (
    Cell,
    Column,
    KeyValues,
    Mark,
    Quantity,
    Report,
    Section,
    Table,
    Text,
    number_text,
    picked,
    upper,
)
from elid_cli.signals.recording import Recording


def friction_report(
    found: FrictionFamily, recording: Recording, robot_argument: str, written: Sequence[str] = ()
) -> Report:
    """Return the report of one comparison.

    Parameters
    ----------
    found, recording
        The result and what it was found from.
    robot_argument
        What ``--robot`` was given.
    written
        The robot files that were written.
    """
    sections: list[Section] = [
        inputs.heading(found.robot, recording),
        KeyValues("answers", (("which friction?", _sentence(found)),)),
        *tree.warned((*recording.warnings, *_poor(found))),
        _errors(found),
        _members(found),
        *_values(found),
        *([Text("smoothed", _SMOOTHED)] if recording.commanded.any() else []),
        KeyValues("inputs", (
            *inputs.recorded_items(found.robot, recording),
            ("held out", inputs.span_words(found.held_out)),
            *(("left out", reason) for reason in found.skipped.values()),
            *(("written", path) for path in written),
        ), "how it was computed"),
        Text("next", _next(found, recording, robot_argument, written), "next"),
    ]  # fmt: skip
    return Report("friction", friction_payload(found, recording), tuple(sections))


def friction_payload(found: FrictionFamily, recording: Recording) -> dict[str, Any]:
    """Return the JSON object of a comparison."""
    final = _final(found)
    return {
        **inputs.robot_payload(found.robot),
        "log": inputs.log_payload(recording),
        "members": {name: picked(m, "title formula") for name, m in found.members.items()},
        "held_out": found.held_out,
        "friction": {
            joint: {
                "supported": found.supported[joint],
                "parameters": final.get(joint, {}),
                "std_error": found.std_error.get(joint, {}),
                "plain": {
                    name: {"estimate": value, "std_error": error}
                    for name, (value, error) in found.plain.get(joint, {}).items()
                },
                "members": {name: _fit(fit) for name, fit in fits.items()},
            }
            for joint, fits in found.fits.items()
        },
        "skipped": dict(found.skipped),
    }


_SMOOTHED = (
    "torques that are computed from commands are as noisy as the positions, and compared after smoothing, which blurs "
    "friction at the lowest speeds: its size and velocity may be off by more than ± says; elid diagnose fits the "
    "motion itself"
)


def _fit(fit: MemberFit) -> dict[str, Any]:
    return {"error": error_payload({"": fit.error})[""], **picked(fit, "folds parameters possible")}


def _final(found: FrictionFamily) -> dict[str, Mapping[str, float]]:
    """Return the supported members' parameters as the whole log gives them, by joint."""
    own = family().name
    return {spec.joint or found.robot.joint_names[0]: spec.parameters
            for spec in found.refined.effects if spec.effect == own}  # fmt: skip


def _sentence(found: FrictionFamily) -> str:
    groups: dict[str, list[str]] = {}
    for joint, member in found.supported.items():
        groups.setdefault(member, []).append(joint)
    titles = found.members
    words = "; ".join(f"{titles[name].title} friction ({name}) at {listed(groups[name])}"
                      for name in titles if name in groups)  # fmt: skip
    return f"{upper(words)}."


def _errors(found: FrictionFamily) -> Table:
    units = {torque_unit(found.robot, joint) for joint in found.fits}
    unit = units.pop() if len(units) == 1 else ""
    columns = [*Column.texts(joint="joint", supported="chosen")]
    columns += [Column(name, name, unit, "right") for name in found.members]
    rows: list[tuple[Cell, ...]] = []
    for joint, fits in found.fits.items():
        own = torque_unit(found.robot, joint)
        cells: list[Cell] = [joint, Mark(found.supported[joint], "good")]
        for name in found.members:
            fit, tone = fits[name], "good" if name == found.supported[joint] else "plain"
            cells.append(Quantity(fit.error.rms, own, 3, tone="good" if tone == "good" else "plain"))
        rows.append(tuple(cells))
    note = (
        "rms of motor torque minus prediction on stretches that no fit saw. A larger member is chosen where it "
        "predicts the other stretches, each by a fit to the rest, better by 3 % of the squared error and beyond the "
        "scatter, and these stretches, too, and no friction is negative"
    )
    return Table("member_errors", tuple(columns), tuple(rows), title="held-out error of each member", note=note)


def _members(found: FrictionFamily) -> Table:
    rows = tuple((name, m.title, m.formula) for name, m in found.members.items())
    columns = Column.texts(member="member", title="adds", formula="largest friction torque")
    note = (
        "τm: motor torque as the model predicts it; τe: minus what the bodies beyond the joint need, so that |τm - τe| "
        "is about twice the load; e = exp(-(|v|/vs)^α). Names as in arXiv 2410.08650 (BAM)"
    )
    return Table("members", columns, rows, title="the family", note=note)


def _poor(found: FrictionFamily) -> list[str]:
    """Return a warning for joints whose friction no member is the whole of."""
    if not found.poor:
        return []
    times = listed([f"{joint} ({number_text(ratio, 2)} times)" for joint, ratio in found.poor.items()])
    return [
        f"more is left than the sensors' noise would leave: at {times}; the model lacks something there that no member "
        "of the family is, and friction may be off by more than ± says; elid diagnose looks for it"
    ]


def _values(found: FrictionFamily) -> list[Section]:
    final, items = _final(found), []
    for joint, plain in found.plain.items():
        texts = [_with_error(found, joint, name, *told) for name, told in plain.items()]
        if joint in final:
            values = _shown(final[joint], found.members[found.supported[joint]])
            texts.append(inputs.effect_text(found.robot, family().name, joint, values, found.std_error.get(joint, {})))
        items.append((joint, ", ".join(texts)))
    return [KeyValues("values", tuple(items), "friction of the chosen members")] if items else []


def _with_error(found: FrictionFamily, joint: str, name: str, value: float, error: float) -> str:
    """Return Coulomb or viscous friction of a joint: ``fs 0.30 ± 0.02 N·m``."""
    turns = found.robot.joint(joint).revolute
    unit = {"fs": torque_unit(found.robot, joint), "fv": "N·m·s/rad" if turns else "N·s/m"}[name]
    return f"{name} {number_text(value, 3, error)} ± {number_text(error, resolution=error)} {unit}"


def _shown(values: Mapping[str, float], member: Member) -> dict[str, float]:
    """Return what is not said elsewhere: the member is named, and `lean` follows from two of the others.

    One without forms does not depend on the speed: its velocity and exponent stand for nothing.
    """
    hidden = {"model", "lean"} if member.forms else {"model", "lean", "velocity", "exponent"}
    return {name: value for name, value in values.items() if value != 0.0 and name not in hidden}


def _next(found: FrictionFamily, recording: Recording, robot: str, written: Sequence[str]) -> str:
    if written:
        return inputs.command("validate", recording, inputs.fullest(written))
    if all(member == PLAIN for member in found.supported.values()):
        return inputs.command("diagnose", recording, robot)
    return inputs.command("friction", recording, robot, "--write-robot", f"{found.robot.name}-friction.yaml")

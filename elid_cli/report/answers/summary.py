"""What every report opens with: can I trust the model, what is missing, which parameters do I know, what to record.

All in plain words. The tables below the answers hold the numbers that they are drawn from.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from math import isfinite

from elid_cli.errors import first_of, in_words
from elid_cli.estimation.drive_law import LAWFUL
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.known_load import BESIDE_BODIES
from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.validation.sufficiency import ABOVE, MATTERS
from elid_cli.estimation.validation.verdicts import DIFFERS, HELD, HIDES, IMPOSSIBLE, TORQUE_SHARE, TURNED, WEAK
from elid_cli.logs.checks.command_scale import TWO_UNITS
from elid_cli.logs.checks.known_inertias import RUNS
from elid_cli.logs.checks.known_masses import AGAINST
from elid_cli.logs.checks.limits import WRONG
from elid_cli.logs.checks.units_and_signs import AS_IT_IS, NOT_TORQUE
from elid_cli.model.regressor import Kind
from elid_cli.report.answers.inputs import Items
from elid_cli.report.tree import KeyValues, Mark, Section, cell_text, number_text, upper
from elid_cli.robot.parameter import StandardParameter
from elid_cli.robot.robot import Robot

AT_FLOOR = ABOVE
"""A held-out error within this factor of the sensors' noise is noise: the test of the model looks at larger ones."""
USABLE = 0.05
"""Share of the torque up to which a prediction is of use although it holds more than noise."""
CLOSE = 0.01
"""The same where nothing is known of the sensors' noise."""
JOINT_KINDS = {
    "K": "stiffness", "Jm": "motor inertia", "Ja": "motor inertia", "fs": "Coulomb friction", "fv": "viscous friction",
}  # fmt: skip
"""Parameters of drive and transmission in words, in the order in which they are told."""
AFTER = " and the joints further out"
TRUST, MISSING, PARAMETERS, RECORD = (
    "can I trust it?", "what is missing?", "what is known?", "what to record next?",
)  # fmt: skip
POOR, BIASED, ROUGH, NOT_SHOWN, NEGATIVE = "poor", "may be biased", "known roughly", "not shown", "negative"
"""A prediction, and parameters, that are not to be relied on: the same words in sentences, tables and figures."""
RULE = f"to {100 * WEAK:.0f} % or better, or to {number_text(100 * WEAK * TORQUE_SHARE)} % of the torque"
"""How well a parameter is known that is called so: `verdicts.judge` in words."""
KNOWN = f"known: {RULE} (one standard error)"
SMALL = "small"
"""What is said of a known value whose standard error is above 30 % of it: it makes less than 1 % of the torque."""
SMALL_WORDS = f"{SMALL}: makes less than {100 * TORQUE_SHARE:.0f} % of the torque, so no percentage is given"
SYMBOLS = {
    "K": "stiffness of the transmission", "Jm": "inertia of the motor", "Ja": "motor inertia at the joint",
    "fs": "Coulomb friction", "fv": "viscous friction", "m": "mass", "c": "first moment (mass times centre of mass)",
    "I": "inertia of the body about its joint's frame",
}  # fmt: skip
"""Symbols of parameters in words; c and I have axes behind them, all of them the number of their joint."""
DOUBTS = (
    WRONG, RUNS, AGAINST, BESIDE_BODIES, NOT_TORQUE, AS_IT_IS, "sign were wrong", "sign looks wrong", "look swapped",
    LAWFUL, TWO_UNITS,
)  # fmt: skip
"""What a warning says that doubts units, signs, or a torque."""
NEEDS = {
    "K": "torque of {} that varies more: a heavier load, stronger accelerations",
    "Jm": "stronger accelerations of the motor of {}",
    "Ja": "stronger accelerations of {}",
    "fs": "slow motion of {} in both directions",
    "fv": "fast and slow motion of {} in both directions",
}
"""What a log must hold to show a parameter of a joint's drive or transmission."""
FIRST = "first find what is left at {}, with elid diagnose"
"""What a parameter needs that is hidden by what the model leaves."""
LIKE = "first find what differs between the logs at {}: each log alone, and elid compare of two results"
"""What a parameter needs that differs from log to log."""
NAMED = 6
"""Names in a sentence, beyond which they are counted."""


def answers(trust: str, missing: str, parameters: str, record: str) -> KeyValues:
    """Return the four answers, one sentence each; an empty one is left out."""
    told = ((TRUST, trust), (MISSING, missing), (PARAMETERS, parameters), (RECORD, record))
    return KeyValues("answers", tuple((question, answer) for question, answer in told if answer))


def light(error: JointError | None, *, lacking: bool = False) -> Mark:
    """Return how far a joint's prediction can be trusted, in a word and a colour; `lacking`: it follows the motion."""
    if error is None:
        return Mark("no torque", "dim")
    share, times = error.relative, above_noise(error)
    if times is not None:
        if (times <= AT_FLOOR or _beyond_noise(error) <= MATTERS) and not lacking:
            return Mark("good", "good")
    elif share <= CLOSE and not lacking:
        return Mark("good", "good")
    worst = max(share, _beyond_noise(error))  # the motor's own equation may be far worse than the whole joint's
    return Mark("fair", "warn") if worst <= USABLE else Mark(POOR, "bad")


def above_noise(error: JointError) -> float | None:
    """Return how many times the sensors' noise is left, in the worse of a joint's equations; None: not known."""
    return max((rms / floor for rms, floor in _beside_noise(error)), default=None)


def _beyond_noise(error: JointError) -> float:
    """Return what is left beyond the sensors' noise, as a part of the torque, in the worse of a joint's equations."""
    beyond = max((rms**2 - floor**2 for rms, floor in _beside_noise(error)), default=0.0)
    return float(max(beyond, 0.0) ** 0.5) / error.torque_rms if error.torque_rms > 0 else 0.0


def _beside_noise(error: JointError) -> list[tuple[float, float]]:
    """Return the errors of a joint's equations beside their noise, as far as it is known."""
    pairs = ((error.rms, error.floor), (error.spring_rms, error.spring_floor))
    return [(rms, floor) for rms, floor in pairs if rms is not None and floor]


def largest_share(error: JointError) -> tuple[float, Kind]:
    """Return the error as a part of the torque, in the worse of a joint's equations, and that equation's row."""
    motor = (error.spring_rms or 0.0) / error.torque_rms if error.torque_rms > 0 else 0.0
    sides: tuple[tuple[float, Kind], ...] = ((error.relative, "sum"), (motor, "motor"))
    return max(sides, key=lambda side: side[0])


def only_noise(error: JointError, share: float) -> bool:
    """Whether a joint's error is above a share of its torque in the motor's equation alone, and there by noise alone.

    Noise of the encoders is there times the stiffness; no other model would leave less.
    """
    floor, left = error.spring_floor, error.spring_rms
    return error.relative <= share and bool(floor and left and left <= AT_FLOOR * floor)


def _motor_side(error: JointError) -> bool:
    """Whether the motor's equation is the worse one beside its noise."""
    times = above_noise(error)
    return bool(error.spring_floor and error.spring_rms and error.spring_rms / error.spring_floor == times)


def trust_words(
    robot: Robot, error: Mapping[str, JointError], lacking: Collection[str] = (), warnings: Sequence[str] = ()
) -> str:
    """Return whether the model predicts the motor torques, in a sentence.

    `lacking` as `light` has it, of joints; `warnings` of the log may doubt its units, which no prediction shows.
    """
    return doubted(_predicted_words(robot, error, lacking), warnings)


def doubted(words: str, warnings: Sequence[str]) -> str:
    """Return an answer to whether a model can be trusted with what warnings of the log doubt."""
    verdict, _, rest = words.partition(": ")
    if verdict.split(",")[0] not in ("Yes", "Mostly") or not any(
        doubt in line for line in warnings for doubt in DOUBTS
    ):
        return words
    _, comma, further = verdict.partition(",")
    what = "torque is what acts" if any(LAWFUL in line for line in warnings) else "units and signs are right"
    return f"Only if the log's {what}, which a warning doubts{comma}{further}: {rest}"


def _predicted_words(robot: Robot, error: Mapping[str, JointError], lacking: Collection[str]) -> str:
    if not error:
        return "Nobody can tell: no joint has a torque in this log."
    marks = {joint: light(e, lacking=joint in lacking).text for joint, e in error.items()}
    shares = {joint: share_text(largest_share(e)[0]) for joint, e in error.items()}
    worst = max(error, key=lambda joint: largest_share(error[joint]))
    noise = all(e.floor for e in error.values())
    silent = [name for name in robot.joint_names if name not in error]
    but = f" Nothing is known of {listed(silent)}, without torque or motion in this log." if silent else ""
    if all(mark == "good" for mark in marks.values()):
        down = "down to the sensors' noise" if noise else "closely"
        return (
            f"Yes: the torque of every joint is predicted {down}; the largest error is {shares[worst]} of the torque "
            f"(rms, at {worst}).{but}"
        )
    poor = [joint for joint, mark in marks.items() if mark == POOR]
    if poor:
        sizes = listed([shares[joint] if len(poor) == 1 else f"{shares[joint]} at {joint}" for joint in poor])
        return f"Not at {listed(poor)}: the torque is predicted with an error of {sizes} (rms, of the torque).{but}"
    fair = [joint for joint, mark in marks.items() if mark == "fair"]
    times = max(((times, j) for j in fair if (times := above_noise(error[j])) is not None), default=None)
    left = ""
    if times:
        where = f"{times[1]}, motor side" if _motor_side(error[times[1]]) else times[1]
        left = f"; the error is up to {number_text(times[0], 2)} times the sensors' noise (at {where})"
    most = shares[worst].removeprefix("< ")
    return f"Mostly: no joint's torque is predicted with an error above {most} (rms, of the torque){left}.{but}"


def small_value(estimate: float, deviation: float, verdict: str) -> bool:
    """Whether a parameter is known although its error is large beside its value: it hardly moves the torque."""
    return verdict == "supported" and WEAK * abs(estimate) < deviation


def called(name: str) -> str:
    """Return a base parameter's short name: ``m2 with 3 others`` of a combination of four."""
    leader, *others = re.split(r" [+-] ", name)
    return f"{leader} with {len(others)} other{'s' * (len(others) > 1)}" if others else leader


def symbol_words(names: Iterable[str]) -> str:
    """Return what the symbols of parameters mean, those that occur in `names`."""
    kinds = {kind for name in names for kind in re.findall(r"[A-Za-z]+", name)}
    kinds |= {kind[0] for kind in kinds if kind not in SYMBOLS}
    return "; ".join(f"{symbol}: {words}" for symbol, words in SYMBOLS.items() if symbol in kinds)


def plan_command(log: str, robot: str) -> str:
    """Return the command that plans a motion for what a log does not show."""
    return shlex.join(["elid", "excite", "--robot", robot, "--after", log, "-o", "next.csv"])


def record_sections(
    found: Identification,
    further: Items,
    arguments: Sequence[str],
    *,
    writes: bool = False,
    written: bool = False,
    plan: bool = False,
    following: str = "",
    unclear: bool = False,
) -> tuple[str, list[Section]]:
    """Return what the next log should hold, in a sentence and as a list with the command that plans its motion.

    Parameters
    ----------
    found
        The parameters after this log.
    further
        What else a log should hold: what for, such as ``to tell X from Y``, and what; it comes first.
    arguments
        The log and the robot as the user named them: what ``elid excite`` aims at.
    writes, written
        Whether the report's next command writes the robot file, or whether that is written already.
    plan
        Whether a motion is to be planned whatever the parameters.
    following
        The report's next command: where it plans the motion, the list does not say so again.
    unclear
        Whether something may be missing that follows nothing.
    """
    log, robot = arguments
    groups: dict[str, list[BaseEstimate]] = {}
    for item in () if found.drives else found.parameters:
        told = item.reason.startswith((IMPOSSIBLE, HELD)) or TURNED in item.reason  # no other motion mends it
        if item.verdict != "supported" and not told:
            groups.setdefault(_needed(item), []).append(item)
    joints = found.robot.joint_names
    items = [*further, *(
        (f"for {listed([called(item.name) for item in members])}",
         _where(need, [item.leader.joint for item in members], joints))
        for need, members in sorted(groups.items(), key=lambda item: item[0] in {FIRST, LIKE})
    )]  # fmt: skip
    if not items:
        check = "Nothing more for these parameters. A second log would check them: elid validate."
        if found.model == "insufficient" or unclear:
            check = "Nothing more for these parameters. First find what is missing: elid diagnose."
        if written:
            check = "Nothing more for these parameters. Check the written robot file on another log: elid validate."
        elif writes:
            check = (
                "Nothing more for these parameters. Write the robot file (next command), then check it on another log: "
                "elid validate."
            )
        return check, []
    sentence = f"{upper(cell_text(items[0][1]))} ({items[0][0]}){'; more below' if len(items) > 1 else ''}."
    command = plan_command(log, robot)
    if (groups.keys() - {FIRST, LIKE} or found.drives or (plan and not further)) and command != following:
        items.append(("command that plans it", command))
    return sentence, [KeyValues("record", tuple(items), "what to record next")]


def _where(need: str, members: Sequence[int], joints: Sequence[str]) -> str:
    """Return a need with its joints in it; what is borne by the joints after moves with them, where there are any."""
    names = [joints[joint] for joint in sorted(set(members))]
    if AFTER in need and len(joints) - 1 in members:
        need = need.replace(AFTER, "")
    return need.format(listed(names) if len(names) < max(len(joints), 3) else f"all {len(names)} joints")


def _needed(item: BaseEstimate) -> str:
    """Return what a log must hold to show a base parameter that this one does not, braces for its joint."""
    kind, joint = item.leader.kind, "{}"
    if item.reason.endswith(DIFFERS):
        return LIKE
    for known in ("does not move", "do not move", "no motor torque", "no torque", "move it into"):
        if known in item.reason:
            return {
                "no motor torque": f"the torque of the motor of {joint}",
                "no torque": f"the torque of {joint}",
                "move it into": f"more poses of {joint} against gravity",
            }.get(known, f"motion of {joint}")
    if item.reason.endswith(HIDES):
        return FIRST
    if "encoder noise" in item.reason:
        return f"more load on {joint} or finer encoders"
    return NEEDS.get(kind, f"stronger accelerations, in more poses, of {joint}{AFTER}")


def by_kind(leaders: Sequence[StandardParameter]) -> list[int]:
    """Return the order in which base parameters are told, by their leaders: drive and transmission, then the bodies."""
    places = {kind: k for k, kind in enumerate(JOINT_KINDS)}
    return sorted(range(len(leaders)), key=lambda k: (places.get(leaders[k].kind, len(places)), k))


PARTIAL = (
    "stopped by Ctrl-C: this is what the search had found so far; more effects may be missing, and no robot file is"
    " written"
)
"""Said of a diagnosis that was not finished."""


def share_text(fraction: float) -> str:
    """Return a share in percent with two digits, as far as they mean anything."""
    percent = 100.0 * fraction
    if not isfinite(percent):
        return "–"
    return "< 0.01 %" if percent < 0.01 else f"{number_text(percent, 2)} %"


def spread_text(deviation: float, value: float) -> str:
    """Return a standard error in percent of a value, without the unit; beyond 100 no number means much."""
    share = deviation / abs(value) if value else float("nan")
    return "> 100" if share > 1.0 else share_text(share).removesuffix(" %")


def signed_share(fraction: float) -> str:
    """Return a change in percent, with its sign."""
    return f"{'+' if fraction > 0 else '−'}{share_text(abs(fraction))}"


def listed(names: Sequence[str]) -> str:
    """Return names as a list in words: ``joint1, joint2 and joint3``."""
    return in_words(names, NAMED)


def counted(names: Sequence[str], between: str = " ") -> str:
    """Return names, or those of the first few with the number of the others."""
    return first_of(names, NAMED, between)

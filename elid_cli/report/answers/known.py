"""Which parameters a log shows, and how well, in a few sentences."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from elid_cli.errors import in_words
from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.validation.verdicts import HELD, IMPOSSIBLE
from elid_cli.report.answers import summary
from elid_cli.report.answers.drives import drives_words
from elid_cli.report.answers.lacking import is_doubted

BODIES = "masses and inertias"
COMBINATIONS = "what motion can show"
"""What base parameters are, in the fewest words."""
IS_NEGATIVE = "came out negative, which no robot's is"
YES = "Yes: "
"""An answer that a warning of units or signs would change."""
NAMED = 5
"""Parameters of a kind that are named; the others are counted."""


def parameter_words(found: Identification, loud: Collection[str] = ()) -> str:
    """Return how many parameters are known, and how well: the largest standard error of each kind.

    `loud` are joints at which more than noise may be left although it follows no variable of the motion.
    """
    if found.drives:
        return drives_words(found)
    supported = [item for item in found.parameters if item.verdict == "supported"]
    known = [item for item in supported if not item.bias_possible]
    held = [item for item in found.parameters if item.reason.startswith(HELD)]
    negative = [item for item in found.parameters if item.reason.startswith(IMPOSSIBLE)]
    rough = [item for item in found.parameters if item.verdict == "weak" and item not in negative and item not in held]
    small = [item for item in known if summary.small_value(item.estimate, item.std_error, item.verdict)]
    named = f"base parameters ({COMBINATIONS})"
    total = len(found.verdict)
    if not known:
        whole = f"None of the {total} {named} is known {summary.RULE}"
    else:
        part = f"All {total}" if len(known) == total else f"{len(known)} of {total}"
        whole = f"{part} {named} are known {summary.RULE}"
    warnings = (*found.log_warnings, *found.warnings)
    sound = found.model == "insufficient" or is_doubted(found) or summary.doubted(YES, warnings) == YES
    by_what = "by what is missing" if sound else "as a warning doubts what the log is"
    said = [
        whole,
        _counted(rough, f"{summary.ROUGH}, less well than that"),
        _counted([item for item in supported if item.bias_possible], f"{summary.BIASED} {by_what}"),
        _counted(negative, IS_NEGATIVE),
        f"{len(held)} {'is' if len(held) == 1 else 'are'} held at the file's values" if held else "",
        _counted([item for item in found.parameters if item.verdict == "refused" and item not in held],
                 f"{summary.NOT_SHOWN} by this log"),
        _counted(small, f"known to be {summary.SMALL}"),
        _stiffnesses(found),
        _in_doubt(found, loud),
    ]  # fmt: skip
    sizes = _largest_errors([item for item in known if item not in small], found.robot.joint_names)
    said += [f"Largest standard errors of the {'others' if small else 'known'}: {sizes}"] if sizes else []
    return " ".join(f"{sentence}." for sentence in said if sentence)


def _stiffnesses(found: Identification) -> str:
    """Return what the motor side says of stiffnesses whose links the log does not hold; nothing where not asked."""
    joints = found.motor_side.joints if found.motor_side else ()
    told: dict[str, list[str]] = {}
    for joint in joints:
        error = "" if joint.verdict == "refused" else f" to {summary.share_text(joint.std_error / joint.stiffness)}"
        told.setdefault(joint.verdict, []).append(f"{joint.joint}{error}")
    words = {"supported": "known", "weak": summary.ROUGH, "refused": f"{summary.NOT_SHOWN} by this log"}
    parts = [f"{words[verdict]} ({in_words(told[verdict], NAMED)})" for verdict in words if verdict in told]
    return f"Stiffness from the motor's side: {'; '.join(parts)}" if parts else ""


def _counted(items: Sequence[BaseEstimate], words: str) -> str:
    """Return how many parameters there are of a kind, and which; nothing of none."""
    verb = "" if words.startswith(("may", "came")) else "is " if len(items) == 1 else "are "
    return f"{len(items)} {verb}{words} ({some(item.name for item in items)})" if items else ""


def some(names: Iterable[str]) -> str:
    """Return the short names of a handful of base parameters, and how many more there are."""
    return in_words([summary.called(name) for name in names], NAMED)


def _in_doubt(found: Identification, loud: Collection[str]) -> str:
    """Return which parameters what is left at some joints may bias if it is no noise: those of these joints first."""
    names = found.robot.joint_names
    own = [item.name for item in found.parameters
           if item.verdict == "supported" and not item.bias_possible and names[item.leader.joint] in loud]  # fmt: skip
    if not own:
        return ""
    where = summary.listed([name for name in names if name in loud])
    return f"If what is left at {where} is no noise, it may bias these first: {some(own)}"


def _largest_errors(known: Sequence[BaseEstimate], joints: Sequence[str]) -> str:
    """Return the largest standard error of each kind of known parameters, in percent of the value, and whose it is."""
    largest: dict[str, tuple[float, str]] = {}
    for item in known:
        if item.estimate:
            word = summary.JOINT_KINDS.get(item.leader.kind, BODIES)
            whose = summary.called(item.name) if word == BODIES else joints[item.leader.joint]
            own = item.std_error / abs(item.estimate), whose
            largest[word] = max(largest.get(word, own), own)
    told = [word for word in dict.fromkeys((*summary.JOINT_KINDS.values(), BODIES)) if word in largest]
    return ", ".join(f"{word} {summary.share_text(largest[word][0])} ({largest[word][1]})" for word in told)

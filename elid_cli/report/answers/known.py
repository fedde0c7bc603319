"""Which parameters a log shows, and how well, in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from elid_cli.estimation.result import BaseEstimate, Identification
from elid_cli.estimation.validation.verdicts import HELD
from elid_cli.report.answers.summary import (
    BIASED,
    JOINT_KINDS,
    NEAR_ZERO,
    NOT_SHOWN,
    ROUGH,
    listed,
    near_zero,
    share_text,
)

BODIES = "masses and inertias"
COMBINATIONS = "what motion can show"
"""What base parameters are, in the fewest words."""


def parameter_words(found: Identification) -> str:
    """Return how many parameters are known, and how well: the largest standard error of each kind."""
    supported = [item for item in found.parameters if item.verdict == "supported"]
    known = [item for item in supported if not item.bias_possible]
    rough = [str(item.leader) for item in found.parameters if item.verdict == "weak"]
    held = sum(item.reason.startswith(HELD) for item in found.parameters)
    counts = {f"{BIASED} by what is missing": len(supported) - len(known),
              f"{ROUGH} ({listed(rough)})": len(rough),
              "held at the file's values": held,
              f"{NOT_SHOWN} by this log": found.verdict.count("refused") - held}  # fmt: skip
    rest = [f"{count} {words}" for words, count in counts.items() if count]
    near = [str(item.leader) for item in known if near_zero(item.estimate, item.std_error, item.verdict)]
    named = f"base parameters ({COMBINATIONS})"
    total = len(found.verdict)
    if not known:
        whole = f"None of the {total} {named} is known"
    else:
        whole = f"{len(known)} of {total} {named} are known" if rest else f"All {total} {named} are known"
        whole += f", {len(near)} of them as {NEAR_ZERO} ({listed(near)})" if near else ""
    whole = "; ".join((whole, *rest))
    sizes = _largest_errors(known)
    return f"{whole}. Largest standard errors of the known: {sizes}." if sizes else f"{whole}."


def _largest_errors(known: Sequence[BaseEstimate]) -> str:
    """Return the largest standard error of each kind of known parameters, in percent of the value; near 0 has none."""
    largest: dict[str, tuple[float, str]] = {}
    for item in known:
        if item.estimate and not near_zero(item.estimate, item.std_error, item.verdict):
            own = item.std_error / abs(item.estimate), str(item.leader)
            word = JOINT_KINDS.get(item.leader.kind, BODIES)
            largest[word] = max(largest.get(word, own), own)
    told = [word for word in dict.fromkeys((*JOINT_KINDS.values(), BODIES)) if word in largest]
    return ", ".join(
        f"{word} {share_text(largest[word][0])}" + f" ({largest[word][1]})" * (word == BODIES) for word in told
    )

"""What ``elid trend`` says of one kind of parameters over all joints."""

from __future__ import annotations

from typing import Any

from elid_cli.estimation.trend.families import Family
from elid_cli.estimation.trend.trends import Trends
from elid_cli.report.answers.summary import share_text, signed_share
from elid_cli.report.tree import picked, upper

KINDS = {
    "fv": "viscous friction",
    "fs": "Coulomb friction",
    "Ja": "rotor inertia",
    "K": "stiffness",
    "d": "damping of the transmission",
}
"""What kinds of drive parameters are called in a sentence."""
CAUSES = {
    "fv": "warming up, or a delay between command and motion that differs between recordings, which acts like it",
    "fs": "warming up, or a torque scale that differs between recordings",
    "K": "a torque scale that differs between recordings, or another temperature or load of the gears",
    "d": "warming up, or a delay between torque and motion that differs between recordings",
}
"""What changes a kind at all joints alike; for every other kind, `SHARED`."""
SHARED = "a torque scale or a delay that differs between recordings; temperature does not change it"
WORDS = {"time": "time", "temperature": "the mean temperature", "delay": "the delay found"}


def family_entries(found: Trends) -> list[dict[str, Any]]:
    """Return the entries of ``families`` in JSON."""
    return [_entry(item) for item in found.families]


def _entry(item: Family) -> dict[str, Any]:
    return {
        **picked(item, "kind names means slope std_error"),
        "slope_interval": item.interval,
        **picked(item, "slope_p together_p"),
        "verdict": item.word,
        "explained": [picked(e, "by share p ruled_out") for e in item.explained],
    }


def family_sentences(found: Trends, word: str) -> list[str]:
    """Return a sentence on every family with this verdict."""
    return [_sentence(item, found) for item in found.families if item.word == word]


def _sentence(item: Family, found: Trends) -> str:
    """Return what joints do together, how far it is a line, and what could do that."""
    low, high = item.interval
    named = f"{KINDS[item.kind]} {item.kind}" if item.kind in KINDS else item.kind
    slope = f"{signed_share(item.slope)} ± {share_text((high - low) / 2)} per {found.axis}"
    joints = f"{named} of {len(item.names)} joints"
    if item.word == "trend":
        said = f"{joints} changes together by {slope} (p = {item.slope_p:.1g})"
    elif low > 0 or high < 0:
        said = f"{joints} {'rises' if item.slope > 0 else 'falls'} together, by {slope} (p = {item.slope_p:.1g})"
        said += f"; joints differ alike between recordings (p = {item.together_p:.1g})"
    else:
        said = f"{joints} differs alike between recordings (p = {item.together_p:.1g}), and no line is shown: {slope}"
    said = upper(said) if item.kind in KINDS else said
    return f"{said}. That can be {CAUSES.get(item.kind, SHARED)}.{_with(item)}"


def _with(item: Family) -> str:
    """Return what the change goes with, of time and what the recordings tell."""
    if len(item.explained) < 2:
        return ""
    best = item.explained[0]
    alike = [e for e in item.explained[1:] if not e.ruled_out]
    said = f" It goes with {WORDS[best.by]} ({share_text(best.share)} of its variance)"
    if not alike:
        others = ", ".join(f"{WORDS[e.by]} ({share_text(e.share)})" for e in item.explained[1:])
        return f"{said}, better than with {others}."
    also = " or ".join(f"{WORDS[e.by]} ({share_text(e.share)})" for e in alike)
    return f"{said} or {also}: these recordings do not tell them apart."

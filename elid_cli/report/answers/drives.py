"""What a fit of the motion under commands found, drive by drive: the bodies stay those of the robot file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor, inf, log10

from elid_cli.errors import in_words
from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.verdicts import WEAK
from elid_cli.report.answers.summary import NAMED, SYMBOLS, listed, share_text
from elid_cli.report.tree import Cell, Column, Mark, Table, number_text

OFFSET = "offset"
DIGITS = 4
WORDS = {"Ja": "motor inertia", "fs": "Coulomb friction", "fv": "viscous friction", OFFSET: "torque offset"}
NEEDS = {
    "Ja": "stronger accelerations of {}",
    "fs": "slow motion of {} in both directions",
    "fv": "fast and slow motion of {} in both directions",
}


def drives_table(found: Identification) -> Table:
    """Return the table of the drives, one a row."""
    columns = (
        Column("joint", "joint"),
        *Column.numbers(Ja="Ja", fs="fs", fv="fv", offset=OFFSET),
    )
    rows = [(joint, *(_cell(values[kind], kind) for kind in WORDS)) for joint, values in found.drives.items()]
    units = ["kg·m², N·m, N·m·s/rad and N·m", "kg, N, N·s/m and N"]
    revolute = {joint.revolute for joint in found.robot.joints}
    unit = "; of sliding joints ".join([u for u, kind in zip(units, (True, False), strict=True) if kind in revolute])
    symbols = "; ".join(f"{kind}: {SYMBOLS.get(kind, words)}" for kind, words in WORDS.items() if kind != OFFSET)
    note = f"{symbols}; offset: of the torque\nin {unit}, with one standard error each"
    return Table("drives", columns, tuple(rows), f"drives, with the bodies of {found.robot.name}", note=note)


def _cell(item: Mapping[str, float], kind: str) -> Cell:
    value, deviation = item["estimate"], item["std_error"]
    # four such columns fit a terminal: one digit of the error, and four of the value at most
    if not 0 < deviation < inf:
        text = f"{number_text(value)} ± {number_text(deviation)}"
    else:
        decimals = -floor(log10(deviation))
        if value:
            decimals = min(decimals, DIGITS - 1 - floor(log10(abs(value))))
        decimals = min(max(decimals, 0), 12)
        least = 10.0**-decimals
        error = f"{deviation:.{decimals}f}" if deviation >= 0.5 * least else f"< {least:.{decimals}f}"
        text = f"{value:.{decimals}f} ± {error}"
    return Mark(text, "warn") if kind != OFFSET and _is_rough(item) else text


def _is_rough(item: Mapping[str, float]) -> bool:
    return not _share(item) <= WEAK


def _share(item: Mapping[str, float]) -> float:
    return item["std_error"] / abs(item["estimate"]) if item["estimate"] else float("inf")


def drives_words(found: Identification) -> str:
    """Return how well the drives are known, in a few sentences."""
    drives, names, rough = found.drives, in_words(list(WORDS.values())), _rough(found)
    whole = "the joint" if len(drives) == 1 else f"all {len(drives)} joints"
    said = [f"{names[:1].upper()}{names[1:]} of {whole}, with the bodies of the robot file"]
    if rough:
        which = "; ".join(f"{WORDS[kind]} of {listed(joints)}" for kind, joints in rough.items())
        said.append(f"Known roughly, to worse than {100 * WEAK:.0f} %: {which}")
    sizes = []
    for kind in NEEDS:
        known = {joint: item[kind] for joint, item in drives.items() if not _is_rough(item[kind])}
        if known:
            worst, share = max(((joint, _share(item)) for joint, item in known.items()), key=lambda pair: pair[1])
            sizes.append(f"{WORDS[kind]} {share_text(share)} ({worst})")
    said += [f"Largest standard errors of the {'others' if rough else 'values'}: {', '.join(sizes)}"] if sizes else []
    return " ".join(f"{sentence}." for sentence in said)


def _rough(found: Identification) -> dict[str, list[str]]:
    """Return the joints of which a parameter is known roughly, by parameter."""
    rough: dict[str, list[str]] = {}
    for joint, values in found.drives.items():
        for kind in NEEDS:
            if _is_rough(values[kind]):
                rough.setdefault(kind, []).append(joint)
    return rough


def drives_needed(found: Identification) -> Sequence[tuple[str, Cell]]:
    """Return what the next log should hold for what is known roughly: for what, and what."""
    said = {kind: joints[0] if len(joints) == 1 else "these joints" for kind, joints in _rough(found).items()}
    return [
        (f"for {WORDS[kind]} of {in_words(joints, NAMED)}", NEEDS[kind].format(said[kind]))
        for kind, joints in _rough(found).items()
    ]

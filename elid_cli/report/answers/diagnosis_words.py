"""Words of a diagnosis: what a residual follows, what a curve runs over, which effect at which joint."""

from __future__ import annotations

from collections.abc import Mapping

from elid_cli.model.effects.library.lookup import ROWS, VARIABLES

_VARIABLES = {
    "reversals": "reversals of its motor (sticking)",
    "theta": "motor angle",
    "dtheta": "motor speed",
    "ddtheta": "motor acceleration",
    "tau": "torque",
    "t": "time",
    "deflection_rate": "deflection rate",
}


def variable_words(variable: str) -> str:
    """Return in words what a residual follows: ``motor speed``, ``angle of joint2``, ``line at 28.3 Hz``."""
    head, _, rest = variable.partition(" ")
    if rest.startswith("of "):
        return f"{'speed' if head == 'dtheta' else 'angle'} {rest}"
    if head == "frequency":
        return f"line at {rest}"
    return _VARIABLES.get(variable, variable)


def curve_words(parameters: Mapping[str, float]) -> str:
    """Return what a `lookup` effect runs over and where it acts: ``velocity in the motor row``."""
    variable, rows = VARIABLES[int(parameters["variable"]) - 1], ROWS[int(parameters["rows"]) - 1]
    return f"{variable} in the {rows}{'' if rows == 'transmission' else ' row'}"


def whose(effect: str, joint: str | None) -> str:
    """Return an effect with its joint."""
    return effect if joint is None else f"{effect} of {joint}"

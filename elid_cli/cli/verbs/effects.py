"""List the effects that a model may lack, or explain one."""

from __future__ import annotations

import click

from elid_cli.cli import values
from elid_cli.cli.group import verb
from elid_cli.cli.options import Output, output


@verb("elid effects stribeck")
@click.argument("name", required=False, metavar="[NAME]", shell_complete=values.completing(values.effects))
@output
def effects(name: str | None, output: Output) -> None:
    """List the effects that elid knows, or explain one: physics, equation, typical size, how its residual looks,
    what it is confused with, and what to record to see it.
    """  # noqa: D205
    from elid_cli.cli.output import emit
    from elid_cli.errors import UsageError, did_you_mean
    from elid_cli.model.effects import effect_classes
    from elid_cli.report.answers.effects import effect_report, effects_report

    library = effect_classes()
    if name is None:
        emit(effects_report(library), output)
    elif name in library:
        emit(effect_report(library[name]), output)
    else:
        raise UsageError(f"elid effects: no effect {name!r}", hint=did_you_mean(name, library))

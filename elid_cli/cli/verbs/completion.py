"""Print the completion script of a shell.

Completes commands, options, robots, effects and files.
"""

from __future__ import annotations

import click

from elid_cli.cli import COMPLETE, options
from elid_cli.cli.group import elid, verb


@verb('eval "$(elid completion bash)"', "elid completion zsh > ~/.zfunc/_elid", "elid completion fish | source")
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")), metavar="SHELL")
@options.debug
def completion(shell: str) -> None:
    """Print the script that lets bash, zsh or fish complete commands, options, robots and effects."""
    from click.shell_completion import ShellComplete, get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None
    # ShellComplete.source, because bash's own would run a bash to ask for its version.
    click.echo(ShellComplete.source(kind(elid, {}, "elid", COMPLETE)))

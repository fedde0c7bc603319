"""`elid` itself: a group that finds its verbs by listing the files of `verbs`, and imports the one called.

A file is a verb when ``@verb`` decorates a function of its own name in it; the first line of its docstring is its
line in ``elid --help``. Both are read from the source text, so that help imports no verb.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import pkgutil
import re
from collections.abc import Callable
from functools import cache
from importlib.abc import InspectLoader
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from elid_cli import __version__
from elid_cli.errors import UsageError, did_you_mean, nearest
from elid_cli.files import refuse_overwriting

PACKAGE = f"{__package__}.verbs"
ORDER = ("info", "init", "identify", "classify", "diagnose", "validate", "reduce", "simulate", "excite")
"""Verbs in the order of a first day with elid; any other follows in alphabetical order."""
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


@cache
def summaries() -> dict[str, str]:
    """Return verb -> one line, without importing any verb."""
    names = [module.name for module in pkgutil.iter_modules(importlib.import_module(PACKAGE).__path__)]
    sources = {name: source for name in names if (source := _verb_source(name))}
    found = {n: (ast.get_docstring(ast.parse(s)) or "").split("\n")[0].rstrip(".") for n, s in sources.items()}
    rest = sorted(set(found) - set(ORDER))
    return {name: found[name] for name in (*ORDER, *rest) if name in found}


@cache
def _verb_source(name: str) -> str:
    """Return the source text of a verb; nothing where there is no such file, or where it is no verb."""
    source = _source(f"{PACKAGE}.{name}") if name.isidentifier() else ""
    return source if re.search(rf"^@verb\((.|\n)*^def {name}\(", source, re.MULTILINE) else ""


def _source(name: str) -> str:
    """Return a module's source text, wherever its loader keeps it."""
    spec = importlib.util.find_spec(name)
    loader = spec.loader if spec is not None else None
    return (loader.get_source(name) or "") if isinstance(loader, InspectLoader) else ""


class Option(click.Option):
    """An option that knows under which heading its help stands."""

    def __init__(self, *args: Any, heading: str = "Options", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.heading = heading


class ExampleFirst:
    """Help that opens with examples to paste."""

    examples: tuple[str, ...] = ()

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write examples, usage, text, then options or commands."""
        for number, example in enumerate(self.examples):
            formatter.write(f"{'Example: ' if number == 0 else '         '}{example}\n")
        if self.examples:
            formatter.write("\n")
        super().format_help(ctx, formatter)  # type: ignore[misc]


class Verb(ExampleFirst, click.Command):
    """A command of elid: examples first, options under headings."""

    def __init__(self, *args: Any, examples: tuple[str, ...] = (), **kwargs: Any) -> None:
        kwargs.setdefault("context_settings", CONTEXT)
        super().__init__(*args, **kwargs)
        self.examples = examples

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; a fault that click's parser finds is told with the verb's name."""
        try:
            if not ctx.resilient_parsing:
                self._written_once(ctx, args)
            rest = super().parse_args(ctx, args)
            if not ctx.resilient_parsing:
                self._nothing_overwritten(ctx)
            return rest
        except click.UsageError as problem:
            problem.ctx = problem.ctx or ctx
            raise

    def _written_once(self, ctx: click.Context, args: list[str]) -> None:
        """Refuse a file to write that is named twice: click would keep the last and say nothing of the first."""
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        for param in dict.fromkeys(order):
            output = getattr(param, "heading", "") == "Output" and isinstance(param.type, click.Path)
            if output and not param.multiple and order.count(param) > 1:
                name = max(param.opts, key=len)
                raise UsageError(
                    f"{name}: given {order.count(param)} times, and only one file is written", hint="name one"
                )

    def _nothing_overwritten(self, ctx: click.Context) -> None:
        """Refuse a file to write that is also read, or written twice."""
        files: dict[bool, list[tuple[str, str]]] = {True: [], False: []}
        for param in self.params:
            value = ctx.params.get(param.name or "")
            written = getattr(param, "heading", "") == "Output"
            if (not isinstance(param.type, click.Path) and param.name != "robot") or param.name == "plot" or not value:
                continue
            name = max(param.opts, key=len) if isinstance(param, click.Option) else ""
            files[written] += [(name, one) for one in ([value] if isinstance(value, str) else value)]
        refuse_overwriting(files[False], files[True])

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, grouped by heading, in the order of their definition."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is not None and isinstance(param, click.Option):
                groups.setdefault(getattr(param, "heading", "Options"), []).append(record)
        for heading, records in groups.items():
            with formatter.section(heading):
                formatter.write_dl(records)


def verb(*examples: str) -> Callable[[Callable[..., None]], Verb]:
    """Return a decorator that makes a function a verb of elid, with examples for its help."""

    def decorate(function: Callable[..., None]) -> Verb:
        return click.command(function.__name__, cls=Verb, examples=examples)(function)

    return decorate


class Verbs(ExampleFirst, click.Group):
    """The group of all verbs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the verbs in the order of help."""
        return list(summaries())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a verb; None where there is no such file."""
        if not _verb_source(cmd_name):
            return None
        command = getattr(importlib.import_module(f"{PACKAGE}.{cmd_name}"), cmd_name)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the verb, or say which one was probably meant."""
        name = args[0]
        if not _verb_source(name) and not ctx.resilient_parsing:
            raise UsageError(f"elid: no such command {name!r}", hint=_meant(name))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs with their lines, importing none."""
        with formatter.section("Commands"):
            formatter.write_dl(list(summaries().items()))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete a verb, importing none."""
        verbs = [CompletionItem(name, help=line) for name, line in summaries().items() if name.startswith(incomplete)]
        return [*verbs, *click.Command.shell_complete(self, ctx, incomplete)]


def _meant(name: str) -> str:
    """Return a hint for a word that is no verb: the nearest verb, or what to do with a file."""
    near = nearest(name, summaries())
    if near is None and Path(name).exists():
        return f"elid info {name}"
    return did_you_mean(name, summaries())


@click.group(cls=Verbs, name="elid", context_settings=CONTEXT, invoke_without_command=True)
@click.version_option(__version__, "--version", message="elid %(version)s", help="Show the version.")
@click.pass_context
def elid(context: click.Context) -> None:
    """Identify the dynamics of a robot with elastic joints from a recorded log, and name the effect that its
    model lacks.

    COMMAND --help explains each command. ELID_ROBOT may name the robot, so that --robot can be left out.
    """  # noqa: D205
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


elid.examples = ("elid identify run07.mcap --robot puma560",)

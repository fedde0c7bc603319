"""What click has to say about a command line, in elid's own form: where, what, and something to paste."""

from __future__ import annotations

import re

import click

from elid_cli.errors import UsageError, did_you_mean, nearest


def usage_error(problem: click.ClickException) -> UsageError:
    """Return the error of elid that stands for an error of click."""
    context = getattr(problem, "ctx", None)
    where = context.command_path if context is not None else "elid"
    if isinstance(problem, click.NoSuchOption):
        message = f"{where}: no such option '{problem.option_name}'"
        return UsageError(message, hint=_hint_for_option(problem.option_name, context))
    if isinstance(problem, click.MissingParameter):
        return _missing(problem, where, context)
    if isinstance(problem, click.BadParameter):
        option = _name(problem.param) or "value"
        return UsageError(f"{where}: {option}: {_plain(problem.message)}", hint=_hint_for_choice(problem))
    return UsageError(f"{where}: {_plain(problem.format_message())}", hint=_help(where))


def _missing(problem: click.MissingParameter, where: str, context: click.Context | None) -> UsageError:
    examples = getattr(context.command, "examples", ()) if context is not None else ()
    name = _name(problem.param)
    what = f"no {name.lower()} given" if isinstance(problem.param, click.Argument) else f"needs {name}"
    return UsageError(f"{where}: {what}", hint=examples[0] if examples else _help(where))


def _hint_for_option(option: str, context: click.Context | None) -> str:
    if context is None:
        return ""
    if isinstance(context.command, click.Group):
        return f"options stand behind the command: elid COMMAND {option} …"
    known = [name for param in context.command.params for name in (*param.opts, *param.secondary_opts)]
    long = [name for name in known if name.startswith("--")]
    return did_you_mean(option, long) if nearest(option, long) else _help(context.command_path)


def _hint_for_choice(problem: click.BadParameter) -> str:
    """Return the nearest choice to what was typed, which click quotes first."""
    kind = problem.param.type if problem.param is not None else None
    typed = re.match(r"'(.*?)' is not one of", problem.message)
    if not isinstance(kind, click.Choice) or typed is None:
        return ""
    choices = [str(choice) for choice in kind.choices]
    return did_you_mean(typed.group(1), choices) if nearest(typed.group(1), choices) else ""


def _name(param: click.Parameter | None) -> str:
    if param is None:
        return ""
    if isinstance(param, click.Argument):
        return (param.metavar or param.human_readable_name).strip("[]….").upper()
    return max(param.opts, key=len)


def _plain(message: str) -> str:
    text = " ".join(message.split()).rstrip(".")
    return text[:1].lower() + text[1:]


def _help(where: str) -> str:
    return f"{where} --help"

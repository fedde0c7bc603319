"""Write what a URDF or MJCF cannot hold into a YAML beside it: `arm.elid.yaml` for `arm.urdf`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from elid_cli.cli import options, values
from elid_cli.cli.group import verb
from elid_cli.cli.options import LOCK, TIP, Output

if TYPE_CHECKING:
    from elid_cli.robot.completion import Completion
    from elid_cli.robot.robot import Robot


@verb("elid init arm.urdf run07.mcap", "elid init arm.urdf run07.csv --map map.yaml --force")
@click.argument("robot", type=values.File(), metavar="ROBOT")
@click.argument("log", type=values.File(), metavar="[LOG]", required=False)
@options.held
@options.maps
@options.out("The file to write. Default: arm.elid.yaml beside arm.urdf, where elid looks for it.", required=False)
@options.option(options.OUTPUT, "--force", is_flag=True, help="Overwrite an existing file.")
@options.output
def init(robot: str, log: str | None, maps: tuple[str, ...], out: str | None, force: bool, output: Output) -> None:
    """Write arm.elid.yaml beside arm.urdf or arm.xml: what such a file cannot hold.

    For example: gear ratios, elastic joints, where the log keeps its signals. Commands with --robot arm.urdf read it.

    In a terminal it asks you, and proposes values from the log. In a pipe it writes what it knows, and the rest as
    comments to fill in.
    """
    from pathlib import Path

    from elid_cli.cli.output import emit, note
    from elid_cli.errors import UsageError
    from elid_cli.files import check_target, write_text
    from elid_cli.logs import read_map_options
    from elid_cli.logs.writing import log_suffixes
    from elid_cli.report.answers.completion import completion_report
    from elid_cli.robot.beside import beside_file
    from elid_cli.robot.completion import completion_text
    from elid_cli.robot.files import read_robot

    if robot.lower().endswith(log_suffixes()):
        raise UsageError(f"{robot}: is a log; the robot's file comes first", hint=f"elid init {log or 'ROBOT'} {robot}")
    machine = read_robot(robot, beside=False)
    if not machine.source:
        raise UsageError(
            f"{robot}: is elid's own description, which says all of this itself",
            hint=f"elid info {log or 'LOG'} --robot {robot} --write-map map.yaml finds the signals of a log",
        )
    target = Path(out) if out else beside_file(Path(robot))
    check_target(target, (".yaml", ".yml"), "a robot's completion")
    if target.exists() and not force:
        raise UsageError(f"{target}: is there already", hint="edit it, or --force to write it anew")
    known = _known(machine, log, read_map_options(maps), asks=_asks(output))
    write_text(target, completion_text(machine, known))
    if target.resolve() != beside_file(Path(robot)).resolve():
        note([f"{target} is read when it is called {beside_file(Path(robot))}"], output)
    emit(completion_report(machine, known, robot, str(target)), output)


def _asks(output: Output) -> bool:
    """Whether somebody is there to be asked."""
    from elid_cli.cli.color import is_terminal

    return not (output.json or output.markdown or output.quiet) and is_terminal(sys.stdin) and is_terminal(sys.stdout)


def _known(robot: Robot, log: str | None, mapping: dict[str, Any], *, asks: bool) -> Completion:
    """Return what options, log and user say of a robot."""
    from dataclasses import replace

    from elid_cli.cli.asking import asked
    from elid_cli.logs.first_look import first_look
    from elid_cli.robot.completion import Completion
    from elid_cli.robot.locking import beside_chain, locked

    meta = click.get_current_context().meta
    tip, lock = meta.get(TIP) or "", dict(meta.get(LOCK) or ())
    chain = dict.fromkeys(beside_chain(robot, tip), 0.0) if tip else {}
    locked(robot, {**chain, **lock})  # names that are none are refused

    def look(held: Mapping[str, float], said: Mapping[str, Any]) -> Completion:
        held = {**held, **lock}
        return first_look(robot, log, held, {**mapping, **said}) if log else Completion(lock=held)

    if asks:
        return asked(robot, look, tip)
    return replace(look(chain, {}), tip=tip, lock=lock)

"""Progress: on a terminal only, on stderr, there within half a second and gone at the end."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from datetime import timedelta
from typing import TYPE_CHECKING

from elid_cli.cli.color import is_terminal, wants_color
from elid_cli.cli.options import Output
from elid_cli.errors import visible

if TYPE_CHECKING:
    from elid_cli._types import Progress

CLEAR = "\r\x1b[K"


@contextlib.contextmanager
def progress(output: Output, first: str = "reading") -> Iterator[Progress | None]:
    """Show progress while the block runs; yields None where nobody looks.

    Enter before anything heavy is imported, so that the first sign of life does not wait for it.
    """
    if output.quiet or not _is_shown():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars
    from rich.table import Column
    from rich.text import Text

    class _Remaining(ProgressColumn):
        """How long still; nothing while that is not known."""

        max_refresh = 0.5

        def render(self, task: Task) -> Text:
            left = task.time_remaining
            return Text("" if left is None else f"about {timedelta(seconds=round(left))} left", style="dim")

    color = wants_color(sys.stderr, output.color)
    console = Console(
        file=sys.stderr, force_terminal=True, color_system="standard" if color else None, markup=False, highlight=False
    )
    spinner = "dots" if (sys.stderr.encoding or "").lower().replace("-", "") == "utf8" else "line"
    columns = (
        SpinnerColumn(spinner),
        TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True)),
        BarColumn(bar_width=24),  # gives way on a narrow terminal
        TimeElapsedColumn(table_column=Column(no_wrap=True)),
        _Remaining(table_column=Column(no_wrap=True)),
    )
    with Bars(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False) as bars:
        bars.add_task(first, total=None)
        bars.refresh()

        def advance(stage: str, share: float) -> None:
            stage = visible(stage)
            # what stands behind a comma is a detail of the same stage, whose clock goes on
            if bars.tasks[-1].description.partition(",")[0] != stage.partition(",")[0]:
                bars.add_task(stage, total=1.0)
                for old in bars.task_ids[:-1]:  # the last one stays: Ctrl-C may come between any two lines
                    bars.remove_task(old)
            began = bars.tasks[-1].description.partition(":")[0] != stage.partition(":")[0]
            bars.update(bars.task_ids[-1], description=stage, total=1.0, completed=min(max(share, 0.0), 1.0))
            if began:  # a step of a stage that is short is shown all the same
                bars.refresh()

        yield advance


def _is_shown() -> bool:
    return is_terminal(sys.stderr) and os.environ.get("TERM") != "dumb"


def tell_plain_steps(output: Output) -> None:
    """Say on stderr that motion is simulated slowly where Numba is missing; before the work, so on a terminal too."""
    from elid_cli.compiling import PLAIN, has_numba

    if not (has_numba() or output.quiet):
        # in place of the line of progress, which is drawn anew below
        sys.stderr.write(f"{CLEAR if _is_shown() else ''}note: {PLAIN}\n")

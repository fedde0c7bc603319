"""What every log format offers: channels to choose from, and streams of the chosen ones.

A format is one module of `elid_cli/logs/formats` that defines `FORMAT`, a `LogFormat`; listing that folder finds it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.logs.source import Source
from elid_cli.signals.recording import Recording


@dataclass(frozen=True)
class Channel:
    """One addressable set of numbers: a CSV column, an HDF5 dataset, a field of an MCAP topic."""

    source: str
    """Column, dataset path or topic: what a mapping's `from` names."""
    field: str = ""
    """Dotted path inside a message; empty for columns and datasets."""
    width: int = 1
    """Values per sample."""
    labels: tuple[str, ...] = ()
    """Names of the values (joint names), where the log has them."""
    rows: int | None = None
    """Samples, where known without reading the log."""
    kind: str = ""
    """Type of the message or of the dataset, for messages to the user."""
    open_ended: bool = False
    """Whether labels other than these may still occur further on in the log."""

    @property
    def address(self) -> str:
        """How a user writes it: ``/topic.field`` or the column."""
        return f"{self.source}.{self.field}" if self.field else self.source


@dataclass(frozen=True)
class Pick:
    """A request for columns of one channel: by label or, for a look or where the channel has no labels, by index.

    `time` is what the mapping calls ``t``, or the format's canonical names do where the log has it.
    """

    source: str
    field: str
    columns: tuple[int | str, ...]
    time: str = ""
    """Column or dataset with the stamps of this channel; empty: the log's own time."""
    signal: str = ""
    """The signal that it is a part of: a table keeps the columns of one signal together."""


@dataclass(frozen=True)
class Stream:
    """Samples of one `Pick`, in the order of the file."""

    values: Array
    """Shape (N, columns); NaN where a message did not carry a column."""
    clocks: Mapping[str, NDArray[Any]]
    """Stamps by clock, each of shape (N,), in the file's own unit; empty: the log has no time.

    ``t`` is a column's or a dataset's, ``header stamp`` and ``log time`` are a message's. Streams that were sampled
    together hold one array.
    """


class RawLog(Protocol):
    """An opened log; nothing but its directory has been read yet."""

    @property
    def channels(self) -> Sequence[Channel]:
        """Everything numeric in the log."""

    @property
    def canonical(self) -> Sequence[Mapping[str, Any]]:
        """The format's canonical names (docs/reference/formats.md) and usual spellings, in the mapping language."""

    @property
    def losses(self) -> list[str]:
        """What could not be read (a cut end, a corrupt chunk), one sentence each; complete after `load`."""

    @property
    def notes(self) -> list[str]:
        """What the format decided by itself (separator, time column)."""

    def load(self, picks: Sequence[Pick]) -> list[Stream]:
        """Read the picked columns in one pass over the file: one stream for each pick, in their order.

        Raises
        ------
        LogError
            Whatever a damaged file does to its reader. Any other exception counts as a fault of elid's, and is reported
            to the user as one.
        """


@dataclass(frozen=True)
class LogFormat:
    """One log format: how to recognise, open and (where supported) write it."""

    name: str
    suffixes: tuple[str, ...]
    recognise: Callable[[Source], bool]
    """Whether the content (never the suffix) is of this format; must be cheap."""
    open: Callable[[Source], Sequence[RawLog]]
    """Open a log; more than one part where it holds separate episodes."""
    write: Callable[[Recording, str], bytes] | None = None
    """Encode a recording canonically; same recording, same bytes. The second argument is the file's name."""
    lacks: tuple[str, ...] = ()
    """Signals of a recording that such a file has no place for: `write` leaves them out, and no other."""
    priority: int = 0
    """Formats are asked in ascending order; text, which would take anything, comes last."""

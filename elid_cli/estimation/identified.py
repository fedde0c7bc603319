"""What several logs say together: the identification, how each log fits it, and the samples where they are at hand."""

from __future__ import annotations

from typing import NamedTuple

from elid_cli.estimation.result import Identification
from elid_cli.estimation.validation.prediction import ByLog
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals


class Identified(NamedTuple):
    """What was found, from what, how it fits each of several logs, and the signals where they are at hand."""

    found: Identification
    recording: Recording
    apart: tuple[ByLog, ...]
    signals: Signals | None

    def __str__(self) -> str:
        return str(self.found)

    def _repr_html_(self) -> str:
        return self.found._repr_html_()

    def to_dict(self) -> dict[str, object]:
        """Return what was found as `Identification.to_dict` does."""
        return self.found.to_dict()

    def to_frame(self) -> object:
        """Return the base parameters as `Identification.to_frame` does."""
        return self.found.to_frame()

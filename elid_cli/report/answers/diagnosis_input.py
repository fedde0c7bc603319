"""What the report of a diagnosis tells of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from elid_cli.diagnosis import Diagnosis
from elid_cli.diagnosis.refit import Contribution
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.result import Identification
from elid_cli.signals.recording import Recording


@dataclass(frozen=True)
class Check:
    """The models before and after on a log that neither was fitted to."""

    recording: Recording
    before: Mapping[str, JointError]
    after: Mapping[str, JointError]


@dataclass(frozen=True)
class DiagnosisInput:
    """A diagnosis with what goes with it in a report."""

    found: Diagnosis
    before: Identification
    after: Identification
    contributions: Sequence[Contribution]
    recording: Recording
    robot_argument: str
    """What ``--robot`` was given."""
    checks: Sequence[Check] = field(default_factory=tuple)
    written: str | None = None
    """The robot file that was written, if any."""
    lookup: bool = False
    """Whether a smooth curve was asked for."""
    only: Sequence[str] = ()
    """The effects that were tried, if not all."""


def referenced(model: Identification) -> bool:
    """Whether the robot file holds a reference of every base parameter."""
    return all(value == value for value in model.reference)

"""What figures are made from: all that a command found. Every kind of figure takes what it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elid_cli.diagnosis.refit import Contribution
    from elid_cli.diagnosis.result import Diagnosis
    from elid_cli.estimation.comparison import Comparison
    from elid_cli.estimation.result import Identification
    from elid_cli.estimation.sampling.sets import ParameterSets
    from elid_cli.estimation.trend.trends import Trends
    from elid_cli.estimation.validation.prediction import Validation
    from elid_cli.experiment.excitation import Excitation
    from elid_cli.experiment.replay import Replay
    from elid_cli.experiment.resolve import Resolution
    from elid_cli.model.regressor import EstimationRow
    from elid_cli.report.figures.joint_views import JointView
    from elid_cli.robot.robot import Robot
    from elid_cli.signals.recording import Recording
    from elid_cli.signals.signals import Signals


@dataclass(frozen=True)
class FigureInput:
    """What a command found; None or empty where it has no such thing."""

    signals: Signals | None = None
    judged: Validation | None = None
    """The robot as it was described or found, judged on the log."""
    judged_before: Validation | None = None
    """The robot before a diagnosis."""
    floor: Mapping[EstimationRow, float] | None = None
    """What the sensors' noise alone leaves in each row of `judged`, N·m (N)."""
    identified: Identification | None = None
    diagnosis: Diagnosis | None = None
    contributions: Sequence[Contribution] = ()
    """What each effect of the diagnosis takes away."""
    excitation: Excitation | Resolution | None = None
    """A planned motion."""
    recording: Recording | None = None
    """A log that nothing was fitted to yet, and the robot that it is read for."""
    described: Robot | None = None
    replays: Sequence[Replay] = ()
    """A replayed log, and the same with another robot."""
    replay_labels: tuple[str, str] = ("error", "error of the other robot")
    cases: Sequence[tuple[str, Mapping[str, float]]] = ()
    """Errors to compare: a label, and the error of each joint, a share of its torque or in `unit`."""
    unit: str = ""
    """What `cases` are in, such as ``mrad``; empty: they are shares of torques."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Of each joint, where they are not all of one."""
    heading: tuple[str, str] = ("Error of each joint", "Error of the torque, rms, as a share of the joint's torque.")
    """Title and caption of the figure of `cases`."""
    sides: Sequence[tuple[str, Mapping[str, float]]] = ()
    """The same of the motor side, where joints have one."""
    comparisons: Sequence[Comparison] = ()
    """Saved results against the first one."""
    trends: Trends | None = None
    """Parameters over recordings."""
    sets: ParameterSets | None = None
    """Drawn parameter sets."""

    @property
    def robot(self) -> Robot | None:
        """The robot of the log."""
        known = self.identified or self.judged
        return self.described if known is None else known.robot

    @property
    def refused(self) -> frozenset[str]:
        """Names of base parameters that were refused."""
        found = self.identified
        if found is None:
            return frozenset()
        return frozenset(n for n, v in zip(found.base.names, found.verdict, strict=True) if v == "refused")

    @cached_property
    def views(self) -> Sequence[JointView]:
        """A view of every joint whose torque is known."""
        return self._views(self.judged, self.floor)

    @cached_property
    def views_before(self) -> Mapping[str, JointView]:
        """The same before the diagnosis, by joint."""
        return {view.joint: view for view in self._views(self.judged_before, None)}

    def _views(self, judged: Validation | None, floor: Mapping[EstimationRow, float] | None) -> tuple[JointView, ...]:
        from elid_cli.report.figures.joint_views import joint_views

        return () if judged is None or self.signals is None else joint_views(judged, self.signals, floor)

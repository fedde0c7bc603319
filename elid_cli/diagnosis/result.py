"""What a diagnosis answers: found effects, their rivals, what stays unexplained, the error before and after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.diagnosis.evidence.quarters import Survival
from elid_cli.diagnosis.fit.state import State
from elid_cli.diagnosis.fit.whitening import JointWhitener
from elid_cli.diagnosis.residuals import Organised, RowState
from elid_cli.estimation.judgement import JointError
from elid_cli.estimation.result import FittedEffect, Identification, Nuisance
from elid_cli.estimation.validation.prediction import Validation
from elid_cli.model.effects import effect_classes, nuisance_of
from elid_cli.model.effects.relations import in_deflection
from elid_cli.robot.robot import Robot
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import Signals
from elid_cli.tables import Shown

if TYPE_CHECKING:
    from elid_cli.diagnosis.refit import Contribution, Published


@dataclass(frozen=True)
class Rival:
    """An effect that the data cannot tell apart from a named one."""

    effect: str
    joint: str | None
    instead_of: str
    gain: float
    parameters: Mapping[str, float]
    separate: str
    """What to record to tell them apart."""
    std_error: Mapping[str, float] = field(default_factory=dict)
    """Of its parameters, from a fit with it in the other's place; empty where there was none."""
    behind: float = 0.0
    """Log-likelihood by which it explains this log worse than the named effect, negative where better."""
    beside: tuple[FoundEffect, ...] = ()
    """Named effects as they are beside it, where their values hang on which of the two it is."""
    change: Array | None = field(default=None, repr=False, compare=False)
    """By how much it moves the base parameters in place of the named one, (b,); None where there was no such fit."""
    drives: Array | None = field(default=None, repr=False, compare=False)
    """The same of the drives' parameters that a motion is fitted with, (n * 4,)."""
    further: Array | None = field(default=None, repr=False, compare=False)
    """What base parameters' standard errors are then more, squared and summed, (b,): it may tell less than that."""
    at: str | None = None
    """The named effect's joint; None where that is one of the whole robot, or effects at several joints together."""
    moved: tuple[tuple[str, float], ...] = ()
    """Base parameters that it moves by two standard errors or more, the most first, and what they then are."""


@dataclass(frozen=True)
class OtherForm:
    """A found effect in another form (friction that fades by another law) that explains the log about as well."""

    parameters: Mapping[str, float]
    behind: float
    """Log-likelihood by which it explains this log worse, negative where better."""
    change: Array = field(repr=False)
    """What it does to the base parameters, (b,)."""
    moved: tuple[tuple[str, float], ...] = ()
    """Base parameters that it moves by two standard errors or more, the most first, and what they then are."""


@dataclass(frozen=True)
class FoundEffect:
    """An effect that held-out data support."""

    effect: str
    joint: str | None
    parameters: Mapping[str, float]
    std_error: Mapping[str, float]
    gain: float
    """Fraction of the held-out residual variance, in the rows it acts on, that it takes away."""
    summary: str
    net: float = 0.0
    """Gain in log-likelihood on the training stretches, net of its price."""
    folds: tuple[bool, ...] = ()
    """In which cross-validation folds it helps."""
    local: bool = False
    """Whether it lives in a part of the log only, which cross-validation over time cannot judge."""
    deflection: tuple[float, float] | None = None
    """Of an effect seen in the positions alone: held-out rms of the deflection without and with it, rad (m)."""
    collocated: bool = False
    """Whether it is a term of a friction curve that the collocation told: its gain is that of all such terms together,
    of what the held-out stretches show beyond noise."""
    quarters: tuple[float, ...] = ()
    """Part of the squared error that it takes from each quarter of the log, predicted from the others; NaN where the
    quarter cannot tell, empty for local effects and curves."""
    absorbed: bool = False
    """Whether base parameters had taken nearly all of it: its size tells it, which is surely not 0, not its gain."""
    forms: tuple[OtherForm, ...] = ()
    """Other forms of it that explain the log about as well; the parameters' standard errors reach to what they say."""


class Nearest(NamedTuple):
    """An effect that comes near to explaining a residual and is not supported."""

    effect: str
    joint: str | None
    gain: float
    """Part of the joint's whitened squared residual that it takes from folds of the search that it was not fitted
    to."""
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Unexplained:
    """Structure that no effect of the library explains."""

    joint: str
    rows: str
    variable: str
    share: float
    """Part of the row's residual variance that follows the variable."""
    rms: float
    ratio: float
    """Residual over the noise floor."""
    nearest: tuple[Nearest, ...]
    """Nearest candidates."""
    by_identify: bool = False
    """Whether identification sees it, at its own cut-off, and not the search: what would explain it was not tried."""


@dataclass(frozen=True)
class Moved:
    """A base parameter that the found effects moved."""

    name: str
    before: float
    after: float
    deviations: float
    """Shift in standard deviations of the estimate after."""


@dataclass(frozen=True)
class RowNoiseModel:
    """Noise of the filtered and decimated rows, joint by joint."""

    rate: float
    """Instants per second."""
    share: float
    """Share of the equations that count as independent once whitened."""
    joints: tuple[JointWhitener, ...]


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """Everything `elid diagnose` says."""

    robot: Robot
    refined: Robot
    before: Mapping[str, JointError]
    after: Mapping[str, JointError]
    effects: tuple[FoundEffect, ...]
    also_possible: tuple[Rival, ...]
    nuisances: tuple[Nuisance, ...]
    unexplained: tuple[Unexplained, ...]
    rows_before: tuple[RowState, ...]
    rows_after: tuple[RowState, ...]
    triage: tuple[str, ...]
    organised: Mapping[tuple[str, str], tuple[Organised, ...]]
    """What the residual before follows, per (joint, rows)."""
    moved: tuple[Moved, ...]
    sufficient: bool
    """Whether the model before already left nothing but noise."""
    tried: int
    held_out: tuple[tuple[float, float], ...]
    """Held-out stretches, s."""
    validation_before: Validation
    validation_after: Validation
    chosen: NDArray[np.bool_]
    """Held-out instants, (M,)."""
    state_before: State
    state_after: State
    usual: Signals | None = None
    """The log as identification takes it; None: prepared from the recording with the usual options."""
    curves: tuple[FoundEffect, ...] = ()
    """Smooth curves added by request where no named effect explains the structure."""
    repeats: float | None = None
    """Period, s, after which the motion repeats: what is locked in time then looks like an effect of the state."""
    partial: bool = False
    """Whether Ctrl-C ended the search: what it had not come to may be missing as well."""
    refuted: tuple[Survival, ...] = ()
    """Effects that the search found and that make some quarter of the log, predicted from the others, worse."""
    searched_at: tuple[float, ...] = ()
    """Cut-offs at which effects were looked for, in order, Hz."""
    yielding: tuple[str, ...] = ()
    """Joints that the robot file has elastic and that are rigid here, as the log has their motors only."""

    @property
    def recording(self) -> Recording:
        """The log that it was found in."""
        recording = self.state_after.log.raw.recording
        assert recording is not None  # `prepare` keeps it
        return recording

    @cached_property
    def _published(self) -> Published:
        from elid_cli.diagnosis.refit import published
        from elid_cli.signals.signals import prepare

        bare = replace(self.robot, effects=())
        return published(self, self.usual or prepare(self.recording, bare))

    @cached_property
    def row_noise(self) -> RowNoiseModel:
        """What the rows of the model after bear beside it: the noise that an effect has to show against."""
        projected = self.state_after.projected
        return RowNoiseModel(self.state_after.log.observation.rate, projected.independent, projected.whiteners)

    @property
    def identified_cutoff(self) -> float:
        """Cut-off of `identified_after`, Hz; infinite where a collocation fitted it."""
        told = self.identified_after.settings.get("published")
        return float(told["cutoff"]) if isinstance(told, dict) else float("inf")

    @property
    def identified_before(self) -> Identification:
        """Base parameters by the model as given, at identification's own cut-off."""
        return self._published.before

    @property
    def identified_after(self) -> Identification:
        """Base parameters by the model with what was found, at identification's own cut-off."""
        return self._published.after

    @property
    def written_robot(self) -> Robot:
        """The robot with what was found, as ``--write-robot`` writes it: without what happened in this log alone."""
        robot, library = self._published.robot, effect_classes()
        declared = [(spec.effect, spec.joint) for spec in self.robot.effects]
        kept = (s for s in robot.effects if not library[s.effect].event or (s.effect, s.joint) in declared)
        return replace(robot, effects=tuple(kept))

    @property
    def corrected(self) -> tuple[Nuisance, ...]:
        """What is corrected in the channels beside the parameters: delays and offsets as identification sees them."""
        named = {(effect.effect, effect.joint) for effect in self.effects}
        others = (item for item in self.nuisances if nuisance_of(item.effect) is None)
        found = (item for item in self.identified_after.nuisances if (item.effect, item.joint) not in named)
        return (*others, *found)

    @property
    def events(self) -> tuple[FoundEffect, ...]:
        """What was found that happened in this log alone."""
        return tuple(effect for effect in self.effects if effect_classes()[effect.effect].event)

    def certain(self, effect: FoundEffect) -> bool:
        """Whether an effect is told from what is locked in time: by a motion that does not repeat, or by the encoders.

        Delays and faults between encoders are in every sample, whatever the motion does.
        """
        kind = effect_classes()[effect.effect]
        at = kind.number(self.robot, effect.joint)
        return self.repeats is None or kind.corrects is not None or in_deflection(kind, self.robot, at)

    @property
    def predicted_worse(self) -> tuple[str, ...]:
        """Joints whose torque, at identification's cut-off and on left-out stretches, what was found predicts worse.

        `written_robot` then has the parameters before, and of what was found what lies between motor and link.
        """
        return self._published.worse

    @property
    def left_out(self) -> tuple[Mapping[str, JointError], Mapping[str, JointError]]:
        """Errors on left-out stretches, before and after, both at one cut-off of identification's, `usual_cutoff`."""
        return self._published.left_out

    @property
    def usual_cutoff(self) -> float:
        """Identification's cut-off that `left_out` is of, Hz."""
        return self._published.cutoff

    @property
    def identified_with_effects(self) -> Identification:
        """`identified_after` with the standard errors of the effects that the search found."""
        known = (FittedEffect(e.effect, e.joint, e.parameters, e.std_error) for e in self.effects)
        return replace(self.identified_after, effects=(*self.identified_after.effects, *known))

    @cached_property
    def contributions(self) -> tuple[Contribution, ...]:
        """Of every effect and curve: the held-out error without it and with it."""
        from elid_cli.diagnosis.refit import contributions

        return contributions(self)

"""Errors of predicted torques, and what residuals say of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.model.regressor import EstimationRow, Kind

if TYPE_CHECKING:
    pass


ModelWord = Literal["sufficient", "insufficient", "not judged"]
EQUATIONS = {
    "sum": "whole joint", "motor": "motor side", "load": "link side", "drive": "drive", "spring": "transmission",
    "link": "link side", "deflection": "deflection",
}  # fmt: skip
"""Row of a joint, by its name in JSON -> what people are told it is."""


@dataclass(frozen=True)
class SensorError:
    """Errors of one joint against its torque sensor, N·m (N), on the same data."""

    load_rms: float
    """Reading minus what the bodies need."""
    drive_rms: float
    """Motor torque minus reading, less rotor and friction; NaN where the motor torque is not known."""
    spring_rms: float
    """Reading minus K (theta - q)."""
    reading_rms: float
    """rms of the reading."""


@dataclass(frozen=True)
class JointError:
    """Error of the predicted motor torque of one joint on data not used in the fit, N·m (N)."""

    rms: float
    """Motor torque minus prediction with the spring eliminated (sum row)."""
    relative: float
    """`rms` over the rms of the torque."""
    spring_rms: float | None
    """Motor row alone: spring torque from K (theta - q); None for a rigid joint."""
    spring_relative: float | None
    torque_rms: float
    floor: float | None = None
    """rms that the sensors' noise alone would leave in the sum row."""
    spring_floor: float | None = None
    sensor: SensorError | None = None
    """The same against the joint's torque sensor, where it has one."""

    def of_torque(self, rms: float) -> JointError:
        """Return the same error as a share of another torque, N·m (N) rms."""
        share = None if self.spring_rms is None else self.spring_rms / rms
        return replace(self, relative=self.rms / rms, spring_relative=share, torque_rms=rms)


@dataclass(frozen=True)
class RowNoise:
    """What one row's residual is like beside the sensors' noise."""

    joint: str
    rows: Kind
    """Row: ``sum`` or ``motor``; of a joint with a torque sensor ``load``, ``drive`` or ``spring``."""
    floor: float
    """rms that the sensors' noise alone would leave, N·m (N)."""
    ratio: float
    """Residual over it."""
    correlation: float
    """How long the residual remembers, s."""
    moment: tuple[float, float] | None = None
    """Start and stop, s, of the one moment in which most of it lies."""


@dataclass(frozen=True)
class Insufficient:
    """A row whose residual follows the motion: the model lacks something there."""

    joint: str
    rows: Kind
    ratio: float
    """Residual over its noise."""
    follows: str
    """What it follows best."""
    share: float
    """Part of its variance that the motion predicts, stretch by stretch from the others."""


@dataclass(frozen=True)
class NotExcluded:
    """A fault or a missing torque that a log would show from some size on only."""

    effect: str
    joint: str | None
    """Where; None: of the whole robot."""
    parameter: str
    """Its amplitude."""
    up_to: float
    """Size up to which it would not be told."""
    unit: str
    moves: float
    """By how many of its standard errors some base parameter is off with one of that size."""


@dataclass(frozen=True)
class ColumnNoise:
    """What noise of the positions is in the columns of a row."""

    row: EstimationRow
    index: NDArray[np.intp]
    """Numbers of its columns, (k,)."""
    gram: Array
    """Mean square of their noise at an instant, (k, k)."""


@dataclass(frozen=True)
class Judgement:
    """What the residual on one log says of the model."""

    noise: tuple[RowNoise, ...]
    insufficient: tuple[Insufficient, ...]
    """The rows whose residual follows the motion."""
    biased: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Base parameters that what is missing can move, (b,); none where nothing was fitted."""
    columns: tuple[ColumnNoise, ...] = ()
    """What noise of the positions is in the columns; none where that is not known."""
    notes: tuple[str, ...] = ()
    """What the other parameters may have taken up, in sentences."""
    misfitted: tuple[Insufficient, ...] = ()
    """Rows of a described robot whose residual follows the motion as other values of its parameters would."""
    not_excluded: tuple[NotExcluded, ...] | None = None
    """What other parameters would take up without a sign, from the one that moves them most; None: not asked."""

    @property
    def model(self) -> ModelWord:
        """What is said of the model."""
        if not self.noise:
            return "not judged"
        return "insufficient" if self.insufficient else "sufficient"


def without_chance(told: Sequence[Judgement]) -> list[Judgement]:
    """Return judgements of several logs, without what few of them find only likely: by chance one of many does."""
    likely = [bool(one.notes) and not one.insufficient for one in told]
    if len(told) == 1 or 2 * sum(likely) >= len(told):
        return list(told)
    return [
        replace(one, notes=(), biased=np.zeros_like(one.biased)) if unsure else one
        for one, unsure in zip(told, likely, strict=True)
    ]


def joined_bounds(told: Sequence[Judgement]) -> tuple[NotExcluded, ...]:
    """Return what none of several logs excludes: up to the smallest size, as each of them would show it."""
    asked = [one.not_excluded for one in told if one.not_excluded is not None]
    kept: dict[tuple[str, str | None, str], NotExcluded] = {}
    for item in (item for bounds in asked for item in bounds):
        key = item.effect, item.joint, item.parameter
        kept[key] = min(item, kept.get(key, item), key=lambda i: i.up_to)
    shown_by = [{(i.effect, i.joint, i.parameter) for i in bounds} for bounds in asked]
    everywhere = [item for key, item in kept.items() if all(key in keys for keys in shown_by)]
    return tuple(sorted(everywhere, key=lambda item: -item.moves))


def joined_noise(said: Sequence[Judgement]) -> tuple[RowNoise, ...]:
    """Return the noise of every row in all logs together."""
    rows: dict[tuple[str, Kind], list[RowNoise]] = {}
    for one in said:
        for item in one.noise:
            rows.setdefault((item.joint, item.rows), []).append(item)
    return tuple(  # a moment is one of a log, and is not told of several
        RowNoise(*row, *np.sqrt(np.mean([[i.floor**2, i.ratio**2, i.correlation**2] for i in items], axis=0)).tolist())
        for row, items in rows.items()
    )  # fmt: skip

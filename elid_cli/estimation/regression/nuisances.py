"""Nuisances of every torque channel, estimated along so that they do not bias the parameters.

Delay: a torque that is held by the drive and logged at the start of the sample acts half a sample later than
logged; left alone, that moves rotor inertias by tens of per cent. To first order
W p = u(t - delay) = u - delay du/dt. Offset: a constant in the torque channel (or friction that differs between
the two directions, which motion alone cannot tell apart) moves Coulomb friction and gravity terms. A joint torque
sensor has an offset of its own, and a gain: where the motor torque shows them beyond doubt they are corrected.
"""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np
from numpy.typing import NDArray

from elid_cli._types import Array
from elid_cli.estimation.regression.least_squares import Solution
from elid_cli.estimation.regression.observation import Observation
from elid_cli.estimation.regression.triangles import ExtraColumns
from elid_cli.model.effects import effect_that
from elid_cli.model.effects.effect import Effect
from elid_cli.model.regressor import EstimationRow

SIGNIFICANT = 4.0
"""Standard deviations a nuisance must differ from zero to be corrected."""
LIKELY = 2.0
"""Standard deviations within which a delay agrees with others."""
FAR = 8.0
"""The same for a delay longer than a sample."""
ALIKE = 0.1
"""Part of their mean by which delays of all channels, of torques logged later than they act, may differ."""
LONGEST = 0.025
"""Longest delay of a torque channel, s, that is corrected."""
DELAY = effect_that(nuisance="delay").name
OFFSET = effect_that(nuisance="offset").name
READING_GAIN = effect_that(nuisance="reading gain").name
READING_OFFSET = effect_that(nuisance="reading offset").name


def delay_columns(observation: Observation) -> list[ExtraColumns]:
    """Return one column per torque channel: du/dt in the joint's sum and motor rows, coefficient = delay in s."""
    return _channel_columns(observation, DELAY, observation.tau_rate, "s")


def offset_columns(observation: Observation) -> list[ExtraColumns]:
    """Return one constant column per torque channel, coefficient = offset in N·m (N)."""
    return _channel_columns(observation, OFFSET, np.ones_like(observation.tau), "N·m")


def _channel_columns(observation: Observation, name: str, values: Array, unit: str) -> list[ExtraColumns]:
    present = {group.row for group in observation.groups if group.count}
    extras = []
    for k in range(observation.robot.n):
        acted = (EstimationRow("sum", k), EstimationRow("motor", k), EstimationRow("drive", k))
        rows = {row: values[k][None] for row in acted if row in present}
        if rows:
            extras.append(ExtraColumns(name, rows, (unit,)))
    return extras


def beside_effects(
    nuisances: Sequence[ExtraColumns], effects: Sequence[Effect], columns: Sequence[ExtraColumns]
) -> list[ExtraColumns]:
    """Return delays and offsets of torque channels but those that effects of the model, with their columns, are.

    That is a late channel, or a constant torque in the rows of the channel.
    """
    late = {effect.joint for effect in effects if effect.corrects == "torque"}
    return [
        extra
        for extra in nuisances
        if not (extra.nuisance == "delay" and next(iter(extra.rows)).joint in late)
        and not (extra.nuisance == "offset" and any(_constant(own, extra) for own in columns))
    ]


def _constant(own: ExtraColumns, offset: ExtraColumns) -> bool:
    """Whether an effect holds the offset of a torque channel: one of its columns is a constant in the same rows.

    A column of zeros is none: what a member of a family lacks.
    """
    if own.rows.keys() != offset.rows.keys():
        return False
    return any(
        all(0 < np.abs(values[k]).max() >= 1e9 * np.ptp(values[k]) for values in own.rows.values())
        for k in range(own.width)
    )


def reading_columns(
    observation: Observation, stiffness: Array, but: Container[tuple[str, int]] = ()
) -> list[ExtraColumns]:
    """Return offset and gain of every joint torque sensor, each in the three rows of its joint.

    Parameters
    ----------
    observation
        Filtered equations.
    stiffness
        Stiffnesses as far as known, (n,). The gain's column is K (theta - q): the reading itself would explain
        everything, with every parameter at 0. A gain then shows in the motor's row only, as it should.
    but
        (name, joint) that the robot file declares as effects.
    """
    extras = []
    for group in observation.groups:
        kind, joint = group.row
        if kind != "spring" or not group.count:
            continue
        spring = stiffness[joint] * group.columns.sum(axis=0)  # the row's only column is the deflection
        for name, unit, values in ((READING_OFFSET, "N·m", np.ones_like(spring)), (READING_GAIN, "1", spring)):
            if (name, joint) not in but and np.any(values):
                rows = {EstimationRow("load", joint): values[None], EstimationRow("spring", joint): values[None]}
                rows[EstimationRow("drive", joint)] = -values[None]
                extras.append(ExtraColumns(name, rows, (unit,)))
    return extras


def significant(
    solution: Solution,
    covariance: Array,
    nuisances: Sequence[ExtraColumns],
    parameters: int,
    dt: float,
    *,
    late: bool = False,
    alone: bool = False,
    declared: Container[int] = (),
) -> list[ExtraColumns]:
    """Return the nuisances whose coefficient is significant; of the delays all where any or their mean is.

    Parameters
    ----------
    solution, covariance
        A solution with all of them, and the covariance of its basis, (r, r).
    nuisances, parameters
        Columns after the standard ones, in their order, and the number of those.
    dt
        Sample time, s.
    late
        Whether torques have been moved: what is left of their delays stays unknown.
    alone
        Whether each delay must show by itself, as far as it may: a search holds effects against the model.
    declared
        Joints whose delays stay as far as the log determines them.
    """
    values, deviations = np.full((2, len(nuisances)), np.nan)
    for k in range(len(nuisances)):
        where = np.flatnonzero(solution.basis == parameters + k)
        # an offset that stands for a weight as well is none: a joint that slides up and down cannot tell the two apart
        if len(where) and solution.determined(parameters + k):
            values[k] = solution.values[parameters + k]
            deviations[k] = np.sqrt(covariance[where[0], where[0]])
    delays = np.array([extra.nuisance == "delay" for extra in nuisances], dtype=bool)
    firm = beyond_doubt(values, deviations, delays, dt, late=late, alone=alone)
    told = np.array([next(iter(extra.rows)).joint in declared for extra in nuisances], dtype=bool)
    firm |= delays & told & np.isfinite(values)
    return [e for e, kept in zip(nuisances, firm, strict=True) if kept]


def of_sampling(delays: Array, deviations: Array, dt: float) -> NDArray[np.bool_]:
    """Return which delays, s, may be those of a torque that is held for a sample, by their standard deviations."""
    return short_enough(delays, deviations, 1.05 * dt)


def short_enough(delays: Array, deviations: Array, longest: float) -> NDArray[np.bool_]:
    """Return which delays, s, may be no longer than `longest`, by their standard deviations; those that are NaN not."""
    return np.asarray(np.abs(delays) <= longest + 2 * deviations)


def beyond_doubt(
    values: Array,
    deviations: Array,
    delays: NDArray[np.bool_],
    dt: float,
    *,
    late: bool = False,
    alone: bool = False,
) -> NDArray[np.bool_]:
    """Return which nuisances stay in the model, (k,).

    The channels of a log are sampled alike: where one delay is beyond doubt, or their mean is, every channel has one.
    A delay corrected at one joint and not at the next moves friction and rotor inertia more than any noise does.

    Parameters
    ----------
    values, deviations
        Coefficients and their standard deviations, (k,); NaN where the log does not determine them.
    delays
        Those that are delays, s, (k,).
    dt
        Sample time, s.
    late
        Whether there are delays for certain.
    alone
        Whether each delay must differ from 0 by itself as well.
    """
    sound = np.isfinite(values) & np.isfinite(deviations)
    size = np.abs(values)
    # what is longer than a sample, or negative, may be friction that builds up: it must stand far out, or stays out
    short = of_sampling(values, deviations, dt)
    doubt = _doubt(size, delays & sound & ~short & (values < 0), dt)
    far = size > FAR * np.hypot(deviations, doubt)
    kept: NDArray[np.bool_] = sound & np.where(delays & ~short, far, size > SIGNIFICANT * deviations)
    may = delays & sound & (short | ((values > 0) & (size <= LONGEST) & far))
    here = may & (deviations > 0)
    if late:
        may = delays & sound & (size <= LONGEST + LIKELY * deviations)
    elif here.any():
        # the channels of a log are sampled alike: each agrees with one that is beyond doubt, or with the mean of all
        weight = 1.0 / np.square(deviations[here])
        mean, spread = float(weight @ values[here] / weight.sum()), float(1.0 / np.sqrt(weight.sum()))
        firm = [(float(values[k]), float(deviations[k])) for k in np.flatnonzero(kept & may)]
        if abs(mean) > SIGNIFICANT * spread:
            firm.append((mean, spread))
        agree = [np.abs(values - value) <= LIKELY * np.hypot(deviations, deviation) for value, deviation in firm]
        may &= np.any(agree, axis=0) if agree else False
        if alone:
            may &= size > LIKELY * deviations
    may |= _all_alike(values, delays & sound & (size <= LONGEST) & (size > FAR * deviations), delays)
    kept[delays] = may[delays]
    return kept


def _doubt(size: Array, early: NDArray[np.bool_], dt: float) -> float:
    """Return what else than a delay moves those of a log, s, as torques that act before they were logged show, (k,).

    A spring or a friction that the model lacks moves one joint's delay up and another one's down.
    """
    return float(np.max(size[early] - dt, initial=0.0))


def _all_alike(values: Array, far: NDArray[np.bool_], delays: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the delays, (k,), where all channels of several are far out by about the same: a clock of their own.

    Friction that builds up lags by another time at every joint.
    """
    none = np.zeros(len(values), dtype=bool)
    if np.count_nonzero(delays) < 2 or not np.array_equal(far, delays):
        return none
    mean = float(values[far].mean())
    return far if np.all(np.abs(values[far] - mean) <= ALIKE * abs(mean)) else none

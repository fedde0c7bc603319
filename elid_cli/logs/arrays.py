"""Signals that a program holds as arrays, read as a log of them would be."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from elid_cli.checks import names, number, optional
from elid_cli.errors import LogError, UsageError, did_you_mean, in_words, nearest
from elid_cli.logs.mapping.language import GAINS, SIGNALS
from elid_cli.logs.mapping.left_out import left_out_of
from elid_cli.logs.reading import Options, read_sources
from elid_cli.logs.source import Source
from elid_cli.robot.robot import Robot
from elid_cli.signals.fitting_robot import check_robot
from elid_cli.signals.recording import Recording

NAME = "arrays"
"""What messages and reports call the log."""


def recording_of(
    robot: Robot,
    signals: Mapping[str, ArrayLike],
    *,
    joints: Sequence[str] | None = None,
    rate: float | None = None,
    mapping: Mapping[str, Any] | None = None,
    strict: bool = False,
) -> Recording:
    """Return arrays as a recording: placed, aligned and checked as the same numbers in a file would be.

    Parameters
    ----------
    robot
        Whose joints are used.
    signals
        ``t`` (N,), s, and signals by their names (docs/reference/formats.md: ``q theta tau dq …``), each (N, n), SI:
        positions and velocities of motors divided by the gear ratio, torques at the joint, NaN where a sample is
        missing or masked. Gains ``kp`` and ``kd`` may be one number, or one per joint. Columns of a DataFrame that are
        named as the joints are, and no others, are taken by their names, else by their place.
    joints
        Names of the columns, n; None: those of the robot in its order. Others than the robot's are left out.
    rate
        Sample rate, Hz, where there is no ``t``.
    mapping, strict
        As of `read_recording`.

    Raises
    ------
    LogError
        A name that is no signal or no joint, shapes that do not fit together, or a log that cannot be used.
    UsageError
        The mapping is wrong, or an argument is of another kind.
    """
    check_robot(robot)
    _check_arguments(signals, joints, rate)
    columns = tuple(robot.joint_names if joints is None else joints)
    if mapping is None and not robot.log:  # these may call the robot's joints otherwise
        _check_names(robot, columns)
    arrays = {name: _values(name, values, columns) for name, values in signals.items()}
    lengths = {name: len(values) for name, values in arrays.items() if name not in GAINS or values.ndim == 2}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise LogError(f"{NAME}: signals of different lengths", detail=f"samples: {said}")
    data = io.BytesIO()
    np.savez(data, joint_names=np.array(columns), **arrays)
    source = Source(NAME, data=data.getvalue())
    try:
        return read_sources([source], Options(robot, mapping, strict, rate, spans=left_out_of(mapping, 1)))
    except LogError as error:
        if "--map" in error.hint:
            error.hint = f"give it among the signals; these are {', '.join(arrays) or 'none'}"
        raise


def _check_arguments(signals: object, joints: object, rate: object) -> None:
    """Refuse arrays without names, one name in place of several, and a rate that is none (UsageError)."""
    if not callable(getattr(signals, "items", None)):  # a DataFrame has them as well
        raise UsageError(
            f"recording_of: signals: a value of type {type(signals).__name__} in place of a mapping",
            hint='arrays by the names of their signals: {"t": t, "q": q, "tau": tau}',
        )
    optional(number(above=0))("recording_of: rate", rate)
    if joints is not None:
        names("recording_of: joints", list(joints) if isinstance(joints, np.ndarray) else joints)


def _check_names(robot: Robot, names: Sequence[str]) -> None:
    """Refuse names of columns that are meant for joints of the robot and misspelt (LogError).

    Those are names near to that of a joint without a column, and all where no joint has one.
    """
    lacking = [name for name in robot.joint_names if name not in names]
    others = [name for name in names if name not in (*robot.joint_names, *robot.order)]
    near = [name for name in others if nearest(name, lacking)]
    wrong = (near or others[:1]) if len(lacking) == robot.n else near
    if lacking and wrong:
        raise LogError(
            f"{NAME}: joints: {robot.name!r} has no joint {wrong[0]!r}",
            detail=f"no column is named for {in_words(lacking, 4)}",
            hint=did_you_mean(wrong[0], lacking),
        )


def _numbers(values: Any, joints: Sequence[str]) -> Any:
    """Return what holds numbers as an array of them, NaN where one is masked or missing (TypeError, ValueError).

    Columns that are named as the joints are, and no others, come in the joints' order.
    """
    if isinstance(values, np.ma.MaskedArray):
        values = np.where(np.ma.getmaskarray(values), np.nan, values.data)
    columns = getattr(values, "columns", None)
    if columns is not None and len(columns) == len(joints) and set(columns) == set(joints):
        values = values[list(joints)]
    if callable(getattr(values, "to_numpy", None)) and not np.iscomplexobj(values):  # pandas, nullable columns too
        values = values.to_numpy(dtype=float, na_value=np.nan)
    if np.iscomplexobj(values):
        raise TypeError("they are complex")
    return np.asarray(values, dtype=float)


def _values(name: str, values: ArrayLike, joints: Sequence[str]) -> Any:
    """Return a signal's numbers in the shape that a log has them (LogError)."""
    if name != "t" and name not in SIGNALS:
        raise LogError(f"{NAME}: no signal is called {name!r}", hint=did_you_mean(name, ("t", *SIGNALS)))
    try:
        found = _numbers(values, joints)
    except (TypeError, ValueError) as error:
        raise LogError(f"{NAME}: {name} does not hold numbers", detail=str(error)) from error
    if name == "t" or (name in GAINS and found.ndim < 2):
        if found.ndim > 1:
            raise LogError(f"{NAME}: t has the shape {found.shape}", hint="one time per sample: (N,)")
        return np.atleast_1d(found)
    found = found[:, None] if found.ndim == 1 else found
    if found.ndim != 2 or found.shape[1] != len(joints):
        raise LogError(
            f"{NAME}: {name} has the shape {np.shape(values)}",
            detail=f"joints: {', '.join(joints)}",
            hint=f"one column per joint: (N, {len(joints)}); name other columns with joints=",
        )
    return found

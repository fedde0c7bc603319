"""Faults of the whole robot, each the only one that is tried, on a plant that shares no code with elid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elid_cli.diagnosis.by_motion.diagnose import diagnose_motion
from elid_cli.diagnosis.by_motion.result import MotionDiagnosis
from elid_cli.logs.reading import read_recording
from elid_cli.signals.recording import Recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import moved, robot, written


def told(folder: Path, recording: Recording, only: str) -> MotionDiagnosis:
    """Return what a search for one effect finds."""
    arm = robot(folder)
    signals = prepare(read_recording([written(folder, "log.h5", recording)], arm), arm)
    return diagnose_motion(arm, signals, None, (only,))


def test_the_zero_of_an_encoder_is_tried_alone_and_found(tmp_path: Path) -> None:
    found = told(tmp_path, moved(6, 6.0, tilt=np.array([0.0, 0.05, 0.0])), "encoder_zero")
    assert [(e.effect, e.joint) for e in found.effects] == [("encoder_zero", "two")]
    (effect,) = found.effects
    assert effect.parameters["offset"] == pytest.approx(0.05, rel=0.02)
    assert abs(effect.parameters["offset"] - 0.05) < 4 * effect.std_error["offset"]
    assert found.tried == 1
    assert not found.also_possible
    assert not found.unexplained


def test_a_wrong_gain_is_tried_alone_and_found(tmp_path: Path) -> None:
    recording, factor = moved(6, 6.0), np.array([1.0, 1.25, 1.0])
    wrong = replace(recording, commands={
        name: values * (factor if name in ("kp", "kd") else 1.0) for name, values in recording.commands.items()
    })  # fmt: skip
    found = told(tmp_path, wrong, "torque_gain")
    assert [(e.effect, e.joint) for e in found.effects] == [("torque_gain", "two")]
    (effect,) = found.effects
    assert effect.parameters["gain"] == pytest.approx(0.25, rel=0.02)
    assert abs(effect.parameters["gain"] - 0.25) < 4 * effect.std_error["gain"]
    assert found.tried == 1
    assert not found.unexplained


def test_neither_is_found_in_a_clean_log(tmp_path: Path) -> None:
    arm = robot(tmp_path)
    signals = prepare(read_recording([written(tmp_path, "clean.h5", moved(6, 4.0))], arm), arm)
    for only in ("encoder_zero", "torque_gain"):
        found = diagnose_motion(arm, signals, None, (only,))
        assert not found.effects
        assert not found.unexplained

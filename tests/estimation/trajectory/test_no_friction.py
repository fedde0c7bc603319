"""Robots without dry friction: a bound that the fit reaches, and commands that look smooth beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.logs.reading import read_recording
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion.plant import ARMATURE, COULOMB, VISCOUS, moved, robot, written


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_values_beside_a_friction_of_none(tmp_path: Path, seed: int) -> None:
    arm = robot(tmp_path)
    log = moved(seed, 6.0, noise=3e-5, grip=lambda q, dq, load: -COULOMB)
    signals = prepare(read_recording([written(tmp_path, "log.h5", log)], arm), arm)
    found = identify(arm, signals, EstimateOptions(fit="trajectory"))
    told = found.settings["trajectory"]
    assert max(told["noise_ratio"].values()) < 1.1  # type: ignore[index]
    assert np.abs(told["delays"]).max() < 1e-4  # type: ignore[index]
    assert "commands" not in found.settings
    for k, own in enumerate(told["joint_parameters"].values()):  # type: ignore[index]
        assert abs(own["Ja"]["estimate"] - ARMATURE[k]) < 4 * own["Ja"]["std_error"] + 1e-5
        assert abs(own["fv"]["estimate"] - VISCOUS[k]) < 4 * own["fv"]["std_error"] + 1e-4
        assert own["fs"]["estimate"] < 0.002

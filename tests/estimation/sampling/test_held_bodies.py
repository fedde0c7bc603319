"""Sets of what simulated motion shows: drives, beside bodies that the fit held at the robot file's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from elid_cli.estimation.identify import EstimateOptions, identify
from elid_cli.estimation.sampling.sets import sample
from elid_cli.logs.reading import read_recording
from elid_cli.robot.parameter import LINK_PARAMETERS
from elid_cli.signals.signals import prepare
from tests.diagnosis.by_motion import plant


def test_bodies_are_the_robots_and_drives_those_of_the_estimate(tmp_path: Path) -> None:
    arms = plant.robot(tmp_path)
    # a file whose armatures are far off: sums with the bodies are not to be divided between both
    wrong = replace(arms, joints=tuple(
        replace(joint, parameters={**joint.parameters, "Ja": factor * value})
        for joint, factor, value in zip(arms.joints, (0.2, 1.0, 3.0), plant.ARMATURE.tolist(), strict=True)
    ))  # fmt: skip
    log = plant.written(tmp_path, "log.h5", plant.moved(3, 7.0, delay=0.002))
    found = identify(wrong, prepare(read_recording([log], wrong), wrong), EstimateOptions(fit="trajectory"))
    sets = sample([found], 400, wrong, seed=1)
    assert any("bodies are held at those of pendulums" in note for note in sets.notes)
    reference = wrong.reference()
    for k, name in enumerate(sets.names):
        own = wrong.parameter_names()[k]
        if own.kind in LINK_PARAMETERS:
            assert np.array_equal(sets.values[:, k], np.full(400, reference[k])), name
            assert sets.origin[k] == "held"
    told = found.settings["trajectory"]["joint_parameters"]  # type: ignore[index]
    for joint, label in enumerate(wrong.joint_names):
        for kind in ("Ja", "fs", "fv"):
            values = sets.values[:, sets.names.index(f"{kind}{joint + 1}")]
            estimate, error = told[label][kind]["estimate"], told[label][kind]["std_error"]
            assert abs(values.mean() - estimate) < 0.25 * error
            np.testing.assert_allclose(values.std(), error, rtol=0.15)

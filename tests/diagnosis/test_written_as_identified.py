"""Where nothing is found, diagnose writes the robot that identify writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.estimation.identify import identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.logs import read_recording
from elid_cli.robot.files import read_robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare

LOG = Path(__file__).parents[2] / "sample_logs" / "planar2.h5"


@pytest.mark.parametrize("known", [True, False], ids=["values in the file", "no values in the file"])
def test_nothing_found_is_written_as_identify_writes_it(known):
    robot = read_robot("planar2")
    if not known:  # what the log does not show is then 0, not what the search made of it at its cut-off
        robot = replace(robot, joints=tuple(replace(joint, parameters={}) for joint in robot.joints))
    recording = read_recording([LOG], robot, None)
    found = diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))
    assert isinstance(found, Diagnosis)
    assert not found.effects
    own = identified_robot(identify(robot, prepare(recording, robot, SignalOptions())))
    written = found.written_robot
    for joint, theirs in zip(written.joints, own.joints, strict=True):
        assert joint.parameters == pytest.approx(dict(theirs.parameters), rel=1e-9, abs=1e-9)
    told = [(e.effect, e.joint, pytest.approx(dict(e.parameters), rel=1e-9)) for e in own.effects]
    assert [(e.effect, e.joint, dict(e.parameters)) for e in written.effects] == told

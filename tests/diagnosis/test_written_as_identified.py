"""Where nothing is found, diagnose writes the robot that identify writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elid_cli.diagnosis import Diagnosis, diagnose
from elid_cli.diagnosis.stiffness_by_load import stiffness_by_load
from elid_cli.estimation.identify import identify
from elid_cli.estimation.refined_robot import identified_robot
from elid_cli.experiment.simulation import SensorOptions, SimulationOptions, simulate
from elid_cli.logs import read_recording
from elid_cli.robot.files import read_robot, robot_from_text
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


GANTRY = """\
name: gantry
gravity: [0, 0, -9.81]
dh: modified
joints:
  - {name: x, type: prismatic, a: 0, alpha: pi/2, d: 0, theta: 0, transmission: elastic,
     parameters: {m: 14, Ja: 12, fs: 22, fv: 40, K: 4.0e5}}
  - {name: z, type: prismatic, a: 0, alpha: pi/2, d: 0.1, theta: 0, transmission: rigid,
     parameters: {m: 6, Ja: 7, fs: 15, fv: 30}}
  - {name: w, a: 0.08, alpha: pi/2, d: 0.15, theta: 0.4, transmission: rigid,
     parameters: {m: 2.5, cx: 0.225, cy: 0.05, Izz: 0.09, Ja: 0.01, fs: 0.5, fv: 0.25}}
"""


def test_what_the_search_found_is_not_taken_for_inertias_that_the_file_knows():
    """Nothing but the deflection tells the axis' mass from its motor's: a link's equation would give the search's."""
    full = robot_from_text(GANTRY, "gantry.yaml")
    robot = replace(full, joints=tuple(replace(joint, parameters={}) for joint in full.joints))
    sensors = SensorOptions(position_noise=3e-6, torque_noise_relative=0.003)
    recording = simulate(full, SimulationOptions(duration=16.0, rate=1000.0, seed=1, sensors=sensors))
    found = diagnose(robot, prepare(recording, robot, SignalOptions.for_diagnosis(recording.rate)))
    assert isinstance(found, Diagnosis)
    for told in (found.identified_before, found.identified_after, identify(robot, prepare(recording, robot))):
        (stiffness,) = (item for item in told.parameters if item.leader.kind == "K")
        assert stiffness.verdict == "refused"
        assert "encoder noise" in stiffness.reason
        (mass,) = (item for item in told.parameters if item.leader == "m1")
        assert mass.verdict == "refused"
    # nor does anything but the assumption that there is no offset tell the weight on the upright axis from one
    (told,) = (note for note in identify(robot, prepare(recording, robot)).notes if "offset of the torque" in note)
    assert told.startswith("z: this log cannot tell")
    assert "m2 + m3" in told
    # by the load, which the identified bodies give, neither: its error knows what noise pulls
    by_load = stiffness_by_load(found.state_after, 0)
    assert by_load is None or by_load.deviation > 0.3 * abs(by_load.value - full.joints[0].parameters["K"])

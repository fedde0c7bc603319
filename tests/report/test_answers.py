"""What a reader is told first: ties as ties, a bad model never written, small values, the same words throughout."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from elid_cli import identify, prepare, read_recording, read_robot
from elid_cli.cli import main
from elid_cli.diagnosis import FoundEffect, Rival
from elid_cli.estimation.judgement import JointError
from elid_cli.report.answers.drives import drives_needed, drives_words
from elid_cli.report.answers.inputs import fullest
from elid_cli.report.answers.known import parameter_words
from elid_cli.report.answers.missing import named_words, replaced, summary_words
from elid_cli.report.answers.summary import called, light, small_value, symbol_words

MEASURED = Path(__file__).parents[3] / "shared" / "data" / "quanser_2dsfl.csv"


def rival(effect: str, joint: str, instead_of: str) -> Rival:
    return Rival(effect, joint, instead_of, 0.6, {}, "slow motion")


def test_what_a_log_cannot_tell_apart_is_named_as_one_of_several() -> None:
    tied = [rival("velocity_coupling", "j1", "stribeck"), rival("torque_ripple", "j1", "stribeck")]
    assert named_words({"stribeck": ["j1", "j2"]}, tied) == (
        "Stribeck friction at j2. One of: Stribeck friction at j1, velocity coupling at j1, torque ripple at j1; "
        "this log cannot tell which."
    )
    assert named_words({"stribeck": ["j1"]}, [], "friction that falls") == (
        "Stribeck friction at j1 (friction that falls)."
    )


def test_a_rival_at_another_joint_stands_beside_the_effect_that_it_could_replace() -> None:
    far = replace(rival("velocity_coupling", "j3", "stribeck"), at="j2")
    assert named_words({"stribeck": ["j1", "j2", "j3"]}, [far]) == (
        "Stribeck friction at j1 and j3. One of: Stribeck friction at j2, velocity coupling at j3; "
        "this log cannot tell which."
    )
    assert replaced(far, [curve("j2", 0.5, 1.0), curve("j3", 0.5, 1.0)]) == "Stribeck friction of j2"


def curve(joint: str, amplitude: float, exponent: float, error: float = 0.01, velocity: float = 0.1) -> FoundEffect:
    parameters = {"amplitude": amplitude, "velocity": velocity, "exponent": exponent}
    return FoundEffect("stribeck", joint, parameters, {"amplitude": error}, 0.9, "", 9.0)


def drive(share: float, verdict: str) -> dict[str, object]:
    return {"estimate": 2.0, "std_error": 2.0 * share, "verdict": verdict}


def test_drives_that_a_far_off_motion_makes_doubtful_are_not_called_known_to_more_than_their_errors() -> None:
    drives = {
        "a": {"Ja": drive(0.5, "weak"), "fs": drive(0.01, "weak"), "fv": drive(0.01, "supported")},
        "b": {"Ja": drive(0.01, "supported"), "fs": drive(0.02, "weak"), "fv": drive(0.02, "supported")},
    }
    found: Any = SimpleNamespace(drives=drives)
    words = drives_words(found)
    assert "Known roughly, not to 30 % or better, or to 0.3 % of the torque: motor inertia of a." in words
    assert "May be biased, as the motion they are fitted to is far off: Coulomb friction of a and b." in words
    assert [what for what, _ in drives_needed(found)] == ["for motor inertia of a"]


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        ([curve("a", 0.5, 1.0)], "friction that rises towards zero speed"),
        ([curve("a", 0.5, -1.0)], "friction that falls towards zero speed"),
        ([curve("a", 0.5, 1.0), curve("a", 0.5, 2.0, velocity=0.02)], "friction that rises towards zero speed"),
        ([curve("a", -0.3, 1.0), curve("a", -0.3, -1.0)],
         "friction that rises towards zero speed, and falls again at the slowest speeds"),
        ([curve("a", -0.3, 1.0, 0.3), curve("a", -0.3, -1.0, 0.3)],
         "friction that changes towards zero speed: that it rises and that it falls both fit"),
        ([curve("a", 0.5, 1.0), curve("b", 0.5, 1.0)], "friction that rises towards zero speed"),
        ([curve("a", 0.5, 1.0), curve("b", -0.5, 1.0)],
         "a: friction that rises towards zero speed; b: friction that falls towards zero speed"),
    ],
)  # fmt: skip
def test_a_friction_curve_says_which_way_it_goes(terms: list[FoundEffect], words: str) -> None:
    assert summary_words(terms) == words


def test_a_known_value_is_small_where_its_error_is_not() -> None:
    assert small_value(3e-6, 1.3e-5, "supported")
    assert small_value(1.0, 0.36, "supported"), "known by the torque it makes, so no percentage stands beside it"
    assert not small_value(1.0, 0.29, "supported")
    assert not small_value(3e-6, 1.3e-5, "weak"), "an interval that is wide in what it moves says nothing"


def test_combinations_have_one_short_name() -> None:
    assert called("m2 - 16*Izz2 + 3*cx1") == "m2 with 2 others"
    assert called("cx1 + 2*Izz1") == "cx1 with 1 other"
    assert called("K1") == "K1"


def test_symbols_are_told_in_words_as_far_as_they_occur() -> None:
    assert symbol_words(["m1 + 2*cx1", "K2"]) == (
        "K: stiffness of the transmission; m: mass; c: first moment (mass times centre of mass)"
    )


@pytest.mark.skipif(not MEASURED.exists(), reason="../shared/data is absent")
def test_a_poor_model_without_a_known_parameter_leads_to_another_log(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(MEASURED), "--robot", "quanser_2dsfl", "--only", "stribeck", "--quiet"]) == 0
    text = capsys.readouterr().out
    said = " ".join(text.split())
    assert "None of the 12 base parameters (what motion can show) is known" in said
    assert text.splitlines()[-1].startswith("Next: elid excite --robot quanser_2dsfl --after ")
    assert "A disturbance that repeats in time would look like an effect of the motion" in said
    assert "A motion that does not repeat (to tell effects of the motion from disturbances in time)" in said


@pytest.mark.parametrize(
    ("motor_side", "lacking", "word"),
    [
        (1.3e-3, False, "good"),  # 1.3 times the noise
        (1.9e-3, False, "good"),  # more, but by 1.6e-5 of the torque: splines and rounding
        (3.0e-3, False, "fair"),  # by 2.8e-5 of it
        (1.9e-3, True, "fair"),
    ],
)
def test_what_is_left_beyond_noise_counts_from_where_it_is_more_than_rounding(
    motor_side: float, lacking: bool, word: str
) -> None:
    error = JointError(9e-3, 9e-5, motor_side, motor_side / 100, 100.0, floor=1e-2, spring_floor=1e-3)
    assert light(error, lacking=lacking).text == word


def test_what_is_left_and_may_be_no_noise_names_the_parameters_of_its_joint() -> None:
    sample = Path(__file__).parents[2] / "sample_logs" / "planar2.h5"
    robot = read_robot("planar2")
    found = identify(robot, prepare(read_recording([sample], robot), robot))
    plain, doubted = parameter_words(found), parameter_words(found, ["joint2"])
    assert "no noise" not in plain
    assert (
        "If what is left at joint2 is no noise, it may bias these first: m2 with 1 other, cx2 with 1 other" in doubted
    )
    assert "known to 30 % or better, or to 0.3 % of the torque. 2 are known to be small (cy1 and cy2)" in plain


@pytest.mark.parametrize(
    ("written", "best"),
    [
        (("a.xml", "b.yaml"), "b.yaml"),
        (("a.urdf", "b.xml"), "a.urdf"),
        (("a.yaml", "b.yaml"), "a.yaml"),
        (("a.MJCF", "plain"), "plain"),
    ],
)
def test_the_next_command_takes_the_file_that_holds_most(written: tuple[str, ...], best: str) -> None:
    assert fullest(written) == best


def test_it_is_said_what_the_other_motors_do_at_a_joints_antiresonance() -> None:
    """With all motors held the links swing at other frequencies."""
    from elid_cli.report.answers.motor_side import NOTE

    assert "link against this joint's held motor, the other motors free" in NOTE

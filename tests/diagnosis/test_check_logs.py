"""Another log that is predicted worse by the model after than by that before speaks against what was found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from elid_cli.estimation.judgement import JointError
from elid_cli.report.answers.diagnosis import WORSE, _against
from elid_cli.report.answers.diagnosis_input import Check, DiagnosisInput
from elid_cli.signals.recording import Recording
from tests.diagnosis.diagnosis_logs import arm


class Found:
    """As much of a diagnosis as the words need."""

    robot = arm()


def recorded(*files: str) -> Recording:
    empty = np.zeros((1, 2))
    return Recording(("joint1", "joint2"), 1e-3, np.zeros(1), empty, empty, empty, files=files)


def errors(joint1: float, joint2: float) -> dict[str, JointError]:
    plain = JointError(0.0, 0.0, None, None, torque_rms=10.0)
    return {"joint1": replace(plain, rms=joint1), "joint2": replace(plain, rms=joint2)}


def told(*checks: Check) -> DiagnosisInput:
    nothing = cast(Any, None)
    return DiagnosisInput(cast(Any, Found()), nothing, nothing, (), recorded("own.h5"), "arm.yaml", checks)


def check(before: tuple[float, float], after: tuple[float, float], *files: str) -> Check:
    return Check(recorded(*files), errors(*before), errors(*after))


@pytest.mark.parametrize("after", [(0.5, 0.5), (0.01, 0.02), (0.5 * WORSE * 0.99, 0.5), (0.5, 0.5 * WORSE * 0.99)])
def test_a_log_that_is_predicted_as_well_or_better_says_nothing(after: tuple[float, float]) -> None:
    assert _against(told(check((0.5, 0.5), after, "other.h5"))) == []


def test_without_other_logs_nothing_is_said() -> None:
    assert _against(told()) == []


def test_every_joint_of_every_log_that_is_predicted_worse_is_named() -> None:
    good = check((0.5, 0.5), (0.1, 0.1), "good.h5")
    one = check((0.5, 0.5), (0.1, 0.75), "one.h5")
    both = check((0.5, 2.0), (0.5 * WORSE * 1.01, 4.0), "a.h5", "b.h5")
    lines = _against(told(good, one, both))
    assert len(lines) == 3
    assert lines[0].startswith("one.h5: joint2 is predicted worse than before, 0.5 → 0.75 N·m: ")
    assert lines[1].startswith("a.h5, b.h5: joint1 is predicted worse than before, 0.5 → ")
    assert lines[2].startswith("a.h5, b.h5: joint2 is predicted worse than before, 2 → 4 N·m: ")
    assert all("may not hold beyond the log" in line for line in lines)

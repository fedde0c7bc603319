"""A standard parameter is a value with a kind and a joint, and the same as its name."""

from __future__ import annotations

import json
import pickle
import re
from copy import deepcopy
from pathlib import Path

import pytest

from elid_cli.robot.files import read_robot
from elid_cli.robot.parameter import StandardParameter, parameter_named

PACKAGE = Path(__file__).parents[2] / "elid_cli"


def test_it_is_its_name_with_kind_and_joint() -> None:
    stiffness = StandardParameter("K", 11)
    assert stiffness == "K12"
    assert {stiffness: 1.0}["K12"] == 1.0
    assert json.dumps({stiffness: [stiffness]}) == '{"K12": ["K12"]}'
    for copy in (pickle.loads(pickle.dumps(stiffness)), deepcopy(stiffness)):
        assert (copy, copy.kind, copy.joint) == ("K12", "K", 11)


def test_names_of_files_are_read() -> None:
    read = parameter_named("Ixx12")
    assert read is not None
    assert (read, read.kind, read.joint) == ("Ixx12", "Ixx", 11)
    assert [parameter_named(name) for name in ("K0", "K", "12", "K1 + m2", "")] == [None] * 5


def test_it_cannot_be_changed() -> None:
    with pytest.raises(AttributeError, match="joint of Jm1"):
        StandardParameter("Jm", 0).joint = 3


def test_the_parameters_of_a_robot_know_their_joints() -> None:
    robot = read_robot("puma560")
    for name in robot.parameter_names():
        assert f"{name.kind}{name.joint + 1}" == name
        assert 0 <= name.joint < robot.n


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_file_makes_or_parses_names_of_parameters_by_itself(path: Path) -> None:
    if path.name == "parameter.py":
        return
    text = path.read_text("utf-8")
    assert not re.search(r'f"(K|Jm|Ja|fs|fv)\{\w+( \+ 1)?\}"|f"\{kind\}\{(i|\w+ \+ 1)\}"', text)
    assert not re.search(r'rstrip\("0123456789"\)|startswith\(\(?"(K|Jm|fs)"', text)

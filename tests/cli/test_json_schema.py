"""What ``--json`` prints is what the published schema says, command by command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from elid_cli.cli.group import summaries
from tests.cli.conftest import Elid

ROOT = Path(__file__).parents[2]
SCHEMA = json.loads((ROOT / "docs" / "reference" / "elid-1.schema.json").read_text("utf-8"))
SAMPLES = ROOT / "sample_logs"
WITHOUT_JSON = {"completion"}
OPEN = {"settings"}
"""Objects that hold further keys, which depend on the estimator."""
STRIBECK = "stribeck@joint2:amplitude=-0.4,velocity=0.1"

LINES = {
    "init": ["init two.urdf short.h5 --force"],
    "info": [f"info {SAMPLES}/planar2.csv", f"info {SAMPLES}/planar2.mcap --robot planar2"],
    "plot": [f"plot {SAMPLES}/planar2.csv", f"plot {SAMPLES}/planar2.mcap --robot planar2"],
    "identify": [
        f"identify {SAMPLES}/planar2.h5 --robot planar2 --physical",
        f"identify {SAMPLES}/planar2.h5 short.h5 --robot planar2",
        f"identify {SAMPLES}/planar2.h5 --robot planar2 --estimator paper",
        "identify sensors.h5 --robot planar2",
    ],
    "classify": ["classify --robot puma560", f"classify {SAMPLES}/planar2.h5 --robot planar2"],
    "diagnose": ["diagnose short.h5 --robot planar2 --only stribeck --check sensors.h5"],
    "validate": [
        f"validate {SAMPLES}/planar2.h5 --robot planar2 --held-out",
        f"validate {SAMPLES}/planar2.h5 short.h5 --robot planar2 --against planar2",
    ],
    "friction": ["friction short.h5 --robot planar2"],
    "replay": [f"replay {SAMPLES}/planar2.h5 --robot planar2 --horizon 0.2 --against planar2"],
    "reduce": [f"reduce {SAMPLES}/planar2.h5 --robot planar2 -o reduced.npz"],
    "simulate": [f"simulate --robot planar2 --duration 1 -o try.csv --effect {STRIBECK}"],
    "excite": [
        "excite --robot planar2 --duration 4 -o try.csv --for K1",
        "excite --robot planar2 --duration 3 -o try.csv --resolve open.json",
    ],
    "compare": ["compare first.json second.json"],
    "trend": ["trend first.json second.json open.json"],
    "sample": ["sample first.json second.json -n 3", "sample first.json -n 3 --robot planar2 -o sets --ranges r.yaml"],
    "effects": ["effects", "effects stribeck"],
}
"""Command -> lines whose output is judged."""


@pytest.fixture(scope="module")
def folder(elid: Elid, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with short logs, one of them with joint torque sensors, and two results."""
    place = tmp_path_factory.mktemp("schema")
    made = "simulate --robot planar2 --duration 5 --rate 500 --counts 1250000"
    for line in (f"{made} --effect {STRIBECK} -o short.h5", f"{made} --seed 3 --torque-sensor -o sensors.h5"):
        assert elid(*line.split(), cwd=place).returncode == 0
    for result, log in (("first.json", "planar2.h5"), ("second.json", "planar2_stribeck.h5")):
        done = elid("identify", str(SAMPLES / log), "--robot", "planar2", "--json", cwd=place)
        (place / result).write_text(done.stdout, "utf-8")
    noisy = "simulate --robot planar2 --duration 5 --rate 500 --torque-noise 2%"
    assert elid(*f"{noisy} --effect torque_offset@joint1:offset=3 -o o.h5".split(), cwd=place).returncode == 0
    tried = "diagnose o.h5 --robot planar2 --only torque_offset --only asymmetric_coulomb --json"
    (place / "open.json").write_text(elid(*tried.split(), cwd=place).stdout, "utf-8")
    made = f"identify {SAMPLES}/planar2.h5 --robot planar2 --write-robot two.urdf --quiet"
    assert elid(*made.split(), cwd=place).returncode == 0
    return place


def closed(schema: Any, name: str = "") -> Any:
    """Return a schema that allows no key but those it names, so that no output goes undescribed."""
    if isinstance(schema, list):
        return [closed(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    copy = {key: closed(value, key) for key, value in schema.items()}
    named = copy.get("type") == "object" and "properties" in copy and name not in OPEN
    return {"additionalProperties": False, **copy} if named else copy


def faults(schema: dict[str, Any], output: dict[str, Any]) -> list[str]:
    whole = {"$ref": f"#/$defs/command_{output['command']}", "$defs": schema["$defs"]}
    return [
        f"{list(error.absolute_path)}: {error.message}" for error in Draft202012Validator(whole).iter_errors(output)
    ]


def test_the_schema_is_one_and_covers_every_command() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    verbs = set(summaries()) - WITHOUT_JSON
    assert verbs == LINES.keys()
    assert {f"command_{verb}" for verb in verbs} == {name for name in SCHEMA["$defs"] if name.startswith("command_")}


@pytest.mark.parametrize("line", [line for lines in LINES.values() for line in lines])
def test_outputs_are_as_the_schema_says(elid: Elid, folder: Path, line: str) -> None:
    done = elid(*line.split(), "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert list(Draft202012Validator(SCHEMA).iter_errors(output)) == []
    assert faults(closed(SCHEMA), output) == []


def test_a_result_without_a_key_breaks_the_schema(folder: Path) -> None:
    output = json.loads((folder / "first.json").read_text("utf-8"))
    del output["base_parameters"][0]["name"]
    assert faults(SCHEMA, output)

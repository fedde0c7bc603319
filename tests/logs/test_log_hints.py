"""Logs as tools write them, each read after pasting what the error itself proposes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from elid_cli.cli import main
from elid_cli.errors import LogError, UsageError
from elid_cli.estimation.judgement import JointError
from elid_cli.logs import read_map_options
from elid_cli.logs.inspect import inspect_log
from elid_cli.logs.mapping.language import parse_mapping
from elid_cli.report.answers.summary import trust_words
from elid_cli.robot.robot import Limits
from elid_cli.robot.text import text_of
from tests.logs.made_logs import JOINTS, ROBOT, like, read, recording, written
from tests.logs.mcap_made import Bag, joint_state

BASE = recording(1200, 500.0)
RIGID = replace(ROBOT, joints=tuple(replace(joint, transmission="rigid") for joint in ROBOT.joints))


def text(
    folder: Path, columns: dict[str, np.ndarray], separator: str = ",", comma: bool = False, head: bool = True
) -> Path:
    """Write columns as text."""
    rows = [separator.join(f"{x:.12g}" for x in row) for row in np.column_stack(list(columns.values()))]
    body = "\n".join(rows)
    path = folder / "log.csv"
    path.write_text(
        (separator.join(columns) + "\n" if head else "") + (body.replace(".", ",") if comma else body) + "\n"
    )
    return path


def each(pattern: str, values: np.ndarray, first: int = 1) -> dict[str, np.ndarray]:
    """Return the columns of a signal, named by the joints' numbers."""
    return {pattern.format(k + first, j=JOINTS[k]): column for k, column in enumerate(values.T)}


def clocked(folder: Path, start: float) -> Path:
    """Return the log with times of day, ``HH:MM:SS,sss``, from `start` s after midnight."""
    path = text(folder, {"Uhrzeit": BASE.t, **each("q{}", Q), **each("tau{}", TAU)}, ";", comma=True)
    head, *rows = path.read_text().splitlines()
    for k, (row, t) in enumerate(zip(rows, (start + BASE.t) % 86400, strict=True)):
        clock = f"{t // 3600:02.0f}:{t // 60 % 60:02.0f}:{t % 60:06.3f}".replace(".", ",")
        rows[k] = f"{clock};{row.partition(';')[2]}"
    path.write_text("\n".join([head, *rows, ""]))
    return path


Q, TAU, T = BASE.q, BASE.tau, {"time": BASE.t}
FORMS: dict[str, Callable[[Path], Path]] = {
    "headerless": lambda f: text(f, {"t": BASE.t, **each("q{}", Q), **each("u{}", TAU)}, head=False),
    "german": lambda f: text(
        f, {"Zeit [s]": BASE.t, **each("Winkel Achse {} [Grad]", np.degrees(Q)),
            **each("Moment Achse {} [Nm]", TAU)}, ";", comma=True,
    ),
    "brackets": lambda f: text(
        f, {"time [ms]": 1e3 * BASE.t, **each("pos_{} [°]", np.degrees(Q)), **each("i_{} [mA]", 1e3 * TAU)}
    ),
    "suffixes": lambda f: text(
        f, {"time_ms": 1e3 * BASE.t, **each("pos{}_deg", np.degrees(Q)), **each("torque{}_mNm", 1e3 * TAU)}
    ),
    "UR RTDE": lambda f: text(
        f, {"timestamp": BASE.t, **each("actual_q_{}", Q, 0), **each("actual_qd_{}", 0 * Q, 0),
            **each("target_moment_{}", TAU, 0), **each("actual_current_{}", TAU / 9, 0)}, " ",
    ),
    "PlotJuggler": lambda f: text(
        f, {"__time": BASE.t + 1.7e9, **each("/arm/joint_states/{j}/position", Q),
            **each("/arm/joint_states/{j}/effort", TAU)}
    ),
    "PlotJuggler, numbered": lambda f: text(
        f, {"__time": BASE.t + 1.7e9, **each("/arm/state/q[{}]", Q, 0), **each("/arm/state/tau[{}]", TAU, 0)}
    ),
    "names nearly right": lambda f: text(f, {"t": BASE.t, **each("q.{j}_joint", Q), **each("tau.{j}_joint", TAU)}),
    "libfranka": lambda f: text(
        f, {"time": BASE.t, **each("q_measured[{}]", Q, 0), **each("tau_measured[{}]", TAU, 0)}
    ),
    "pandas": lambda f: text(
        f, {"": np.arange(1200), "timestamp": BASE.t, **each("joint_{}_position", Q, 0),
            **each("joint_{}_torque", TAU, 0)}
    ),
    "Spanish, joints in reverse": lambda f: text(
        f, {"tiempo [ns]": 1e9 * BASE.t, **{f"posición {JOINTS[k]} [°]": np.degrees(Q[:, k]) for k in (2, 1, 0)},
            **{f"velocidad {j} [°/s]": 0 * Q[:, k] for k, j in enumerate(JOINTS)},
            **{f"par {JOINTS[k]} [Nm]": TAU[:, k] for k in (2, 1, 0)}}, ";",
    ),
    "a unit of its own per joint": lambda f: text(
        f, {"time": BASE.t, f"{JOINTS[0]}_pos[mm]": 1e3 * Q[:, 0], f"{JOINTS[1]}_pos[deg]": np.degrees(Q[:, 1]),
            f"{JOINTS[2]}_pos": Q[:, 2], f"{JOINTS[0]}_torque[mNm]": 1e3 * TAU[:, 0],
            **{f"{j}_torque[Nm]": TAU[:, k] for k, j in enumerate(JOINTS) if k}}
    ),
    "German, times of day over midnight": lambda f: clocked(f, 86399.0),
    "other time": lambda f: text(f, {"Zeit": BASE.t, **each("q{}", Q), **each("tau{}", TAU)}),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_what_the_error_proposes_reads_the_log(tmp_path: Path, form: str) -> None:
    path = FORMS[form](tmp_path)
    with pytest.raises(LogError) as caught:
        read(path, robot=RIGID)
    pasted = shlex.split(caught.value.hint.partition("--map")[2].split(", or give")[0].replace("--map", ""))
    log = read(path, robot=RIGID, mapping=read_map_options(pasted))
    np.testing.assert_allclose(log.q, Q, atol=1e-9)
    np.testing.assert_allclose(log.tau, TAU, atol=1e-8)
    assert log.rate == pytest.approx(500)


@pytest.mark.parametrize("form", FORMS)
def test_info_writes_a_mapping_and_names_the_command_that_uses_it(
    tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path, robot, file = FORMS[form](tmp_path), tmp_path / "arm.yaml", tmp_path / "map.yaml"
    robot.write_text(text_of(RIGID))
    assert main(["info", str(path), "--robot", str(robot), "--write-map", str(file)]) == 0
    said = capsys.readouterr().out
    assert f"--map {file}" in " ".join(said.split())
    np.testing.assert_allclose(read(path, robot=RIGID, mapping=read_map_options([str(file)])).tau, TAU, atol=1e-8)
    assert main(["info", str(path), "--robot", str(robot), "--map", str(file)]) == 0
    assert "Next: elid identify" in capsys.readouterr().out


def test_times_of_day_go_on_over_midnight_and_this_is_noted(tmp_path: Path) -> None:
    mapping = {"t": {"from": "Uhrzeit"}}
    for start, passes in ((86399.0, True), (43200.0, False)):
        log = read(clocked(tmp_path, start), robot=RIGID, mapping=mapping)
        assert log.duration == pytest.approx(BASE.duration, abs=1e-9)
        assert ("Uhrzeit: times of day that pass midnight" in log.notes) is passes


def test_next_names_no_file_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(FORMS["german"](tmp_path)), "--color", "never"]) == 0
    after = " ".join(capsys.readouterr().out.split()).partition("Next: ")[2]
    assert "--write-map map.yaml" in after
    assert "--map map.yaml" not in after


def test_a_misspelt_time_is_named_and_mended(tmp_path: Path) -> None:
    path = FORMS["other time"](tmp_path)
    with pytest.raises(LogError) as caught:
        read(path, robot=RIGID, mapping={"t": {"from": "Zeitt"}})
    assert "no 'Zeitt' (nearest: 'Zeit')" in caught.value.detail
    assert "t: {from: Zeit" in caught.value.hint


@pytest.mark.parametrize(("unit", "meant"), [("grad", "deg"), ("Umdr", "rev"), ("°", "deg"), ("Degrees", "deg")])
def test_a_unit_of_another_language_is_not_corrected_into_a_wrong_one(unit: str, meant: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_mapping({"q": {"from": "q{i}", "unit": unit}}, RIGID, "--map")
    assert f"did you mean '{meant}'?" in caught.value.hint


def test_a_unit_before_the_number_of_a_joint_is_proposed(tmp_path: Path) -> None:
    path = text(tmp_path, T | each("pos_deg_{}", np.degrees(Q)) | each("torque_{}", TAU))
    assert 'q: {from: "pos_deg_{i}", unit: deg}' in inspect_log(path, RIGID).mapping


def test_a_motor_side_is_guessed_for_position_and_torque_together_or_for_none(tmp_path: Path) -> None:
    path = text(tmp_path, T | each("motor{}_pos", BASE.theta) | each("joint{}_pos", Q) | each("motor{}_torque", TAU))
    assert "side: motor" not in inspect_log(path, ROBOT).mapping


def test_commands_are_guessed_where_there_is_no_torque(tmp_path: Path) -> None:
    """With the drives' gains they make one; a command of torque is none of a position."""
    names = {"{j}_pos_rad": Q, "{j}_cmd_rad": Q + 0.01, "{j}_cmd_rad_s": BASE.q, "{j}_cmd_torque": TAU}
    columns = T | {key: v for name, values in names.items() for key, v in each(name, values).items()}
    measured = columns | each("{j}_torque_Nm", TAU)
    lines = inspect_log(text(tmp_path, columns | each("{j}_cmd_torque", TAU)), RIGID).mapping.splitlines()
    found = {line.partition(":")[0]: line for line in lines}
    assert found["tau"].startswith('tau: {from: "{joint}_cmd_torque"')  # the nearest thing to one, if nothing else is
    assert "q_des" not in found
    bare = {key: values for key, values in columns.items() if "torque" not in key}
    lines = inspect_log(text(tmp_path, bare), RIGID).mapping.splitlines()
    assert lines == [
        'q: {from: "{joint}_pos_rad"}', 'q_des: {from: "{joint}_cmd_rad"}', 'dq_des: {from: "{joint}_cmd_rad_s"}',
    ]  # fmt: skip
    assert "q_des" not in inspect_log(text(tmp_path, measured), RIGID).mapping


def test_what_is_far_beyond_the_robots_limits_is_told(tmp_path: Path) -> None:
    joints = tuple(replace(j, limits=Limits((-3.0, 3.0), velocity=9.0, torque=30.0)) for j in RIGID.joints)
    robot = replace(RIGID, joints=joints)
    assert not any("limit" in said for said in read(written(tmp_path, "log.csv", BASE), robot=robot).warnings)
    wrong = like(BASE, tau=100 * TAU, q=np.degrees(Q), theta=np.degrees(Q))
    said = " ".join(read(written(tmp_path, "log.csv", wrong), robot=robot).warnings)
    assert re.search(r"times the effort limit of 30 \([\w ]+ beyond as well\): the unit or the side", said)
    assert "times the velocity limit of 9" in said
    assert "are outside its limits, -3 to 3" in said


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        ({"unit": "mA"}, "tau is in A"),
        ({"unit": "A", "scale": 1.0}, "tau is in A"),
        ({"unit": "permille"}, "tau is in shares of a rated torque"),
        ({"unit": "A", "scale": {JOINTS[0]: 0.1}}, "tau is in A"),
        ({"unit": "A", "scale": 0.1}, ""),
        ({"unit": "percent", "scale": [12.0] * len(JOINTS)}, ""),
        ({"unit": "mN.m"}, ""),
    ],
)
def test_a_torque_that_is_a_current_or_a_share_needs_a_scale(
    tmp_path: Path, spec: dict[str, object], told: str
) -> None:
    path = text(tmp_path, {"t": BASE.t} | each("q{}", Q) | each("u{}", TAU))
    said = [w for w in read(path, robot=RIGID, mapping={"tau": {"from": "u{i}", **spec}}).warnings if "scale" in w]
    assert bool(said) == bool(told), said
    assert all(line.startswith(told) for line in said)


def test_a_prediction_is_not_called_trusted_where_a_unit_is_doubted(tmp_path: Path) -> None:
    error = {joint: JointError(1e-3, 1e-4, None, None, 10.0, floor=1e-3) for joint in JOINTS}
    joints = tuple(replace(j, limits=Limits(torque=30.0)) for j in RIGID.joints)
    robot = replace(RIGID, joints=joints)
    right = read(written(tmp_path, "log.csv", BASE), robot=robot).warnings
    assert trust_words(robot, error, warnings=right).startswith("Yes: ")
    wrong = read(written(tmp_path, "log.csv", like(BASE, tau=100 * TAU)), robot=robot).warnings
    assert trust_words(robot, error, warnings=wrong).startswith("Only if the log's units and signs are right")
    path = text(tmp_path, {"t": BASE.t, **each("q{}[deg]", Q), **each("tau{}[A]", TAU)})
    told = read(path, robot=RIGID, mapping={"q": {"from": "q{i}"}, "tau": {"from": "tau{i}", "scale": 2.0}}).warnings
    assert trust_words(RIGID, error, warnings=told[:1]).startswith("Only if the log's units and signs are right")
    assert "which is no torque" in told[1]
    path = text(tmp_path, {"t": BASE.t, "q1[rad]": Q[:, 0], "q2[deg]": Q[:, 1], "q3": Q[:, 2], **each("tau{}", TAU)})
    told = read(path, robot=RIGID, mapping={"q": {"from": "q{i}"}, "tau": {"from": "tau{i}"}}).warnings
    line = 'q: {from: "q{i}", unit: {elbow: deg}}'
    assert f"q is in 'deg' by its header and taken without conversion; if so, map it: {line}" in told


def test_numbered_values_of_joint_states_are_said_to_be_taken_in_the_robots_order(tmp_path: Path) -> None:
    columns = {"__time": BASE.t, **each("/joint_states/position[{}]", Q, 0), **each("/joint_states/effort[{}]", TAU, 0)}
    notes = read(text(tmp_path, columns), robot=RIGID).notes
    assert any(note.startswith("q: values of /joint_states/position[{i0}] have no names") for note in notes)


def test_no_joint_is_proposed_the_column_of_another(tmp_path: Path) -> None:
    """The nearest name is that of a joint which has its own."""
    columns = {"t": BASE.t, **each("q.{j}", Q), **each("tau.{j}", TAU), **each("theta.{j}", BASE.theta)}
    del columns["theta.elbow"]
    with pytest.raises(LogError, match="no motor position for elbow") as caught:
        read(text(tmp_path, columns))
    assert "shoulder wrist" in caught.value.detail
    assert "joints:" not in caught.value.hint
    columns["theta.elbo"] = BASE.theta[:, 1]
    with pytest.raises(LogError, match="no motor position for elbow") as caught:
        read(text(tmp_path, columns))
    assert "joints: {elbow: elbo}" in caught.value.hint


def test_columns_of_a_name_that_two_joints_have_are_proposed_by_number(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file.attrs["joint_names"] = ["shoulder", "wrist", "wrist"]
        for name in ("t", "q", "theta", "tau"):
            file[name] = getattr(BASE, name)
    with pytest.raises(LogError, match="for elbow") as caught:
        read(path)
    assert "names wrist more than once" in caught.value.detail
    pasted = shlex.split(caught.value.hint.partition("--map")[2].replace("--map", ""))
    log = read(path, mapping=read_map_options(pasted))
    for name in ("q", "theta", "tau"):
        assert np.array_equal(getattr(log, name), getattr(BASE, name))


def test_no_signal_is_proposed_that_was_found(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        for name in ("t", "theta", "tau"):
            file[name] = getattr(BASE, name)
        file["q"] = BASE.q[:, 0]
    with pytest.raises(LogError, match="no link position") as caught:
        read(path)
    assert "theta" not in caught.value.hint


def test_names_of_another_number_than_the_columns_are_told(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file.attrs["joint_names"] = ["elbow", "wrist"]
        for name in ("t", "q", "theta", "tau"):
            file[name] = getattr(BASE, name)
    log = read(path)
    assert np.array_equal(log.q, BASE.q)
    assert "joint_names holds 2 names (elbow, wrist) and /q 3 columns: not used" in log.repairs
    with pytest.raises(LogError, match="joint_names holds 2 names"):
        read(path, strict=True)


def without_elbow(folder: Path, form: str) -> Path:
    """Write a log that holds no torque of the elbow."""
    if form == "columns":
        columns = {"t": BASE.t, **each("q.{j}", Q), **each("tau.{j}", TAU), **each("theta.{j}", BASE.theta)}
        return text(folder, {name: values for name, values in columns.items() if name != "tau.elbow"})
    bag = Bag()
    for topic in ("/joint_states", "/motor_states", "/motor_torques"):
        bag.topic(topic)
    for row, t in enumerate(np.rint(BASE.t * 1e9).astype(int).tolist()):
        stamp = 10**18 + t
        bag.add("/joint_states", stamp, joint_state(stamp, list(JOINTS), Q[row]))
        bag.add("/motor_states", stamp, joint_state(stamp, list(JOINTS), BASE.theta[row]))
        torques = joint_state(stamp, ["wrist", "shoulder"], [0, 0], effort=TAU[row, [2, 0]])
        bag.add("/motor_torques", stamp, torques)
    path = folder / "log.mcap"
    path.write_bytes(bag.bytes())
    return path


@pytest.mark.parametrize("form", ["columns", "messages"])
def test_a_joint_without_torque_is_refused_until_it_is_told_so(tmp_path: Path, form: str) -> None:
    path, mapping = without_elbow(tmp_path, form), {}
    if form == "messages":
        mapping = {"tau": {"from": "/motor_torques", "field": "effort", "sign": -1}}
    with pytest.raises(LogError, match="no torque for elbow") as caught:
        read(path, mapping=mapping)
    assert caught.value.exit_code == 3
    assert "names" in caught.value.detail
    (line,) = shlex.split(caught.value.hint.partition("to do without: --map ")[2])
    log = read(path, mapping=mapping | read_map_options([line]))
    assert np.isnan(log.tau).all(axis=0).tolist() == [False, True, False]
    np.testing.assert_allclose(log.tau[:, 0], TAU[:, 0] * (-1 if form == "messages" else 1), atol=1e-9)
    place = "/motor_torques.effort" if form == "messages" else "tau.shoulder, tau.wrist"
    assert any(warning.startswith(f"elbow: no torque tau in {place}: inertia") for warning in log.warnings)


def test_units_of_headers_are_proposed_by_info_for_signals_that_it_finds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each joint in its own unit; what is in SI needs no word."""
    columns = {"t": BASE.t, **each("q.{j}", Q), **each("dq.{j} [°/s]", Q), **each("tau.{j} [Nm]", TAU)}
    columns["q.elbow [°]"], columns["q.wrist [mm]"] = np.degrees(columns.pop("q.elbow")), 1e3 * columns.pop("q.wrist")
    path, robot, file = text(tmp_path, columns), tmp_path / "arm.yaml", tmp_path / "map.yaml"
    robot.write_text(text_of(RIGID))
    info = inspect_log(path, RIGID)
    assert info.missing == ()
    assert info.mapping.splitlines() == [
        'q: {from: "q.{joint}", unit: {elbow: deg, wrist: mm}}', 'dq: {from: "dq.{joint}", unit: deg/s}',
    ]  # fmt: skip
    words = ["info", str(path), "--robot", str(robot), "--color", "never"]
    assert main([*words, "--write-map", str(file)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "This log can be used, with the mapping below, which says its units" in said
    assert f"--map {file}" in said
    log = read(path, robot=RIGID, mapping=read_map_options([str(file)]))
    np.testing.assert_allclose(log.q, Q, atol=1e-9)
    assert not any("by its header" in warning for warning in log.warnings)
    assert main([*words, "--map", str(file)]) == 0
    assert "This log can be used: it has" in " ".join(capsys.readouterr().out.split())


def degrees(name: str, j: str, k: int) -> dict[str, np.ndarray]:
    """Return a joint's position in degrees, in a column of this name."""
    return {name.format(j=j): np.degrees(Q[:, k])}


@pytest.mark.parametrize("name", ["q.{j}_deg", "q_deg.{j}", "{j}_q_deg", "{j} q [°]"])
def test_units_at_the_end_of_names_are_proposed_where_a_joint_has_no_column(tmp_path: Path, name: str) -> None:
    first, second, third = JOINTS
    columns = degrees(name, first, 0) | degrees(name, third, 2)
    path = text(tmp_path, {"t": BASE.t, **columns, f"theta.{second}": Q[:, 1], **each("tau.{j}", TAU)})
    line = next(line for line in inspect_log(path, RIGID).mapping.splitlines() if line.startswith("q: "))
    log = read(path, robot=RIGID, mapping=read_map_options([line]))
    np.testing.assert_allclose(log.q[:, [0, 2]], Q[:, [0, 2]], atol=1e-9)
    np.testing.assert_allclose(log.theta[:, 1], Q[:, 1], atol=1e-9)


def test_a_unit_at_the_end_of_one_name_is_proposed_beside_plain_ones(tmp_path: Path) -> None:
    first, _, third = JOINTS
    columns = {f"q.{third}": Q[:, 2], **degrees("q.{j}_deg", first, 0)}
    path = text(tmp_path, {"t": BASE.t, **columns, **each("theta.{j}", BASE.theta), **each("tau.{j}", TAU)})
    elastic = replace(ROBOT, joints=tuple(replace(j, transmission="elastic") for j in ROBOT.joints))
    found = inspect_log(path, elastic)
    line = f"q: {{from: [q.{first}_deg, null, q.{third}], unit: {{{first}: deg}}}}"
    assert found.mapping == line
    assert any(f"map it: {line}" in note for note in found.notes)
    log = read(path, robot=elastic, mapping=read_map_options([line]))
    np.testing.assert_allclose(log.q[:, [0, 2]], Q[:, [0, 2]], atol=1e-9)
    assert any("no link position q" in said and line in said for said in read(path, robot=elastic).warnings)

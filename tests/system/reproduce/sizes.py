"""How large the code is and where it is complicated: what a clean-up is measured by.

    python -m tests.system.reproduce.sizes [--list]

Code lines hold code: no blank line, comment or docstring. Complexity is McCabe's, as ruff's C901 counts it.
With ``--list`` every function and module over a limit is named. The second table divides the code between version 0.1
(8dff405 begins 0.2.0; the code before it is 24.9 k lines) and what came since: ``LATER`` says which folders and modules
came with which feature. What grew within a module of 0.1, and modules that several features share, count to 0.1.
"""

from __future__ import annotations

import ast
import io
import json
import subprocess
import sys
import tokenize
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "elid_cli"
COMPLEXITY = 10
PARAMETERS = 7
LINES = 350
FOR_THE_FEATURES_OF_0_1 = 22_000
"""Code lines that are aimed at for the features of version 0.1."""
LATER: dict[str, str] = {
    "motion under commands, replay": "model/coordinates model/rollout model/rollout_alone model/rollout_loops "
    "model/rollout_steps model/linearised model/drives model/runs "
    "experiment/replay cli/verbs/replay report/answers/replay report/figures/plots/replayed",
    "trajectory fits": "estimation/trajectory estimation/output_error",
    "diagnosis by motion": "diagnosis/by_motion report/answers/motion_diagnosis",
    "friction family": "diagnosis/friction_family cli/verbs/friction report/answers/friction "
    "model/effects/library/servo_friction model/effects/breakaway",
    "actuators for simulators": "estimation/actuators estimation/actuator_text experiment/replay/actuators",
    "commands as torque, sample times": "logs/checks/commanded logs/repair/sample_times signals/command_torque",
    "stiffness from the motor side": "model/link_vectors estimation/motor_side experiment/stiffness_motion "
    "report/answers/motor_side report/answers/stiffness_motion report/figures/plots/response",
    "excite --resolve": "experiment/resolve report/answers/resolution",
    "trend": "estimation/trend cli/verbs/trend report/answers/trend report/answers/trend_families "
    "report/figures/plots/trended",
    "sample": "estimation/sampling cli/verbs/sample report/answers/sampling report/figures/plots/drawn_sets",
    "gains of drives from a payload": "estimation/drive_gains report/answers/drive_gains",
    "does the model suffice": "estimation/validation/following estimation/validation/sufficiency "
    "estimation/validation/too_quiet estimation/regression/known_columns signals/repeating "
    "diagnosis/search/channel_faults diagnosis/search/one_for_two diagnosis/evidence/usual_cutoff "
    "diagnosis/evidence/leftover diagnosis/evidence/driving_friction diagnosis/written report/answers/missing "
    "model/effects/library/position_delay",
    "MJCF, patched files, trees": "robot/mjcf robot/patch robot/xml_edit robot/beside robot/frames robot/locking "
    "experiment/real_bodies",
    "init, incomplete robots": "cli/asking cli/verbs/init robot/completion robot/ideal report/answers/completion "
    "logs/first_look",
    "further log formats": "logs/formats/db3 logs/formats/json_lines logs/formats/long_form logs/formats/mat5 "
    "logs/formats/npz logs/formats/packed logs/formats/parquet logs/formats/ros2_echo logs/mapping/long_table "
    "logs/mapping/nameless logs/mapping/profiles logs/formats/csv_times",
    "elastic by the log, doubted units": "logs/adapt logs/checks/deflection model/body_torques "
    "logs/checks/known_inertias logs/checks/known_masses logs/checks/limits logs/checks/position_scale",
    "hostile files, dropouts": "budget logs/repair/dropouts logs/repair/scattered",
    "the page, plot": "cli/verbs/plot report/answers/known report/answers/log report/answers/summary "
    "report/glossary "
    "report/figures/drawing report/figures/raster report/figures/svg report/figures/timeline "
    "report/figures/plots/change report/figures/plots/errors report/figures/plots/signals",
    "results in Python": "tables report/present",
    "compiled and exact simulation, jobs": "experiment/simulation/compiled_periods experiment/simulation/exponential "
    "experiment/simulation/kernel diagnosis/search/side_by_side",
}
"""Folders and modules of `elid_cli` that came with a feature after version 0.1; a deeper path wins over its folder."""
_THIN = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def code_lines(source: str) -> set[int]:
    """Return the numbers of the lines that hold code."""
    texts: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            texts |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _THIN:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return lines - texts


def import_lines(tree: ast.Module) -> int:
    """Return how many lines of a file are imports."""
    heads = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    return sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in heads)


def many_parameters(tree: ast.Module) -> list[tuple[int, str, int]]:
    """Return (line, name, count) of functions with more parameters than the limit, self and cls not counted."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            count = len([name for name in names if name not in ("self", "cls")])
            if count > PARAMETERS:
                found.append((node.lineno, node.name, count))
    return found


def complicated() -> list[str]:
    """Return ``file:line: function (complexity)`` of functions over the limit."""
    done = subprocess.run(
        [sys.executable, "-m", "ruff", "check", str(PACKAGE), "--isolated", "--no-cache", "--select", "C901",
         "--config", f"lint.mccabe.max-complexity={COMPLEXITY}", "--output-format", "json"],
        capture_output=True, text=True,
    )  # fmt: skip
    return [
        f"{Path(row['filename']).relative_to(ROOT)}:{row['location']['row']}: {row['message']}"
        for row in json.loads(done.stdout)
    ]


def feature_of(path: Path) -> str | None:
    """Return the feature after version 0.1 that a module came with; None if it serves version 0.1."""
    owners = {place: feature for feature, places in LATER.items() for place in places.split()}
    module = path.relative_to(PACKAGE).with_suffix("")
    return next((owners[str(m)] for m in (module, *module.parents) if str(m) in owners), None)


def features(code: dict[Path, int]) -> None:
    """Print how many modules and code lines serve version 0.1, and how many came with each feature since."""
    sizes: dict[str | None, Counter[str]] = defaultdict(Counter)
    for path, lines in code.items():
        sizes[feature_of(path)].update(modules=1, code=lines)
    first = sizes.pop(None)
    print(f"\n{'feature':36s} {'modules':>7s} {'code':>7s}")
    print(f"{'version 0.1, and what is shared':36s} {first['modules']:7d} {first['code']:7d}")
    for feature, size in sorted(sizes.items(), key=lambda item: -item[1]["code"]):
        print(f"{feature:36s} {size['modules']:7d} {size['code']:7d}")
    over = first["code"] - FOR_THE_FEATURES_OF_0_1
    print(f"for the features of 0.1: {first['code']} code lines, {over:+d} against {FOR_THE_FEATURES_OF_0_1} aimed at")


def levels() -> tuple[int, int]:
    """Return (longest chain of imports between files, arrows between files), imports inside functions left out."""
    modules = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in PACKAGE.rglob("*.py")}
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        graph[name] = set()
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                targets = {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
                graph[name] |= {t for t in targets if t in modules}

    @cache
    def depth(name: str) -> int:
        return 1 + max((depth(other) for other in graph[name] if other != name), default=0)

    return max(map(depth, graph)), sum(map(len, graph.values()))


def main() -> None:
    """Print sizes by folder, then what is over a limit."""
    rooms: dict[str, Counter[str]] = defaultdict(Counter)
    code: dict[Path, int] = {}
    long: list[str] = []
    wide: list[str] = []
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text("utf-8")
        tree = ast.parse(source)
        parts = path.relative_to(PACKAGE).parts
        room = parts[0] if len(parts) > 1 else "(top)"
        rows = len(source.splitlines())
        code[path] = len(code_lines(source))
        rooms[room].update(files=1, lines=rows, code=code[path], imports=import_lines(tree))
        where = str(path.relative_to(ROOT))
        if rows > LINES:
            long.append(f"{where}: {rows} lines")
        wide += [f"{where}:{line}: {name} ({count} parameters)" for line, name, count in many_parameters(tree)]
    total: Counter[str] = Counter()
    print(f"{'folder':12s} {'files':>6s} {'lines':>7s} {'code':>7s} {'imports':>8s}")
    for room, sizes in sorted(rooms.items(), key=lambda item: -item[1]["code"]):
        total.update(sizes)
        print(f"{room:12s} {sizes['files']:6d} {sizes['lines']:7d} {sizes['code']:7d} {sizes['imports']:8d}")
    print(f"{'all':12s} {total['files']:6d} {total['lines']:7d} {total['code']:7d} {total['imports']:8d}")
    chain, arrows = levels()
    print(f"longest chain of imports {chain}, imports between files {arrows}")
    features(code)
    print()
    for title, rows_over in (
        (f"functions over complexity {COMPLEXITY}", complicated()),
        (f"functions with more than {PARAMETERS} parameters", wide),
        (f"modules over {LINES} lines", long),
    ):
        print(f"{title}: {len(rows_over)}")
        if "--list" in sys.argv:
            print(*(f"  {row}" for row in rows_over), sep="\n")


if __name__ == "__main__":
    main()

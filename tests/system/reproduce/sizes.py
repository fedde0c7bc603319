"""How large the code is and where it is complicated: what a clean-up is measured by.

    python -m tests.system.reproduce.sizes [--list]

Code lines hold code: no blank line, comment or docstring. Complexity is McCabe's, as ruff's C901 counts it.
With ``--list`` every function and module over a limit is named.
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
    long: list[str] = []
    wide: list[str] = []
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text("utf-8")
        tree = ast.parse(source)
        parts = path.relative_to(PACKAGE).parts
        room = parts[0] if len(parts) > 1 else "(top)"
        rows = len(source.splitlines())
        rooms[room].update(files=1, lines=rows, code=len(code_lines(source)), imports=import_lines(tree))
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

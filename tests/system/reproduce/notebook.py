"""Run the notebooks of the documentation and keep what their cells print.

    python -m tests.system.reproduce.notebook                # in place
    python -m tests.system.reproduce.notebook --to FOLDER    # beside, to compare

A cell that fails stops the run with its traceback. Times of execution are not kept, so that the same outputs give the
same bytes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[3] / "docs" / "notebooks"
CELL_LIMIT = 500
"""s, for one cell."""


def main() -> None:
    """Run every notebook, in the folder where it lies."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--to", type=Path, default=NOTEBOOKS)
    folder = parser.parse_args().to
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        client = NotebookClient(
            notebook, timeout=CELL_LIMIT, kernel_name="python3", record_timing=False,
            resources={"metadata": {"path": str(path.parent)}},
        )  # fmt: skip
        client.execute()
        notebook.metadata.pop("language_info", None)  # names the interpreter's version
        nbformat.write(notebook, folder / path.name)


if __name__ == "__main__":
    main()

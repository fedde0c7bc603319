"""Random robots are shared with the tests of robot files."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "robots"))

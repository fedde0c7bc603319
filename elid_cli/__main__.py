"""Run elid as ``python -m elid_cli``."""

import sys

from elid_cli.cli import main

if __name__ == "__main__":
    sys.exit(main())

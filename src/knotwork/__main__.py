"""`python -m knotwork`."""

import sys

from knotwork.core.cli.main import main

if __name__ == "__main__":
    sys.exit(main())

"""Runs the command line as `python -m ravenjax.cli`."""

import sys

from ravenjax.cli import main

sys.exit(main())

"""Tests draw their virtual logs as the scripts of the analysis do."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[3] / "analysis/calibration"))

"""A made-up campaign with haptic sets of which one comes for nothing now and then, and what each
misses.
"""

import numpy as np
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import cues

RUNS = 900
MANIFEST = synthetic.manifest(RUNS)
FRAME = synthetic.frame(RUNS).assign(golden_tip_path_mm=np.arange(RUNS) % 40 + 0.5)
LOW = [k for k, cue in enumerate(MANIFEST.cues) if cue.threshold_mm == 1.0]
for _k in LOW:  # at 1 mm every tenth motion has a cue without any fault, late
    FRAME[f"golden_cue{_k}_first_ms"] = np.where(FRAME["golden_tip_path_mm"] % 10 == 0.5, 700, -1)
# A set of 3 mm misses more than one of 2 mm does.
for _k in [k for k, cue in enumerate(MANIFEST.cues) if cue.threshold_mm == 3.0]:
    FRAME[f"cue{_k}_first_ms"] = np.where(FRAME.index % 4 == 0, -1, FRAME[f"cue{_k}_first_ms"])
TABLE = Runs.of(FRAME, MANIFEST)
ROWS = {row.number: row for row in cues.cue_rows(TABLE)}
HAZARD = ((FRAME["hazard"] == "unintended motion") & (FRAME["failed"] == "")).to_numpy()


def missed(frame, k):
    """Runs with a hazard that cue k does not tell of, bool [runs]."""
    cue, golden = frame[f"cue{k}_first_ms"].to_numpy(), frame[f"golden_cue{k}_first_ms"].to_numpy()
    told = (cue >= 0) & ~((golden >= 0) & (golden <= cue)) & (cue >= frame["first_active_ms"])
    return HAZARD & ~told

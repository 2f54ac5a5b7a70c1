"""The worst runs of each outcome against plain pandas."""

from pathlib import Path

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import worst

RUNS = 1500
MANIFEST = synthetic.manifest(RUNS)
FRAME = synthetic.judged(
    synthetic.frame(RUNS).assign(
        cue0_ms=np.random.default_rng(1).permutation(RUNS),
        halted_ms=lambda frame: np.where(
            np.arange(RUNS) % 7 == 0, 300 + np.arange(RUNS), frame["halted_ms"]
        ),
    )
)
FAULTY = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
FOUND = {kind["name"]: kind for kind in worst.worst_rows(Runs.of(FRAME, MANIFEST), Path("my out"))}
TOLD = FAULTY["response"].isin(["stopped", "flagged"])
UNINTENDED, LOSS = (FAULTY["hazard"] == name for name in ("unintended motion", "loss of motion"))
KINDS = {
    "evaded": (UNINTENDED & ~TOLD, "unintended_mm"),
    "told": (UNINTENDED & TOLD, "unintended_mm"),
    "loss": (LOSS & (FAULTY["loss_first_ms"] >= 0), "loss_mm"),
    "halted": (LOSS & (FAULTY["loss_first_ms"] < 0), "halted_ms"),
    "misreport": (FAULTY["hazard"] == "false report", "false_report_mm"),
    "phantom": ((FAULTY["hazard"] == "none") & (FAULTY["cue0_first_ms"] >= 0), "cue0_ms"),
    "depth": (FAULTY["tissue_depth_mm"] > FAULTY["golden_tissue_depth_mm"], "tissue_depth_mm"),
}


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_by_pandas(name):
    chosen, column = KINDS[name]
    assert chosen.sum() > worst.SHOWN_RUNS
    expected = FAULTY[chosen].nlargest(worst.SHOWN_RUNS, column)
    kind = FOUND[name]
    assert kind["n"] == chosen.sum()
    assert [row["run_id"] for row in kind["rows"]] == expected["run_id"].tolist()
    assert [row["far"] for row in kind["rows"]] == pytest.approx(expected[column].tolist())

"""What is derived of each run, against a plain count and on rows made by hand."""

from __future__ import annotations

import numpy as np
import synthetic_results as synthetic

from ravenjax.report.data import facts as run_facts

FRAME = synthetic.frame(600)


def test_fault_free_motions_that_are_one_computation_count_once():
    frame = FRAME.head(40).assign(operator="suture", golden_tip_path_mm=np.repeat([30.0, 31.0], 20))
    free = run_facts.golden_runs(frame, run_facts.derive(frame)["plain"].to_numpy(bool))
    assert len(free) == 2
    assert run_facts.hours(free) == 2 * 2800 / 3.6e6
    frame = frame.assign(operator=np.where(np.arange(40) % 2, "suture", "circle"))
    assert len(run_facts.golden_runs(frame, run_facts.derive(frame)["plain"].to_numpy(bool))) == 4

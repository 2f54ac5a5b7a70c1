"""The study of the hazard library: its tables on made-up runs, and the whole on the simulator."""

import pytest

from ravenjax.hazards import library
from studies.hazards import library as hazard_library
from studies.study import Findings, Table

RUNNABLE = [row for row in library.all_hazards() if row.runnable]


def titled(found: Findings, begins: str) -> Table:
    return next(one for one in found.tables if one.title.startswith(begins))


@pytest.mark.slow
def test_the_study_runs(reproduced) -> None:
    few = {hazard_library.EVERY_CYCLE: ("campaign.limit=20",)}
    found = reproduced(hazard_library.STUDY, {hazard_library.BASELINE: (), **few})
    run = titled(found, "Outcome of every")
    assert len(run.rows) == len(RUNNABLE)
    runs, activated = (run.columns.index(name) for name in ("runs", "runs with an activated fault"))
    for row in run.rows:
        assert row[runs] and row[activated], f"{row[0]}: never activated"

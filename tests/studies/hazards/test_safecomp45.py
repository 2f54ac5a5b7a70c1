"""The study of the 45 injections: its rows, its arithmetic on made-up runs, and the whole on the
simulator.
"""

import pytest

from ravenjax.campaign import loading
from ravenjax.hazards import naming
from studies.hazards import safecomp45

NOT_SIMULATED = {4, 13, 14, 32, 44, 45}


def test_the_list_has_45_rows_and_the_campaign_runs_all_that_can_be_run() -> None:
    rows = safecomp45.injections()
    assert list(rows) == list(range(1, 46))
    assert {number for number, row in rows.items() if not row.runnable} == NOT_SIMULATED
    groups = loading.load_campaign("safecomp45.toml").group
    run = {name for group in groups for name in naming.hazards_of(group.name)}
    assert run == {row.id for row in rows.values() if row.runnable}
    assert any(not group.fault for group in groups)  # a fault-free run


@pytest.mark.slow
def test_the_study_runs(reproduced) -> None:
    """A pedal that flickers between two packets (C05) is seen by nobody; all other faults change
    a number.
    """
    few = dict.fromkeys(safecomp45.LENGTHS, ("campaign.limit=20",))
    found = reproduced(safecomp45.STUDY, {safecomp45.BASELINE: (), **few})
    rows = found.tables[0]
    activated = rows.columns.index("simulated runs with an activated fault")
    for row in rows.rows:
        if row[0] not in NOT_SIMULATED:
            k, _, n = str(row[activated]).partition(" of ")
            assert int(k) == int(n) > 0 or (row[1] == "C05" and int(n) > int(k) > 0), row
    by_hazard = {row[1]: row[rows.columns.index("verdict")] for row in rows.rows}
    assert by_hazard["K02"] == by_hazard["B12"] == safecomp45.AGREE
    assert by_hazard["B13"] == safecomp45.DIFFER  # a watchdog's wave does not pass a stuck byte

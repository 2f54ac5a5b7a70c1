"""The study of the 45 injections: its rows, its arithmetic on made-up runs, and the whole on the
simulator.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import result_rows

from ravenjax.campaign import loading
from ravenjax.hazards import naming
from studies import findings as findings_files
from studies.hazards import safecomp45
from studies.study import Findings

NOT_SIMULATED = {4, 13, 14, 32, 44, 45}


def table() -> pd.DataFrame:
    """Each simulated row stops once by the PLC, but K01 by the overdrive check and B11 with a
    jump.
    """
    rows = []
    for number, row in safecomp45.injections().items():
        if number in NOT_SIMULATED:
            continue
        cause = "overdrive" if row.id in ("K01", "B11") else "plc"
        rows.append(
            {
                "group": f"list/{row.id}",
                "response": "stopped",
                "response_cause": cause,
                "jump_tip": row.id == "B11",
            }
        )
    return result_rows.frame(*rows, {"group": "fault_free"})


def findings(monkeypatch: pytest.MonkeyPatch) -> Findings:
    monkeypatch.setattr(safecomp45.folder, "read_all", lambda path: table())
    return safecomp45.compare(safecomp45.Context({"list": Path("a"), "present_limits": Path("b")}))


def test_the_list_has_45_rows_and_the_campaign_runs_all_that_can_be_run() -> None:
    rows = safecomp45.injections()
    assert list(rows) == list(range(1, 46))
    assert {number for number, row in rows.items() if not row.runnable} == NOT_SIMULATED
    groups = loading.load(safecomp45.CAMPAIGN).group
    run = {name for group in groups for name in naming.hazards_of(group.name)}
    assert run == {row.id for row in rows.values() if row.runnable}
    assert any(not group.fault for group in groups)  # a fault-free run


@pytest.mark.slow
def test_rows_that_are_not_simulated_never_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = findings(monkeypatch).tables[0]
    assert len(rows.rows) == 45
    place = rows.columns.index("verdict")
    assert {row[0] for row in rows.rows if row[place] == safecomp45.NOT_SIMULATED} == NOT_SIMULATED


def test_agreement_is_counted_over_simulated_rows_without_an_interval(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = findings(monkeypatch)
    line = found.lines[0]
    stops = sum(
        row.expected_class == ("stop",) for row in safecomp45.injections().values() if row.runnable
    )
    assert line.predicted is not None and line.target == "A7"
    assert line.predicted.n == 39
    assert line.predicted.value == pytest.approx(100 * (stops + 1) / 39)  # B11: stop and jump
    assert np.isnan(line.predicted.low)  # every row of the list: nothing was sampled


@pytest.mark.slow
def test_the_study_runs(tmp_path: Path) -> None:
    """A pedal that flickers between two packets (C05) is seen by nobody; all other faults change
    a number.
    """
    found = findings_files.reproduce(safecomp45.STUDY, tmp_path)
    rows = found.tables[0]
    activated = rows.columns.index("activated, of")
    for row in rows.rows:
        if row[0] not in NOT_SIMULATED:
            k, _, n = str(row[activated]).partition(" of ")
            assert int(k) == int(n) > 0 or (row[1] == "C05" and int(n) > int(k) > 0), row
    by_hazard = {row[1]: row[rows.columns.index("verdict")] for row in rows.rows}
    assert by_hazard["K02"] == by_hazard["B12"] == safecomp45.AGREE
    assert by_hazard["B13"] == safecomp45.DIFFER  # a watchdog's wave does not pass a stuck byte

"""The study of the hazard library: its tables on made-up runs, and the whole on the simulator."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
import result_rows

from ravenjax.hazards import expansion, library
from studies import findings as findings_files
from studies.hazards import library as hazard_library
from studies.study import Findings, Table

RUNNABLE = [row for row in library.rows() if row.runnable]


def first(value: object) -> object:
    """One value that a plain group documents."""
    if isinstance(value, dict):
        return next(iter(value.values()))[0]
    return value[0] if isinstance(value, list) else value


def table() -> pd.DataFrame:
    """One quiet run a case of each hazard, with a documented value in each slot."""
    rows: list[dict[str, object]] = [{"group": "fault_free"}]
    for group in expansion.expand({"name": "library", "hazards": "all"}):
        values = {
            f"fault{k}_value": first(fault.get("value")) for k, fault in enumerate(group["fault"])
        }
        rows.append({"group": group["name"], **values})
    frame = result_rows.frame(*rows)
    slots = [name for name in frame if name.endswith("_value")]
    return frame.astype(dict.fromkeys(slots, float))


def findings(monkeypatch: pytest.MonkeyPatch, frame: pd.DataFrame) -> Findings:
    monkeypatch.setattr(hazard_library.folder, "read_all", lambda path: frame)
    return hazard_library.compare(
        hazard_library.Context({"library": Path("a"), "sudden_jump": Path("b")})
    )


def titled(found: Findings, begins: str) -> Table:
    return next(one for one in found.tables if one.title.startswith(begins))


def test_every_row_is_run_or_documented(monkeypatch: pytest.MonkeyPatch) -> None:
    found = findings(monkeypatch, table())
    run, rest = titled(found, "Every hazard"), titled(found, "Documented only")
    assert [row[0] for row in run.rows] == [row.id for row in RUNNABLE]
    assert len(run.rows) + len(rest.rows) == len(library.rows())
    assert all(row[-1] for row in rest.rows)
    assert {line.quantity: line.predicted.value for line in found.lines[:3] if line.predicted} == {
        "rows that ran": len(RUNNABLE),
        "rows with at least one activated run": len(RUNNABLE),
        "rows whose every run was activated": len(RUNNABLE),
    }


@pytest.mark.slow
def test_the_study_runs(tmp_path: Path) -> None:
    found = findings_files.reproduce(hazard_library.STUDY, tmp_path)
    run = titled(found, "Every hazard")
    assert len(run.rows) == len(RUNNABLE)
    runs, activated, values = (
        run.columns.index(name) for name in ("runs", "activated", "values as documented")
    )
    for row in run.rows:
        assert row[runs] and row[activated], f"{row[0]}: never activated"
        k, _, n = str(row[values]).partition(" of ")
        assert k == n == str(row[runs]), f"{row[0]}: values that are not documented"

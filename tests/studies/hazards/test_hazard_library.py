"""The study of the hazard library: its tables on made-up runs, and the whole on the simulator."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
import result_rows

from ravenjax.campaign import loading
from ravenjax.hazards import expansion, library, naming
from studies import findings as findings_files
from studies.hazards import library as hazard_library
from studies.hazards import maude
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


def test_values_are_counted_against_the_documented_ones() -> None:
    frame = table()
    assert all(
        (k, n) == (n, len(row.case))
        for row in RUNNABLE
        for k, n in [hazard_library.documented(frame, row)]
    )
    frame.loc[frame["group"] == "library/B24", "fault0_value"] = 300.0  # not one of the 17
    frame.loc[frame["group"] == "library/C01-below", "fault0_value"] = -100.0  # inside, not below
    assert hazard_library.documented(frame, library.find("B24")) == (0, 1)
    assert hazard_library.documented(frame, library.find("C01")) == (2, 3)


def test_report_shares_come_with_their_caveat(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = titled(findings(monkeypatch, table()), "Risk by category")
    assert maude.CAVEAT in shown.note
    assert [row[2] for row in shown.rows if row[0] == "video"] == ["not simulated"]


@pytest.mark.parametrize("variant", hazard_library.STUDY.variants, ids=lambda v: v.name)
def test_every_variant_loads_and_names_hazards(variant: hazard_library.Variant) -> None:
    config = loading.load(variant.campaign, variant.overrides)
    known = {row.id for row in library.rows()}
    for group in config.group:
        ids = naming.hazards_of(group.name)
        assert set(ids) <= known
        assert bool(ids) == bool(group.fault), group.name


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

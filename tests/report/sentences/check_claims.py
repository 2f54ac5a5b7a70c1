"""Sentences and tables of checks, failures and precision, written as they should be."""

from __future__ import annotations

import numpy as np
import plain_statistics as plain
from claim_words import brief, many, prose
from expected_numbers import Expected, evades
from generated_campaigns import CHECKS
from page_text import DASH, Node, cell, count, fixed, number, rows


def checks(e: Expected, html: Node) -> None:
    """Which check tripped, how close it came, which decided the response."""
    section = html.one("section", "checks")
    text = prose(section, "checks")
    f, n = e.faults, e.n
    if not n:
        text.says("There is no fault to judge.")
        assert not list(section.all("table"))
        return
    text.says(f"Of {many(n, 'distinct fault')}, those in which each check tripped at all")
    text.says("Below each share: faults, and its 95 % interval (Wilson): the faults were drawn.")
    does = {
        "stopped": "stops the robot",
        "flagged": "tells a person",
        "limited": "limits, tells nobody",
    }
    unit = {
        "overdrive_instant": " DAC counts",
        "overdrive_clip": " DAC counts",
        "ik_reject": " rad",
        "master_timeout": " ticks",
    }
    table = {cells[0].words.partition(" ")[0]: cells for cells in rows(section.one("table"))}
    assert set(table) == set(CHECKS)
    tripped = []
    for name, cells in table.items():
        hits = e.count(f[f"check_{name}_first_ms"] >= 0)
        tripped.append(hits)
        closest = f.loc[f["response"] == "silent", f"check_{name}_margin"].dropna().min()
        cell(cells[1], does[CHECKS[name]], name)
        cell(cells[2], brief(hits, n), name)
        cell(
            cells[3], f"{number(closest)}{unit.get(name, '') if np.isfinite(closest) else ''}", name
        )
    assert tripped == sorted(tripped, reverse=True)
    responded = f[f["response"] != "silent"]
    if not len(responded):
        assert len(list(section.all("table"))) == 1
    else:
        found = {cells[0].words: cells[1:] for cells in rows(list(section.all("table"))[1])}
        assert set(found) == set(responded["response_cause"])
        for cause, cells in found.items():
            mine = responded[responded["response_cause"] == cause]
            for node, response in zip(cells, ("stopped", "flagged", "limited"), strict=True):
                cell(node, count((mine["response"] == response).sum()), cause)
    text.is_said()


def failures(e: Expected, html: Node) -> None:
    """Runs without a valid outcome."""
    section = html.one("section", "failures")
    text = prose(section, "failures")
    failed = e.all[e.all["failed"]]
    if not len(failed):
        text.says("None: every run gave a valid outcome.")
    else:
        text.says(
            f"{count(len(failed))} of {many(len(e.all), 'run')} gave no valid outcome. They are in"
            " no rate."
        )
        sizes = failed.groupby(failed["group"].astype(str)).size()
        table = rows(section.one("table"))
        assert [cells[1].words for cells in table] == sizes.index.tolist()
        for cells, (name, n) in zip(table, sizes.items(), strict=True):
            cell(cells[0], "nan", "failures")
            cell(cells[2], count(n), f"failures of {name}")
            first = failed.loc[failed["group"].astype(str) == name, "run_id"].iloc[0]
            assert f"ravenjax trace out {first}" in cells[3].words
    text.is_said("None:")


def precision(e: Expected, html: Node) -> None:
    """How sharp each rate is, and how many faults more it needs."""
    faulty = e.all[e.all["faulty"]]
    if not len(faulty):
        assert not list(html.all("section", "precision"))
        return
    section = html.one("section", "precision")
    text = prose(section, "precision")
    text.says("would narrow its 95 % interval")
    names = sorted(faulty["group"].astype(str).unique())
    parts = {name: faulty[faulty["group"].astype(str) == name] for name in names}
    if len(names) > 1:
        parts["all faults"] = faulty
    table = rows(section.one("table"))
    assert sorted(cells[0].words for cells in table) == sorted(parts)
    widths = []
    for cells in table:
        part = parts[cells[0].words]
        k, n = evades(part[part["sample"]])
        low, high = plain.wilson(k, n)
        widths.append((high - low) / 2 if n else -1.0)
        expected = [
            cells[0].words,
            count(n) + (f" {many(len(part), 'run')}" if len(part) != n else ""),
            brief(k, n),
            f"{fixed(50 * (high - low), 1)} points" if n else DASH,
            *(more(k, n, half) for half in (0.03, 0.01)),
        ]
        for node, words in zip(cells, expected, strict=True):
            cell(node, words, f"precision of {cells[0].words}")
    own = widths[len(names) > 1 :]
    assert own == sorted(own, reverse=True)
    text.is_said()


def more(k: int, n: int, half: float) -> str:
    """A cell with the further faults that make an interval so narrow."""
    if not n:
        return DASH
    low, high = plain.wilson(k, n)
    likely, safe = (plain.further(p, n, half) for p in (k / n, min(max(0.5, low), high)))
    return f"{count(likely)} up to {count(safe)}" if safe else "none"

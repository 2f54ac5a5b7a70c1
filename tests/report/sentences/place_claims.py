"""Sentences and tables of maps, worst runs and provenance, written as they should be."""

from __future__ import annotations

import re

import pandas as pd
from claim_words import between, many, prose
from expected_numbers import Expected, untold
from generated_campaigns import CHECKS
from page_text import Node, Text, cell, count, fixed, percent, rows

MOST_WORST = 5
FEWEST_SHOWN = 10
"""Cells of fewer faults are written as k/n."""
FEWEST_RUNS = 12
"""Fewer runs of one site and effect have no map."""


def measures(e: Expected, faulty: bool, part: pd.DataFrame) -> dict[str, tuple[str, pd.Series]]:
    """Title of what is mapped -> its words, and which runs had it."""
    told = part["response"].isin(["stopped", "flagged"])
    if not faulty:
        came = part[f"cue{e.plan.verdict_cue}_first_ms"] >= 0
        return {"A check told of it": ("were told of", told), "The cue came": ("had the cue", came)}
    moved = part["hazard"] == "unintended motion"
    return {
        "Unintended motion": ("moved unintendedly", moved),
        "A check told of it": ("were told of", told),
        "The cue came": ("had the cue", part["warned_ms"] >= 0),
        "Evaded the checks": ("evaded", moved & ~told),
    }


def maps(e: Expected, html: Node) -> None:
    """How many faults each map is of, what share had what, and cells that add up to it."""
    section = html.one("section", "maps")
    text = prose(section, "maps")
    faulty = e.n > 0
    every, unit = (e.faults, "faults") if faulty else (e.all[e.all["sample"]], "runs")
    drawn = list(section.all("div", "map"))
    if drawn:
        text.says(
            f"Share of {unit}, in %, by what was injected or varied; k/n where fewer than 10 fell"
            " into a cell."
        )
        text.says("Point at a cell for its counts, and its 95 % interval where faults were drawn.")
    if len(drawn) > 6:
        text.says(f"{count(len(drawn) - 6)} more maps, of less unintended motion")
    led: list[float] = []
    for node in drawn:
        heading = node.one("h3").words
        name = heading.rpartition(f" {node.one('h3').one('span').words}")[0]
        part = every if name == "all faults" else every[every["block"] == name]
        text.says(f"{name} {count(len(part))} {unit}")
        one_map(e, node, text, part, faulty)
        if name != "all faults" and faulty:
            led.append(float((part["hazard"] == "unintended motion").mean()))
    assert led == sorted(led, reverse=True), "the most unintended motion first"
    same = text.words.partition("The same in every run, so without a map: ")[2]
    blank = re.findall(r"([^;()]+) \((\S+) (?:faults|runs); ([^)]*)\)(?:; )?", same)
    for name, n, words in blank:
        part = every if name == "all faults" else every[every["block"] == name]
        assert int(n.replace(",", "")) == len(part), name
        shares = [
            f"{title.lower()} in {'all' if hit.any() else 'none'}"
            for title, (_, hit) in measures(e, faulty, part).items()
        ]
        assert words == ", ".join(shares), name
        text.says(f"{name} ({count(len(part))} {unit}; {words})")
    if not drawn and not blank:
        text.says(
            f"No map: each site and effect has fewer than {count(FEWEST_RUNS)} runs, or nothing"
            " that could be an axis varies among them."
        )
    text.is_said()


def one_map(e: Expected, node: Node, text: Text, part: pd.DataFrame, faulty: bool) -> None:
    """One map's shares, and the cells of its tables."""
    n, titles = len(part), [h4.words for h4 in node.all("h4")]
    by_words = {words: int(hit.sum()) for words, hit in measures(e, faulty, part).values()}
    for title, (_, hit) in measures(e, faulty, part).items():
        k = int(hit.sum())
        varies = 0 < k < n
        assert any(heading.startswith(title) for heading in titles) == varies, title
        if varies:
            text.says(f"{title} {percent(k / n)} % ({between(k, n)})")
        else:
            text.says(f"{title}: {'all' if k else 'none'} of {count(n)} ({between(k, n)}).")
    for table in node.all("table", "cells"):
        cells_of(table, n, by_words)
    for summary in node.all("summary"):
        assert summary.words.endswith(" by other inputs")


def cells_of(table: Node, n: int, by_words: dict[str, int]) -> None:
    """A map's cells: each says its counts and interval, and together they are all faults."""
    hits, runs, said = 0, 0, set()
    for box in table.one("tbody").all("td"):
        label = (box.attributes.get("title") or "").replace("\u202f", " ")
        if not label:
            assert box.words == "", "no run fell there"
            continue
        match = re.fullmatch(r"([\d,]+) of ([\d,]+) (\D+) \((.*)\)", label)
        assert match, label
        k, of = (int(text.replace(",", "")) for text in match.groups()[:2])
        Text(match[4], "cell").says(between(k, of))
        assert box.words == (f"{k}/{of}" if of < FEWEST_SHOWN else f"{100 * k / of:.0f}"), label
        hits, runs = hits + k, runs + of
        said.add(match[3])
    (words,) = said
    assert (hits, runs) == (by_words[words], n), f"{words}: cells add up to {hits} of {runs}"


def worst(e: Expected, html: Node) -> None:
    """The worst runs of each outcome, one a fault."""
    found = list(html.all("section", "worst"))
    if not found:
        assert not e.n
        return
    section, f = found[0], e.faults
    text = prose(section, "worst runs")
    moved, loss = f["hazard"] == "unintended motion", f["hazard"] == "loss of motion"
    halted = loss & (f["loss_first_ms"] < 0)
    free = (f["hazard"] == "none") & (f["warned_ms"] >= 0)
    kinds = (
        ("Unintended motion, nobody told", moved & untold(f), "unintended_mm", "mm", 1),
        ("Unintended motion, a check told", moved & ~untold(f), "unintended_mm", "mm", 1),
        ("Loss of motion while live", loss & ~halted, "loss_mm", "mm", 1),
        ("Loss of motion: not live", halted, "halted_ms", "ms", 0),
        ("False report", f["hazard"] == "false report", "false_report_mm", "mm", 1),
        ("Cue without a hazard", free, f"cue{e.plan.verdict_cue}_ms", "ms", 0),
        (
            "Deeper in the tissue than the golden run",
            f["tissue_depth_mm"] > f["golden_tissue_depth_mm"],
            "tissue_depth_mm",
            "mm",
            1,
        ),
    )
    tables = {table.one("caption").words: rows(table) for table in section.all("table")}
    without = []
    for title, mask, column, unit, decimals in kinds:
        part = f[mask & f[column].notna()]
        if not len(part):
            without.append(title.lower())
            assert title not in tables
            continue
        shown = min(len(part), MOST_WORST)
        more = (
            f" the worst {count(shown)} of {count(len(part))} faults" if len(part) > shown else ""
        )
        text.says(f"{title}{more}")
        far = sorted(part[column], reverse=True)[:shown]
        assert len(tables[title]) == shown
        for cells, expected in zip(tables[title], far, strict=True):
            (run,) = re.findall(r"ravenjax trace out (\w+)", cells[0].words)
            row = part[part["run_id"] == run].iloc[0]
            assert row[column] == expected, title
            assert f"{row['group']}, {row['response']}/{row['hazard']}/" in cells[0].words
            cell(cells[1], f"{fixed(expected, decimals)} {unit}", title)
            one_run(cells, row, title != "Deeper in the tissue than the golden run")
    if without:
        text.says(f"No run had: {'; '.join(without)}.")
    text.is_said("No run had")


def one_run(cells: list[Node], row: pd.Series, depth: bool) -> None:
    """What a check did, when the cue came, how deep the tip went."""
    first = row["first_active_ms"]
    if row["response_ms"] < 0:
        cell(cells[2], "none", "check")
    else:
        after = f"{row['response']} after {count(row['response_ms'] - first)} ms"
        cell(cells[2], f"{after} {row['response_cause']}", "check")
        assert row["response"] == CHECKS.get(row["response_cause"], row["response"])
    came = row["warned_ms"] >= max(first, 0)
    cell(cells[3], f"after {count(row['warned_ms'] - first)} ms" if came else "no cue", "cue")
    assert len(cells) == 4 + depth
    if depth:
        cell(cells[4], f"{fixed(row['tissue_depth_mm'], 1)} mm", "depth")


def provenance(e: Expected, html: Node) -> None:
    """How many runs there are, and how long each is."""
    runs = Text(html.one("footer", "provenance").one("dd").words, "provenance")
    of = f"{count(len(e.frame))} of {count(e.manifest.runs)}, each {count(e.end)} ms"
    runs.says(f"{of}, in {many(len(e.manifest.parts), 'checked part')}")
    runs.is_said()

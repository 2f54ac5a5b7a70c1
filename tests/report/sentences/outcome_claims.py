"""Sentences and tables of verdicts and groups, written as they should be."""

from __future__ import annotations

import itertools

import pandas as pd
from claim_words import are, between, brief, false_cues, many, prose, rate
from expected_numbers import Expected, evades, largest_first, untold
from page_text import DASH, Node, Text, cell, count, number, percent, rows

RESPONSES = ("stopped", "flagged", "limited", "silent")
HAZARDS = ("unintended motion", "loss of motion", "false report", "none")


def verdicts(e: Expected, html: Node) -> None:
    """Tiles, matrix, notes, jumps and definitions."""
    section = html.one("section", "verdicts")
    text = prose(section, "verdicts")
    f, n = e.faults, e.n
    definitions(e, text)
    if not n:
        text.says("There is no fault to judge.")
        assert not list(section.all("table"))
        text.is_said()
        return
    text.says(f"{'Each of ' if n > 1 else ''}{many(n, 'distinct fault')} by what the checks did")
    text.says(
        f"whether the {e.threshold} cue came. Each cell: share of all of them, count, 95 % interval"
        " (Wilson) of faults drawn so."
    )
    nobody, cued = untold(f), f["warned_ms"] >= 0
    evading = nobody & (f["hazard"] == "unintended motion")
    tiles = {
        "evaded the checks, the cue came": evading & cued,
        "evaded the checks, no cue": evading & ~cued,
        "nobody told, loss of motion": nobody & (f["hazard"] == "loss of motion"),
        "nobody told, only the report wrong": nobody & (f["hazard"] == "false report"),
        "a check told a person": f["response"] == "flagged",
        "stopped by a check": f["response"] == "stopped",
        "changed at least one bit": f["activated"].astype(bool),
    }
    found = list(section.all(name="tile"))
    assert len(found) == len(tiles)
    for tile, (words, hits) in zip(found, tiles.items(), strict=True):
        k = e.count(hits)
        cell(
            tile,
            f"{percent(k / n)} % {words} {count(k)} of {many(n, 'fault')} {between(k, n)}",
            "tile",
        )
    matrix(section.one("table", "matrix"), f, "verdicts")
    if evading.any():
        text.says("Orange frame: the faults that evaded.")
    phantom = e.count(nobody & (f["hazard"] == "none") & cued)
    if phantom:
        text.says(
            f"In {many(phantom, 'fault')} without a hazard, of which no check told anyone, the cue"
            " came all the same."
        )
    late = e.count((f["response"] == "stopped") & (f["warned_ms"] >= f["response_ms"]))
    if late:
        text.says(
            f"In {count(late)} stopped {'run' if late == 1 else 'runs'} the cue came only with the"
            " stop, or after it."
        )
    every = e.all
    if e.repeats:
        text.says(
            f"Of a fault that was run several times the first valid run counts; {count(e.repeats)}"
            f" further {'run is' if e.repeats == 1 else 'runs are'} in no rate here."
        )
    failed = e.count(every["failed"])
    if failed:
        text.says(
            f"{many(failed, 'run')} ended without a valid outcome and {are(failed)} in no rate;"
            " failures."
        )
    reacting = e.count(~every["plain"])
    if reacting:
        text.says(
            f"{many(reacting, 'run')} in which an operator reacts to the cue {are(reacting)} in no"
            " rate here; reaction."
        )
    if len(e.motions):
        text.says(false_cues(e))
    still = e.count(~f["activated"].astype(bool))
    if still:
        text.says(f"{many(still, 'fault')} never changed a bit.")
    rules = {
        "jump_code": f"reported tip: steps over {number(0.25)} mm on two packets in a row",
        "jump_tip": f"true tip: steps over {number(0.25)} mm in two ticks in a row",
        "jump_text": f"true tip: over {number(1.5)} mm within 2 ms",
    }
    table = rows(list(section.all("table"))[1])
    for cells, (name, words) in zip(table, rules.items(), strict=True):
        jumped = f[f[name].astype(bool)]
        moved, wrong = (
            e.count(jumped["hazard"] == word) for word in ("unintended motion", "false report")
        )
        for node, expected in zip(
            cells, (words, brief(len(jumped), n), count(moved), count(wrong)), strict=True
        ):
            cell(node, expected, name)
    text.is_said(
        "Orange",
        "phantom",
        "after the stop",
        "several times",
        "valid outcome",
        "reacts",
        "never changed",
    )


def matrix(table: Node, f: pd.DataFrame, where: str) -> None:
    """Responses by hazards and cue, of valid runs."""
    n, cued = len(f), f["warned_ms"] >= 0
    for cells, response in zip(rows(table), RESPONSES, strict=True):
        mine = f["response"] == response
        cell(cells[0], response, where)
        kinds = itertools.product(HAZARDS, (cued, ~cued))
        for node, (hazard, cue) in zip(cells[1:-1], kinds, strict=True):
            cell(
                node,
                rate(int((mine & (f["hazard"] == hazard) & cue).sum()), n),
                f"{where} {response} {hazard}",
            )
            bad = response in ("silent", "limited") and hazard == "unintended motion"
            framed = "bad" in (node.attributes.get("class") or "").split()
            assert framed == (bad and (mine & (f["hazard"] == hazard) & cue).any())
        cell(cells[-1], rate(int(mine.sum()), n), f"{where} {response}")


def definitions(e: Expected, text: Text) -> None:
    """The words with the numbers of the campaign."""
    for words in (
        f"its true tip was more than {e.limit} from golden run and nominal model",
        f"its tip was more than {e.limit} from golden run and model",
        f"it was not live for more than {count(200)} ms longer than in the golden run",
        f"the tip that it reported was more than {e.limit} from its true tip",
        f"The {e.threshold} haptic cue came, and the golden run had none by then.",
        f"the hazard is an unintended motion over {e.limit}.",
    ):
        text.says(words)


def groups(e: Expected, html: Node) -> None:
    """Outcomes and verdicts of each group."""
    section = html.one("section", "groups")
    text = prose(section, "groups")
    text.says(
        "Below each share: faults, and, where the group draws its faults, a 95 % interval (Wilson)"
    )
    every = e.all
    parts = []
    for name in every["group"].astype(str).unique():
        part = every[every["group"].astype(str) == name]
        faulty = bool(part["faulty"].any())
        chosen = part["sample"] if faulty else part["plain"] & ~part["failed"]
        parts.append((name, part, faulty, part[chosen]))
    parts.sort(key=lambda one: (not one[2], *largest_first(evades(one[3]))))
    table = rows(section.one("table", "groups"))
    shares = [
        (cells[0].words.removesuffix(" no fault: its own golden run"), cells) for cells in table
    ]
    assert sorted(name for name, _ in shares) == sorted(name for name, *_ in parts)
    by_name = {name: rest for name, *rest in parts}
    order = [(not by_name[name][1], *largest_first(evades(by_name[name][2]))) for name, _ in shares]
    assert order == sorted(order)
    drawn = list(section.all("table", "matrix"))
    for (name, cells), table in zip(shares, drawn, strict=True):
        part, faulty, f = by_name[name]
        n, nobody, cued = len(f), untold(f), f["warned_ms"] >= 0
        none = nobody & (f["hazard"] == "none")
        columns = {
            "stopped": f["response"] == "stopped",
            "flagged": f["response"] == "flagged",
            "felt": nobody & (f["hazard"] == "unintended motion") & cued,
            "unseen": nobody & (f["hazard"] == "unintended motion") & ~cued,
            "lost": nobody & (f["hazard"] == "loss of motion"),
            "misreported": nobody & (f["hazard"] == "false report"),
            "phantom": none & cued,
            "limited": none & ~cued & (f["response"] == "limited"),
        }
        cell(cells[0], name + ("" if faulty else " no fault: its own golden run"), "groups")
        cell(
            cells[1],
            count(n) + (f" {many(len(part), 'run')}" if len(part) != n else ""),
            f"faults of {name}",
        )
        for node, hits in zip(cells[3:-1], columns.values(), strict=True):
            cell(node, brief(int(hits.sum()), n), f"group {name}")
        cell(cells[-1], count(int(part["failed"].sum())), f"failed of {name}")
        columns["quiet"] = none & ~cued & (f["response"] == "silent")
        label = Text(
            (cells[2].one(name="bar").attributes["aria-label"] or "").replace("\u202f", " "), name
        )
        for word, hits in columns.items():
            label.says(f"{word} {percent(hits.sum() / n)} %" if n else f"{word} {DASH}")
        matrix(table, f, f"group {name}")
        cell(
            table.one("caption"),
            f"{name}, {many(n, 'fault' if faulty else 'run')}",
            f"table of {name}",
        )
    if (~every["plain"]).any():
        text.says("the first valid run in which nobody reacts counts.")
    text.is_said("nobody reacts")

"""Sentences and tables of the operator's reaction, written as they should be."""

from __future__ import annotations

import naive_facts
import numpy as np
import pandas as pd
import plain_statistics as plain
from claim_words import ACTIONS, brief, many, points, prose, rate
from expected_numbers import Expected, in_pairs, mean_far
from page_text import ANY_SPAN, DASH, Node, cell, count, number, percent, rows, signed

from ravenjax.report.data import pair_intervals as intervals
from ravenjax.stats.bootstrap import units
from ravenjax.stats.comparison import clustered


def reaction(e: Expected, html: Node) -> None:
    """Pairs of runs with and without it, and interruptions of fault-free motion."""
    if not e.plan.actions:
        assert not list(html.all("section", "reaction"))
        return
    section = html.one("section", "reaction")
    text = prose(section, "reaction")
    lines = []
    for action, both in e.pairs.items():
        parts = [("all faults", both)]
        layers = both["layer"].drop_duplicates().tolist()
        parts += [(layer, both[both["layer"] == layer]) for layer in layers if len(layers) > 1]
        if e.plan.crossed_robot:
            values = both.groupby("pair")["param:plant.friction_scale"].nunique()
            shown = (
                sorted(both["param:plant.friction_scale"].unique()) if (values > 1).any() else []
            )
            parts += [
                (
                    f"plant.friction_scale = {number(v)}",
                    both[both["param:plant.friction_scale"] == v],
                )
                for v in shown
            ]
        lines += [(action, among, part) for among, part in parts]
        without, with_ = in_pairs(both)
        text.says(
            f"{ACTIONS[action].capitalize()}: an unintended motion in {count(with_.sum())} of "
            f"{many(len(both), 'pair')} instead of {count(without.sum())}, "
            f"{points(change(both))}."
        )
    if lines:
        text.says(f"Unintended motion: over {e.limit}, see definitions.")
        text.says("95 % intervals and p over faults that were drawn, all pairs of a fault together")
        if not e.leads(e.plan.verdict_cue):
            text.says(
                f"The {e.threshold} cue is no warning of it, as both are distances from the nominal"
                " model"
            )
        table = rows(section.one("table", "wide"))
        last = None
        for cells, (action, among, part) in zip(table, lines, strict=True):
            pair_row(e, cells, (ACTIONS[action] + " " if action != last else "") + among, part)
            last = action
    else:
        text.says(
            "there is nothing to compare. Cross the reaction to get pairs: [cross] with"
            " reaction.action = [0, 1]."
        )
    acting = sorted(set(e.all["action"]) - {0})
    if acting:
        table = rows(list(section.all("table"))[-1])
        for cells, action in zip(table, acting, strict=True):
            interruptions(e, cells, action)
    text.is_said("nothing to compare", "instead of")


def pair_row(e: Expected, cells: list[Node], title: str, part: pd.DataFrame) -> None:
    """One kind of pairs."""
    n = len(part)
    without, with_ = in_pairs(part)
    value, low, high = change(part)
    acted = part["reaction_ms"] >= 0
    depth = float((part["tissue_depth_mm"] - part["tissue_depth_mm_alone"]).mean())
    few = part["distinct"].nunique() < (2 if one_each(part) else units.FEWEST)
    spans = "" if few else f" {ANY_SPAN}"
    expected = [
        title,
        count(n),
        share_of(without, part),
        share_of(with_, part),
        f"{signed(value)} points" + ("" if np.isnan(low) else f" {signed(low)} to {signed(high)}"),
        f"{count((without & ~with_).sum())}, {count((with_ & ~without).sum())}",
        number(p_value(part), 2),
        f"{number(round(mean_far(part), 2))} mm{spans}",
        f"{number(round(depth, 2))} mm{spans}",
        share_of(acted.to_numpy(), part),
        share_of(~without[acted.to_numpy()], part[acted.to_numpy()]) if acted.any() else DASH,
    ]
    for place, (node, words) in enumerate(zip(cells, expected, strict=True)):
        cell(node, words, f"reaction, {title}, column {place}")


def one_each(part: pd.DataFrame) -> bool:
    """Whether each pair is of another fault; where not, the library resamples faults, which has
    tests of its own.
    """
    return bool(part["distinct"].is_unique)


def change(part: pd.DataFrame) -> plain.Known:
    """Difference of the rates of unintended motions with its interval."""
    without, with_ = in_pairs(part)
    if one_each(part):
        return plain.pair_difference(with_, without)
    found = intervals.rate_difference(with_, without, units.units(part["distinct"]))
    return found.value, found.low, found.high


def share_of(hit: np.ndarray, part: pd.DataFrame) -> str:
    """A cell with a share of pairs."""
    if one_each(part):
        return brief(int(hit.sum()), len(hit))
    found = units.rate(hit, units.units(part["distinct"]))
    bounds = (
        f"· {percent(found.low)}{DASH}{percent(found.high)} %"
        if found.low == found.low
        else f"of {count(len(hit))}"
    )
    return f"{percent(found.value)} % {count(found.k)} {bounds}"


def p_value(part: pd.DataFrame) -> float:
    """That both sides are alike."""
    without, with_ = in_pairs(part)
    if one_each(part):
        return plain.mcnemar(with_, without)
    return clustered.exchange_p(with_, without, units.units(part["distinct"]).unit)


def interruptions(e: Expected, cells: list[Node], action: int) -> None:
    """What one reaction does to fault-free motion."""
    mine = e.all["action"] == action
    free = naive_facts.motions(e.frame, mine)
    k, hours = e.count(free["golden_reaction_ms"] >= 0), free["golden_pedal_down_ms"].sum() / 3.6e6
    value, low, high = plain.poisson(k, hours)
    crossed = ["param:plant.friction_scale"] if e.plan.crossed_robot else []
    valid = e.all[~e.all["faulty"] & ~e.all["failed"]]
    both = valid[valid["action"] == action].merge(
        valid[valid["action"] == 0], on=["pair", *crossed], suffixes=("", "_alone")
    )
    both = both.drop_duplicates(["distinct", *crossed])
    acted = both[both["reaction_ms"] >= 0]
    lost = (acted["pedal_down_ms_alone"] - acted["pedal_down_ms"]).mean()
    expected = [
        ACTIONS[action],
        rate(k, len(free)),
        f"{number(value)} {number(low)}{DASH}{number(high)}",
        f"{number(lost)}{' ms' if len(acted) else ''}",
    ]
    for node, words in zip(cells, expected, strict=True):
        cell(node, words, f"interruptions, {ACTIONS[action]}")

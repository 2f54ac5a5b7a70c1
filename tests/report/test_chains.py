"""Explained runs in the report, against plain Python."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic
from rendered_page import Page, rendered, words

from ravenjax import robots
from ravenjax.errors import StoreError
from ravenjax.report.data.runs import Runs
from ravenjax.report.run import chain
from ravenjax.report.sections import chains
from ravenjax.stats import units
from ravenjax.stats.intervals import wilson_interval
from ravenjax.store.access import explained
from ravenjax.vocabulary.seams import list_crossings

RUNS = 900
ROBOT = robots.find_robot("raven2")
MANIFEST = synthetic.manifest(RUNS)
FRAME = synthetic.frame(RUNS)
PLACES = list_crossings(ROBOT.seams, ("gold",))
GROUPS = [{"name": name, "fault": [{"value": {"uniform": [0, 1]}}]} for name in synthetic.BLOCKS]
DRAWN = MANIFEST.model_copy(update={"config": {**MANIFEST.config, "group": GROUPS}})


def ticks_of(frame, seed=1):
    """Made-up explanations of all runs with a fault: numbers differ from the fault on, some
    leave their range.
    """
    random = np.random.default_rng(seed)
    mine = frame[frame["fault0_site"] != ""]
    start, n = mine["fault0_start_ms"].to_numpy(), len(mine)
    columns = {
        "run_id": mine["run_id"],
        "index": mine["index"],
        "harm_ms": mine["unintended_first_ms"],
    }
    for number, place in enumerate(PLACES):
        differs = np.where(random.random(n) < 0.6, start + random.integers(0, 90, n), -1)
        columns[f"differs:{place.name}"] = differs
        if place.channel.site:
            leaves = (differs >= 0) & (random.random(n) < (0.02 if number % 3 else 0.05))
            later = differs + random.integers(0, 90, n)
            columns[f"leaves:{place.name}"] = np.where(leaves, later, -1)
    for check in synthetic.CHECKS:
        columns |= {f"near:{check}": np.full(n, 1.5), f"golden_near:{check}": np.full(n, 2.0)}
        columns[f"near_ms:{check}"] = start + 3
    return pd.DataFrame(columns).reset_index(drop=True)


TICKS = ticks_of(FRAME)


def evading(frame) -> Any:
    mine = frame[(frame["fault0_site"] != "") & (frame["failed"] == "")]
    return mine[
        mine["response"].isin(["silent", "limited"]) & (mine["hazard"] == "unintended motion")
    ]


def first_of(row, beginning, seam):
    """The earliest tick of a seam's numbers; -1: never."""
    names = [f"{beginning}{place.name}" for place in PLACES if place.seam.name == seam]
    came = [row[name] for name in names if name in row and row[name] >= 0]
    return min(came, default=-1)


def naive(frame, ticks):
    """Seam -> (carries, leads, first), by loops over runs and seams."""
    by_id = ticks.set_index("run_id").to_dict("index")
    seams = list(dict.fromkeys(place.seam.name for place in PLACES))
    out = {seam: [0, [], 0] for seam in seams}
    hidden, best = 0, []
    for run in evading(frame).to_dict("records"):
        row, harm = by_id[run["run_id"]], run["unintended_first_ms"]
        shows = []
        for place, seam in enumerate(seams):
            differs, leaves = (
                first_of(row, beginning, seam) for beginning in ("differs:", "leaves:")
            )
            if 0 <= differs <= harm:
                out[seam][0] += 1
            if 0 <= leaves < harm:
                out[seam][1].append(harm - leaves)
                shows.append((leaves, place))
        if shows:
            out[seams[min(shows)[1]]][2] += 1
            best.append(harm - min(shows)[0])
        hidden += not shows
    return out, hidden, best


def propagation(frame, manifest, ticks):
    return chains.summarize_chains(Runs.of(frame, manifest), ticks)


def test_shares_and_leads_by_loops():
    one = propagation(FRAME, DRAWN, TICKS)
    seams, hidden, best = naive(FRAME, TICKS)
    n = len(evading(FRAME))
    assert one.runs == one.evading == n and n > 100 and one.counted == "faults" and not one.partial
    assert [row.seam for row in one.carriers] == [name for name, (k, _, _) in seams.items() if k]
    for row in one.carriers:
        k, leads, first = seams[row.seam]
        assert (row.carries, row.shows, row.first) == tuple(
            wilson_interval(count, n) for count in (k, len(leads), first)
        )
        if leads:
            assert row.lead_ms.value == np.quantile(leads, 0.5, method="inverted_cdf")
            few = len(leads) < units.MIN_UNITS
            assert few or row.lead_ms.low <= row.lead_ms.value <= row.lead_ms.high
    assert one.hidden == wilson_interval(hidden, n)
    assert one.lead_ms.value == np.quantile(best, 0.5, method="inverted_cdf")
    assert 0 < hidden < n and sum(row.first.k for row in one.carriers) == n - hidden


def test_shares_are_of_groups_that_are_explained_whole():
    lost = evading(FRAME)[evading(FRAME)["group"] == "encoder"]["run_id"].iloc[0]
    one = propagation(FRAME, DRAWN, TICKS[TICKS["run_id"] != lost])
    rest = evading(FRAME)[evading(FRAME)["group"] != "encoder"]
    assert (one.partial, one.runs, one.evading) == (["encoder"], len(rest), len(evading(FRAME)))
    assert "not completely explained: encoder" in " ".join(chains.chain_sentences(one))


@pytest.mark.slow
def test_a_damaged_file_is_told_of(monkeypatch, tmp_path):
    def broken(*_):
        raise StoreError("explained.parquet: damaged")

    monkeypatch.setattr(explained, "read_explained", broken)
    assert "The file with the explained runs is not readable: explained.parquet: damaged" in words(
        Page(rendered(FRAME, DRAWN))
    )


def chain_of(run, **changes):
    """The chain of a row of FRAME."""
    ticks = TICKS[TICKS["run_id"] == run["run_id"]].iloc[0].to_dict()
    return chain.trace_chain({**run, **changes}, {**ticks, **changes}, ROBOT, ("gold",), 0)


def test_a_chain_has_the_earliest_number_of_each_signal():
    run = evading(FRAME).iloc[3].to_dict()
    one, row = chain_of(run), TICKS.set_index("run_id").loc[run["run_id"]]
    assert len(one.links) > 10 and one.harm_ms == run["unintended_first_ms"]
    for link in one.links:
        seam = link.signal.rpartition("/")[2]
        assert link.differs_ms == first_of(row, "differs:", seam)
        assert link.leaves_ms == first_of(row, "leaves:", seam)
        assert row[f"differs:{link.signal}/{link.differs_in}"] == link.differs_ms
        if link.leaves_ms >= 0:
            assert link.left_ms == one.harm_ms - link.leaves_ms
    came = [link.leaves_ms for link in one.links if link.leaves_ms >= 0]
    assert (one.first.leaves_ms if one.first else None) == min(came, default=None)
    assert [check.margin for check in one.checks] == [1.5] * len(synthetic.CHECKS)

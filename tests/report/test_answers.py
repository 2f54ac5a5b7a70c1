"""The first page's numbers against plain counts."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report import answers, detectors
from ravenjax.report.runs import Runs
from ravenjax.stats.intervals import wilson

MANIFEST = synthetic.manifest(1200)
FRAME = synthetic.frame(1200)
RUNS = Runs.of(FRAME, MANIFEST)
ALARMS = detectors.alarms(RUNS, MANIFEST)
SAID = detectors.known(ALARMS)
KNOWN = RUNS.table.frame(f"SELECT {SAID} AS ms FROM facts ORDER BY row")["ms"].to_numpy()
VALID = (FRAME["failed"] == "") & FRAME["activated"]
HARM_MS = np.array(
    [
        min([t for t in times if t >= 0], default=-1)
        for times in zip(FRAME["moved_first_ms"], FRAME["jump_code_first_ms"], strict=True)
    ]
)
HARMFUL = VALID.to_numpy() & (HARM_MS >= 0)


def naive_known(index):
    """First of check, cue and quiet detector levels that is not before the first effect."""
    row = FRAME.loc[index]
    quiet = [(0, 0), (1, 0)]  # twins score 0.4: below the first level of both detectors, 0.5 and 3
    times = [row["response_ms"], row["cue0_first_ms"], *(row[f"detector{d}_level{k}_first_ms"] for d, k in quiet)]
    return min([t for t in times if t >= max(0, row["first_active_ms"])], default=-1)


def test_first_possible_knowledge():
    chosen = FRAME.index[HARMFUL][:200]
    assert [KNOWN[FRAME.index.get_loc(index)] for index in chosen] == [naive_known(index) for index in chosen]


def test_time_to_know_is_of_harmful_faults_and_censored():
    found = answers.knowledge(RUNS, SAID, MANIFEST)
    known, harm = KNOWN[HARMFUL], HARM_MS[HARMFUL]
    assert found.delay.n == HARMFUL.sum() and found.never == wilson(int((known < 0).sum()), len(known))
    assert found.lead.before == wilson(int(((known >= 0) & (known < harm)).sum()), len(known))
    assert found.by_detectors
    delays = np.sort(known[known >= 0] - FRAME.loc[HARMFUL, "first_active_ms"].to_numpy()[known >= 0])
    if (known >= 0).all():  # without censoring the median is that of the sample
        assert found.half_ms.value == delays[int(np.ceil(len(delays) / 2)) - 1]
    assert found.half_ms.low <= found.half_ms.value <= found.half_ms.high


def test_nobody_can_know_what_nothing_tells():
    found = answers.knowledge(RUNS, "-1", MANIFEST)
    assert found.never.value == 1 and np.isnan(found.half_ms.value) and found.lead.before.k == 0


@pytest.mark.parametrize(("kind", "column"), [("group", "group"), ("site", "fault0_site")])
def test_classes_against_a_plain_count(kind, column):
    rows = {row.name: row for row in answers.classes(RUNS, SAID, MANIFEST)[kind]}
    faulty = FRAME["fault0_site"] != ""
    assert set(rows) == set(FRAME.loc[faulty, column].astype(str))
    for name, row in rows.items():
        mine = (faulty & (FRAME[column].astype(str) == name)).to_numpy()
        evading = FRAME["verdict"].astype(str).str.startswith("silent/haptic") & mine
        assert row.evaded == wilson(int(evading.sum()), int(mine.sum()))
        harm = mine & (HARM_MS >= 0) & (FRAME["failed"] == "").to_numpy()
        assert row.harm == wilson(int(harm.sum()), int(mine.sum()))
        told = mine & HARMFUL
        before = told & (KNOWN >= 0) & (KNOWN < HARM_MS)
        assert (row.before.k, row.before.n) == (int(before.sum()), int(told.sum()))


def test_most_evasive_classes_come_first():
    for rows in answers.classes(RUNS, SAID, MANIFEST).values():
        shares = [row.evaded.value for row in rows]
        assert shares == sorted(shares, reverse=True)


def test_what_the_cue_announces_of_the_evading():
    found = answers.changed(RUNS, MANIFEST, [])
    evading = FRAME["verdict"].astype(str).str.startswith("silent/haptic") & (FRAME["moved_first_ms"] >= 0) & VALID
    early = evading & (FRAME["cue0_first_ms"] < FRAME["moved_first_ms"])
    assert found.pairs == [] and found.announced is not None
    assert found.announced.lead.before == wilson(int(early.sum()), int(evading.sum()))
    assert found.better is not None and found.better.false.k == 0
    assert found.better.lead.before.k > found.announced.lead.before.k


def test_a_cue_that_disturbs_is_no_better_one():
    frame = FRAME.assign(**{f"twin_cue{k}_first_ms": 2999 for k in range(1, len(MANIFEST.cues))})
    assert answers.changed(Runs.of(frame, MANIFEST), MANIFEST, []).better is None

"""Responses, hazards and verdicts against their definitions written out run by run."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import synthetic_results as synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax import robots
from ravenjax.outcomes import events, verdict
from ravenjax.outcomes.events import Rules
from ravenjax.robots.raven2.declaration import CHECKS

STRENGTH = {"stop": 3, "flag": 2, "limit": 1}
WORDS = {3: "stopped", 2: "flagged", 1: "limited", 0: "silent"}
NAMES = ("overdrive_instant", "overdrive_clip", "packet_skip", "ik_reject", "estop", "a_new_one")

times = st.integers(-1, 400)
trip = st.tuples(st.integers(0, 400), st.integers(0, 3), st.integers(0, 400), st.integers(0, 3))
"""First trip, how often, and the same of the golden run."""
runs = st.lists(
    st.fixed_dictionaries({"onset": st.integers(0, 300), **dict.fromkeys(NAMES, trip)}), min_size=1
)


def columns(rows):
    """(outcomes, golden) as an engine returns them."""
    outcomes = {"first_active_ms": np.array([row["onset"] for row in rows])}
    golden = {}
    for name in NAMES:
        trips = np.array([row[name] for row in rows]).T
        for table, (first, count) in ((outcomes, trips[:2]), (golden, trips[2:])):
            table[f"check_{name}_count"] = count
            table[f"check_{name}_first_ms"] = np.where(count > 0, first, -1)
    return outcomes, golden


def told(row):
    """(strength, cause, time, time of the first flag or stop) of one run."""
    events = []
    for name in NAMES:
        first, own, usual_first, usual = row[name]
        sooner = own > 0 and (usual == 0 or first < usual_first)
        if own > usual or sooner:
            known = CHECKS.get(name)
            ms = first if sooner else max(first, row["onset"])
            cause = known.cause or name if known else name
            events.append((STRENGTH[known.action if known else "flag"], ms, cause))
    if not events:
        return 0, "", -1, -1
    strongest = max(strength for strength, _, _ in events)
    ms, cause = min(
        ((ms, cause) for strength, ms, cause in events if strength == strongest),
        key=lambda one: one[0],
    )
    return strongest, cause, ms, min((ms for strength, ms, _ in events if strength > 1), default=-1)


@pytest.mark.slow
@settings(max_examples=200)
@given(runs)
def test_a_response_is_the_strongest_that_the_golden_run_has_not(rows):
    found = verdict.classify_responses(*columns(rows), robots.USUAL)
    for i, row in enumerate(rows):
        strength, cause, ms, told_ms = told(row)
        assert verdict.RESPONSES[found.response[i]] == WORDS[strength]
        assert (found.causes[found.cause[i]], found.ms[i], found.told_ms[i]) == (cause, ms, told_ms)


def test_a_clip_and_a_dropped_packet_tell_nobody():
    limits = {name for name, check in CHECKS.items() if check.action == "limit"}
    assert limits == {"overdrive_clip", *(name for name in CHECKS if name.startswith("packet_"))}
    outcomes = {"first_active_ms": np.array([5]), "check_overdrive_clip_count": np.array([9])}
    outcomes["check_overdrive_clip_first_ms"] = np.array([7])
    golden = {
        "check_overdrive_clip_count": np.array([0]),
        "check_overdrive_clip_first_ms": np.array([-1]),
    }
    found = verdict.classify_responses(outcomes, golden, robots.USUAL)
    assert verdict.RESPONSES[found.response[0]] == "limited" and (
        found.ms[0],
        found.told_ms[0],
    ) == (7, -1)


@given(
    st.lists(
        st.tuples(times, times, times, st.integers(0, 900), st.integers(0, 900), st.booleans()),
        min_size=1,
        max_size=40,
    )
)
def test_the_gravest_hazard_counts(rows):
    unintended, loss, report, halted, golden, stopped = (
        np.array(values) for values in zip(*rows, strict=True)
    )
    frame = {
        "unintended_first_ms": unintended,
        "loss_first_ms": loss,
        "false_report_first_ms": report,
        "halted_ms": halted,
        "golden_halted_ms": golden,
    }
    found = verdict.classify_hazards(frame, stopped)
    for i, (u, l, r, h, g, s) in enumerate(rows):
        lost = l >= 0 or (h > g + 200 and not s)
        expected = (
            "unintended motion"
            if u >= 0
            else "loss of motion"
            if lost
            else "false report"
            if r >= 0
            else "none"
        )
        assert verdict.HAZARDS[found[i]] == expected


def test_what_the_golden_run_has_by_then_does_not_count():
    own, golden = np.array([5, 5, 5, -1, 0, 5]), np.array([-1, 4, 6, 3, 0, 5])
    assert verdict.beyond_golden(own, golden).tolist() == [5, -1, 5, -1, -1, -1]
    frame = pd.DataFrame({"cue2_first_ms": own, "golden_cue2_first_ms": golden, "failed": ""})
    _, cue = events.events_happened(pa.Table.from_pandas(frame), ["cue"], Rules(cue=2))
    assert cue.tolist() == [True, False, True, False, False, False]


EVENTS = {
    "evades": lambda f: (
        f["response"].isin(["silent", "limited"]) & (f["hazard"] == "unintended motion")
    ),
    "evades_built_in": lambda f: (
        f["response"].isin(["silent", "limited"]) & (f["hazard"] == "unintended motion")
    ),
    "unintended_motion": lambda f: f["hazard"] == "unintended motion",
    "loss_of_motion": lambda f: f["hazard"] == "loss of motion",
    "false_report": lambda f: f["hazard"] == "false report",
    "hazard": lambda f: f["hazard"] != "none",
    "stopped": lambda f: f["response"] == "stopped",
    "flagged": lambda f: f["response"] == "flagged",
    "limited": lambda f: f["response"] == "limited",
    "silent": lambda f: f["response"] == "silent",
    "told": lambda f: (f["response"] == "stopped") | (f["response"] == "flagged"),
    "cue": lambda f: f["verdict"].str.endswith("/cue"),
    "jump": lambda f: f["jump_text"],
    "cable_overload": lambda f: (
        (f["cable_overload_first_ms"] >= 0) & (f["golden_cable_overload_first_ms"] < 0)
    ),
    "restart": lambda f: f["restart_ms"] >= 0,
    "diverged": lambda f: f["diverged"],
}


@pytest.mark.parametrize("event", events.EVENTS)
def test_events_over_a_table(event):
    rules = Rules(cue=2, threshold_mm=2.0, jump="jump_text", limit_mm=3.0)
    frame = synthetic.judged(synthetic.frame(3000), cue=2)
    place = np.arange(len(frame))
    frame["cable_overload_first_ms"] = np.where(place % 2 == 0, 5, -1)
    frame["golden_cable_overload_first_ms"] = np.where(place % 3 == 0, 4, -1)
    names = events.event_columns([event], rules)
    valid, cases = events.events_happened(pa.Table.from_pandas(frame[names]), [event], rules)
    assert valid.tolist() == (frame["failed"] == "").tolist()
    expected = EVENTS[event](frame)
    assert cases[valid].tolist() == expected[valid].tolist()
    assert 0 < expected[valid].sum() < valid.sum(), "the example tells them apart"

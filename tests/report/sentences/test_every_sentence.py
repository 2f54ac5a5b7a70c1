"""Every number of every sentence of the report, recomputed from the raw table of campaigns that
nobody simulated.

Each section has a function that writes its sentences as they should be (`*_claims`), with numbers
from plain pandas on the raw columns and the estimates of `plain_statistics`, and takes them out of
the page. What is left over must hold no digit.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable

import alarm_claims
import check_claims
import first_page_claims
import generated_campaigns
import naive_facts
import numpy as np
import outcome_claims
import place_claims
import pytest
import reaction_claims
from campaign_page import rendered
from claim_words import many
from expected_numbers import Expected
from generated_campaigns import Plan
from hypothesis import HealthCheck, example, given, settings
from page_text import Node, Text, count, percent

from ravenjax.cli import terminal
from ravenjax.report import page
from ravenjax.report.sections import answers, dependence
from ravenjax.store import schema
from ravenjax.store.access.results import Results


@functools.cache
def environment():
    return made_environment()


made_environment = page._environment


@pytest.fixture(scope="module", autouse=True)
def cheap():
    """Templates are compiled once; what is drawn, and what depends on the robot, is tested
    elsewhere.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "_environment", environment)
        patch.setattr(dependence, "conclusions", lambda runs, robots: [])
        patch.setattr(answers, "MOST_CLASSES", first_page_claims.MOST_CLASSES)
        yield


SECTIONS: tuple[Callable[[Expected, Node], None], ...] = (
    first_page_claims.first_page,
    outcome_claims.verdicts,
    outcome_claims.groups,
    place_claims.maps,
    alarm_claims.time,
    alarm_claims.detectors,
    alarm_claims.cues,
    alarm_claims.after_stop,
    place_claims.worst,
    reaction_claims.reaction,
    check_claims.checks,
    check_claims.failures,
    check_claims.precision,
    place_claims.provenance,
)


@pytest.mark.slow
@settings(max_examples=4, suppress_health_check=[HealthCheck.too_slow])
@given(generated_campaigns.plans())
@example(Plan(0, faults=0, free=3))
@example(Plan(1, faults=1, free=0, fate="all evade"))
@example(Plan(2, faults=30, fate="all told", detectors=2, limit_mm=2.0))
@example(Plan(3, faults=12, fate="all failed", actions=(0, 1)))
@example(Plan(4, faults=12, fate="nothing happens", stray=1.0))
@example(
    Plan(
        5,
        faults=60,
        groups=5,
        motions=5,
        repeats=9,
        arms=("gold", "green"),
        limit_mm=4.25,
        thresholds=(2.0, 0.7, 3.0),
        detectors=2,
    )
)
@example(
    Plan(
        6,
        faults=40,
        free=4,
        actions=(0, 1, 3),
        crossed_robot=True,
        repeats=6,
        motions=4,
        stray=1.0,
        usual="slow",
    )
)
@example(Plan(7, faults=20, actions=(2,), usual="slow", limit_mm=0.5))
@example(Plan(8, faults=40, fate="all evade", thresholds=(4.5, 0.7, 2.345), motions=4, stray=1.0))
@example(Plan(9, faults=30, motions=3, stray=0.0, thresholds=(4.5, 1.0)))
def test_every_number_of_the_page_is_that_of_the_raw_table(plan):
    compare(plan)


@pytest.mark.slow
@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(generated_campaigns.plans())
def test_every_number_of_many_more_pages(plan):
    compare(plan)


def compare(plan):
    campaign = generated_campaigns.made(plan)
    expected, html = Expected(campaign), rendered(campaign)
    for section in SECTIONS:
        section(expected, html)


def test_no_sentence_knows_another_limit_or_threshold_than_the_campaigns():
    plan = Plan(
        11,
        faults=40,
        limit_mm=4.25,
        thresholds=(5.5, 6.5),
        verdict_cue=1,
        detectors=2,
        actions=(0, 1),
    )
    body = rendered(generated_campaigns.made(plan)).one("body").without("table", "pre")
    found = set(re.findall(r"(\S+) mm\b(?! on average)", body.words))
    assert found == {"4.25", "6.5"}


def test_a_number_that_is_another_is_told_with_what_was_expected():
    text = Text("Of 5 distinct faults, 2 (40.0 %) evade. 7 runs failed.", "page")
    with pytest.raises(
        AssertionError, match=r"says: 2 \(40.0 %\)\nexpected: \[n2\] \(\[p50.0\] %\)"
    ):
        text.says(f"{count(2)} ({percent(0.5)} %)")
    with pytest.raises(AssertionError, match="does not say: no such sentence"):
        text.says("no such sentence")
    text.says(f"Of {many(5, 'distinct fault')}, {count(2)} ({percent(0.4)} %) evade.")
    with pytest.raises(AssertionError, match=r"a number that nobody expected: +7 runs failed"):
        text.is_said()


@settings(max_examples=8)
@given(generated_campaigns.plans())
def test_the_terminal_counts_runs_with_a_fault(plan):
    campaign = generated_campaigns.made(plan)
    table = schema.conform(campaign.frame, campaign.manifest.shape)
    counted = Results(campaign.manifest.shape, None, [table]).verdicts()
    told = terminal.outcome_rows(counted)
    facts = naive_facts.derive(campaign.frame, plan.verdict_cue)
    mine = facts[facts["faulty"] & ~facts["failed"]]
    words = mine["response"] + "/" + mine["hazard"] + "/" + np.where(mine["cued"], "cue", "no cue")
    sizes = words.value_counts()
    assert {verdict: int(runs) for verdict, runs, _ in told} == sizes.to_dict()
    assert [share for *_, share in told] == [
        f"{100 * int(runs) / len(mine):.1f} %" for _, runs, _ in told
    ]
    evading = mine[
        mine["response"].isin(["silent", "limited"]) & (mine["hazard"] == "unintended motion")
    ]
    if len(mine):
        sentence = terminal.evading(counted, campaign.manifest.limit_mm)
        assert sentence.startswith(f"{len(evading) or 'None'} of {len(mine)} runs")
        assert not len(evading) or sentence.endswith(
            f"The cue comes in {evading['cued'].sum()} of these."
        )

"""Sentences that were once false, empty or ungrammatical in an unusual campaign: each in that
campaign.
"""

from __future__ import annotations

import re

import generated_campaigns
import pytest
from campaign_page import rendered
from generated_campaigns import Plan

from ravenjax.report import wording
from ravenjax.report.comparison import ComparedPairs, FolderComparison
from ravenjax.report.sections import dependence


@pytest.fixture(autouse=True)
def cheap(monkeypatch):
    monkeypatch.setattr(dependence, "conclusions", lambda runs, robots: [])


def words(plan: Plan, element: str = "section", name: str = "cues") -> str:
    html = rendered(generated_campaigns.made(plan))
    return (html.one(element, name) if element == "section" else html.one(element)).words


@pytest.mark.parametrize("thresholds", [(3.0,), (3.0, 1.0)])
def test_one_cue_is_compared_with_no_lower_one(thresholds):
    """And of several it is not said that the lower misses less: what the golden run has, too,
    counts as missed.
    """
    text = words(Plan(12, faults=20, thresholds=thresholds))
    assert ("A lower threshold is reached earlier" in text) == (len(thresholds) > 1)
    assert ("a low threshold may miss more" in text) == (len(thresholds) > 1)
    assert "misses less" not in text


@pytest.mark.parametrize("limit", [0.7, 3.0, 4.5])
def test_a_motion_is_not_known_before_it_by_a_cue_at_its_own_distance(limit):
    text = words(
        Plan(8, faults=40, fate="all evade", thresholds=(3.0, 1.0, 2.0), limit_mm=limit), "header"
    )
    leads = limit > 3.0
    assert leads == bool(
        re.search(rf"\) could be known before the motion reached {limit:g} mm", text)
    )
    assert leads != (
        f"could be known from a check before the motion reached {limit:g} mm; the 3 mm cue" in text
    )
    assert ("With a 2 mm cue, which came in " in text) == (limit == 3.0)
    assert leads != ("known before the motion, without the cue" in text)
    assert not re.search(r"[a-z]\.\d", text.replace("e.g.", "")), "a space follows a sentence"


def test_sites_with_the_same_share_are_all_named():
    """The site of the largest share is not the one where most faults evade."""
    text = words(Plan(8, faults=40, fate="all evade"), "header")
    assert (
        "The largest share evades at" in text and " at each." in text and "ost evade at" not in text
    )


@pytest.mark.parametrize(
    ("faults", "said"), [(1, "It never changed a bit."), (5, "None of them ever changed a bit.")]
)
def test_faults_that_did_nothing_are_not_merely_said_not_to_evade(faults, said):
    campaign = generated_campaigns.made(Plan(0, faults=faults, fate="nothing happens"))
    quiet = campaign.frame.assign(activated=False, first_active_ms=-1)
    assert said in rendered(campaign._replace(frame=quiet)).one("header").words
    campaign = campaign._replace(frame=quiet.assign(activated=True, first_active_ms=500))
    assert "changed a bit" not in rendered(campaign).one("header").words


def test_a_zero_has_no_sign():
    assert wording.hundredths(-0.004) == wording.number(-0.0) == "0"


def test_few_pairs_are_told_of_in_the_singular(tmp_path):
    pairs = ComparedPairs(1, 0, (1, 0), 1, 1, True)
    found = FolderComparison(
        (tmp_path, tmp_path), ("a", "b"), (3.0, 3.0), (), (), pairs, (), {}, ()
    )
    assert found.sentences() == [
        (
            "Paired by run id: 1 run, by fault: 0. Compared: 1 pair with a fault and two valid"
            " outcomes."
        ),
        "Of 1 fault; intervals, 95 %, are over these faults, all pairs of a fault together.",
        f"Without a counterpart: 1 run of {tmp_path}, 0 of {tmp_path}.",
    ]

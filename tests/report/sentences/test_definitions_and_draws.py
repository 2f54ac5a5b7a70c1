"""What the page must not say: what is true by definition, and intervals of faults that nobody
drew.
"""

from __future__ import annotations

import re

import generated_campaigns
import pytest
from campaign_page import rendered
from generated_campaigns import Campaign, Plan

from ravenjax.report.sections import dependence

PERCENT_SPAN = re.compile(r"\d–\d[\d.]*\W?%")
"""An interval of a share, as 4.1–6.3 %."""


def enumerated(plan: Plan) -> Campaign:
    """The same runs, of a campaign whose groups are grids."""
    campaign = generated_campaigns.made(plan)
    names = campaign.frame["group"].unique()
    config = {
        **campaign.manifest.config,
        "group": [{"name": name, "design": "grid"} for name in names],
    }
    return campaign._replace(manifest=campaign.manifest.model_copy(update={"config": config}))


def header(plan: Plan) -> str:
    return rendered(generated_campaigns.made(plan)).one("header").words


@pytest.mark.parametrize(("threshold", "limit"), [(3.0, 3.0), (4.5, 3.0), (3.0, 2.0)])
def test_a_cue_at_the_limit_or_beyond_is_not_said_to_be_late(threshold, limit):
    text = header(Plan(8, faults=40, fate="all evade", thresholds=(threshold,), limit_mm=limit))
    assert f"A cue at {threshold:g} mm is no warning of a motion of {limit:g} mm" in text
    assert f"No cue below {limit:g} mm was evaluated." in text
    assert f"cue comes before the motion reaches {limit:g} mm" not in text


@pytest.mark.parametrize(("lower", "limit"), [(1.0, 3.0), (2.345, 4.25)])
def test_a_lower_cue_is_a_finding(lower, limit):
    text = header(
        Plan(8, faults=40, fate="all evade", thresholds=(4.5, lower), limit_mm=limit, stray=0.0)
    )
    assert re.search(
        rf"A {lower:g} mm cue, .* comes before the motion reaches {limit:g} mm in \d+ of 40 ", text
    )
    first = header(
        Plan(8, faults=40, fate="all evade", thresholds=(lower, 4.5), limit_mm=limit, stray=0.0)
    )
    assert f"The {lower:g} mm cue comes before the motion reaches {limit:g} mm in" in first
    assert "no warning" not in first and "a 4.5 mm cue, which never came" not in first


def test_where_each_lower_cue_cries_wolf_that_is_said():
    text = header(
        Plan(3, faults=40, fate="all evade", thresholds=(3.0, 1.0, 0.7), motions=12, stray=1.0)
    )
    assert "Every cue below 3 mm came in fault-free motion, too." in text


@pytest.mark.parametrize(
    "plan", [Plan(5, faults=60, detectors=2, thresholds=(3.0, 1.0)), Plan(6, 40, actions=(0, 1))]
)
def test_enumerated_faults_have_no_interval_in_any_section(plan):
    assert PERCENT_SPAN.search(
        rendered(generated_campaigns.made(plan)).one("section", "after_stop").words
    )
    html = rendered(enumerated(plan))
    for name in (
        "verdicts",
        "groups",
        "maps",
        "time",
        "checks",
        "after_stop",
        "cues",
        "detectors",
        "reaction",
    ):
        for section in html.all("section", name):
            words = section.words
            if name in ("verdicts", "reaction"):  # fault-free motions are another sample
                words = re.sub(r"Without any fault the .*?\)\.", "", words).partition(
                    "Interruptions of"
                )[0]
            assert not PERCENT_SPAN.search(words), name
            assert "nan" not in words.lower().split(), name
    assert not list(html.all("section", "precision"))


@pytest.mark.parametrize(
    "plan",
    [
        Plan(0, faults=0, free=3),
        Plan(1, faults=1, free=0, fate="all evade"),
        Plan(2, faults=1, fate="all told", detectors=2),
        Plan(3, faults=20, groups=1, actions=(0, 1)),
        Plan(4, faults=3, limit_mm=12.0, thresholds=(0.7,), detectors=1),
        Plan(5, faults=12, fate="nothing happens"),
    ],
)
@pytest.mark.parametrize("make", [generated_campaigns.made, enumerated])
def test_few_faults_make_sentences_all_the_same(plan, make, monkeypatch):
    monkeypatch.setattr(dependence, "conclusions", lambda runs, robots: [])
    html = rendered(make(plan))
    causes = [section.words for section in html.all("section", "failures")]  # a cause is called nan
    words = html.without("pre").words
    for cause in causes:
        words = words.replace(cause, "")
    assert not {"nan", "inf"} & set(words.lower().split())
    assert "( )" not in words and "()" not in words and " ," not in words.replace(" , ", "")

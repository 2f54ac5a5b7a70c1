"""A sample of the report's sentences, their numbers recomputed from the raw table."""

import re

import numpy as np
import pytest
import synthetic_results as synthetic
from rendered_page import Page, rendered, words

from ravenjax.cli import console, terminal
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.stats.intervals import share_of_cells

RUNS = 1200
FRAME = synthetic.frame(RUNS)
VALID = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
MOVED = VALID["hazard"] == "unintended motion"
UNTOLD = VALID["response"].isin(["silent", "limited"])
PERCENT_SPAN = re.compile(r"\d–\d[\d.]*\W?%")
"""An interval of a share, as 4.1–6.3 %."""


def text_of(frame, manifest):
    return words(Page(rendered(frame, manifest)))


@pytest.fixture(scope="module")
def text():
    return text_of(FRAME, synthetic.manifest(RUNS))


def share(hit):
    return f"{100 * hit.mean():.1f}\u202f%"


def test_which_came_first(text):
    both = VALID[(VALID["cue0_first_ms"] >= 0) & (VALID["told_ms"] >= 0)]
    lead = both["told_ms"] - both["cue0_first_ms"]
    first = lead > 0
    assert f"{len(both)} faults had both a cue and an alarm or stop by a check" in text
    assert f"The cue came first in {first.sum()} of them ({share(first)}" in text
    when = "before" if lead.median() > 0 else "after"
    assert f"At the median the cue came {abs(lead.median()):g} ms {when} the check" in text


@pytest.mark.slow
def test_enumerated_faults_have_no_interval_in_any_section():
    config = {"group": [{"name": name, "design": "grid"} for name in FRAME["group"].unique()]}
    html = rendered(FRAME, synthetic.manifest(RUNS, config=config))
    for name in ("groups", "maps", "time", "checks", "after_stop"):
        section = re.search(rf'<section id="{name}">.*?</section>', html, re.DOTALL)
        assert section and not PERCENT_SPAN.search(re.sub("<[^>]*>", "", section[0])), name


def test_the_terminal_counts_distinct_faults():
    manifest = synthetic.manifest(RUNS)
    counted = FRAME.loc[FRAME["fault0_site"] != "", "verdict"].value_counts().to_dict()
    cue = np.where(VALID["cue0_first_ms"] >= 0, "cue", "no cue")
    sizes = (VALID["response"] + "/" + VALID["hazard"] + "/" + cue).value_counts()
    told = terminal.share_rows(counted, len(VALID))
    assert {verdict: int(runs) for verdict, runs, _ in told} == sizes.to_dict()
    evading = VALID[MOVED & UNTOLD]

    def sentence(frame, **changes):
        head = tables.headline_counts(Runs.of(frame, manifest), manifest) | changes
        return console.render_template("evading.j2", counts=head, record=manifest)

    said = sentence(FRAME)
    assert said.startswith(f"{len(evading)} of {len(VALID)} distinct faults evade")
    cues = (evading["cue0_first_ms"] >= 0).sum()
    assert said.endswith(f"The cue comes in {cues} of these faults.")
    none = share_of_cells(0, 160)
    said = sentence(FRAME, evaded=none, unintended=none)
    assert said.startswith("None of 160 distinct faults") and "do not test the checks" in said

"""Sentences beside the numbers that they tell, for small and odd cases."""

from __future__ import annotations

import numpy as np
import pytest
import tiny_campaign

from ravenjax import robots
from ravenjax.analyses.monitors import scores
from ravenjax.analyses.monitors.counterfactual import output
from ravenjax.analyses.monitors.counterfactual.candidates import (
    MARGINS,
    Candidate,
    Question,
)
from ravenjax.analyses.monitors.counterfactual.finding import Counterfactual
from ravenjax.analyses.monitors.counterfactual.hazards import NEVER, Hazards
from ravenjax.analyses.monitors.counterfactual.motions import FreeMotion
from ravenjax.analyses.monitors.counterfactual.promise import Grounds

PARTS = tuple(Candidate(score, 1) for score in scores.catalogue(robots.USUAL)[:3])
FAULTS = 40


def counterfactual(question, hours=100.0, peaks=0.5, robots=False, sampled=True, members=(0, 1)):
    """Candidate 0 sees the even faults 50 ms before harm, candidate 1 those of group b,
    candidate 2 none.
    """
    lead = np.full((FAULTS, len(PARTS)), NEVER)
    lead[::2, 0] = 50
    group = np.array(["a", "b"] * (FAULTS // 2), dtype=str)
    group[: FAULTS // 2] = "a"
    lead[group == "b", 1] = 20
    hazards = Hazards(
        group,
        np.full(FAULTS, sampled),
        np.arange(FAULTS) // (2 if robots else 1),
        robots,
        np.full(FAULTS, 900),
        np.repeat(lead[:, :, None], len(MARGINS), axis=2),
    )
    free = FreeMotion(np.full((20, 1, len(PARTS)), peaks, np.float32), np.full((20, 1), hours / 20))
    grounds = Grounds(question, free, free, hazards, *hazards.halves(question.seed))
    return Counterfactual(
        question,
        tiny_campaign.config(),
        PARTS,
        grounds,
        grounds.promise(members),
        tuple(grounds.promise([place]) for place in range(len(PARTS))),
        grounds.promise([grounds.best_single()]),
        None,
        grounds.promise(range(len(PARTS))),
        grounds.at_random(len(members)),
        grounds.of_strangers(),
        0.5,
    )


def said(one):
    return " ".join(output.sentences(one)).replace("\u202f", " ")


def test_shares_are_those_of_the_half_that_states():
    one = counterfactual(Question())
    rows, hazards = one.grounds.statement_half, one.grounds.hazards
    seen = ((np.arange(FAULTS) % 2 == 0) | (hazards.group == "b"))[rows]
    assert f"2 checks together see {seen.sum()} of {rows.sum()} ({100 * seen.mean():.1f} %" in said(
        one
    )
    first, second = output.rows(one)
    assert first[1] == first[2]  # what the first sees it adds
    assert float(first[2].split()[0]) + float(second[2].split()[0]) == pytest.approx(
        100 * seen.mean(), abs=0.1
    )
    lost, among = int((~seen).sum()), int((hazards.group[rows] == "a").sum())
    assert f"Not seen in time: a ({lost} of {among})." in said(one)


def test_sets_chosen_without_a_group_are_tried_on_it():
    one = counterfactual(Question())
    grounds = one.grounds
    # the first candidate sees faults of group a alone, the second of group b alone
    assert grounds.selected() == [0, 1] and grounds.selected(without="b") == [0]
    assert one.promise.covered.k > 0 and one.strangers.k == 0
    assert "tried on, sets see 0.0 %." in said(one)

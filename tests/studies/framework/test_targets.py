"""One rule of when a target is met, in the same words wherever it is said."""

from __future__ import annotations

import json
import re

import pytest
from fake_study import FINDINGS

from ravenjax.bundled import resources
from studies import catalogue
from studies.framework import markdown, targets
from studies.framework.study import plain

ROOT = resources.bundled("campaigns", "quick.toml")[0].parents[1]


def test_a_target_is_met_where_every_line_with_a_band_is_inside_it():
    states = {state.id: state for state in targets.states(plain(FINDINGS)["lines"])}
    assert {name: (state.met, state.inside, state.judged) for name, state in states.items()} == {
        "A6": (False, 1, 2),
        "A4": (True, 1, 1),
        "A5": (None, 0, 0),
    }
    assert targets.sentence(states["A6"]) == "A6 not met: 1 of 2 lines inside their band"
    assert targets.sentence(states["A4"]) == "A4 met: 1 of 1 line inside its band"
    assert (
        targets.sentence(states["A5"])
        == "A5 not judged: no line of it with a band has a prediction"
    )
    (bare,) = targets.states([{"target": "A7", "band": None, "passed": None}])
    assert targets.sentence(bare) == "A7 not judged: no line of it has a band"


def test_every_target_of_a_study_is_defined_and_names_the_study():
    for study in map(catalogue.find, catalogue.NAMES):
        for name in study.targets:
            assert study.name in targets.targets()[name].judged_by.split(", "), (study.name, name)
    assert list(targets.targets()) == [f"A{number}" for number in range(1, 8)]
    assert (
        targets.definition("A2").startswith("A2: time of one Euler step")
        and targets.definition("B1") == ""
    )


@pytest.mark.parametrize(
    "path",
    sorted(ROOT.glob("results/reference/*/findings.json")),
    ids=lambda path: path.parent.name,
)
def test_the_findings_that_are_kept_say_it_in_these_words(path):
    record = json.loads(path.read_text(encoding="utf-8"))
    page = (path.parent / "findings.md").read_text(encoding="utf-8")
    words = markdown.verdicts(record["lines"])
    assert (f"**{'. '.join(words)}.**" in page) == bool(words)
    for name in re.findall(r"^\| (A\d):", page, re.MULTILINE):
        assert targets.definition(name) in page

"""A study without simulation: fixed findings of every kind."""

from __future__ import annotations

import math

from studies.framework.provenance import CampaignRecord, Provenance
from studies.framework.study import Drawing, Findings, Line, Study, StudyEstimate, Table


def draw(figure):
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0, 2.0], [0.1, 0.4, 0.2], label="predicted")
    axes.set_xlabel("time, s")
    axes.legend()


FINDINGS = Findings(
    lines=(
        Line(
            "peak | first",
            "mm",
            StudyEstimate(2.1, 2.0, 2.2, 0, "Figure 1"),
            StudyEstimate(1.5, 1.25, 1.75, 9, "motions"),
        ),
        Line(
            "mean",
            "mm",
            StudyEstimate(0.8),
            StudyEstimate(0.506, n=12345, of="runs"),
            (0.7, 2.5),
            "A6",
            "it is colder",
        ),
        Line("slope", "", StudyEstimate(7.2), StudyEstimate(7.0), (6.0, 8.0), "A6"),
        Line("stops", "", None, StudyEstimate(3, n=9, of="runs"), (1, math.inf), "A4"),
        Line("not measured", "s", StudyEstimate(0.2), None, (0.1, 0.3), "A5"),
    ),
    tables=(
        Table("Settings", ("what", "mm"), (("a", 1.25), ("b", math.nan), ("c", 3)), "Below it."),
    ),
    drawings=(Drawing("first", "What it shows.", draw),),
    notes=("Nothing was fitted.",),
)
STUDY = Study(
    "fake", "A fake", "Nobody, 2026", "Is it so?", (), lambda context: FINDINGS, ("A4", "A5", "A6")
)
MADE = Provenance(
    engine="simd",
    device="a CPU",
    code_hash="c0de" * 16,
    lock_hash="",
    versions={"python": "3.11.7", "numpy": "2.4.6"},
    campaigns=(
        CampaignRecord("base", "quick.toml", ("campaign.limit=2",), "", 2, 3.0, 7, "ab" * 32),
    ),
)

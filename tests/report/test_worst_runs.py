"""The worst runs of a folder, beside a plain sort of its table."""

import pytest
import synthetic_results as synthetic

from ravenjax.errors import UserError
from ravenjax.report.run import ranking

FRAME = synthetic.frame(600)
CASES = FRAME[(FRAME["failed"] == "") & (FRAME["fault0_site"] != "")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return synthetic.folder(tmp_path_factory.mktemp("worst"), FRAME, synthetic.manifest(600), 250)


def sorted_ids(values, most):
    cases = CASES.assign(value=values)
    cases = cases[cases["value"] > 0]
    return (
        cases.sort_values(["value", "index"], ascending=[False, True])["run_id"].head(most).tolist()
    )


@pytest.mark.parametrize(
    ("by", "values"),
    [
        ("unintended", CASES["unintended_mm"].astype("float32")),
        ("loss", CASES["loss_mm"].astype("float32")),
        ("report", CASES["false_report_mm"].astype("float32")),
        ("tissue", (CASES["tissue_depth_mm"] - CASES["golden_tissue_depth_mm"]).astype("float32")),
        ("cue", CASES["cue0_ms"]),
        (
            "response",
            (CASES["response_ms"] - CASES["first_active_ms"]).where(
                (CASES["response_ms"] >= 0) & (CASES["first_active_ms"] >= 0)
            ),
        ),
    ],
)
def test_the_worst_are_those_of_a_plain_sort(folder, by, values):
    found = ranking.worst_runs(folder, 7, by)
    assert [run.run_id for run in found] == sorted_ids(values, 7)
    assert [run.value for run in found] == sorted((run.value for run in found), reverse=True)


@pytest.mark.parametrize(
    ("most", "by", "words"),
    [
        (0, "cue", "--worst 0: expected a number of runs"),
        (1, "respons", "expected unintended, .*Did you mean 'response'"),
    ],
)
def test_what_cannot_be_asked(folder, most, by, words):
    with pytest.raises(UserError, match=words):
        ranking.worst_runs(folder, most, by)

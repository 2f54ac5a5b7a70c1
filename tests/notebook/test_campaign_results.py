"""Results as an object: what it says is what the table and the report say."""

import gc
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

import ravenjax as rj
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.stats.intervals import wilson_interval

CAMPAIGN = rj.Campaign(
    name="small",
    duration_s=0.6,
    operator=rj.Operator(motion="reach"),
    haptics=rj.Haptics(threshold_mm=[3, 1]),
    group=[
        rj.Group(name="free", parameters={"plant.friction_scale": [0.8, 1.2]}),
        rj.Group(
            name="drawn",
            design="random",
            runs=24,
            fault=[
                rj.Fault(
                    site="usb_out",
                    channel="elbow",
                    effect="overwrite",
                    value=rj.uniform(-9000, 9000),
                    start_ms=200,
                    duration_ms=100,
                )
            ],
        ),
        rj.Group(
            name="grid",
            repeats=2,
            fault=[
                rj.Fault(
                    site="packet",
                    channel="delx",
                    effect="random",
                    value=[50, 2000],
                    start_ms=[150, 200],
                )
            ],
        ),
    ],
)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return CAMPAIGN.run(tmp_path_factory.mktemp("results") / "small", engine="simd")


def test_the_table_is_that_of_run(results):
    table = rj.run(CAMPAIGN, engine="simd")
    pd.testing.assert_frame_equal(results.to_pandas(), table)
    assert results.to_pandas().attrs == table.attrs and len(results) == len(table) == 34
    arrow = results.to_arrow(["run_id", "group", "unintended_mm"])
    assert arrow.column_names == ["run_id", "group", "unintended_mm"]
    assert arrow.column("run_id").to_pylist() == table["run_id"].tolist()
    assert list(results.to_pandas(["index"])) == ["index"]


def test_rates_count_distinct_faults_as_the_report_does(results):
    rows = {
        row["name"]: row
        for row in tables.group_rows(Runs.open(results.folder, results.manifest))
        if row["faulty"]
    }
    rates = results.rates().set_index("group")
    assert set(rates.index) == set(rows) == {"drawn", "grid"}
    for name, line in rates.iterrows():
        np.testing.assert_equal(
            tuple(line[["k", "n", "rate", "low", "high"]]), tuple(rows[name]["evaded"])
        )
    table = results.to_pandas().query("group == 'drawn'")
    hits = int(
        (
            table["response"].isin(["silent", "limited"]) & (table["hazard"] == "unintended motion")
        ).sum()
    )
    assert tuple(rates.loc["drawn", ["k", "n", "rate", "low", "high"]]) == tuple(
        wilson_interval(hits, 24)
    )
    assert 0 < hits < 24
    # Each repeat of a fault that draws its own numbers is a further fault.
    grid = rates.loc["grid"]
    assert grid["n"] == 8 and grid["low"] == wilson_interval(int(grid["k"]), 8).low


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda one: one.rates("evade"), "unknown event 'evade', .* Did you mean 'evades'"),
        (lambda one: one.rates(by="sit"), "by 'sit': no such column, .* Did you mean 'site'"),
        (lambda one: one.query("DROP TABLE facts"), "expected one query"),
        (lambda one: one.plot_roc(), "the campaign has no"),
        (lambda one: rj.open_results(5), "folder is 5, expected the path"),
    ],
)
def test_what_it_does_not_take(results, call, words):
    with pytest.raises(rj.UserError, match=words):
        call(results)


def test_a_folder_without_results(tmp_path):
    with pytest.raises(rj.StoreError):
        rj.open_results(tmp_path)


def test_the_worst_runs(results):
    table = (
        results.to_pandas().query("fault0_site != ''").sort_values("unintended_mm", ascending=False)
    )
    worst = results.worst(5)
    assert worst["run_id"].tolist() == table["run_id"].head(5).tolist()
    assert worst["unintended_mm"].tolist() == pytest.approx(table["unintended_mm"].head(5).tolist())
    assert (
        worst.attrs["units"] == {"unintended_mm": "mm"}
        and worst["fault"].str.contains("elbow|delx").all()
    )


def test_a_query_sees_table_and_facts(results):
    counts = results.query(
        'SELECT r."group", count(*) AS n FROM results r JOIN facts USING (row) WHERE faulty GROUP'
        " BY ALL"
    )
    assert dict(zip(counts.iloc[:, 0].astype(str), counts["n"], strict=True)) == {
        "drawn": 24,
        "grid": 8,
    }


def test_a_chain_is_that_of_explain(results):
    run = results.worst(1)["run_id"][0]
    pd.testing.assert_frame_equal(results.explain(run), rj.explain(CAMPAIGN, run, "simd"))
    pd.testing.assert_frame_equal(results.explain(run), rj.explain(results, run))
    assert run in results.plot_chain(run)._repr_svg_()


@pytest.mark.parametrize("name", ["verdicts", "time_to_know", "tradeoff"])
def test_figures(results, name, tmp_path):
    figure = getattr(results, f"plot_{name}")()
    assert ElementTree.fromstring(figure._repr_svg_()).tag.endswith("svg")
    figure.savefig(tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_results_without_a_folder_take_their_own_along():
    campaign = CAMPAIGN.replace(limit=2)
    results = campaign.run(engine="simd")
    folder = results.folder
    assert len(results) == 2 and folder.is_dir()
    assert "No run has a fault" in results._repr_html_() and results.rates().empty
    with pytest.raises(rj.UserError, match="no run has a fault"):
        results.plot_verdicts()
    del results
    gc.collect()
    assert not folder.exists()

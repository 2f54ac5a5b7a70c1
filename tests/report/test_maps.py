"""Maps of whatever was swept: cells against plain pandas, axes that tell most, small samples."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import maps as panels
from ravenjax.stats.intervals import wilson

MANIFEST = synthetic.manifest(2000)
FRAME = synthetic.frame(2000)
FAULTY = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
MEASURES = {
    "unintended": lambda frame: frame["hazard"] == "unintended motion",
    "told": lambda frame: frame["response"].isin(["stopped", "flagged"]),
    "cue": lambda frame: frame["cue0_first_ms"] >= 0,
    "evaded": lambda frame: (
        (frame["hazard"] == "unintended motion") & frame["response"].isin(["silent", "limited"])
    ),
}
"""As the definitions have them; no golden run has a cue here."""


def swept(rows, **columns):
    """A campaign of one site and effect in which nothing varies but these columns, and the
    operator, so that no row repeats another."""
    frame = synthetic.frame(2 * rows, seed=1)
    frame = frame[frame["fault0_site"] != ""].head(rows).reset_index(drop=True)
    same = {
        "fault0_site": "dac",
        "fault0_effect": "overwrite",
        "fault0_channel": "elbow",
        "fault0_value": 1.0,
        "fault0_start_ms": 500,
        "fault0_duration_ms": 20,
        "param:plant.friction_scale": 1.0,
        "failed": "",
        "operator": [f"suture {k}" for k in range(rows)],
    }
    return synthetic.judged(frame.assign(**(same | columns)))


def moving(frame, where):
    """The same with unintended motion where it is said and nowhere else."""
    return synthetic.judged(
        frame.assign(
            unintended_first_ms=np.where(where, 700, -1), loss_first_ms=-1, false_report_first_ms=-1
        )
    )


def made(frame):
    return panels.all_maps(Runs.of(frame, MANIFEST))


def counts(panel):
    """(column, row) -> (k, n) of the cells with runs."""
    return {
        (column, row["label"]): (cell.k, cell.n)
        for row in panel["rows"]
        for column, cell in zip(panel["columns"], row["cells"], strict=True)
        if cell is not None
    }


def panel_of(item, name="unintended"):
    (found,) = [panel for panel in item["panels"] if panel["name"] == name]
    return found


def plain(frame, across, up, name="unintended"):
    """The same by pandas, of inputs with few values."""
    hit = MEASURES[name](frame)
    found = hit.groupby([frame[across], frame[up]]).agg(["sum", "size"])
    return {
        (f"{x:g}".replace("-", "−"), f"{y:g}"): tuple(row)
        for (x, y), row in zip(found.index, found.to_numpy(), strict=True)
    }


@pytest.mark.parametrize(
    "values", [np.arange(200, 2400), np.linspace(-3, 3, 500), 2.0 ** np.linspace(0, 9, 300)]
)
def test_bins_hold_their_values(values):
    axis = panels.number_axis("x", values.astype(float), panels.MOST_VALUES)
    limits = [
        [float(e.replace("−", "-").replace("k", "e3")) for e in label.split(" to ")]
        for label in axis.labels
    ]
    assert axis.place.min() == 0 and axis.place.max() == len(axis.labels) - 1 <= 12
    for value, i in zip(values, axis.place, strict=True):
        assert limits[i][0] <= value < limits[i][1] or value == limits[-1][1]


def test_few_values_have_a_bin_each():
    axis = panels.number_axis("x", np.array([8.0, 1, 64, 8]), panels.MOST_VALUES)
    assert axis.labels == ["1", "8", "64"] and axis.place.tolist() == [1, 0, 2, 1]


def test_words_stand_in_the_order_of_the_joints_and_rare_ones_together():
    channels = np.array(["wrist", "elbow", "shoulder"])
    axis = panels.word_axis("channel", channels, ("shoulder", "elbow", "wrist"))
    assert axis.labels == ["shoulder", "elbow", "wrist"]
    many = panels.word_axis("x", np.repeat([f"w{k:02}" for k in range(20)], np.arange(30, 10, -1)))
    assert len(many.labels) == panels.MOST_VALUES
    assert many.labels[0] == "w00" and many.labels[-1] == "others"


def test_every_map_counts_each_fault_once_and_as_pandas_does():
    found = made(FRAME)
    assert found[0]["name"] == panels.WHOLE and found[0]["n"] == len(FAULTY)
    blocks = FAULTY["fault0_site"] + " · " + FAULTY["fault0_effect"]
    assert {item["name"] for item in found[1:]} == set(blocks)
    for item in found:
        mine = FAULTY if item["name"] == panels.WHOLE else FAULTY[blocks == item["name"]]
        for one in item["rates"]:
            assert one["rate"] == wilson(int(MEASURES[one["name"]](mine).sum()), len(mine))
        for panel in item["panels"] + item["more"]:
            cells = counts(panel).values()
            assert sum(n for _, n in cells) == len(mine)
            assert sum(k for k, _ in cells) == MEASURES[panel["name"]](mine).sum()
            assert all(len(row["cells"]) == len(panel["columns"]) for row in panel["rows"])


def test_the_map_of_all_faults_has_a_row_for_each_site_and_effect():
    panel = panel_of(made(FRAME)[0])
    block = FAULTY["fault0_site"] + " · " + FAULTY["fault0_effect"]
    assert panel["up"] == panels.PLACE and {row["label"] for row in panel["rows"]} == set(block)
    shares = [MEASURES["unintended"](FAULTY[block == row["label"]]).mean() for row in panel["rows"]]
    assert shares == sorted(shares, reverse=True)


def test_channel_by_value():
    channel, value = (
        np.tile(["shoulder", "elbow", "insertion"], 30),
        np.repeat([-3.0, -1.0, 0.0, 1.0, 3.0], 18),
    )
    frame = moving(
        swept(90, fault0_channel=channel, fault0_value=value), (channel == "elbow") & (value > 0)
    )
    (item,) = made(frame)
    panel = panel_of(item)
    assert (panel["across"], panel["up"]) == ("value", "channel")
    assert [row["label"] for row in panel["rows"]] == ["shoulder", "elbow", "insertion"]
    hit = MEASURES["unintended"](frame).groupby([value, channel]).agg(["sum", "size"])
    expected = {
        (f"{x:g}".replace("-", "−"), y): tuple(row)
        for (x, y), row in zip(hit.index, hit.to_numpy(), strict=True)
    }
    assert counts(panel) == expected


def test_a_value_of_the_second_fault_is_an_axis_too():
    value = np.tile([1.0, 2.0, 3.0], 20)
    names = {f"fault1_{key}": FRAME[f"fault0_{key}"].iloc[0] for key in panels.SLOT_INPUTS}
    frame = (
        swept(60)
        .assign(fault1_site="encoder", fault1_effect="offset", **names)
        .assign(fault1_value=value)
    )
    (item,) = made(moving(frame, value == 2))
    panel = panel_of(item)
    assert panel["across"] == "fault 2: value" and counts(panel) == {
        ("1", ""): (0, 20),
        ("2", ""): (20, 20),
        ("3", ""): (0, 20),
    }


def test_of_many_inputs_those_that_decide_are_the_axes():
    random = np.random.default_rng(0)
    inputs = {f"param:p{k}": random.choice([1.0, 2.0, 3.0], 400) for k in range(9)}
    inputs |= {
        "fault0_value": random.uniform(-5, 5, 400),
        "fault0_start_ms": random.integers(200, 900, 400),
    }
    frame = moving(swept(400, **inputs), (inputs["param:p6"] > 1) & (inputs["fault0_value"] > 0))
    (item,) = made(frame)
    panel = panel_of(item)
    assert {panel["across"], panel["up"]} == {"value", "p6"}
    assert len(item["more"]) <= panels.MORE_PAIRS


def test_a_duration_until_the_end_is_said_so_and_comes_last():
    lengths = np.tile([-1, 30, 300], 16)
    frame = moving(
        swept(48, fault0_duration_ms=lengths, fault0_start_ms=np.repeat([100, 200], 24)),
        lengths == -1,
    )
    (item,) = made(frame)
    panel = panel_of(item)
    assert (panel["across"], panel["up"]) == ("duration, ms", "onset, ms")
    assert panel["columns"] == ["30", "300", "to the end"]
    assert [[cell.k for cell in row["cells"]] for row in panel["rows"]] == [[0, 0, 8], [0, 0, 8]]


def test_durations_that_are_binned_leave_those_until_the_end_alone():
    lengths = np.concatenate([np.arange(1, 200), np.full(57, -1)])
    (item,) = made(moving(swept(256, fault0_duration_ms=lengths), lengths > 100))
    panel = panel_of(item)
    assert panel["columns"][-1] == "to the end" and "−1" not in "".join(panel["columns"])
    assert sum(row["cells"][-1].n for row in panel["rows"]) == 57


def test_a_parameter_that_some_groups_leave_alone_is_not_set_there():
    friction = np.tile([np.nan, 1.0, 1.4], 20)
    (item,) = made(moving(swept(60, **{"param:plant.friction_scale": friction}), friction == 1.4))
    assert counts(panel_of(item)) == {
        ("1", ""): (0, 20),
        ("1.4", ""): (20, 20),
        ("not set", ""): (0, 20),
    }


def test_a_bin_without_runs_is_no_rate():
    onset = np.repeat([100, 200], 12)
    frame = swept(24, fault0_start_ms=onset, fault0_value=np.where(onset == 100, 1.0, 2.0))
    (item,) = made(moving(frame, onset == 100))
    assert [[cell and cell.n for cell in row["cells"]] for row in panel_of(item)["rows"]] == [
        [None, 12],
        [12, None],
    ]


def test_few_runs_are_pooled_in_coarser_bins():
    random = np.random.default_rng(2)
    value, onset = random.uniform(-1, 1, 24), random.integers(200, 900, 24)
    frame = moving(swept(24, fault0_value=value, fault0_start_ms=onset), value > 0)
    (item,) = made(frame)
    cells = counts(panel_of(item))
    assert len(cells) <= 12 and sum(n for _, n in cells.values()) == 24


def test_a_grid_of_two_inputs_shows_each_run():
    friction, mass = np.repeat([0.6, 0.8, 1.0, 1.2, 1.5, 2.0], 4), np.tile([0.7, 0.9, 1.1, 1.3], 6)
    frame = swept(24, **{"param:plant.friction_scale": friction, "param:plant.mass_scale": mass})
    (item,) = made(moving(frame, friction * mass > 1))
    cells = counts(panel_of(item))
    assert len(cells) == 24 and {n for _, n in cells.values()} == {1}
    assert sum(k for k, _ in cells.values()) == (friction * mass > 1).sum()


def test_sites_that_are_too_small_are_in_the_map_of_all_faults():
    frame = swept(60, fault0_site=np.tile(["dac", "encoder", "mpos", "packet", "plc", "brake"], 10))
    frame = moving(frame, frame["fault0_site"] == "packet")
    (item,) = made(frame)
    assert item["name"] == panels.WHOLE and item["n"] == 60
    panel = panel_of(item)
    assert panel["rows"][0]["label"] == "packet · overwrite" and panel["rows"][0]["cells"][
        0
    ] == wilson(10, 10)
    assert [row["cells"][0].k for row in panel["rows"]] == [10, 0, 0, 0, 0, 0]


def test_many_sites_share_a_last_row():
    sites = [f"site{k:02}" for k in range(40)]
    frame = swept(400, fault0_site=np.repeat(sites, 10))
    frame = moving(frame, np.arange(400) % 10 < np.arange(400) // 40)
    panel = panel_of(made(frame)[0])
    assert len(panel["rows"]) == panels.MOST_ROWS + 1 and panel["rows"][-1]["label"] == "others"
    assert panel["rows"][-1]["cells"][0].n == 10 * (40 - panels.MOST_ROWS)


def test_repeats_of_a_fault_count_once():
    onset = np.tile([100, 200], 30)
    frame = moving(
        swept(60, fault0_start_ms=onset, fault0_value=np.repeat(np.arange(30.0), 2)), onset == 100
    )
    twice = pd.concat([frame, frame.assign(seed=8)], ignore_index=True).assign(pair=np.arange(120))
    (once,), (again,) = made(frame), made(twice)
    assert again["n"] == once["n"] == 60 and counts(panel_of(again)) == counts(panel_of(once))


def test_a_campaign_in_which_nothing_evades_still_has_its_maps():
    value = np.repeat([-1.0, 0.0, 1.0], 20)
    frame = swept(60, fault0_value=value).assign(response="stopped", told_ms=800, response_ms=800)
    (item,) = made(moving(frame, value > 0))
    assert [panel["name"] for panel in item["panels"]] == ["unintended", "cue"]
    rates = {one["name"]: one["rate"] for one in item["rates"]}
    assert rates["evaded"] == wilson(0, 60) and rates["told"] == wilson(60, 60)


def test_a_campaign_without_faults_maps_checks_and_cue():
    friction = np.repeat([0.7, 1.0, 1.4], 10)
    frame = swept(30, fault0_site="", fault0_effect="", **{"param:plant.friction_scale": friction})
    frame = synthetic.judged(
        frame.assign(cue0_first_ms=np.where(friction < 1, 400, -1), told_ms=-1, response="silent")
    )
    (item,) = made(frame)
    assert (item["name"], item["unit"]) == ("no fault", "runs")
    assert [panel["name"] for panel in item["panels"]] == ["cue"]
    assert counts(panel_of(item, "cue")) == {
        ("0.7", ""): (10, 10),
        ("1", ""): (0, 10),
        ("1.4", ""): (0, 10),
    }


def test_nothing_varied_has_no_map():
    assert made(swept(30)) == []
    failed = swept(30, fault0_value=np.arange(30.0)).assign(failed="nan")
    assert made(failed) == []


def test_cells_of_a_file_have_a_column_a_measure():
    found = made(FRAME)
    rows = panels.cells(found)
    whole = [row for row in rows if row["faults"] == panels.WHOLE]
    assert sum(row["unintended"].n for row in whole) == len(FAULTY)
    assert {"faults", "across", "column", "up", "row", *MEASURES} <= set(whole[0])

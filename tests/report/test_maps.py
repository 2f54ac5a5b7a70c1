"""Maps of whatever was swept: cells against plain pandas, axes that tell most, small samples."""

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import maps as panels
from ravenjax.stats.intervals import wilson_interval

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


@pytest.mark.parametrize(
    "values", [np.arange(200, 2400), np.linspace(-3, 3, 500), 2.0 ** np.linspace(0, 9, 300)]
)
def test_bins_hold_their_values(values):
    axis = panels.number_axis("x", values.astype(float), panels.MAX_VALUES)
    limits = [
        [float(e.replace("−", "-").replace("k", "e3")) for e in label.split(" to ")]
        for label in axis.labels
    ]
    assert axis.bins.min() == 0 and axis.bins.max() == len(axis.labels) - 1 <= 12
    for value, i in zip(values, axis.bins, strict=True):
        assert limits[i][0] <= value < limits[i][1] or value == limits[-1][1]


def test_every_map_counts_each_fault_once_and_as_pandas_does():
    found = made(FRAME)
    assert found[0]["name"] == panels.WHOLE and found[0]["n"] == len(FAULTY)
    blocks = FAULTY["fault0_site"] + " · " + FAULTY["fault0_effect"]
    assert {item["name"] for item in found[1:]} == set(blocks)
    for item in found:
        mine = FAULTY if item["name"] == panels.WHOLE else FAULTY[blocks == item["name"]]
        for one in item["rates"]:
            assert one["rate"] == wilson_interval(int(MEASURES[one["name"]](mine).sum()), len(mine))
        for panel in item["panels"]:
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


def test_a_weak_pair_is_found_too_and_its_share_named():
    """Adjusted R2 by hand, for the two inputs among three on which the rate depends a little."""
    x, y, z = np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0])
    inputs = {f"param:p{k}": np.repeat(v.ravel(), 6) for k, v in enumerate((x, y, z))}
    hits = np.array([2 if a == b else 4 for a, b in zip(y.ravel(), z.ravel(), strict=True)])
    frame = moving(swept(48, **inputs), np.arange(48) % 6 < np.repeat(hits, 6))
    (item,) = made(frame)
    assert item["axes"][0]["inputs"] == ["p2", "p1"]
    told = [MEASURES[one["name"]](frame).to_numpy(float) for one in item["rates"]]
    cells = 2 * inputs["param:p1"] + inputs["param:p2"]
    within = sum(
        ((h[cells == c] - h[cells == c].mean()) ** 2).sum() for h in told for c in range(4)
    )
    whole = sum(((h - h.mean()) ** 2).sum() for h in told)
    assert item["axes"][0]["share"] == pytest.approx(1 - within / 44 / (whole / 47))
    assert item["axes"][0]["share"] > item["axes"][1]["share"]

"""The studies of the targeted attacks: their campaigns, published numbers, trajectories, and
findings.
"""

import numpy as np
import pytest
from made_up_runs import VALUES, runs_of

import studies
from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
from studies.dsn16 import attacks
from studies.dsn16.attacks import stored

ONSETS_A = range(1000, 2000, 50)


def test_every_cell_of_scenario_a_displaces_three_axes_alike() -> None:
    rows = design.table_columns(loading.load_campaign("dsn16_a.toml"))
    rows = rows[rows["fault0_site"] != ""]
    for column in ("value", "start_ms", "duration_ms"):
        for slot in (1, 2):
            assert rows[f"fault{slot}_{column}"].tolist() == rows[f"fault0_{column}"].tolist()
    assert set(rows["fault0_channel"]) | set(rows["fault1_channel"]) | set(
        rows["fault2_channel"]
    ) == {"delx", "dely", "delz"}
    displacement = np.array([int(group[1:]) for group in rows["group"]])
    assert rows["fault0_value"].tolist() == np.trunc(displacement / np.sqrt(3.0)).tolist()
    cells = rows.groupby([displacement, "fault0_duration_ms"])["fault0_start_ms"].agg(list)
    assert len(cells) == 12 * 8
    assert all(sorted(onsets) == list(ONSETS_A) for onsets in cells)


def test_runs_are_counted_from_a_table_in_any_order() -> None:
    runs = runs_of({(1000, 64): 4, (40000, 8): 10})
    assert runs.frame["index"].tolist() == list(range(1, 1 + len(VALUES) * 8 * 10))
    assert runs.percent("jump").tolist() == [0, 0, 0, 25.0, 0, 0, 10.0, 0]
    assert runs.percent("stop").tolist() == [25.0] * 8
    assert runs.percent("missed").tolist() == [0, 0, 0, 0, 0, 0, 10.0, 0]
    assert runs.percent("ik").tolist() == [50.0] * 8  # more often than the fault-free run
    # Ten packets are past t1 + 8 + 1. A packet lasts a millisecond here.
    inside = attacks.in_window(runs.frame, runs.frame["jump_ms"].to_numpy() + 1)
    only_inside = runs.counting(inside, "inside").percent("jump")
    assert only_inside.tolist() == [0, 0, 0, 0, 0, 0, 10.0, 0]
    assert runs.share("jump").shape == (len(VALUES), 8)


@pytest.mark.parametrize(
    ("value", "kept"),
    [(20000, 20000), (40000, -25536), (80000, 14464), (800000, 13568), (-40000, 25536)],
)
def test_large_values_wrap(value: int, kept: int) -> None:
    assert stored(value) == kept


@pytest.mark.slow
def test_scenario_b_end_to_end(reproduced) -> None:
    thin = ("group.scenario_b.fault.0.start_ms=[1000,1500]",)
    few = ("group.fault_free.repeats=2",)
    found = reproduced(
        studies.find("dsn16_b"),
        {
            "baseline": thin,
            "slow_replay": thin,
            "build_robot": thin,
            "training_suture": few,
            "training_peg_transfer": few,
        },
    )
    lines = {line.quantity: line for line in found.lines}
    assert sum(line.target == "A1" for line in found.lines) == 9
    short = next(line for name, line in lines.items() if name.startswith("runs with a jump, 2"))
    assert short.predicted is not None and short.passed == (short.predicted.value == 0.0)
    rows = next(t for t in found.tables if t.title.startswith("Runs with a jump")).rows
    assert {row[0] for row in rows} == {
        "published",
        "baseline",
        "inside_window",
        "jump_text",
        "slow_replay",
        "build_robot",
    }


@pytest.mark.slow
def test_scenario_a_and_thresholds_end_to_end(reproduced) -> None:
    few = ("group.fault_free.repeats=2",)
    a = studies.find("dsn16_a")
    training = {"training_suture": few, "training_peg_transfer": few}
    found = reproduced(a, {"baseline": (), "drift": (), **training})
    assert all(line.published is None or "stated" in line.published.of for line in found.lines)
    few = ("group.fault_free.repeats=3",)
    found = reproduced(studies.find("dsn16_thresholds"), {"suture": few, "peg_transfer": few})
    assert len(found.tables[0].rows) == 18
    steps = [line for line in found.lines if ", motor position, " in line.quantity]
    assert all(line.predicted is not None and line.predicted.value > 0 for line in steps)

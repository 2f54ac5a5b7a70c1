"""Learning curves: who and what belongs to them, and the numbers that they show."""

import json

import pytest
import synthetic_session as synthetic

from ravenjax.store.logs.session import description
from ravenjax.train.debrief import figures, learning
from ravenjax.train.debrief import page as debrief


def session(base, name, day, **header):
    folder = synthetic.write(
        base / name, [], recorded=False, started=f"2026-01-{day:02}T00:00:00.000+00:00", **header
    )
    arms = {arm: {"path_mm": 10.0 * day, "sparc": -5.0 + day} for arm in ("gold", "green")}
    told = {
        "dexterity": {"idle": 0.5, "arms": arms},
        "hazards": {"score": 5 * day, "median_reaction_ms": None},
    }
    description.update(folder, {"summary": told})
    return folder


def test_a_curve_holds_the_persons_sessions_of_the_scenario_so_far_in_order(tmp_path):
    third = session(tmp_path, "a", 3)
    session(tmp_path, "b", 1)
    session(tmp_path, "c", 2, participant="P2")
    session(tmp_path, "d", 2, scenario={"name": "other"})
    session(tmp_path, "e", 4)
    told = learning.attempts(third)
    assert [one.name for one in told] == ["b", "a"]
    assert (
        told[1].score == 15
        and told[1].path_mm == pytest.approx(60.0)
        and told[1].sparc == pytest.approx(-2.0)
    )
    drawn = json.loads(figures.learning(told).json)
    assert [trace["y"] for trace in drawn["data"]] == [
        [5, 15],
        [20.0, 60.0],
        [-4.0, -2.0],
    ]  # no reaction was timed
    assert figures.learning(told[:1]) is None


def test_nobody_who_is_not_named_has_a_curve(tmp_path):
    assert learning.attempts(session(tmp_path, "a", 1, participant="")) == []


@pytest.mark.slow
def test_the_debrief_keeps_and_shows_the_measures(tmp_path):
    session(tmp_path, "first", 1, participant="P1")
    folder = synthetic.write(tmp_path / "second", [synthetic.hazard(0)], seconds=6.0)
    text = debrief.write(folder).read_text()
    measures = description.read(folder)["summary"]["dexterity"]
    assert f"{measures['arms']['gold']['path_mm']:.1f} mm" in text
    assert "How you moved" in text and "Balasubramanian" in text and "learning-figure" in text

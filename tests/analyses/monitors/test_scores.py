"""Scores as data, and that what is printed of them gives what the definitions say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ravenjax import robots
from ravenjax.analyses.monitors import code, scores
from ravenjax.analyses.monitors.scores import Score
from ravenjax.numbers.vec import Vec
from ravenjax.parts import part
from ravenjax.robots.raven2.loop.user_files import View

RAVEN = robots.USUAL


def test_every_signal_of_the_catalogue_is_a_field_of_the_view():
    names = set(View.__annotations__)
    for score in scores.catalogue(RAVEN):
        assert score.signal in names and score.against in names | {""}
        assert score.layer in RAVEN.layers


def test_candidates_have_names_of_their_own_and_cover_every_kind():
    every = scores.catalogue(RAVEN)
    assert len({score.name for score in every}) == len(every) > 50
    assert {score.kind for score in every} == set(scores.KINDS)
    (tool,) = [score for score in every if score.name == "jpos_residual_jpos_d_tool"]
    assert tool.channels == (3, 4, 5, 6) and tool.labels == (
        "tool_roll",
        "wrist",
        "grasp1",
        "grasp2",
    )
    (speed,) = [score for score in every if score.name == "jvel_bound"]
    assert (
        speed.units == ("rad/s", "rad/s", "m/s")
        and speed.words == "jvel (shoulder, elbow, insertion)"
    )
    assert [one.words for one in speed.singles] == [
        "jvel (shoulder)",
        "jvel (elbow)",
        "jvel (insertion)",
    ]
    assert sum(len(score.singles) for score in every) == sum(len(score.scales) for score in every)


VIEW = {"mvel": 7, "jpos": 7, "jpos_d": 7, "tip_error": 0}
SOME = (
    Score(
        "fast", "bound", "mvel", (0, 2), ("shoulder", "insertion"), ("rad/s",) * 2, (2.0, 0.5), "L5"
    ),
    Score("error", "bound", "tip_error", (), ("",), ("m",), (0.25,), "L5"),
    Score("steps", "rate", "mvel", (1,), ("elbow",), ("rad/s",), (4.0,), "L5"),
    Score("alone", "rate", "tip_error", (), ("",), ("m",), (0.5,), "L5"),
    Score(
        "apart",
        "residual",
        "jpos",
        (3, 6),
        ("tool_roll", "grasp2"),
        ("rad",) * 2,
        (1.0, 8.0),
        "L5",
        "jpos_d",
    ),
)
_NUMBER = st.one_of(st.floats(-1e6, 1e6, width=32), st.just(float("nan")))


def expected(score: Score, now: dict, before: dict | None) -> float:
    """The largest of the channels, as the module's words say, by NumPy in single precision."""
    places = [score.channels] if score.channels else slice(None)

    def values(view: dict, field: str) -> np.ndarray:
        return np.nan_to_num(np.atleast_1d(np.float32(view[field]))[places].ravel())

    size = values(now, score.signal)
    if score.kind == "residual":
        size = size - values(now, score.against)
    if score.kind == "rate":
        size = size - values(before, score.signal) if before else 0 * size
    return float(max([0.0, *(np.abs(size) / np.float32(score.scales))]))


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.lists(st.sampled_from(SOME), min_size=1, max_size=5, unique=True),
    st.lists(
        st.fixed_dictionaries(
            {
                n: st.lists(_NUMBER, min_size=k, max_size=k) if k else _NUMBER
                for n, k in VIEW.items()
            }
        ),
        min_size=1,
        max_size=3,
    ),
)
def test_the_printed_part_gives_what_the_words_say(tmp_path, some, views):
    path = tmp_path / "printed.py"
    path.write_text(code.write_part([single for one in some for single in one.singles]))
    own = part.loaded(part.read("printed", path))
    params = own.params()
    state = own.init(params, "float32")
    before = None
    for now in views:
        values = {
            n: Vec(map(np.float32, v)) if isinstance(v, list) else np.float32(v)
            for n, v in now.items()
        }
        state, score = own.step(params, state, _View(values), "float32", score=part.SCORE)
        assert float(score) == pytest.approx(
            max(expected(one, now, before) for one in some), rel=1e-6
        )
        before = now


class _View:
    def __init__(self, values: dict) -> None:
        self.__dict__.update(values)

"""Scores as data, and that what is printed of them gives what the definitions say."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ravenjax.analyses.monitors import code
from ravenjax.analyses.monitors.scores import Score
from ravenjax.numbers.vec import Vec
from ravenjax.parts import part

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
    path.write_text(code.write_part([single for one in some for single in one.channel_scores]))
    own = part.load_part(part.read_source("printed", path))
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

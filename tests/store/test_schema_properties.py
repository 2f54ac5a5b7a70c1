"""Whatever the shape and the values: what fits comes back to the bit, what does not is refused
by name.
"""

import made_up_rows
import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from synthetic_results import write_part

from ravenjax.errors import StoreError
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.declaration import CHECKS
from ravenjax.robots.raven2.loop.optional import STAGES
from ravenjax.store import parts, schema

names = st.text("abcdefghijklmnopqrstuvwxyz_.0123456789", min_size=1, max_size=12)
SHAPES = st.builds(
    schema.Shape,
    arms=st.sampled_from([("gold",), ("green",), ("gold", "green")]),
    joints=st.sampled_from([("shoulder",), JOINTS]),
    slots=st.integers(0, 3),
    cues=st.integers(0, 3),
    checks=st.lists(st.sampled_from([*CHECKS, "a_new_one"]), unique=True, max_size=3).map(tuple),
    parameters=st.lists(names, unique=True, max_size=3).map(tuple),
    stages=st.lists(st.sampled_from(list(STAGES)), unique=True).map(tuple),
    detectors=st.lists(st.integers(1, 3), max_size=2).map(tuple),
)
FEW = settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.slow
@FEW
@given(SHAPES, st.integers(1, 40), st.integers(0, 2**31), st.randoms())
def test_a_part_gives_back_what_went_in(tmp_path, shape, rows, seed, random):
    frame = made_up_rows.frame(shape, rows, seed)
    shuffled = random.sample(list(frame.columns), len(frame.columns))
    as_written = random.choice(
        [frame[shuffled], {name: frame[name].to_numpy() for name in shuffled}]
    )
    written = write_part(tmp_path, as_written, shape, "of this campaign")
    table = parts.read_part(tmp_path / written.file, "of this campaign", written)
    assert table.schema.equals(schema.arrow_schema(shape))
    back = parts.concatenate_parts([table])
    for name in frame:
        if isinstance(back[name].dtype, pd.CategoricalDtype) or frame[name].dtype == object:
            assert back[name].tolist() == frame[name].tolist(), name
        else:
            assert back[name].dtype == frame[name].dtype, name
            np.testing.assert_array_equal(_bits(back[name]), _bits(frame[name]), name)


def _bits(values):
    plain = values.to_numpy()
    return (
        np.where(np.isnan(plain), np.inf, plain).view(f"i{plain.itemsize}")
        if plain.dtype.kind == "f"
        else plain
    )


@FEW
@given(SHAPES, st.data())
def test_columns_that_lack_or_are_too_many_are_named(shape, data):
    frame = made_up_rows.frame(shape, 2)
    lost = data.draw(st.lists(st.sampled_from(list(frame.columns)), unique=True, max_size=3))
    more = data.draw(
        st.lists(names.filter(lambda name: name not in frame), unique=True, max_size=2)
    )
    changed = frame.drop(columns=lost).assign(**dict.fromkeys(more, 0))
    if not lost and not more:
        assert schema.conform_table(changed, shape).num_rows == 2
        return
    with pytest.raises(StoreError) as wrong:
        schema.conform_table(changed, shape)
    assert all(name in str(wrong.value) for name in (*lost, *more))

"""Series of a run as a dataset: every number where its names say, units beside it."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.store.logs import time_series

T = 40


def series(arms=("gold", "green")):
    random = np.random.default_rng(5)
    sizes = {"joint": 7, "axis": 3, "jaw_axis": 3, "cue": 2}
    out = {name: random.normal(size=T) for name in time_series.OF_RUN if name != "fault_active"}
    out |= {f"fault{slot}_active": np.arange(T) % 11 == slot for slot in range(11)}
    for arm in arms:
        for one in time_series.OF_ARM.values():
            out[f"{arm}/{one.name}"] = random.normal(size=(T, *(sizes[axis] for axis in one.axes)))
    return out


@pytest.mark.parametrize("arms", [("gold",), ("green",), ("gold", "green")])
def test_every_series_is_where_its_names_say(arms):
    given = series(arms)
    found = time_series.dataset(given, {"run_id": "ab"}, (3.0, 2.0))
    assert set(found.data_vars) == set(time_series.OF_RUN) | set(time_series.OF_ARM)
    assert found["arm"].values.tolist() == list(arms) and found["joint"].values.tolist() == list(
        JOINTS
    )
    for arm in arms:
        for name in time_series.OF_ARM:
            np.testing.assert_array_equal(
                found[name].sel(arm=arm).values, given[f"{arm}/{name}"], err_msg=name
            )
    np.testing.assert_array_equal(found["brakes"], given["brakes"])
    for slot in range(11):
        np.testing.assert_array_equal(
            found["fault_active"].sel(fault=slot), given[f"fault{slot}_active"]
        )
    elbow = found["jpos"].sel(arm=arms[0], joint="elbow", time=0.017)
    assert elbow.item() == given[f"{arms[0]}/jpos"][17, 1]
    assert found["rotation"].dims == ("time", "arm", "axis", "jaw_axis")
    assert found["cue_threshold_mm"].values.tolist() == [3.0, 2.0] and found.attrs == {
        "run_id": "ab"
    }

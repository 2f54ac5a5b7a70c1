"""Time series as CSV, and what every series is."""

import numpy as np
import pandas as pd
import pytest

from ravenjax.store.logs import time_series

T = 50


@pytest.fixture
def series():
    random = np.random.default_rng(2)
    return {
        "runlevel": np.full(T, 3, np.int32),
        "fault0_active": np.arange(T) > 10,
        "gold/jpos": random.normal(size=(T, 7)).astype(np.float32),
        "gold/rotation": random.normal(size=(T, 3, 3)).astype(np.float32),
        "gold/tip": np.where(np.arange(T)[:, None] < 5, np.nan, random.normal(size=(T, 3))),
        "gold/cue_force": random.random((T, 2)).astype(np.float32),
        "gold/dac_cnt": random.integers(-32768, 32767, (T, 7)).astype(np.int32),
    }


def test_what_was_written_is_read(series, tmp_path):
    path = tmp_path / "run.csv"
    time_series.write_csv(path, series)
    table = pd.read_csv(path)
    assert table["time_s"].tolist() == [tick / 1000 for tick in range(T)]
    assert list(table)[1:6] == [
        "runlevel",
        "fault0_active",
        "gold/jpos/shoulder [rad]",
        "gold/jpos/elbow [rad]",
        "gold/jpos/insertion [m]",
    ]
    assert {
        "gold/cue_force/1 [device units]",
        "gold/rotation/x/z",
        "gold/dac_cnt/grasp2 [counts]",
    } <= set(table)
    assert len(table.columns) == 1 + 1 + 1 + 7 + 9 + 3 + 2 + 7
    np.testing.assert_array_equal(
        table["gold/jpos/insertion [m]"].astype(np.float32), series["gold/jpos"][:, 2]
    )
    np.testing.assert_array_equal(
        table["gold/rotation/x/z"].astype(np.float32), series["gold/rotation"][:, 0, 2]
    )
    np.testing.assert_allclose(table["gold/tip/y [m]"], series["gold/tip"][:, 1], rtol=1e-6)
    assert table["gold/tip/y [m]"].isna().sum() == 5
    assert table["fault0_active"].tolist() == series["fault0_active"].astype(int).tolist()
    assert table["gold/dac_cnt/elbow [counts]"].tolist() == series["gold/dac_cnt"][:, 1].tolist()

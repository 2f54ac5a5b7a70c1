"""Fault-free segments measured on made series, straight lines and means over motions with known
answers.
"""

import numpy as np
import pandas as pd
import pytest

from studies.seed.fault_free import REST_TICKS, growth, segment

TICKS = 2500


def made():
    """At rest 0.3 mm apart, then 1 mm apart, with a peak of 4 mm; the true tip is always 0.5 mm
    away.
    """
    model = np.zeros((TICKS, 3))
    tip, position = model.copy(), model.copy()
    tip[:, 1] = 0.5e-3
    position[:, 0] = 0.3e-3
    position[REST_TICKS:, 0] = 1.0e-3
    position[1000, 0] = 4.0e-3
    error = np.linalg.norm(position, axis=1) * 1e3
    force = np.where(error > 3.0, 0.018, 0.0)
    return {
        "tip": tip,
        "position": position,
        "model_position": model,
        "tip_error_mm": error,
        "cue_force": force,
    }


ROW = {"group": "as modelled", "param:operator.scale": 0.1, "check_estop_first_ms": -1}


def test_a_segment_begins_with_the_motion():
    found = segment(ROW, made())
    assert (found["group"], found["scale"]) == ("as modelled", 0.1)
    assert (found["stop_ms"], found["pulses"]) == (-1, 1)
    assert found["peak_mm"] == pytest.approx(4.0) and found["rest_mm"] == pytest.approx(0.3)
    assert found["mean_mm"] == pytest.approx(1.0 + 3.0 / 2000)
    assert found["true_mean_mm"] == pytest.approx(0.5)
    assert found["zeroed_mean_mm"] == pytest.approx(0.7 + 3.0 / 2000)


def test_a_line_through_a_line_is_that_line():
    line = growth(pd.Series([1.0, 1.5, 2.0, 2.5], [0.05, 0.1, 0.15, 0.2]))
    assert line.to_dict() == pytest.approx({"slope": 10.0, "at_zero": 0.5, "explained": 1.0})

"""Series of many runs at once are those of a replay, bit for bit, with and without varied
parameters.
"""

import numpy as np
import pytest

from ravenjax.campaign import loading, runner
from ravenjax.campaign.inspection import replay
from studies.network_operator import HERE
from studies.series import SIGNALS, Recorder, own_operator, rises

FAULT = {
    "site": "usb_out",
    "channel": "shoulder",
    "effect": "overwrite",
    "value": [-9000, 4000, 9000],
    "start_ms": 210,
    "duration_ms": 40,
}
PLAIN = {"campaign": {"name": "x", "duration_s": 0.3}, "group": [{"name": "g", "fault": [FAULT]}]}
VARIED = {**PLAIN, "parameters": {"operator.scale": [0.1, 0.2]}}


@pytest.mark.slow
@pytest.mark.parametrize(
    "raw", [pytest.param(PLAIN, id="alike"), pytest.param(VARIED, id="varied")]
)
def test_series_are_those_of_a_replay(tmp_path, raw):
    config = loading.from_dict(raw)
    runner.run_campaign(config, tmp_path, "simd")
    recorder = Recorder(SIGNALS)
    runs = recorder.measure(
        tmp_path, lambda row, series: (row["index"], row["fault0_value"], dict(series))
    )
    assert [index for index, _, _ in runs] == list(range(len(runs))) and len(runs) in (3, 6)
    last, value, found = runs[-1]
    assert value == 9000.0 and set(found) == set(SIGNALS)
    alone = replay.Replayer(config, "simd").replay(int(last)).series
    for name, values in found.items():
        of_robot = {"fault_active": "fault0_active", "last_seq": "last_seq"}
        wanted = alone[of_robot.get(name, f"gold/{name}")]
        wanted = wanted[:, 0] if name == "cue_force" else wanted
        assert np.array_equal(values, np.asarray(wanted)), name
    assert rises(found["fault_active"]) == [210]
    assert recorder.measure(tmp_path, lambda row, _: row["index"], [2, 0]) == [2, 0]


@pytest.mark.slow
def test_a_number_of_an_own_operator_is_a_series(tmp_path):
    operator = {"motion": "suture", "hands": str(HERE / "hands.py")}
    config = loading.from_dict({**PLAIN, "operator": operator})
    runner.run_campaign(config, tmp_path, "simd")
    progress = own_operator("done_ms")
    (found,) = Recorder([progress]).measure(tmp_path, lambda _, series: series[progress], [0])
    assert found[199] == 0 and (np.diff(found[250:]) > 0).all() and found[-1] <= 100


def test_rises_are_where_a_signal_begins():
    assert rises(np.array([1, 1, 0, 0, 1, 0, 1], bool)) == [0, 4, 6]
    assert rises(np.zeros(3, bool)) == []

"""Bursts measured on made series whose answers are known."""

import numpy as np
import pytest

from studies.seed import burst
from studies.seed.burst import jump_ticks, rebound

TICKS = 20_000
ONSETS = (2000, 10_000)


def made(peak_mm=5.0, reach_deg=-2.0, back_deg=6.0, after_ms=150, cue_ms=200):
    """Two bursts: the shoulder goes to `reach_deg` in 300 ms and back by `back_deg` within
    `after_ms`.
    """
    time = np.arange(TICKS)
    shoulder, error, force = np.full(TICKS, 30.0), np.full(TICKS, 0.5), np.zeros(TICKS)
    active = np.zeros(TICKS, bool)
    for onset in ONSETS:
        active[onset : onset + 300] = True
        since = time - onset
        going = (since >= 0) & (since < 300)
        coming = (since >= 300) & (since < 300 + after_ms)
        shoulder[going] = 30.0 + reach_deg * (since[going] + 1) / 300.0
        shoulder[coming] = 30.0 + reach_deg + back_deg * (since[coming] - 299) / after_ms
        shoulder[(since >= 300 + after_ms) & (since < 1500)] = 30.0 + reach_deg + back_deg
        error[onset + 310] = peak_mm
        force[onset + cue_ms : onset + cue_ms + 100] = 0.02
        shoulder[since >= 1500] = 30.0
    jpos = np.zeros((TICKS, 7))
    jpos[:, 0] = np.radians(shoulder)
    still = np.zeros((TICKS, 3))
    return {
        "fault_active": active,
        "jpos": jpos,
        "tip_error_mm": error,
        "cue_force": force,
        "position": still,
    }


def row(**changed):
    plain = {
        "group": "burst",
        "fault0_value": 500.0,
        "response": "silent",
        "response_cause": "",
        "response_ms": -1,
        "cue0_first_ms": ONSETS[0] + 200,
    }
    return plain | changed


def measured(series, **changed):
    return burst.run(row(**changed), series, np.zeros((TICKS, 3)))


def test_both_bursts_are_measured():
    run = measured(made())
    assert len(run["events"]) == len(ONSETS)
    for event in run["events"]:
        assert (
            event["peak_mm"] == 5.0
            and event["force"] == 0.02
            and event["cue_s"] == pytest.approx(0.2)
        )
        assert event["rebound_deg"] == pytest.approx(6.0) and event["rebound_ms"] == 150
        assert not event["jumped"] and not event["cut"]
    assert run["cause"] == ""


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_rebound_goes_back_from_the_farthest_point_either_way(sign):
    shoulder = np.concatenate(
        [np.linspace(0, 4, 301), np.linspace(4, -1, 101)[1:], np.full(199, -1.0)]
    )
    degrees, ms = rebound(30.0 + sign * shoulder)
    assert degrees == pytest.approx(5.0) and ms == 100


def test_a_jump_is_two_long_steps_in_a_row_that_the_golden_run_does_not_make():
    golden = np.zeros((50, 3))
    tip = golden.copy()
    tip[20:, 0] += 150.0
    assert len(jump_ticks(tip, golden)) == 0
    tip[21:, 0] += 150.0
    assert jump_ticks(tip, golden).tolist() == [21]
    assert len(jump_ticks(tip, tip)) == 0
    series = made()
    series["position"][ONSETS[1] + 100 :, 0] += 150e-6
    series["position"][ONSETS[1] + 101 :, 0] += 150e-6
    assert [event["jumped"] for event in measured(series)["events"]] == [False, True]

"""Runs that go on from their golden run end as whole ones do, to the bit; and runs that end
early as shorter ones.
"""

import dataclasses

import numpy as np
import pytest
from branching_cases import (
    OBSERVE,
    TICKS,
    drawn,
    observed,
    plain,
    require_same,
    require_within,
    tables,
    with_every_fault,
)
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import ravenjax as rj
from ravenjax.campaign.faults.table import FOREVER_TICKS
from ravenjax.campaign.golden_runs import FastForwardPlan
from ravenjax.campaign.inspection.replay import Replayer
from ravenjax.campaign.inspection.verification import verify_folder
from ravenjax.campaign.runner import run_campaign
from ravenjax.engines.cpu.engine import SimdEngine
from ravenjax.vocabulary.effects import TRIGGER_CODES


@pytest.fixture(scope="module")
def every_fault():
    return with_every_fault(plain())


@pytest.mark.slow
@settings(max_examples=6, deadline=None, phases=[Phase.generate])
@given(st.integers(0, 2**32))
def test_runs_of_any_fault_are_whole_runs_to_the_bit(every_fault, seed):
    ready = drawn(every_fault, seed)
    assert (
        FastForwardPlan(ready, 1).uses_checkpoints.any()
        and (ready.acts > 0).any()
        and (ready.acts < TICKS).any()
    )
    whole = tables(ready, SimdEngine(), whole=True)
    require_same(tables(ready, SimdEngine()), whole)
    require_within(ready, whole[0])
    require_within(observed(ready, OBSERVE), whole[0])
    assert (whole[0]["active_ticks"] > 0).any()


@pytest.mark.slow
@settings(max_examples=2, deadline=None, phases=[Phase.generate])
@given(st.integers(0, 2**32))
def test_runs_that_end_early_are_shorter_runs_to_the_bit(every_fault, seed):
    ready = observed(drawn(every_fault, seed), OBSERVE)
    counted = (ready.faults["trigger"] != TRIGGER_CODES["time"]).all(axis=1)
    assert (ready.ends[counted] < TICKS).any() and (ready.acts[counted] > 0).any()
    found = tables(ready, SimdEngine())
    require_same(found, tables(ready, SimdEngine(), whole=True))
    for end in np.unique(ready.ends)[:3]:
        rows = np.flatnonzero(ready.ends == end)
        shorter = observed(ready, 2 * FOREVER_TICKS)
        shorter = dataclasses.replace(
            shorter, program=dataclasses.replace(ready.program, ticks=int(end), ends=False)
        )
        for one, other in zip(found, tables(shorter, SimdEngine(), whole=True), strict=True):
            for name, values in other.items():
                np.testing.assert_array_equal(
                    one[name][rows], values[rows], err_msg=f"{name} at {end}"
                )


OPERATION = {
    "campaign": {"name": "operation", "duration_s": 0.5, "observe_ms": 40},
    "group": [
        {"name": "free"},
        {
            "name": "dac",
            "fault": [
                {
                    "site": "usb_out",
                    "channel": "elbow",
                    "effect": "overwrite",
                    "value": [-9000, 9000],
                    "start_ms": [50, 300, 480],
                    "duration_ms": [5, "end"],
                }
            ],
        },
    ],
}


@pytest.mark.slow
def test_each_run_tells_when_it_ended(tmp_path):
    config = rj.load_campaign(OPERATION)
    table = rj.run(config, out=tmp_path / "results", engine="simd")
    ends = [500, *[95, 500, 345, 500, 500, 500] * 2]
    assert table["observed_ms"].tolist() == ends
    assert (table["pedal_down_ms"] <= table["observed_ms"]).all()
    assert (table["golden_pedal_down_ms"] <= table["observed_ms"]).all()
    assert (table["applied0_last_ms"] < table["observed_ms"]).all()
    assert verify_folder(tmp_path / "results").fine
    again = Replayer(config, "simd").replay(1)
    assert again.row["observed_ms"] == 95
    assert {len(values) for values in again.series.values()} == {95}
    for name in ("rms_model_deviation_mm", "golden_tip_path_mm", "verdict", "halted_ms"):
        assert again.row[name] == table[name][1]


@pytest.mark.parametrize(("watchdog_ticks", "still"), [(5, True), (75, False)])
def test_a_note_tells_of_golden_runs_that_stand_still_or_do_harm(watchdog_ticks, still):
    parameters = {"plc.watchdog_ticks": watchdog_ticks}
    whens = {"late": "time > 1", "never": "time < 0", "of_faults": "unintended > 1"}
    harm = [{"name": name, "when": when} for name, when in whens.items()]
    told = []
    run_campaign(
        rj.load_campaign({**OPERATION, "parameters": parameters, "harm": harm}),
        engine="simd",
        on_progress=told.append,
    )
    notes = told[-1].notes
    words = "in 1 of 1 golden runs the robot stands still for up to"
    assert any(words in note for note in notes) == still
    harms = [note for note in notes if "golden runs, so a fault" in note]
    assert len(harms) == 1 and harms[0].startswith("harm 'late' happens in 1 of 1")

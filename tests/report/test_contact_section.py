"""The report's section on contact, against plain pandas; the sentence against the table."""

import dataclasses

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import contact
from ravenjax.stats.intervals import wilson_interval

RUNS = 1200
NAMES = ("contact_peak_n", "contact_vessel_peak_n", "contact_instruments_peak_n")


def table(arms=("gold", "green")):
    """A made-up table with contact: a third of the runs as their golden runs, the others harder."""
    random = np.random.default_rng(3)
    frame = synthetic.frame(RUNS)
    harder = np.arange(RUNS) % 3 > 0
    for i, name in enumerate(NAMES):
        golden = random.uniform(0, 0.3, RUNS).astype(np.float32)
        more = (random.uniform(0.0, 2.0, RUNS) * (random.random(RUNS) < 0.9 - 0.3 * i)).astype(
            np.float32
        )
        frame[f"golden_{name}"] = golden
        frame[name] = np.where(harder, golden + more, golden).astype(np.float32)
    frame["contact_impulse_n_s"] = random.gamma(2, 0.2, RUNS).astype(np.float32)
    manifest = synthetic.manifest(RUNS)
    shape = dataclasses.replace(manifest.shape, stages=("contact",), arms=arms)
    return synthetic.judged(frame), manifest.model_copy(update={"shape": shape})


FRAME, MANIFEST = table()
ROWS = contact.contact_rows(Runs.of(FRAME, MANIFEST))
FAULTY = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]


def test_every_fault_and_each_group_by_pandas() -> None:
    assert [row.group for row in ROWS] == [
        contact.ALL_FAULTS,
        *sorted(FAULTY["group"].astype(str).unique()),
    ]
    for row in ROWS:
        mine = (
            FAULTY
            if row.group == contact.ALL_FAULTS
            else FAULTY[FAULTY["group"].astype(str) == row.group]
        )
        assert row.n == len(mine)
        shares = (row.harder, row.vessel, row.instruments)
        for name, share in zip(NAMES, shares, strict=True):
            assert share == wilson_interval(
                int((mine[name] > mine[f"golden_{name}"]).sum()), len(mine)
            )
        for name, found in (
            ("contact_peak_n", row.peak_n),
            ("contact_impulse_n_s", row.impulse_n_s),
        ):
            assert list(found) == pytest.approx(
                [np.quantile(mine[name], q) for q in (0.5, 0.95, 1.0)], rel=1e-5
            )
        assert row.vessel_n == pytest.approx(mine["contact_vessel_peak_n"].max())
        assert row.instruments_n == pytest.approx(mine["contact_instruments_peak_n"].max())

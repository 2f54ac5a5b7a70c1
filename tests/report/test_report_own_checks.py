"""What the report says of checks of one's own, recounted row by row from the raw table."""

import dataclasses

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import own_checks
from ravenjax.stats.intervals import wilson_interval
from ravenjax.vocabulary import checks

GATE, EYE = checks.of_own("gate", "usb_out", "stop"), checks.of_own("eye", "jpos", "watch")
SECTIONS = [
    {"name": "gate", "file": "gate.py", "at": "usb_out", "acts": "stop", "threshold": 0.25},
    {
        "name": "eye",
        "file": "eye.py",
        "at": "jpos",
        "acts": "watch",
        "threshold": 2.0,
        "consecutive": 3,
    },
]
ROWS = 200


def campaign(own=(GATE, EYE), varied=None):
    """A campaign in which each of `own` trips at random; in one of its two motions the eye does
    without a fault, too.

    varied: threshold of the gate in each run, where it varies.
    """
    names = tuple(one.name for one in own)
    shape = dataclasses.replace(
        synthetic.shape(),
        checks=(*synthetic.CHECKS, *names),
        own_checks=tuple(own),
        parameters=(
            "plant.friction_scale",
            *(() if varied is None else ("checks.threshold.gate",)),
        ),
    )
    frame, random = synthetic.frame(ROWS, 3, shape), np.random.default_rng(5)
    struck = frame["activated"].to_numpy()
    strays = (frame["operator"] == "circle").to_numpy()
    for number, name in enumerate(names):
        golden = np.where(strays, 900, -1) if name == EYE.name else np.full(ROWS, -1)
        trips = struck & (random.random(ROWS) < 0.5)
        at = frame["fault0_start_ms"].to_numpy() + random.integers(0, 120, ROWS) + number
        sooner = trips & ((golden < 0) | (at < golden))
        frame[f"check_{name}_first_ms"] = np.where(sooner, at, golden)
        frame[f"check_{name}_count"] = (golden >= 0) * 1 + sooner * 1
        frame[f"golden_check_{name}_first_ms"] = golden
        frame[f"golden_check_{name}_count"] = (golden >= 0) * 1
    if "built_in_response" in {column.name for column in synthetic.schema.table_columns(shape)}:
        frame["built_in_response"] = frame["response"]
        frame["built_in_told_ms"] = frame["told_ms"]
    if varied is not None:
        frame["param:checks.threshold.gate"] = varied
    config = {
        "name": "synthetic",
        "seed": 7,
        "check": [one for one in SECTIONS if f"own_{one['name']}" in names],
    }
    return frame, synthetic.manifest(ROWS, shape=shape, config=config)


def recounted(frame, name, others):
    """(faults, tripped, alone, with a motion, caught, free of one, harmless), by hand, run by
    run.
    """
    found = np.zeros(7, int)
    for row in frame.to_dict("records"):
        if row["failed"] or not row["fault0_site"]:
            continue
        trips = {one: new(row, one) for one in (name, *others)}
        alone = (
            trips[name] and row["built_in_told_ms"] < 0 and not any(trips[one] for one in others)
        )
        moved = row["unintended_first_ms"] >= 0
        caught, harmless = moved and trips[name], not moved and trips[name]
        found += [1, trips[name], alone, moved, caught, not moved, harmless]
    return found.tolist()


def new(row, name):
    """Whether a check did what it does not in the golden run."""
    first, golden = row[f"check_{name}_first_ms"], row[f"golden_check_{name}_first_ms"]
    sooner = first >= 0 and not 0 <= golden <= first
    return sooner or row[f"check_{name}_count"] > row[f"golden_check_{name}_count"]


def test_each_rate_is_that_of_the_raw_rows():
    frame, manifest = campaign()
    gate, eye = own_checks.own_check_rows(Runs.of(frame, manifest))
    for row, name, other in ((gate, GATE.name, EYE.name), (eye, EYE.name, GATE.name)):
        faults, tripped, alone, moved, caught, still, harmless = recounted(frame, name, [other])
        assert (row.tripped.k, row.tripped.n) == (tripped, faults) and 0 < tripped < faults
        assert (row.alone.k, row.alone.n) == (alone, tripped) and 0 < alone < tripped
        assert (row.alarms.caught.k, row.alarms.caught.n) == (caught, moved) and 0 < caught < moved
        assert (row.alarms.harmless.k, row.alarms.harmless.n) == (harmless, still) and harmless > 0
        assert tuple(row.tripped) == pytest.approx(tuple(wilson_interval(tripped, faults)))
    assert (gate.name, gate.at, gate.does) == ("gate", "usb_out", "stops the robot")
    assert gate.threshold == "above 0.25"
    assert (eye.name, eye.at, eye.threshold) == ("eye", "jpos", "above 2, 3 ms in a row")

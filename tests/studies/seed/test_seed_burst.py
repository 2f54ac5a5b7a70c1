"""The burst study: its campaign is the published burst, its findings follow from its runs, no
constant is chosen.
"""

import math

import numpy as np
import pytest

from ravenjax.campaign import loading, plan
from ravenjax.numbers import paths
from studies.seed import burst
from studies.seed.burst import BURST, MODELLED
from studies.seed.motions import MOTIONS
from studies.study import Context


def own(ready, path):
    """The robot's own value of the first number that a path names."""
    return float(
        next(iter(paths.named_numbers(ready.program.params, ready.program.setup, path).values()))
    )


CONSTANTS, PACKETS = 69, "packets"


@pytest.fixture(scope="module")
def ready():
    return plan.make_plan(loading.load_campaign("seed_burst.toml"))


def test_the_campaign_is_the_published_burst(ready):
    table = ready.rows
    assert table["group"].tolist() == ["fault_free"] + [BURST] * CONSTANTS + [PACKETS] * 11
    bursts = table[table["group"] == BURST]
    assert (bursts["fault0_site"] == "usb_out").all() and (
        bursts["fault0_channel"] == "shoulder"
    ).all()
    assert (bursts["fault0_duration_ms"] == 300).all() and (bursts["fault0_every_ms"] == 8000).all()
    assert (bursts["fault0_trigger"] == "pedal").all()
    values = bursts["fault0_value"].to_numpy()
    assert np.array_equal(values, -values[::-1]) and 0.0 in values and len(set(values)) == CONSTANTS
    assert (table.loc[table["group"] == PACKETS, "fault0_site"] == "packet").all()
    assert own(ready, "operator.scale") == 0.1


FIELDS = ("peak_mm", "cut", "rebound_deg", "rebound_ms", "cue_s", "force", "jumped")
GOOD = dict(zip(FIELDS, (5.0, False, 5.0, 150.0, 0.2, 0.024, False), strict=True))
UNSEEN = {"rebound_deg": math.nan, "rebound_ms": math.nan}
LAST = {**GOOD, **UNSEEN, "peak_mm": 6.6, "cut": True, "force": 0.05}
LARGE = GOOD | {"peak_mm": 8.0}


def runs(setting, motion, whole_at=()):
    """Three constants; those of `whole_at` as published, the others hold through four bursts of
    8 mm.
    """
    found = [
        ("fault_free", math.nan, [], ""),
        (PACKETS, 20.0, [LARGE] * 4, ""),
        *(
            (BURST, value, [GOOD, GOOD, GOOD, LAST], "overdrive")
            if value in whole_at
            else (BURST, value, [LARGE] * 4, "")
            for value in (700.0, 750.0, 800.0)
        ),
    ]
    names = ("setting", "kind", "seed", "group", "value", "events", "cause")
    return [dict(zip(names, (setting, *motion, *one), strict=True)) for one in found]


def compared(monkeypatch, whole_at):
    measured = runs("hard regulation", MOTIONS[0])
    for motion in MOTIONS:
        measured += runs(MODELLED, motion, whole_at if motion == MOTIONS[0] else ())
        measured += runs("stop above 13000 counts", motion, (800.0,))
    monkeypatch.setattr(burst, "_measured", lambda context: measured)
    return burst.compare(Context({}))


def test_a_run_as_published_meets_a4_and_a5(monkeypatch):
    findings = compared(monkeypatch, (750.0, 800.0))
    lines = {line.quantity: line for line in findings.lines}
    together = lines["runs in which all conditions of A4 hold"]
    assert (
        together.predicted.value == 2
        and together.predicted.n == 3 * len(MOTIONS)
        and together.passed
    )
    assert together.reason == "met with 2 constants"
    assert all(line.passed for line in findings.lines if line.target)
    rebound = lines["rebound of the shoulder, bursts with a peak of 3 to 7 mm"]
    assert rebound.predicted.value == pytest.approx(
        5.0
    ) and rebound.published.value == pytest.approx(5.2)

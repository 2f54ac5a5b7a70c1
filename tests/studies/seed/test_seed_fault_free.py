"""The fault-free study: its campaigns say what their names say, its findings follow from its
segments.
"""

import json

import pandas as pd
import pytest

from studies.seed import fault_free
from studies.seed.fault_free import MODELLED, SCALES, STUDY
from studies.seed.motions import MOTIONS
from studies.study import Context


def made(setting, mean_of, pulses=0):
    """A row per motion and scale; the peak is 15 mm times the scale."""
    rows = [(setting, *motion, scale) for motion in MOTIONS for scale in SCALES]
    frame = pd.DataFrame(rows, columns=["setting", "kind", "seed", "scale"])
    mean = frame["scale"].map(mean_of)
    return frame.assign(
        peak_mm=15.0 * frame["scale"],
        mean_mm=mean,
        true_mean_mm=mean - 0.1,
        zeroed_mean_mm=mean - 0.2,
        rest_mm=0.3,
        pulses=pulses,
        stop_ms=-1,
    )


@pytest.fixture
def segments():
    parts = (
        made(MODELLED, lambda scale: 8.0 * scale),
        made("noise", lambda scale: 8.0 * scale, pulses=1),
        made("robot slow", lambda scale: 9.0 * scale),
        made("set B", lambda scale: 0.1),
    )
    return pd.concat(parts)


def compared(monkeypatch, segments):
    monkeypatch.setattr(fault_free, "_measured", lambda context: segments)
    return fault_free.compare(Context({}))


def test_findings_follow_from_the_segments(monkeypatch, segments):
    findings = compared(monkeypatch, segments)
    lines = {line.quantity: line for line in findings.lines}
    mean = lines["mean tip error of all segments"]
    assert mean.predicted.value == pytest.approx(1.0) and mean.passed and mean.target == "A6"
    assert mean.published.value == pytest.approx(0.8)
    slope = lines["mean tip error, slope over the scale"]
    assert slope.predicted.value == pytest.approx(8.0) and slope.published.value == pytest.approx(
        7.2
    )
    straight = lines["share of the variance of the means that a line over the scale explains"]
    assert straight.predicted.value == pytest.approx(
        1.0
    ) and straight.published.value == pytest.approx(0.982, abs=1e-3)
    cues = lines["fault-free segments with noise and a cue"]
    assert cues.predicted.value == 4 * len(MOTIONS) and cues.band is None
    assert lines["peak tip error, scale 0.2"].predicted.value == pytest.approx(3.0)
    rows = {row[0]: row for row in findings.tables[0].rows}
    assert rows["robot slow"][5].startswith("1.12") and rows["set B"][6] == "no"


@pytest.mark.slow
def test_the_whole_study(reproduced, tmp_path):
    names = [one.name for one in STUDY.variants]
    few = dict.fromkeys(names[: len(MOTIONS) + 1], ("campaign.duration_s=2.5",))
    findings = reproduced(STUDY, few)
    assert {line.target for line in findings.lines} == {"", "A6"}
    file = tmp_path / "seed_fault_free" / "findings.json"
    before = file.read_bytes()
    assert len(json.loads(before)["provenance"]["campaigns"]) == len(few)
    reproduced(STUDY, few)
    assert file.read_bytes() == before

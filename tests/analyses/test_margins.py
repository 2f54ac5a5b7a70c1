"""A gate passes an equal robot, fails a worse one, and does not decide on too few faults."""

from xml.etree import ElementTree

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax import cli
from ravenjax.analyses import gate
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.intervals import Estimate, independent_difference

RUNS = 900


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Results of a robot, of an equal one, and of one in which a tenth of harmless faults evade."""
    place = tmp_path_factory.mktemp("gate")
    frame = synthetic.frame(RUNS)
    frame["activated"] = True
    worse = frame.copy()
    harmless = (frame["hazard"] == "none") & (frame["response"] == "silent")
    changed = frame.index[harmless & (np.arange(RUNS) % 3 == 0)]
    worse.loc[changed, "hazard"] = "unintended motion"
    worse.loc[changed, "unintended_mm"] = 5.0
    worse.loc[changed, "unintended_first_ms"] = 900
    return [
        synthetic.folder(place / name, table, synthetic.manifest(RUNS))
        for name, table in (("base", frame), ("equal", frame), ("worse", worse))
    ]


def test_a_gate_passes_an_equal_robot_and_fails_a_worse_one(folders, tmp_path, capsys):
    base, equal, worse = map(str, folders)
    words = ["--margin", "evades +2 points", "--margin", "false cues +3000/h"]
    assert cli.main(["gate", base, equal, *words]) == 0
    files = ["--junit", str(tmp_path / "gate.xml"), "--markdown", str(tmp_path / "gate.md")]
    assert cli.main(["gate", base, worse, *words, *files]) == 1
    assert "fail" in capsys.readouterr().out
    suite = ElementTree.parse(tmp_path / "gate.xml").getroot()
    assert suite.attrib["tests"] == "2" and suite.attrib["failures"] == "1"
    (failure,) = suite.iter("failure")
    assert "points (95 % interval +" in failure.attrib["message"]
    assert "| evades +2 points |" in (tmp_path / "gate.md").read_text()
    # Loss in the other direction is no harm, and a rise that may not happen is undecided.
    assert cli.main(["gate", base, worse, "--margin", "evades -1 points"]) == 0
    assert cli.main(["gate", base, equal, "--margin", "evades +0.01 points"]) == 2


@pytest.mark.parametrize(
    ("change", "margin", "verdict"),
    [
        (Estimate(1.0, 0.2, 1.8), 2.0, "pass"),
        (Estimate(1.0, 0.2, 2.2), 2.0, "undecided"),
        (Estimate(3.0, 2.2, 3.8), 2.0, "fail"),
        (Estimate(-3.0, -3.8, -2.2), -2.0, "fail"),
        (Estimate(-1.0, -1.8, -0.2), -2.0, "pass"),
        (Estimate(2.5, np.nan, np.nan), 2.0, "fail"),
        (Estimate(2.0, np.nan, np.nan), 2.0, "pass"),
    ],
)
def test_a_margin_is_judged_by_the_whole_interval(change, margin, verdict):
    assert gate.judge_change(change, margin) == verdict


def test_the_interval_of_a_difference_of_rates_covers_it():
    random = np.random.default_rng(0)
    hours, rates = (4.0, 6.0), (3.0, 5.0)
    hits = 0
    for counts in random.poisson(np.multiply(hours, rates), (1000, 2)):
        before, after = (Estimate(*rate[2:]) for rate in map(alarm_rate, counts, hours))
        change = independent_difference(after, before)
        hits += change.low <= rates[1] - rates[0] <= change.high
    assert hits >= 950


@pytest.mark.parametrize(
    ("margin", "message"),
    [
        ("evades 0.5 points", "expected an event, a signed number and a unit"),
        ("evade +0.5 points", "Did you mean 'evades'?"),
        ("evades +2/h", "expected one of false cues"),
    ],
)
def test_a_wrong_margin_says_what_to_write(folders, capsys, margin, message):
    assert cli.main(["gate", *map(str, folders[:2]), "--margin", margin]) == 2
    assert message in " ".join(capsys.readouterr().err.split())

"""Coverage recounted run by run, its intervals by simulation, and cut sets from single runs."""

import dataclasses
import itertools
import json
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic

from ravenjax import cli
from ravenjax.analyses import double_faults
from ravenjax.report.data import pair_intervals
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import coverage as checks
from ravenjax.report.sections.tables import EVERY_SITE
from ravenjax.vocabulary.effects import FIELDS

FRAME, RECORD = synthetic.frame(600), synthetic.manifest(600)


def test_coverage_is_that_of_the_raw_rows():
    fits = (FRAME["failed"] == "") & (FRAME["fault0_site"] != "")
    harmful = FRAME.loc[fits & (FRAME["hazard"] == "unintended motion")].to_dict("records")
    # A stop helps until 40 ms after the first effect in the first half of these runs, and in the
    # others never. The last run is not in the table.
    helps = np.arange(len(harmful)) < len(harmful) // 2
    deadlines = pd.DataFrame(harmful).rename(columns={"run_id": "run"})
    deadlines = deadlines.assign(
        action="stop",
        effect_ms=deadlines["first_active_ms"],
        deadline_ms=np.where(helps, 40, -1),
        monotone=True,
    )
    found = checks.measure_coverage(Runs.of(FRAME, RECORD), deadlines.iloc[:-1])
    rows = {(row.site, row.name): row for row in found.rows}
    for name in ("overdrive_clip", "joint_limit", "ik_reject"):
        times = [row[f"check_{name}_first_ms"] for row in harmful]
        row = rows[EVERY_SITE, name]
        assert (row.detected.k, row.detected.n) == (sum(ms >= 0 for ms in times), len(harmful))
        assert row.before.k == sum(
            0 <= ms < one["unintended_first_ms"] for ms, one in zip(times, harmful, strict=True)
        )
        late = [ms - one["first_active_ms"] > 40 for ms, one in zip(times, harmful, strict=True)]
        assert (row.in_time or row.detected).k == (
            helps & (np.array(times) >= 0) & ~np.array(late)
        ).sum()
    told = sum(row["told_ms"] >= 0 for row in harmful)
    assert rows[EVERY_SITE, "built-in checks"].detected.k == told
    encoder = [one["told_ms"] >= 0 for one in harmful if one["fault0_site"] == "encoder"]
    assert rows["encoder", "built-in checks"].detected[:2] == (sum(encoder), len(encoder))


def test_the_smallest_sets_are_those_of_an_exhaustive_search():
    found = checks.measure_coverage(Runs.of(FRAME, RECORD))
    for one, latest in zip(found.smallest, (np.inf, found.harmful["harm_ms"] - 1), strict=True):
        names = [source.name for source in found.sources if source.reports]
        hits = {name: found.harmful[name].between(0, latest).to_numpy() for name in names}
        every = np.logical_or.reduce(list(hits.values()))
        fitting = [
            team
            for size in range(1, len(hits) + 1)
            for team in itertools.combinations(hits, size)
            if np.array_equal(np.logical_or.reduce([hits[name] for name in team]), every)
        ]
        least = {frozenset(team) for team in fitting if len(team) == len(fitting[0])}
        assert {frozenset(team) for team in one.sets} == least
        assert one.faults == every.sum() > 0


def test_the_command_lists_the_runs_behind_a_number(tmp_path, capsys):
    place = str(synthetic.folder(tmp_path / "runs", FRAME, RECORD))
    assert cli.main(["coverage", place, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    row = next(row for row in rows if row["name"] == "joint_limit")
    assert cli.main(["coverage", place, "--runs", "joint_limit", "--json"]) == 0
    runs = json.loads(capsys.readouterr().out)["runs"]
    assert sum(run["detected"] != "never" for run in runs) == row["detected"]["k"] > 0
    table = pd.read_csv(tmp_path / "runs/coverage/coverage.csv")
    assert (table["joint_limit"] >= 0).sum() == row["detected"]["k"]
    for words in (["--runs", "joint_limt"], ["--pairs"], ["--pairs", "--runs", "joint_limit"]):
        assert cli.main(["coverage", place, *words]) == 2


def test_the_interval_of_a_coverage_covers_it():
    """Runs of one fault resemble each other in how often they harm and are detected."""
    random, covered = np.random.default_rng(4), 0
    for _ in range(100):
        harm, told = random.random(60), random.beta(1.2, 0.8, 60)
        fault = np.repeat(np.arange(60), 4)
        fault = fault[random.random(len(fault)) < harm[fault]]
        hit = random.random(len(fault)) < told[fault]
        rate = pair_intervals.pair_rate(hit, pair_intervals.pair_faults(fault, True))
        covered += rate.low <= 0.6 <= rate.high  # the mean of that beta distribution
    assert covered >= 91


def test_pairs_are_compared_with_their_single_faults():
    """Faults a to d, alone or in pairs: the check detects b, but not with a or c."""
    harms = {"a": True, "b": False, "c": False, "ab": False, "ac": True, "bc": True, "bd": True}
    shape = dataclasses.replace(synthetic.shape(), slots=2)
    frame = synthetic.frame(len(harms), 1, shape).assign(operator="circle", failed="")
    frame["param:plant.friction_scale"] = 1.0
    for slot, field in itertools.product(range(2), FIELDS):
        frame[f"fault{slot}_{field}"] = 0 if field.endswith(("ms", "value")) else ""
    for slot in range(2):
        present = [len(name) > slot for name in harms]
        frame[f"fault{slot}_site"] = np.where(present, "usb_out", "")
        frame[f"fault{slot}_value"] = [ord(name[slot : slot + 1] or "-") for name in harms]
        frame[f"applied{slot}_ticks"] = np.array(present) * 1
    detected = np.array([name == "b" for name in harms])
    frame = frame.assign(
        unintended_first_ms=np.where(list(harms.values()), 900, -1),
        activated=True,
        first_active_ms=500,
        check_joint_limit_first_ms=np.where(detected, 600, -1),
        check_joint_limit_count=detected * 1,
    )
    runs = Runs.of(synthetic.judged(frame), synthetic.manifest(len(harms), shape=shape))
    doubles = double_faults.measure_pairs(runs)
    found = [(pair.kind, "joint_limit" in pair.defeated) for pair in doubles.pairs]
    assert found == [("masked", True), ("", False), ("cut set", True)]
    assert tuple(map(len, doubles.cut_sets())) == (1, 1)


@pytest.mark.slow
def test_cut_sets_of_the_bundled_campaign_follow_from_its_runs(tmp_path, capsys):
    place = tmp_path / "runs"
    assert cli.main(["run", "double_faults", "--out", str(place), "--no-report"]) == 0
    capsys.readouterr()
    assert cli.main(["coverage", str(place), "--pairs", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    alone, double = {}, {}
    for row in pd.read_parquet(place / "parts").to_dict("records"):
        faults = [tuple(str(row[f"fault{n}_{key}"]) for key in FIELDS) for n in range(2)]
        if not faults[1][0]:
            alone[faults[0]] = row["hazard"] == "unintended motion"
        elif row["applied0_ticks"] and row["applied1_ticks"]:
            double[row["run_id"]] = (*faults, row["hazard"] == "unintended motion")
    kinds = {pair["run"]: pair["kind"] for pair in found["pairs"]}
    assert kinds.keys() == double.keys()
    for run, (first, second, harm) in double.items():
        either = alone[first] or alone[second]
        assert kinds[run] == ("" if harm == either else "cut set" if harm else "masked")
    assert len(found["cut_sets_of_order_1"]) == sum(alone.values()) > 0
    ids = {run for run in kinds if kinds[run] == "cut set"}
    drawing, model = (ElementTree.parse(path) for path in found["files"][:2])
    assert ids and all(name in "".join(drawing.getroot().itertext()) for name in ids)
    assert {f"run-{name}" for name in ids} == {gate.get("name") for gate in model.iter("gate")}

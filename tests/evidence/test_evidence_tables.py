"""Tables of evidence: their counts and sentences are the report's, counted again by hand."""

import collections
import csv
import io
import re

import pytest
import synthetic_results as synthetic

from evidence import risk_tables, writing
from evidence.record import Source, opened
from evidence.risk_tables import count_control_actions, count_failure_modes
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables

RUNS = 600
FRAME = synthetic.frame(RUNS)
SAMPLE = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
BEGINS = int(SAMPLE.index[(SAMPLE["hazard"] != "none") & (SAMPLE.index > RUNS // 3)][0])
"""Rows of a part, and the first row of the second."""


def of(frame, **changes):
    """A result in memory."""
    manifest = synthetic.manifest(len(frame), **changes)
    return Source("R1", None, manifest, Runs.of(frame, manifest))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def source():
    return of(FRAME)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """In parts of which one begins with a run that ended in a hazard."""
    place = tmp_path_factory.mktemp("evidence") / "made up"
    return synthetic.folder(place, FRAME, synthetic.manifest(RUNS), BEGINS)


def test_failure_modes_are_counted_by_hand(source):
    rows = list(count_failure_modes(source).itertuples())
    by_hand = (
        SAMPLE.groupby(["group", "fault0_site", "fault0_effect", "response", "hazard"])
        .size()
        .to_dict()
    )
    counted = collections.Counter()
    for row in rows:
        counted[row.group, row.site, row.effect, row.response, row.hazard] += row.rate.k
    assert dict(counted) == by_hand
    for key, part in SAMPLE.groupby(["group", "fault0_site", "fault0_effect"]):
        mine = [row for row in rows if (row.group, row.site, row.effect) == key]
        assert {row.rate.n for row in mine} == {len(part)} and sum(
            row.rate.k for row in mine
        ) == len(part)
    assert (FRAME["failed"] != "").any()  # those are in no line


def test_unsafe_control_actions_hold_every_hazard_once(source):
    rows = list(count_control_actions(source).itertuples())
    for hazard in risk_tables.TRACED:
        mine = [row for row in rows if row.hazard == hazard]
        assert sum(row.rate.k for row in mine) == (SAMPLE["hazard"] == hazard).sum() > 0
    assert (
        sum(row.evaded for row in rows)
        == tables.headline_counts(source.runs, source.record)["evaded"].k
    )
    assert {row.rate.n for row in rows if row.site == "plc"} == {
        (SAMPLE["fault0_site"] == "plc").sum()
    }


def test_each_kind_of_control_action_by_its_rule():
    frame = FRAME.copy()
    frame.loc[frame["group"] == "packet_position", ["fault0_site", "fault0_channel"]] = (
        "network",
        "delay",
    )
    frame.loc[frame["group"] == "encoder", "fault0_effect"] = "stuck"
    kinds = collections.defaultdict(set)
    for row in count_control_actions(of(frame)).itertuples():
        kinds[row.site, row.hazard].add(row.kind)
    assert kinds["network", "unintended motion"] == {"too early, too late or out of order"}
    assert kinds["encoder", "unintended motion"] == {"applied too long"}
    assert kinds["usb_out", "unintended motion"] == {"provided wrongly"}
    assert kinds["encoder", "false report"] == {"feedback wrong"}
    assert kinds["plc", "loss of motion"] <= {"not provided", "stopped too soon"}
    assert "not provided" in kinds["usb_out", "loss of motion"]
    every = {name for names in kinds.values() for name in names}
    assert (
        every <= {kind.name for kind in risk_tables.KINDS} - {"none"}
        and "stopped too soon" in every
    )


def test_the_trace_names_every_run_and_its_part(folder, tmp_path):
    with opened([folder]) as sources:
        risk_tables.write_trace(tmp_path / "trace.csv", sources)
        (source,) = sources
        matrix = risk_tables.count_matrix(source).to_dict("records")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "trace.csv").read_text(encoding="utf-8"))))
    expected = SAMPLE[SAMPLE["hazard"] != "none"]
    assert sorted(row["run_id"] for row in rows) == sorted(expected["run_id"])
    parts = {part.file: part for part in source.record.parts}
    assert len(parts) == 3 and {row["part"] for row in rows} == set(parts)
    assert str(BEGINS) in {row["index"] for row in rows}
    for row in rows:
        assert (
            int(row["index"]) in parts[row["part"]].rows
            and row["part_sha256"] == parts[row["part"]].sha256
        )
        assert FRAME["run_id"][int(row["index"])] == row["run_id"]
        assert FRAME["hazard"][int(row["index"])] == row["hazard"]
    for line in matrix:
        mine = SAMPLE[SAMPLE["group"] == line["group"]]
        assert line["faults"] == len(mine)
        for hazard in risk_tables.TRACED:
            assert line[hazard.replace(" ", "_")] == (mine["hazard"] == hazard).sum()
    assert {line["group"] for line in matrix} == set(synthetic.BLOCKS)


def test_the_name_of_a_campaign_is_no_html_formula_or_link(tmp_path):
    forged = synthetic.manifest(RUNS, campaign="=1+1 <img src=x> [a](javascript:b)\n# c")
    place = synthetic.folder(tmp_path / "forged", FRAME, forged, BEGINS)
    writing.write([place], tmp_path / "out")
    assert (
        "=1+1 &lt;img src=x> [a\\](javascript:b) # c,"
        in (tmp_path / "out" / writing.README).read_text()
    )
    for table in (tmp_path / "out").glob("*.csv"):
        assert not re.search(r'(^|,)"?=', table.read_text(), re.MULTILINE)
    assert not [path for path in (tmp_path / "out").glob("*.m*") if "<img" in path.read_text()]

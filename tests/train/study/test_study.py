"""Studies: design, collection, blinding, and comparisons against what the sessions were made of."""

import csv
import dataclasses
import io
import math
import shutil

import numpy as np
import pytest
import synthetic_session as synthetic
from training import study

from analysis.training import clustered
from ravenjax.errors import StoreError, UserError
from ravenjax.stats import intervals, multiplicity
from ravenjax.store.logs.session import description
from ravenjax.train.recording import reader

PEOPLE = [f"P{i:02d}" for i in range(12)]


def session(base, participant, group, hazards, *, cue=None, name="", **header):
    """The folder of one session."""
    name = name or f"{participant}-{group}"
    on = (group == "cue") if cue is None else cue
    table = [
        dataclasses.replace(one, participant=participant, group=group, cue="on" if on else "off")
        for one in hazards
    ]
    listed = [{"number": i, "within_s": 2.0} for i in range(len(hazards))]
    told = {"participant": participant, "group": group, "cue": on, "name": name}
    told |= {"hazards": listed} | header
    return synthetic.write(base / name, table, recorded=False, **told)


def met(number, time, off=5.0):
    return synthetic.hazard(number, struck=1000.0 + 5000 * number, response=time, off=off)


def missed(number, off=12.0):
    return synthetic.hazard(number, struck=1000.0 + 5000 * number, response=None, off=off, ok=False)


def made(base, both=False, blinded=False, people=PEOPLE):
    """Sessions of three hazards: with the cue 300 ms faster, 3 mm nearer, and none missed."""
    random = np.random.default_rng(4)
    for one in study.assign_groups(people, ["cue", "control"], seed=3):
        skill = random.normal(0, 40)
        for group in ("cue", "control") if both else (one.group,):
            hazards = []
            for i in range(3):
                slow = 300.0 * (group == "control")
                time = 600 + skill + slow + random.normal(0, 60)
                lost = group == "control" and i == 2
                hazards.append(
                    missed(i) if lost else met(i, time, 4 + slow / 100 + random.normal(0, 0.5))
                )
            session(base, one.participant, group, hazards, blinded=blinded)
    return base


# --- collection ---


def test_sessions_of_other_studies_are_refused(tmp_path):
    session(tmp_path, "P1", "cue", [met(0, 500.0)])
    session(tmp_path, "P2", "control", [met(0, 900.0)], scenario={"name": "other"})
    with pytest.raises(UserError, match=r"not of one study: the scenario of .* differs in name"):
        study.collect_sessions([tmp_path])


def test_what_cannot_be_compared_says_why(tmp_path):
    with pytest.raises(UserError, match="contains no session"):
        study.collect_sessions([tmp_path])
    one = session(tmp_path, "P1", "cue", [met(0, 500.0)])
    with pytest.raises(UserError, match="all 1 sessions have one group and cue 'on'"):
        study.collect_sessions([tmp_path])
    shutil.copytree(one, tmp_path / "copy")
    with pytest.raises(UserError, match="is a copy of"):
        study.collect_sessions([tmp_path])
    description.update_session(one, {"sha256": {"hazards.csv": "0" * 64}})
    with pytest.raises(StoreError, match=r"hazards\.csv: has changed since the session ended"):
        study.collect_sessions([one])


def test_a_name_is_no_formula_of_a_spreadsheet():
    text = reader.as_csv(["who", "mm"], [{"who": "=HYPERLINK(0)", "mm": -1.5}])
    assert text == "who,mm\n'=HYPERLINK(0),-1.5\n"


def test_hazards_that_were_cut_off_count_for_nobody(tmp_path):
    made(tmp_path, people=PEOPLE[:4])
    session(tmp_path, "P8", "cue", [synthetic.hazard(0, struck=None)])
    cut_off = dataclasses.replace(met(1, 900.0), outcome="interrupted")
    session(tmp_path, "P7", "cue", [met(0, 500.0), cut_off])
    found = study.collect_sessions([tmp_path])
    assert [hazard.number for one, _, hazard in found.rows() if one.participant == "P7"] == [0]
    cut, left_out = found.notes
    assert "1 of 14 hazards are left out" in cut and "P8-cue" in left_out


@pytest.mark.slow
def test_what_does_not_vary_is_no_part_of_the_family(tmp_path):
    """Nobody misses and nobody is deep: two of the four outcomes have nothing to test, and cost
    the others nothing.
    """
    for i, one in enumerate(PEOPLE[:7]):
        for group in ("cue", "control"):
            slow = 300.0 * (group == "control")
            hazards = [
                dataclasses.replace(met(k, 600.0 + slow + i, 4 + slow / 100), deepest_mm=-1.0)
                for k in range(2)
            ]
            session(tmp_path, one, group, hazards)
    found = study.compare_groups(study.collect_sessions([tmp_path]))
    right, time, unintended, depth = found
    assert math.isnan(right.p) and math.isnan(depth.p) and not right.clear
    assert time.p == unintended.p == pytest.approx(2 / 2**7)
    # With the other two in the family it would be 8 / 2**7, 0.0625.
    assert time.adjusted == pytest.approx(4 / 2**7) and time.clear
    text = study.write_study([tmp_path], tmp_path / "out").text
    assert "the outcome did not vary" in text
    assert "2 of 2 comparisons are clear" in text


# --- comparison ---


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    base = tmp_path_factory.mktemp("study")
    return study.write_study([made(base / "in")], base / "out")


@pytest.mark.slow
def test_groups_of_different_participants_are_compared(result):
    right, time, off, depth = result.comparisons
    assert not right.paired and right.first.label == "control" and right.second.label == "cue"
    assert right.first.values.mean() == pytest.approx(100 * 12 / 18) and right.second.mean == 100
    assert right.difference.value == pytest.approx(100 / 3)
    # A miss counts as 2 s.
    assert time.difference.value == pytest.approx(-300 * 2 / 3 - (2000 - 600) / 3, abs=60)
    assert time.second.median < time.first.median
    assert off.difference.low < off.difference.value < off.difference.high < 0 and depth.clear
    assert time.g.value < -1
    # Every participant of one group before every one of the other.
    assert time.p == pytest.approx(2 / math.comb(12, 6)) and time.adjusted >= time.p


def test_participants_of_both_conditions_are_compared_with_themselves(tmp_path):
    made(tmp_path, both=True)
    session(tmp_path, "P99", "cue", [met(0, 100.0)])  # did one condition only
    found = study.compare_groups(study.collect_sessions([tmp_path]))
    right, time = found[:2]
    assert right.paired and right.left_out == 1
    assert len(right.first.means) == len(right.second.means) == 12
    own = time.second.means - time.first.means
    assert time.difference.value == pytest.approx(own.mean()) and time.p == pytest.approx(2 / 2**12)
    assert time.difference.high < 0


def test_one_hazard_a_participant_is_the_usual_risk_difference(tmp_path):
    for i in range(8):
        session(tmp_path, f"A{i}", "cue", [met(0, 500.0) if i else missed(0)])
        session(tmp_path, f"B{i}", "control", [met(0, 500.0) if i < 3 else missed(0)])
    right, time = study.compare_groups(study.collect_sessions([tmp_path]))[:2]
    expected = intervals.rate_difference(7, 8, 3, 8)
    assert right.difference == pytest.approx([100 * bound for bound in expected])
    assert math.isinf(time.first.median)


def test_to_carry_on_has_no_time(tmp_path):
    carried = synthetic.hazard(
        1, response=None, response_ok=True, right_response="continue", what="continue"
    )
    for i in range(3):
        session(tmp_path, f"A{i}", "cue", [met(0, 400.0 + i), carried])
        session(tmp_path, f"B{i}", "control", [met(0, 800.0 + i), carried])
    right, time = study.compare_groups(study.collect_sessions([tmp_path]))[:2]
    assert len(right.first.values) == 6 and len(time.first.values) == 3 and right.second.mean == 100


# --- blinding ---


@pytest.mark.slow
def test_a_blinded_study_shows_letters_until_it_is_unblinded(tmp_path):
    base = made(tmp_path / "in", blinded=True)
    blind = study.write_study([base], tmp_path / "blind")
    assert {one.first.label for one in blind.comparisons} == {"A"}
    shown = csv.DictReader(io.StringIO(blind.table.read_text(encoding="utf-8")))
    rows = list(shown)
    assert not {"group", "cue", "cue_ms", "session"} & set(shown.fieldnames or [])
    assert {row["compared"] for row in rows} == {"A", "B"}
    html = blind.page.read_text(encoding="utf-8").split("<body>")[1]
    assert "control" not in html and "P00-cue" not in html and "control" not in blind.text
    again = study.write_study([base], tmp_path / "again")
    assert again.text == blind.text
    open_ = study.write_study([base], tmp_path / "open", unblind=True)
    assert {one.first.label for one in open_.comparisons} == {"control"}
    sizes = [[abs(one.difference.value) for one in run.comparisons] for run in (blind, open_)]
    assert sizes[0] == pytest.approx(sizes[1])


# --- design ---


def test_assignment_is_balanced_in_every_block_and_the_same_again():
    got = study.assign_groups(PEOPLE, ["a", "b", "c"], seed=11)
    assert got == study.assign_groups(PEOPLE, ["a", "b", "c"], seed=11)
    assert got != study.assign_groups(PEOPLE, ["a", "b", "c"], seed=12)
    for block in (0, 1):
        names = [one.group for one in got if one.block == block]
        assert sorted(names) == ["a", "a", "b", "b", "c", "c"]
    longer = study.assign_groups([*PEOPLE, "late"], ["a", "b", "c"], seed=11)
    assert longer[:12] == got and longer[12].block == 2
    assert [one.participant for one in got] == PEOPLE


def largest(n, paired):
    """p of a difference without any overlap."""
    first, second = ([np.array([base + i]) for i in range(n)] for base in (0.0, 1000.0))
    return clustered.permutation_p(first, second, is_paired=paired)


@pytest.mark.parametrize("n", [2, 3, 4, 6, 7, 8, 13, 14, 20, 30])
@pytest.mark.parametrize("paired", [True, False])
def test_the_floor_is_what_the_test_reaches(n, paired):
    people = n if paired else 2 * n
    assert study.smallest_p(people, paired) == pytest.approx(largest(n, paired), rel=0.02)


def test_six_pairs_can_never_be_clear_over_four_outcomes():
    found = study.plan_study(6)
    assert (found.smallest_p, found.adjusted) == (0.03125, 0.125)
    holm = multiplicity.holm_test({str(i): found.smallest_p for i in range(4)})
    assert [one.adjusted for one in holm.values()] == [pytest.approx(found.adjusted)] * 4
    text = study.describe_plan(found)
    assert "the smallest p is 0.0312; after Holm over 4 comparisons 0.125: no result" in text


def test_an_effect_needs_more_and_a_smaller_one_more_still():
    large, small = (study.plan_study(6, effect=effect).for_effect for effect in (1.0, 0.5))
    assert study.plan_study(6).needed == 8 < large < small

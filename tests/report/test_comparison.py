"""Two folders beside each other: pairs, rates, transitions and the most changed runs, beside
plain pandas.
"""

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.errors import UserError
from ravenjax.outcomes import verdict
from ravenjax.report import comparison
from ravenjax.stats import paired
from ravenjax.store import manifest

RUNS = 900
FIRST = synthetic.frame(RUNS)
# Some faults act in neither folder, some in the first only.
FIRST["activated"] &= FIRST["pair"] % 10 > 0


def changed():
    """The same faults: a third with other run ids and outcomes, some of them twice, in another
    order.
    """
    frame = FIRST.copy()
    other = synthetic.frame(RUNS, seed=1)
    third = np.arange(RUNS) % 3 == 0
    outcome = ("response", "hazard", "verdict", "failed", "cue0_first_ms")
    for name in (*outcome, "unintended_mm", "unintended_first_ms"):
        frame[name] = np.where(third, other[name], frame[name])
    frame["run_id"] = np.where(third, other["run_id"], frame["run_id"])
    frame["activated"] &= frame["pair"] % 10 < 9
    frame = frame.iloc[::-1].reset_index(drop=True)
    return frame.assign(index=np.arange(RUNS), pair=np.arange(RUNS))


SECOND = changed()


def folder(place, frame, **changes):
    return synthetic.folder(place, frame, synthetic.manifest(len(frame), **changes))


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    base = tmp_path_factory.mktemp("compare")
    operator = {"name": "circle", "scale": 0.1}
    config = {"name": "synthetic", "seed": 7, "duration_s": 3.0, "operator": operator}
    second = {"config": config, "config_hash": manifest.config_hash(config), "code_hash": "f" * 64}
    return folder(base / "a", FIRST), folder(base / "b", SECOND, **second)


@pytest.fixture(scope="module")
def found(folders):
    return comparison.compare_folders(*folders, 15)


def pairs():
    """Rows of both tables side by side, by what a fault is."""
    keys = [name for name in FIRST if name.startswith(("fault", "param:"))]
    assert not FIRST[FIRST["fault0_site"] != ""].duplicated(keys).any()
    joined = FIRST.merge(SECOND, on=keys, suffixes=("", "_b"))
    faulty = joined[
        (joined["fault0_site"] != "") & (joined["failed"] == "") & (joined["failed_b"] == "")
    ]
    return faulty[faulty["activated"] | faulty["activated_b"]].reset_index(drop=True)


def test_runs_are_paired_by_id_and_then_by_fault(found):
    same = FIRST["run_id"].isin(SECOND["run_id"]).sum()
    assert (found.pairs.by_run_id, found.pairs.by_fault) == (same, RUNS - same)
    assert found.pairs.unpaired == (0, 0)
    assert found.pairs.compared == len(pairs()) < RUNS
    assert f"Left out: {found.pairs.inactive} pairs of runs whose fault changed no bit" in " ".join(
        found.sentences()
    )
    assert found.pairs.inactive > 20


def test_rates_and_their_differences(found):
    table = pairs()
    for rate in found.rates:
        hits = []
        for end in ("", "_b"):
            untold = table[f"response{end}"].isin(verdict.UNTOLD)
            moved = table[f"hazard{end}"] == "unintended motion"
            cue = table[f"cue0_first_ms{end}"] >= 0
            hits.append(
                {
                    "evades": untold & moved,
                    "unintended_motion": moved,
                    "cue": cue,
                    "loss_of_motion": table[f"hazard{end}"] == "loss of motion",
                    "false_report": table[f"hazard{end}"] == "false report",
                }.get(rate.name, table[f"response{end}"] == rate.name)
            )
        assert (rate.first.k, rate.second.k) == (hits[0].sum(), hits[1].sum()), rate.name
        assert rate.first.n == rate.second.n == len(table)
        only = (hits[1] & ~hits[0]).sum(), (hits[0] & ~hits[1]).sum()
        wanted = paired.difference_of_counts(*only, len(table))
        np.testing.assert_allclose(rate.difference, wanted, err_msg=rate.name)
        assert (rate.second_only, rate.first_only) == only


def test_the_most_changed_runs_come_first(found):
    table = pairs()
    far = (
        table["unintended_mm"].astype("float32") - table["unintended_mm_b"].astype("float32")
    ).abs()
    order = far.sort_values(ascending=False, kind="stable").index[:15]
    assert [one.run_ids for one in found.changed] == list(
        zip(table["run_id"][order], table["run_id_b"][order], strict=True)
    )
    assert found.changed[0].fault.startswith(table["fault0_site"][order[0]])
    assert found.changed[0].verdicts == (table["verdict"][order[0]], table["verdict_b"][order[0]])


def test_what_differs_is_named(found):
    (change,) = found.configuration
    assert tuple(change) == ("operator.name", '"suturing"', '"circle"')
    assert [one.path for one in found.environment] == ["code_hash"]


def test_folders_that_share_nothing_are_refused(tmp_path, folders):
    def part(name, frame, faulty):
        rows = frame[(frame["fault0_site"] != "") == faulty].reset_index(drop=True)
        numbers = np.arange(len(rows))
        return folder(tmp_path / name, rows.assign(index=numbers, pair=numbers))

    place, free = part("b", synthetic.frame(RUNS, seed=9), True), part("free", FIRST, False)
    alone = comparison.compare_folders(free, free)
    assert not alone.rates and "Run one campaign with faults twice" in alone.sentences()[-1]
    with pytest.raises(UserError, match="share no fault"):
        comparison.compare_folders(folders[0], place)
    with pytest.raises(UserError, match="--most -1"):
        comparison.compare_folders(folders[0], folders[0], -1)

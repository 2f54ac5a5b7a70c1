"""A campaign that stops by itself: as far as its rule asks."""

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.campaign import loading
from ravenjax.campaign.executors.shards import Shard
from ravenjax.campaign.stop import adaptive, decisions
from ravenjax.campaign.stop.adaptive import group_draws
from ravenjax.errors import UserError
from ravenjax.store import manifest as manifests
from ravenjax.store.folder import ResultFolder, Results, read_all

FAULT = {"site": "usb_out", "channel": "elbow", "effect": "overwrite", "start_ms": 5}
CHUNK = 64
LOOKS = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0]


def config(allocation="proportional", of="groups", half_width=0.06, repeats=1):
    return loading.from_dict(
        {
            "campaign": {"name": "x", "noise": True},
            "stop": {
                "half_width": half_width,
                "rates": ["jump", "flagged"],
                "looks": LOOKS,
                "allocation": allocation,
                "of": of,
            },
            "group": [
                {"name": "free"},
                {
                    "name": "grid",
                    "repeats": repeats,
                    "fault": [FAULT | {"value": list(range(600)), "duration_ms": 4}],
                },
                {
                    "name": "drawn",
                    "design": "sobol",
                    "runs": 1500,
                    "fault": [FAULT | {"value": {"uniform": [0, 99]}}],
                },
            ],
        }
    )


class Stand:
    """Takes the place of the runner: rows of a made-up table, through the real store."""

    def __init__(self, rows=2101):
        self.table = synthetic.frame(rows)
        drawn = self.table.index >= rows - 1500
        self.table["jump_code"] = np.random.default_rng(1).random(rows) < np.where(drawn, 0.4, 0.03)

    def __call__(self, config, out, *, rows, **_):
        asked = tuple((r.start, r.stop - 1) for r in rows)
        folder = ResultFolder.open(out, synthetic.manifest(len(self.table), rows=asked))
        for span in folder.missing(CHUNK):
            folder.add(self.table.iloc[span.start : span.stop])
        folder.close(0.0, 0.0, 0)
        return Results(synthetic.shape(), out)


@pytest.fixture
def run(monkeypatch):
    def go(config, out=None):
        monkeypatch.setattr(adaptive.runner, "run_campaign", Stand())
        return adaptive.run_adaptively(config, out)

    return go


@pytest.mark.slow
@pytest.mark.parametrize("of", ["groups", "whole"])
@pytest.mark.parametrize("allocation", ["proportional", "neyman"])
def test_it_stops_at_the_first_look_at_which_every_interval_is_narrow(
    run, tmp_path, allocation, of
):
    results = run(config(allocation, of), tmp_path)
    looks, rows = decisions.read_looks(tmp_path), results.frame()
    assert looks[-1].stop and not looks[-1].waiting and 1 < looks[-1].number < len(LOOKS)
    assert all(look.waiting and look.widest > 0.06 for look in looks[:-1])
    assert all(interval.half_width <= 0.06 for interval in looks[-1].intervals)
    assert len(rows) == sum(looks[-1].taken.values()) < 2101
    if (allocation, of) == ("neyman", "groups"):
        assert looks[-1].taken["grid"] / 600 < looks[-1].taken["drawn"] / 1500, (
            "a group that is known well gets no more"
        )


@pytest.mark.slow
def test_a_look_counts_what_the_table_says(run, tmp_path):
    table = run(config("neyman"), tmp_path).frame().set_index("index")
    first = {of.first: of for of in group_draws(config())}
    for look in decisions.read_looks(tmp_path):
        for interval in look.intervals:
            start = {"grid": 1, "drawn": 601}[interval.stratum]
            rows = table.loc[[*first[start].rows_of(look.taken[interval.stratum])]]
            rows = rows[rows["failed"] == ""]
            came = rows["jump_code"] if interval.rate == "jump" else rows["response"] == "flagged"
            assert (interval.k, interval.n) == (came.sum(), len(rows))


@pytest.mark.slow
def test_lost_decisions_and_lost_parts_are_made_again(run, tmp_path):
    run(config(), tmp_path)
    whole, table = (tmp_path / decisions.FILE).read_bytes(), read_all(tmp_path)
    (tmp_path / decisions.FILE).write_text("rubbish")
    for number, part in enumerate(sorted((tmp_path / "parts").iterdir())):
        if number % 3 == 0:
            part.unlink()
    run(config(), tmp_path)
    assert (tmp_path / decisions.FILE).read_bytes() == whole and read_all(tmp_path).equals(table)
    assert manifests.read_manifest(tmp_path).finished is not None


def test_of_repeats_the_first_valid_one_that_acted_counts(tmp_path):
    table = synthetic.frame(3301)
    # of draw 0 the first repeat failed, of draw 1 all three
    table["failed"] = np.where(table.index.isin([1, 4, 5, 6]), "tip not finite", "")
    # the second repeat of draw 0 jumps, and the second of draw 2
    table["jump_code"] = table.index.isin([2, 8, 10])
    # the fault of draw 3 never acts
    table["activated"] &= ~table.index.isin([10, 11, 12])
    one = config(repeats=3)
    folder = ResultFolder.open(tmp_path, synthetic.manifest(3301))
    folder.add(table)
    folder.close(0.0, 0.0, 3301)
    results = Results(synthetic.shape(), tmp_path)
    k, n = adaptive.count_cases(
        results, group_draws(one), np.array([1, 4, 0]), ("jump",), one.rules
    )
    assert k.tolist() == [[0, 1, 0]] and n.tolist() == [1, 2, 0]


def test_a_shard_of_it_is_refused():
    with pytest.raises(UserError, match=r"--shard 2/7: the rule \[stop\] needs all runs"):
        adaptive.run_adaptively(config(), shard=Shard(2, 7))

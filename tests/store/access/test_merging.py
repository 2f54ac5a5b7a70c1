"""Shards joined: the table of one folder, whatever the cuts and the order; what does not fit is
named.
"""

import itertools
import tempfile
from pathlib import Path

import pandas as pd
import pytest
import synthetic_results as synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.errors import StoreError
from ravenjax.store import manifest as manifests
from ravenjax.store.access import merging
from ravenjax.store.folder import ResultFolder, read_all

RUNS = 120
FRAME = synthetic.frame(RUNS)


def shard(path, ranges, **changes):
    """A folder that holds these rows, each range one part."""
    folder = ResultFolder.open(path, synthetic.manifest(RUNS, **changes))
    for first, stop in ranges:
        folder.add(FRAME.iloc[first:stop])
    folder.close(1.0, 2.0, RUNS, [f"begins at row {ranges[0][0]}"])
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return read_all(shard(tmp_path_factory.mktemp("whole"), [(0, RUNS)]))


def two(tmp_path, **changes):
    return [
        shard(tmp_path / "a", [(0, 30), (60, 120)]),
        shard(tmp_path / "b", [(30, 60)], **changes),
    ]


@pytest.mark.slow
@settings(max_examples=12)
@given(st.data())
def test_any_cut_into_parts_and_shards_in_any_order_is_the_same_table(whole, data):
    cuts = sorted({0, RUNS, *data.draw(st.sets(st.integers(1, RUNS - 1), max_size=9))})
    ranges = list(itertools.pairwise(cuts))
    owner = data.draw(st.lists(st.integers(0, 2), min_size=len(ranges), max_size=len(ranges)))
    order = data.draw(st.permutations(sorted(set(owner))))
    with tempfile.TemporaryDirectory() as place:
        root = Path(place)
        shards = {
            n: shard(root / str(n), [r for r, o in zip(ranges, owner, strict=True) if o == n])
            for n in set(owner)
        }
        done = merging.merge_shards(root / "out", [shards[n] for n in order])
        assert done.missing == [] and done.linked == len(ranges)
        pd.testing.assert_frame_equal(read_all(root / "out"), whole)
        assert [part.first for part in done.manifest.parts] == cuts[:-1]
        again = merging.merge_shards(root / "out", [shards[n] for n in reversed(order)])
        assert (again.present, again.linked, again.copied) == (len(ranges), 0, 0)
        pd.testing.assert_frame_equal(read_all(root / "out"), whole)


def test_missing_rows_are_named_unless_a_part_of_the_table_will_do(tmp_path):
    a, b = two(tmp_path)
    with pytest.raises(
        StoreError, match=r"120 runs, but 30 of these are in no shard: rows 30 to 59\..*--partial"
    ):
        merging.merge_shards(tmp_path / "out", [a])
    assert not (tmp_path / "out").exists()
    done = merging.merge_shards(tmp_path / "out", [a], partial=True)
    assert (
        done.missing == [range(30, 60)]
        and manifests.read_manifest(tmp_path / "out").finished is None
    )
    assert len(read_all(tmp_path / "out")) == 90
    done = merging.merge_shards(tmp_path / "out", [b])  # what is merged already counts
    assert (done.present, done.linked, done.missing) == (2, 1, [])
    assert done.manifest.finished is not None
    assert done.manifest.notices == ("begins at row 0", "begins at row 30")


def test_an_interrupted_merge_is_finished_by_the_same_command(tmp_path, monkeypatch, whole):
    shards = two(tmp_path)
    real, calls = merging.write_aside, []

    def killed(path, write):
        calls.append(path)
        if len(calls) == 2:
            raise KeyboardInterrupt
        real(path, write)

    monkeypatch.setattr(merging, "write_aside", killed)
    with pytest.raises(KeyboardInterrupt):
        merging.merge_shards(tmp_path / "out", shards)
    (tmp_path / "out" / "parts" / f".{calls[1].name}.tmp").write_bytes(b"half a copy")
    monkeypatch.setattr(merging, "write_aside", real)
    done = merging.merge_shards(tmp_path / "out", shards)
    assert (done.present, done.linked) == (1, 2)
    pd.testing.assert_frame_equal(read_all(tmp_path / "out"), whole)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"engine": "simd"}, 'engine: "xla" here, "simd" there'),
        ({"device": "another"}, '" here, "another" there'),
    ],
)
def test_another_campaign_code_or_engine_is_no_shard(tmp_path, changes, told):
    with pytest.raises(StoreError, match="is no shard of the campaign") as caught:
        merging.merge_shards(tmp_path / "out", two(tmp_path, **changes))
    assert told in str(caught.value) and not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["../../../part", "/part", "..\\\\part", "p" * 300, "a\\u0000"])
def test_a_forged_name_of_a_part_leads_nowhere(tmp_path, name):
    shards = two(tmp_path)
    record = shards[1] / manifests.PARTS_FILE
    record.write_text(record.read_text().replace('"file":"part', f'"file":"{name}'))
    with pytest.raises(StoreError, match=r"b: the list of files contains '"):
        merging.merge_shards(tmp_path / "out", shards)
    assert not (tmp_path / "out").exists()


def test_a_link_in_the_place_of_a_folder_leads_nowhere(tmp_path):
    for folder in ("out", "elsewhere"):
        (tmp_path / folder).mkdir()
    (tmp_path / "out" / "parts").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(StoreError, match="not a link"):
        merging.merge_shards(tmp_path / "out", two(tmp_path))
    assert not list((tmp_path / "elsewhere").iterdir())

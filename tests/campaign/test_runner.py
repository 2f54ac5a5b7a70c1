"""Campaigns from file to table: the same rows however they are cut, stopped and resumed."""

import numpy as np
import pandas as pd
import pytest

import ravenjax as rj
from ravenjax.campaign import computation, runner
from ravenjax.campaign.executors import protocol
from ravenjax.campaign.inspection import replay
from ravenjax.engines.cpu import engine as simd
from ravenjax.errors import StoreError

CAMPAIGN = {
    "campaign": {"name": "small", "duration_s": 0.7, "seed": 3, "chunk": 7},
    "operator": {"motion": "reach"},
    "haptics": {"threshold_mm": [0.5, 1.0, 3.0]},
    "group": [
        {"name": "free"},
        {
            "name": "dac",
            "design": "random",
            "runs": 20,
            "fault": [
                {
                    "site": "usb_out",
                    "channel": ["shoulder", "elbow"],
                    "effect": ["overwrite", "latch_offset"],
                    "value": {"uniform": [-9000, 9000]},
                    "start_ms": {"uniform": [250, 399]},
                    "duration_ms": {"uniform": [1, 100]},
                }
            ],
        },
        {
            "name": "weak cable",
            "design": "grid",
            "parameters": {"plant.cable_stiffness_scale": [0.5, 2.0]},
            "fault": [
                {
                    "site": "mpos",
                    "channel": "insertion",
                    "effect": "offset",
                    "value": [0.5, 5.0, 50.0],
                    "start_ms": 300,
                    "duration_ms": 50,
                }
            ],
        },
    ],
}


def config(**campaign):
    return rj.load_campaign({**CAMPAIGN, "campaign": {**CAMPAIGN["campaign"], **campaign}})


@pytest.fixture(scope="module")
def whole():
    """The campaign in one go."""
    return rj.run(config())


def same(a: pd.DataFrame, b: pd.DataFrame) -> None:
    """Equal to the last bit; categories and strings as text."""
    assert list(a.columns) == list(b.columns)
    for name in a.columns:
        left, right = a[name].to_numpy(), b[name].to_numpy()
        if left.dtype.kind == "f":
            np.testing.assert_array_equal(
                left.astype(np.float32), right.astype(np.float32), err_msg=name
            )
        else:
            np.testing.assert_array_equal(left.astype(str), right.astype(str), err_msg=name)


def test_rows_do_not_depend_on_chunks_nor_on_the_store(whole, tmp_path):
    same(whole, rj.run(config(chunk=3), out=tmp_path / "three"))
    same(whole, rj.run(config(chunk=1000), out=tmp_path / "thousand"))


def test_an_interrupted_campaign_resumes_where_it_stopped(whole, tmp_path, monkeypatch):
    left, put = iter(range(2)), runner.ResultFolder.put

    def interrupted(self, part):
        if next(left, None) is None:
            raise KeyboardInterrupt
        put(self, part)

    monkeypatch.setattr(runner.ResultFolder, "put", interrupted)
    with pytest.raises(KeyboardInterrupt):
        rj.run(config(chunk=4), out=tmp_path)
    monkeypatch.setattr(runner.ResultFolder, "put", put)
    parts = {path: path.stat().st_mtime_ns for path in (tmp_path / "parts").iterdir()}
    assert len(parts) == 2
    same(whole, rj.run(config(chunk=9), out=tmp_path))
    assert all(path.stat().st_mtime_ns == time for path, time in parts.items()), (
        "finished parts are left alone"
    )


def test_a_start_that_stored_nothing_does_not_keep_its_folder(whole, tmp_path, monkeypatch):
    with monkeypatch.context() as broken, pytest.raises(TypeError):
        broken.setattr(protocol, "Computation", None)
        rj.run(config(), out=tmp_path, engine="simd")
    other = config(name="other", duration_s=0.5)
    assert len(rj.run(other, out=tmp_path)) == len(whole)


def test_parts_are_stored_while_later_runs_are_computed(monkeypatch, tmp_path):
    monkeypatch.setattr(simd, "MIN_LANES", 16)
    seen: list[tuple[int, float]] = []
    work = rj.load_campaign(CAMPAIGN, ["group.dac.runs=200", "campaign.chunk=16"])
    rj.run(
        work, out=tmp_path, engine="simd", on_progress=lambda s: seen.append((s.parts, s.progress))
    )
    assert any(0 < parts < 13 and share < 1 for parts, share in seen)


def test_a_finished_campaign_computes_nothing_again(whole, tmp_path, monkeypatch):
    rj.run(config(), out=tmp_path)
    monkeypatch.setattr(protocol, "Computation", None)
    same(whole, rj.run(config(), out=tmp_path))


def test_rows_do_not_depend_on_the_size_of_blocks(whole, monkeypatch):
    """Nor on how many golden runs fit in memory, down to one."""
    monkeypatch.setattr(simd, "MAX_LANES", 16)
    monkeypatch.setattr(computation, "GOLDEN_BYTES", 1)
    same(whole, rj.run(config()))


def test_another_campaign_is_refused_and_nothing_is_lost(tmp_path):
    rj.run(config(limit=2), out=tmp_path)
    before = sorted(path.name for path in tmp_path.rglob("*"))
    with pytest.raises(StoreError, match=r"(?s)duration_s.*rm -r"):
        rj.run(config(duration_s=0.5, limit=2), out=tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*")) == before


def test_a_fault_free_run_is_its_own_golden_run(whole):
    free = whole[whole["group"] == "free"].iloc[0]
    assert free["verdict"] == "silent/none/no cue"
    assert free["peak_golden_deviation_mm"] == 0.0
    assert not free["activated"] and not free["diverged"]
    assert 0.0 < free["peak_model_deviation_mm"] < 2.0


@pytest.fixture(scope="module")
def replayer():
    return replay.Replayer(config())


@pytest.mark.parametrize("index", [0, 9])
def test_a_replay_is_the_run(whole, replayer, index):
    row = whole.iloc[index]
    again = replayer.replay(row["run_id"])
    for name in (
        "first_active_ms",
        "active_ticks",
        "response",
        "response_ms",
        "verdict",
        "cue0_first_ms",
    ):
        assert again.row[name] == row[name], name
    assert again.row["peak_model_deviation_mm"] == pytest.approx(
        row["peak_model_deviation_mm"], rel=1e-3
    )
    series = again.series
    assert all(len(values) == 700 for values in series.values())
    apart = np.linalg.norm(series["gold/tip"] - series["gold/model_position"], axis=1) * 1e3
    assert apart.max() == pytest.approx(row["peak_model_deviation_mm"], rel=1e-3)
    assert int(series["fault0_active"].sum()) >= row["active_ticks"]

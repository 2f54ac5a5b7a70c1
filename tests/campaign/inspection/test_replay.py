"""Finding a run by what a user types; several runs again, planned and compiled once."""

import numpy as np
import pytest
import tiny_campaign

from ravenjax.campaign import runner
from ravenjax.campaign.inspection import replay
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.robots.raven2.geometry import arrays
from ravenjax.store.logs import time_series

IDS = np.array([0xAB00000000000001, 0xAB10000000000000, 0x1234567890123456, 0x12], np.uint64)


@pytest.mark.parametrize(
    ("typed", "index"),
    [
        (2, 2),
        ("2", 2),
        ("ab1", 1),
        ("ab00000000000001", 0),
        ("1234567890123456", 2),
        ("0000000000000012", 3),
    ],
)
def test_a_run_is_found_by_index_id_or_beginning(typed, index):
    assert replay.find_run(IDS, typed) == index


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        (4, "expected an index in 0..3"),
        (-1, "expected an index in 0..3"),
        ("99", "expected an index in 0..3"),
        ("ab", "2 run ids begin so"),
        ("abc", "no run has this id"),
        ("", "4 run ids begin so"),
        ("zz", "no run has this id"),
        *((run, "expected its index") for run in (None, 1.0, True, [0], b"0")),
    ],
)
def test_what_is_no_run_is_named(typed, told):
    with pytest.raises(UserError, match=f"^run .*: .*{told}"):
        replay.find_run(IDS, typed)


CONFIG = tiny_campaign.config(runs=20)


@pytest.fixture(scope="module")
def replayer():
    return replay.Replayer(CONFIG, "simd")


@pytest.mark.slow
def test_an_engine_is_a_class_and_an_entry(tmp_path, monkeypatch):
    entry = selection.ENGINES["simd"]._replace(portable=False)
    monkeypatch.setitem(selection.ENGINES, "other", entry)
    table = runner.run_campaign(CONFIG, tmp_path, "other").frame()
    again = replay.Replayer.of_folder(tmp_path).replay(3)
    assert again.engine.startswith("other on ")
    assert again.row["unintended_mm"] == table["unintended_mm"][3]


@pytest.mark.slow
def test_a_second_run_compiles_nothing(replayer, monkeypatch):
    replayer.replay(4)
    for step in ("traced.trace_tick", "cpu.jit.compile_functions"):
        monkeypatch.setattr(f"ravenjax.engines.{step}", None)
    assert replayer.replay(5).row["index"] == 5


def test_every_series_is_described_and_stands_where_its_joints_are(replayer):
    again = replayer.replay(9)
    for name, values in again.series.items():
        one = time_series.describe_series(name)
        assert one.meaning and values.ndim == 1 + len(one.axes), name
    without_contact = {name for name in time_series.OF_ARM if not name.startswith("contact_")}
    assert {name.partition("/")[2] for name in again.series if "/" in name} == without_contact
    for joints, place, rotation in (
        ("link_jpos", "tip", "tip_rotation"),
        ("model_jpos", "model_position", "model_rotation"),
    ):
        wanted = arrays.forward_kinematics(again.series[f"gold/{joints}"], "gold")
        np.testing.assert_allclose(again.series[f"gold/{place}"], wanted[0], atol=1e-6)
        np.testing.assert_allclose(again.series[f"gold/{rotation}"], wanted[1], atol=1e-6)
    assert again.golden["check_estop_count"] == 0 and set(again.bases) == {"gold"}

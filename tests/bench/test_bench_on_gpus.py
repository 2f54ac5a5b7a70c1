"""What the benchmark asks of GPUs, asked of real ones; skipped, with one line, where there are
none.
"""

import pytest

from bench import engines, machine, process, scaling


@pytest.fixture(scope="module", autouse=True)
def gpus():
    here, _ = process.call(machine.describe, environment={})
    if not here["gpus"]:
        pytest.skip(here["no_gpu"])


def test_a_gpu_is_measured(tmp_path, monkeypatch):
    monkeypatch.setenv("RAVENJAX_CACHE", str(tmp_path / "cache"))
    (row,) = scaling.measure_gpus(1.0, 1, "cuda", scaling.Work(8192, 200, 4096, 200))
    assert row["runs"] == 4096
    assert min(row["kernel_ticks_per_s"], row["campaign_ticks_per_s"]) > 1e5


def test_engine_is_measured():
    rows, _ = process.call(engines.measure, 1.0, "cuda", environment={"RAVENJAX_CACHE": "off"})
    assert rows[0]["ready_s"] > 0.0 and max(row["ticks_per_s"] for row in rows) > 1e6

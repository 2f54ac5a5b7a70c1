"""The machine is described by what the system tells, also where it tells little."""

import pytest

from bench import machine


@pytest.fixture
def cpus(tmp_path):
    """CPUs 0 to 3 of two cores: 0 and 2 share one, 1 and 3 the other."""
    for cpu, siblings in enumerate(("0,2", "1,3", "0,2", "1,3")):
        folder = tmp_path / f"cpu{cpu}/topology"
        folder.mkdir(parents=True)
        (folder / "thread_siblings_list").write_text(f"{siblings}\n")
    return tmp_path


def test_real_cores_come_first(cpus):
    every = [(0, False), (1, False), (2, True), (3, True)]
    assert machine.order_cpus([0, 1, 2, 3], cpus) == every
    # nobody else uses their cores here
    assert machine.order_cpus([2, 3], cpus) == [(2, False), (3, False)]
    assert machine.order_cpus([2, 0], cpus) == [(0, False), (2, True)]
    assert machine.order_cpus([7, 5], cpus / "nothing") == [(5, False), (7, False)]

"""What stands in for parts of a benchmark; light, as each process that runs one imports it."""

from __future__ import annotations

import os
import time

from ravenjax.bench.machine import BenchMachine

MACHINE = BenchMachine(
    cpu="CPU [4]",
    cores=3,
    real_cores=2,
    quota=float("inf"),
    caches=("L1 48K", "L2 2048K"),
    nodes=1,
    memory_gb=16.0,
    vectors="AVX-512",
    width=16,
    gpus=(),
    no_gpu="no GPU",
    system="Linux",
    versions={"jax": "0.10"},
    code="0123456789abcdef",
)


def machine():
    return MACHINE


def no_machine():
    raise RuntimeError("no CPU")


def answers(seconds, *arguments):
    return 42.0


def crashes(seconds):
    os._exit(9)


def sleeps(seconds):
    time.sleep(120.0)


def cache(seconds):
    return os.environ["RAVENJAX_CACHE"]

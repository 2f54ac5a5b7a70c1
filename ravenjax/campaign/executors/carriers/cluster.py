"""Executor `ray`: tasks on the nodes of a Ray cluster, an extra (`pip install 'ravenjax[ray]'`).

Parts come back to the coordinator as bytes, through Ray's object store, rather than being written
by the nodes: a cluster then needs no shared file system, one process alone answers for the folder,
and a task that Ray runs twice (its node was only cut off) leaves no trace. It costs the
coordinator's network some 200 B a run, both ways together.

Ray itself runs a task again whose worker or node died; what it gives up is tried again alone, see
`Attempts`.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import threading
from collections.abc import Callable, Sequence
from typing import Any

from ravenjax import interruption
from ravenjax.campaign.executors import remote
from ravenjax.campaign.executors.background import BackgroundQueue
from ravenjax.campaign.executors.carriers.attempts import Attempts, Handed
from ravenjax.campaign.executors.protocol import Work
from ravenjax.campaign.progress.counts import Progress
from ravenjax.errors import UserError

RETRIES = 3
"""How often Ray itself runs a task again whose worker or node died."""
CORES = 4
"""Cores of a task, where nobody says how many tasks there should be; fewer where no node has as
many.
"""
WRITERS = 4
"""Parts that are written side by side, at most."""
ANSWER_S = 10.0
"""How long a cluster may take to answer."""
_PASSED_ON = ("XLA_FLAGS", "JAX_PLATFORMS", "JAX_ENABLE_X64", "RAVENJAX_CACHE")
"""Environment of the coordinator that decides how a task computes, set before anything is
imported there.
"""

_benches: dict[str, remote.Bench] = {}
"""In a Ray worker: what it made ready for earlier chunks of the same campaign."""


class Ray:
    """See `protocol.Executor`."""

    name = "ray"

    def __init__(self, workers: int | None = None, address: str | None = None) -> None:
        """address: of a running cluster, None for one on this machine alone. Raises UserError
        without the package.
        """
        self.workers, self._address = workers, address
        _import()

    def run(self, work: Work[Any], chunks: Sequence[range]) -> None:
        """See `protocol.Executor`."""
        ray = _import()
        mine = not ray.is_initialized()
        if mine:
            _join(ray, self._address)
        try:
            self._run(ray, work, chunks)
        finally:
            if mine:
                ray.shutdown()

    def _run(self, ray: Any, work: Work[Any], chunks: Sequence[range]) -> None:
        gpu = work.engine.name == "cuda"
        cores, seats = _seats(ray.cluster_resources(), ray.nodes(), self.workers, gpu)
        progress = work.progress
        progress.workers = seats
        attempts = Attempts(chunks, progress, 1)  # Ray itself sees to it that nobody hoards
        progress.tell("compile")
        head = ray.put(remote.head(work, chunks))
        compute = ray.remote(
            num_cpus=cores,
            num_gpus=int(gpu),
            max_retries=RETRIES,
            runtime_env={"env_vars": environment(work.engine.name)},
        )(_compute)
        key = f"{os.getpid()}-{id(work)}-{os.urandom(4).hex()}"
        under_way: dict[Any, Handed] = {}

        def start(rows: range) -> Any:
            return compute.remote(key, head, ray.put(remote.share(work.ready, rows)), cores)

        def deliver(finished: Any) -> None:
            try:
                work.deliver(finished)
            except BaseException as error:
                attempts.stop(error)
                raise
            progress.ticks(len(finished.rows) * work.ready.program.ticks)
            attempts.delivered()

        with interruption.held_back(), BackgroundQueue(WRITERS) as queue:
            try:
                while _fill(attempts, under_way, 2 * seats, start):
                    interruption.point()
                    done, _ = ray.wait(list(under_way), num_returns=1, timeout=1.0)
                    for task in done:
                        chunk = under_way.pop(task)
                        try:
                            compile_s, finished = ray.get(task)
                        except ray.exceptions.RayError as error:
                            refused = getattr(error, "cause", None)
                            if isinstance(refused, UserError):
                                raise refused from None
                            attempts.failed(chunk.rows, _cause(error))
                        else:
                            progress.began(compile_s)
                            queue.call(deliver, finished)
                    if not done and attempts.stopped:
                        break
                queue.finish()
            except BaseException as error:
                attempts.stop(error)
                for task in under_way:
                    ray.cancel(task, force=True)
                raise
        attempts.conclude()


def _fill(
    attempts: Attempts, under_way: dict[Any, Handed], most: int, start: Callable[[range], Any]
) -> bool:
    """Start what there is room for; whether anything is under way."""
    while len(under_way) < most and not any(chunk.alone for chunk in under_way.values()):
        chunk = attempts.take(idle=not under_way)
        if chunk is None:
            break
        under_way[start(chunk.rows)] = chunk
    return bool(under_way)


def _join(ray: Any, address: str | None) -> None:
    """Join the cluster of that address, or begin one here. Raises UserError where nobody
    answers.
    """
    terminated = signal.getsignal(signal.SIGTERM)
    try:
        if address is not None and (match := re.fullmatch(r"\[?([^/]+?)\]?:(\d+)", address)):
            socket.create_connection(
                (match[1], int(match[2])), ANSWER_S
            ).close()  # Ray itself would ask for minutes
        ray.init(
            address=address, include_dashboard=False, log_to_driver=False, logging_level="error"
        )
    except OSError as error:  # a ConnectionError, which Ray raises, is one
        raise UserError(
            f"--ray-address {address}: no Ray cluster answers there ({error})"
        ) from error
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, terminated)  # Ray has put its own in its place


def environment(engine: str) -> dict[str, str]:
    """Environment of a task of this engine: the coordinator's, and no GPU for JAX where it would
    only take memory.
    """
    variables = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return {"JAX_PLATFORMS": "cpu"} | variables if engine == "simd" else variables


def _compute(key: str, head: remote.Head, share: remote.Share, cores: int) -> tuple[float, Any]:
    """The task: (s of compiling, Finished)."""
    progress = Progress("", 0, 0, 1, None)
    if key not in _benches:
        _benches.clear()  # of another campaign
        _benches[key] = remote.Bench(head, progress, cores)
    bench = _benches[key]
    return progress.compile_s, bench.finish(*bench.compute(share))


def _seats(
    resources: dict[str, float], nodes: Sequence[dict[str, Any]], workers: int | None, gpu: bool
) -> tuple[int, int]:
    """(cores of a task, tasks side by side)."""
    if gpu:
        seats = int(resources.get("GPU", 0))
        return max(1, int(resources.get("CPU", 1)) // max(1, workers or seats)), workers or max(
            1, seats
        )
    largest = max(
        (int(node["Resources"].get("CPU", 0)) for node in nodes if node["Alive"]), default=1
    )
    total = int(resources.get("CPU", 1))
    cores = max(1, min(largest, CORES if workers is None else total // workers))
    return cores, workers or max(1, total // cores)


def _cause(error: Exception) -> str:
    """Why a task failed, in one line."""
    cause = getattr(error, "cause", None) or error
    return f"{type(cause).__name__}: {cause}".strip().splitlines()[0][:300]


def _import() -> Any:
    try:
        import ray
    except ImportError as error:
        raise UserError(
            "--executor ray needs the package ray: pip install 'ravenjax[ray]'"
        ) from error
    return ray

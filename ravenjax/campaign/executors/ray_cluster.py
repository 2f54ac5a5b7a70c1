"""Computes the chunks of a campaign on a Ray cluster (`pip install 'ravenjax[ray]'`). A chunk is a
range of runs. Each worker process receives the campaign's compiled-code settings once (`Head`). For
each chunk it then receives the inputs of its runs, about 100 B per run. It returns the finished
Parquet file as bytes through Ray's object store. Therefore the cluster needs no shared file system,
and a task that Ray runs twice has no side effects. The machine on which the command runs sends and
receives about 200 B per run, in total.

Ray repeats a task whose worker or node died or does not answer. A worker whose chunk takes very
long is replaced as well. If a chunk still fails, the executor delivers all others and then reports
the failed chunk. The same command, started again, computes only this chunk.
"""

import dataclasses
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax import consent, interruption
from ravenjax.campaign import compile_cache, memory_windows
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.executors import protocol
from ravenjax.campaign.executors.protocol import FinishedChunk, Pack, Work
from ravenjax.campaign.memory_windows import PartRows
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import Progress
from ravenjax.engines import selection
from ravenjax.engines.interface import Engine
from ravenjax.errors import UserError, list_lines
from ravenjax.store import manifest

RETRIES = 3
"""How often Ray repeats a task whose worker or node died."""
CORES = 4
"""Cores of a task, if the user gives no number of tasks and a node has so many."""
WRITERS = 4
"""Largest number of files that are written in parallel."""
MAX_CHUNK_S = 600.0
"""Longest time to wait for a chunk before its worker is replaced, s. It doubles each time."""
SLOW_S, SLOW_FACTOR = 60.0, 10.0
"""After the first chunk this time is SLOW_FACTOR times that of the slowest, at least SLOW_S, s."""
ANSWER_S = 10.0
"""Time in which a cluster must answer, s."""
_PASSED_ON = ("XLA_FLAGS", "JAX_PLATFORMS", "JAX_ENABLE_X64", "RAVENJAX_CACHE")
"""Environment variables that affect results or speed. Each task gets the user's values."""

_workers: "dict[str, Worker]" = {}
"""In a Ray worker process: the compiled Worker of the current campaign, by key."""


class Head(NamedTuple):
    """The settings that all chunks of a campaign share."""

    plan: Plan  # without rows
    engine: str
    pack: Pack
    largest_chunk: int  # largest number of rows of a chunk
    cores: int  # number of cores of a task
    computed_by: dict[str, str]  # code, device and versions of the coordinator


def make_head(work: Work, chunks: Sequence[range], cores: int) -> Head:
    """Return the settings for these chunks. cores: number of cores of a task."""
    # The plan has no rows here: each task receives those of its chunk.
    return Head(
        plan=work.plan.take(slice(0)),
        engine=work.engine.name,
        pack=work.pack,
        largest_chunk=max(map(len, chunks)),
        cores=cores,
        computed_by=_computed_by(work.plan, work.engine),
    )


def _computed_by(plan: Plan, engine: Engine) -> dict[str, str]:
    """Return code hash, kind of device, versions and settings, which determine results."""
    code = manifest.code_hash(plan.config.robot)[:16]
    # An engine names several devices as '2 x A'. Their kind must agree, not their number.
    kind = engine.device.partition(" x ")[2] or engine.device
    settings = manifest.package_versions() | compile_cache.engine_settings(engine.name)
    return {"code": code, "device": kind} | settings


class Worker:
    """Computes chunks of a campaign in a Ray worker process. The first chunk compiles the code."""

    def __init__(self, head: Head):
        """Raise UserError if this process has other code, device or versions than the user's."""
        self._head, self.progress = head, Progress("", 0, 0, 1)
        self._engine = compile_cache.cached_engine(head.engine, head.plan.program.setup.precision)
        _require_same(_computed_by(head.plan, self._engine), head.computed_by)
        self._computation: Computation | None = None

    def compute(self, rows: Mapping[str, Any]) -> tuple[Plan, PartRows]:
        """Compute a chunk. rows: the `Plan` fields of its runs. Return its plan and outcomes."""
        head, plan = self._head, dataclasses.replace(self._head.plan, **rows)
        if self._computation is None:
            self._computation = Computation(
                plan, self._engine, self.progress, runs=head.largest_chunk, threads=head.cores
            )
        ranges = [range(plan.runs)]
        blocks = self._computation.of(plan).blocks(ranges)
        # The only range gives one part.
        return plan, next(memory_windows.assemble_parts(ranges, blocks))


def _require_same(worker: dict[str, str], coordinator: dict[str, str]):
    # Results must not depend on the machine, so other versions or devices are refused.
    different = [
        f"{name}: {worker.get(name)} on the worker,"
        f" {coordinator.get(name)} on the machine of the command"
        for name, _, _ in manifest.find_changes(worker, coordinator)
    ]
    if different:
        raise UserError(
            f"the worker on {socket.gethostname()} would compute other results:"
            f" {'; '.join(different)}. Install the same versions on all machines, and use one kind"
            " of device for a campaign."
        )


def _compute(key: str, head: Head, rows: Mapping[str, Any]) -> tuple[float, FinishedChunk]:
    # Computes one chunk in a Ray task. Returns (time of compilation in s, the finished chunk). key:
    # identifies the campaign, whose compiled code the worker process keeps for further chunks.
    if key not in _workers:
        # The worker of an earlier campaign is not needed any more.
        _workers.clear()
        _workers[key] = Worker(head)
    worker = _workers[key]
    finished = protocol.finish_chunk(*worker.compute(rows), head.pack)
    return worker.progress.status.compile_s, finished


class Ray:
    """Computes chunks on a Ray cluster; see `protocol.Executor`."""

    def __init__(self, workers: int | None = None, address: str | None = None):
        """address: of a running cluster; None: start a cluster. Raises UserError without Ray."""
        self.workers, self._address = workers, address
        _import_ray()

    def run(self, work: Work, chunks: Sequence[range]) -> None:
        """Compute and deliver every chunk, as `protocol.Executor.run` describes."""
        ray = _import_ray()
        # A program may have joined a cluster before, and then stays in it.
        joins_here = not ray.is_initialized()
        if joins_here:
            _join_cluster(ray, self._address)
        try:
            self._run(ray, work, chunks)
        finally:
            if joins_here:
                ray.shutdown()

    def _run(self, ray, work: Work, chunks: Sequence[range]):
        progress, properties = work.progress, selection.engine_properties(work.engine.name)
        gpu = properties.needs_gpu
        cores, tasks = _cores_and_tasks(ray.cluster_resources(), ray.nodes(), self.workers, gpu)
        progress.status.workers = tasks
        progress.tell("compile")
        head = ray.put(make_head(work, chunks, cores))
        first_node = ray.get_runtime_context().gcs_address
        compute = ray.remote(
            num_cpus=cores,
            num_gpus=int(gpu),
            max_retries=RETRIES,
            runtime_env={
                "env_vars": task_environment(keeps_off_gpus=properties.portable and not gpu)
            },
        )(_compute)
        key = f"{os.getpid()}-{id(work)}-{os.urandom(4).hex()}"
        waiting, pending = list(reversed(chunks)), dict[Any, tuple[range, float]]()
        lost: dict[range, str] = {}
        delivered, patience, longest_s, asked_at = 0, 1, 0.0, time.monotonic()

        def deliver(finished: FinishedChunk):
            work.deliver(finished)
            progress.ticks(len(finished.rows) * work.plan.program.ticks)

        with interruption.delay_signals(), protocol.BackgroundQueue(WRITERS) as queue:
            try:
                while waiting or pending:
                    interruption.check_interruption()
                    while waiting and len(pending) < 2 * tasks:
                        rows = waiting.pop()
                        share = ray.put(work.plan.row_fields(slice(rows.start, rows.stop)))
                        pending[compute.remote(key, head, share)] = rows, time.monotonic()
                    done, _ = ray.wait(list(pending), num_returns=1, timeout=1.0)
                    now = time.monotonic()
                    if not done or now - asked_at > ANSWER_S:
                        _require_answer(first_node)
                        asked_at = now
                    for task in done:
                        longest_s = max(longest_s, now - pending[task][1])
                    usual_s = max(SLOW_S, SLOW_FACTOR * longest_s) if delivered else MAX_CHUNK_S
                    limit_s = patience * min(MAX_CHUNK_S, usual_s)
                    slow = {task for task in pending if now - pending[task][1] > limit_s}
                    patience *= 2 if slow.difference(done) else 1
                    # Ray repeats tasks whose process died, but not tasks that hang.
                    for task in slow.difference(done):
                        ray.cancel(task, force=True)
                        waiting.append(pending.pop(task)[0])
                        progress.note(f"no result for {limit_s:g} s, so a worker was replaced")
                    for task in done:
                        rows, _ = pending.pop(task)
                        try:
                            compile_s, finished = ray.get(task)
                        except ray.exceptions.RayError as error:
                            cause = getattr(error, "cause", None) or error
                            if isinstance(cause, UserError):
                                raise cause from None
                            text = f"{type(cause).__name__}: {cause}".strip()
                            reason = text.splitlines()[0][:300]
                            lost[rows] = reason
                            progress.count_failures({reason: len(rows)})
                            progress.note(f"rows {rows.start} to {rows.stop - 1}: {reason}")
                        else:
                            progress.began(compile_s)
                            queue.call(deliver, finished)
                            delivered += 1
                    if len(lost) > tasks and not delivered:
                        # All tasks fail, so the cause is not a single chunk.
                        raise _chunk_error(lost, delivered)
                queue.finish()
            except BaseException:
                for task in pending:
                    ray.cancel(task, force=True)
                raise
        if lost:
            raise _chunk_error(lost, delivered)


def _require_answer(address: str):
    """Raise UserError if the cluster's first machine does not answer."""
    host, _, port = address.rpartition(":")
    # Ray itself would end this process a minute later, without a message about the results.
    try:
        socket.create_connection((host, int(port)), ANSWER_S).close()
    except OSError as error:
        raise UserError(
            f"the Ray cluster at {address} has ended ({error}). Finished results are kept. Start"
            " the cluster again; the same command then continues"
        ) from None


def _chunk_error(lost: Mapping[range, str], delivered: int) -> UserError:
    # Returns one error about all chunks that failed on the cluster. lost: rows of a failed chunk ->
    # reason. delivered: number of finished chunks.
    lines = [
        f"rows {rows.start} to {rows.stop - 1}: {reason}"
        for rows, reason in sorted(lost.items(), key=lambda item: item[0].start)
    ]
    rest = "all other chunks are finished and kept" if delivered else "no chunk was finished"
    return UserError(
        f"{len(lost)} chunk(s) of runs failed; {rest}:\n{list_lines(lines)}\nThe same command tries"
        " only these again. With --executor local it prints the original error."
    )


def _join_cluster(ray, address: str | None):
    # Joins the cluster at this address; None: starts a cluster on this machine. Raises UserError if
    # the address does not answer, or if Ray cannot start.
    sigterm_handler = signal.getsignal(signal.SIGTERM)
    try:
        # HOST:PORT or [IPV6]:PORT is tried first, because Ray itself would retry for minutes.
        if address is not None and (match := re.fullmatch(r"\[?([^/]+?)\]?:(\d+)", address)):
            socket.create_connection((match[1], int(match[2])), ANSWER_S).close()
        ray.init(address, include_dashboard=False, log_to_driver=False, logging_level="error")
    # Also catches ConnectionError, which Ray raises: it is a subclass of OSError.
    except OSError as error:
        message = "Ray cannot start on this machine"
        if address is not None:
            message = f"--ray-address {address}: no Ray cluster answers there"
        raise UserError(f"{message} ({error})") from error
    if threading.current_thread() is threading.main_thread():
        # Ray replaced the handler of SIGTERM, so the earlier handler is restored.
        signal.signal(signal.SIGTERM, sigterm_handler)


def task_environment(keeps_off_gpus: bool) -> dict[str, str]:
    """Return the environment variables of a task. keeps_off_gpus: JAX uses the CPU by default."""
    variables = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    # The user has already agreed to the campaign's Python code.
    variables[consent.VARIABLE] = "1"
    return {"JAX_PLATFORMS": "cpu"} | variables if keeps_off_gpus else variables


def _cores_and_tasks(
    resources: dict[str, float], nodes: Sequence[dict[str, Any]], workers: int | None, gpu: bool
) -> tuple[int, int]:
    # Returns the cores of each task, and the number of tasks that run at the same time. resources,
    # nodes: those of the cluster, as Ray reports them. workers: requested number of tasks; None:
    # as many as fit. gpu: each task uses one GPU.
    total = int(resources.get("CPU", 1))
    if gpu:
        tasks = workers or max(1, int(resources.get("GPU", 0)))
        return max(1, total // tasks), tasks
    # A task cannot use cores of two nodes.
    node_cores = [int(node["Resources"].get("CPU", 0)) for node in nodes if node["Alive"]]
    wanted = CORES if workers is None else total // workers
    cores = max(1, min(max(node_cores, default=1), wanted))
    return cores, workers or max(1, total // cores)


def _import_ray() -> Any:
    # Ray is an optional dependency, so it is imported only when a campaign uses it.
    try:
        import ray
    except ImportError as error:
        raise UserError("--executor ray needs package ray: pip install 'ravenjax[ray]'") from error
    return ray

"""Commands about this machine: `bench`, `doctor`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Listing

PartName = Literal[
    "engines",
    "shell",
    "cores",
    "devices",
    "fault_times",
    "campaigns",
    "software",
    "operations",
    "peak",
    "peers",
]
"""As `ravenjax.bench.parts.NAMES`, which is slow to import."""


def bench(
    *,
    json: Annotated[bool, Parameter(negative="", help="print every number as JSON")] = False,
    quick: Annotated[
        bool, Parameter(negative="", help="half a minute instead of minutes: the shorter parts")
    ] = False,
    markdown: Annotated[Path | None, Parameter(help="also write the tables to this file")] = None,
    only: Annotated[
        list[PartName] | None,
        Parameter(consume_multiple=True, negative="", help="these parts alone"),
    ] = None,
    seconds: Annotated[
        float | None,
        Parameter(help="how long it may take, about; default: 160, and 35 of a quick run"),
    ] = None,
    beside: Annotated[
        Path | None,
        Parameter(
            help=(
                "folder of another checkout: take turns with it, commands and campaigns alone, any"
                " commit"
            )
        ),
    ] = None,
) -> int:
    """Measure this machine: engines beside MuJoCo and MJX, commands from the shell, cores, GPUs,
    faults by their time.

    Each part runs in a process of its own, and what it shows is also said in sentences. What no
    longer fits into the time is left out and named. Exit code 1: nothing could be measured.
    """
    from ravenjax.bench import effort
    from ravenjax.errors import UserError

    if markdown is not None and not markdown.absolute().parent.is_dir():
        raise UserError(
            f"--markdown {markdown}: the folder does not exist, expected a file in a folder that"
            " does"
        )
    if seconds is not None and not effort.LEAST_S <= seconds <= effort.LONGEST_S:
        raise UserError(
            f"--seconds {seconds:g}: expected {effort.LEAST_S:g} to {effort.LONGEST_S:g}"
        )
    if beside is not None and (only or quick):
        raise UserError(
            "--beside measures commands and campaigns of both: leave out --only and --quick"
        )
    total = seconds or (effort.QUICK_S if quick else effort.FULL_S)
    words = [f"--only {' '.join(only)}"] if only else []
    words += ["--quick"] * quick + ([f"--seconds {seconds:g}"] if seconds is not None else [])

    def tell(what: str) -> None:
        console.err.print(f"measuring: {what}", markup=False, highlight=False, soft_wrap=True)

    if beside is not None:
        return _beside(beside, total, tell, json, markdown)
    from ravenjax.bench import findings, suite, tables

    results = suite.measure(total, quick, only or (), tell)
    if markdown is not None:
        markdown.write_text(
            tables.markdown(results, " ".join(["ravenjax bench", *words, "--markdown FILE"]))
        )
    lines = findings.sentences(results)
    if json:
        console.emit_json(results.as_json() | {"sentences": lines})
    else:
        _show(tables.tables(results), lines)
    return int(results.is_empty)


def _beside(
    folder: Path, total: float, tell: Callable[[str], None], json: bool, markdown: Path | None
) -> int:
    from ravenjax.bench import beside, tables
    from ravenjax.errors import UserError

    try:
        results = beside.measure(folder, total, tell)
    except RuntimeError as error:
        raise UserError(f"--beside {folder}: {error}") from None
    if markdown is not None:
        title = "Two checkouts beside each other"
        command = "ravenjax bench --beside FOLDER --markdown FILE"
        markdown.write_text(tables.page(title, command, results.sentences(), "", [results.table()]))
    if json:
        console.emit_json(results.as_json())
    else:
        _show([results.table()], results.sentences())
    return 0


def _show(
    tables: Iterable[tuple[str, tuple[str, ...], list[tuple[str, ...]]]], lines: Sequence[str]
) -> None:
    """Tables, and sentences below them."""
    from ravenjax.cli import terminal

    for title, columns, rows in tables:
        console.out.print(terminal.table(title, columns, rows))
        console.out.print()
    for line in lines:
        console.say(f"- {line}")


def doctor(
    *,
    realtime: Annotated[
        bool, Parameter(negative="", help="measure how well a session keeps time instead")
    ] = False,
    seconds: Annotated[
        float, Parameter(help="of each of the five loops that --realtime measures")
    ] = 60.0,
    as_json: AsJson = False,
) -> int:
    """Check this machine: versions, devices, CPU, memory, and that each part works."""
    from ravenjax.cli import terminal

    if realtime:
        return _keeps_time(seconds, as_json)
    from ravenjax.robots.raven2.console.packet import UDP_PORT

    about = Listing("machine", "This machine", ("what", "is"), list(terminal.machine()))
    if not as_json:
        console.emit([about], as_json)
        console.out.print()
    tests: dict[str, Callable[[], str]] = {
        "jax computes": _jax_computes,
        "engine auto": _engine_chosen,
        "robot model": _model_loads,
        "campaigns": _campaigns_load,
        "results": _results_writable,
        "console port": lambda: terminal.udp_port(UDP_PORT),
    }
    works = Listing(
        "works", "What works", ("what", "state", "detail"), list(terminal.checks(tests))
    )
    console.emit([about, works] if as_json else [works], as_json)
    return int(any(state != "ok" for _, state, _ in works.rows))


def _keeps_time(seconds: float, as_json: bool) -> int:
    from ravenjax.train import timing

    measured = timing.measure(seconds, lambda what: console.err.print(what, highlight=False))
    loops = Listing(
        "loops", "One tick a millisecond", timing.COLUMNS, [one.row() for one in measured]
    )
    states = timing.verdict(measured)
    if as_json:
        console.emit([loops, Listing("verdict", "", ("state", "sentence"), list(states))], as_json)
    else:
        console.emit([loops], as_json)
        for state, sentence in states:
            console.say(f"{state}: {sentence}")
    return int(any(state != "ok" for state, _ in states))


def _jax_computes() -> str:
    import jax
    import jax.numpy as jnp

    total = float(jax.jit(lambda x: (x * x).sum())(jnp.arange(4.0)))
    if total != 14.0:
        raise ArithmeticError(f"0 + 1 + 4 + 9 came out as {total}")
    return ", ".join(
        f"{device.platform}:{device.id} {device.device_kind}" for device in jax.devices()
    )


def _engine_chosen() -> str:
    from ravenjax.engines import selection
    from ravenjax.numbers.setup import CAMPAIGN

    name, why = selection.fastest(CAMPAIGN)
    return f"{name} on {selection.select(name, CAMPAIGN).device}" + (f"; {why}" if why else "")


def _model_loads() -> str:
    import mujoco

    from ravenjax.bundled import resources

    path = resources.model("raven2/raven2.xml")
    model = mujoco.MjModel.from_xml_path(str(path))  # pyright: ignore[reportAttributeAccessIssue]
    return f"{path}, {model.njnt} joints"


def _campaigns_load() -> str:
    from ravenjax.bundled import resources
    from ravenjax.campaign import loading

    files = resources.bundled("campaigns", "*.toml")
    for path in files:
        loading.load(path)
    return f"{len(files)} bundled campaigns are valid"


def _results_writable() -> str:
    import tempfile

    with tempfile.TemporaryDirectory(dir=Path.cwd()):
        return f"{Path.cwd()} can be written to"

"""Commands about this machine: `bench`, `doctor`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, get_args

from cyclopts import Parameter

from ravenjax.cli import console
from ravenjax.cli.console import AsJson, Listing

TableName = Literal["engines", "shell", "cores", "devices", "fault_times", "campaigns", "peers"]


def bench(
    *,
    json: Annotated[bool, Parameter(negative="", help="print every number as JSON")] = False,
    quick: Annotated[
        bool, Parameter(negative="", help="half a minute instead of minutes: the shorter parts")
    ] = False,
    markdown: Annotated[Path | None, Parameter(help="also write the tables to this file")] = None,
    only: Annotated[
        list[TableName] | None,
        Parameter(consume_multiple=True, negative="", help="these parts alone"),
    ] = None,
    seconds: Annotated[
        float | None,
        Parameter(help="how long it may take, about; default: 160, and 35 of a quick run"),
    ] = None,
) -> int:
    """Measure the speed of this machine, and compare it with MuJoCo and MJX.

    Each part runs in its own process. Parts that do not fit into the time are named and left
    out. The exit code is 1 if nothing could be measured.
    """
    from ravenjax.cli import checkout, terminal
    from ravenjax.errors import UserError

    suite = checkout.load_module("bench.suite")
    if markdown is not None and not markdown.absolute().parent.is_dir():
        raise UserError(
            f"--markdown {markdown}: the folder does not exist, expected a file in a folder that"
            " does"
        )
    if seconds is not None and not suite.LEAST_S <= seconds <= suite.LONGEST_S:
        raise UserError(f"--seconds {seconds:g}: expected {suite.LEAST_S:g} to {suite.LONGEST_S:g}")

    def tell(what: str) -> None:
        console.err.print(f"measuring: {what}", markup=False, highlight=False, soft_wrap=True)

    total_s = seconds or (suite.QUICK_S if quick else suite.FULL_S)
    found = suite.measure(total_s, quick, only or (), tell)
    every = suite.make_tables(found)
    if markdown is not None:
        words = [f"--only {' '.join(only)}"] if only else []
        words += ["--quick"] * quick + ([f"--seconds {seconds:g}"] if seconds is not None else [])
        command = " ".join(["ravenjax bench", *words, "--markdown FILE"])
        markdown.write_text(suite.write_markdown("How fast the engines are", command, every))
    if json:
        console.emit_json(found)
    else:
        for title, columns, rows in every:
            console.out.print(terminal.table(title, columns, rows))
            console.out.print()
    return int(not any(name in found for name in get_args(TableName)))


def doctor(
    *,
    realtime: Annotated[
        bool, Parameter(negative="", help="measure how well a session keeps time instead")
    ] = False,
    seconds: Annotated[
        float, Parameter(help="of each of the four loops that --realtime measures")
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
